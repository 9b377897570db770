"""One way to get a robot: a known name, a URDF or MJCF, another library's model, or joint screws."""

from __future__ import annotations

import difflib
import warnings
from collections.abc import Sequence
from importlib import metadata
from math import inf
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, MissingExtra, RobotModelError, UnknownName, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.screws import angular_speeds
from invariantqp.robots.chain import Chain
from invariantqp.robots.compose import stand_on
from invariantqp.robots.description import is_text, read_xml, require_robot
from invariantqp.robots.kinematics import question_pose, question_range
from invariantqp.robots.published import PUBLISHED, published
from invariantqp.robots.tree import chain_to_link
from invariantqp.robots.urdf import disabled, joint_of_yourdfpy, joints_of, parts_of

DATA = "example-robot-data"
SOURCES = (
    "a robot's name, the path or the text of a URDF or MJCF, a model of Pinocchio, MuJoCo or yourdfpy, or (6, m) joint "
    "screws"
)


class Known(NamedTuple):
    """Where a named robot's URDF is in example-robot-data, its tool frame, its joints, None for all, and its SRDF."""

    urdf: str
    tool: str
    joints: tuple[str, ...] | None = None
    srdf: str = ""


IN_DATA = {
    "panda": Known("panda_description/urdf/panda.urdf", "panda_hand_tcp", srdf="panda_description/srdf/panda.srdf"),
    "ur3": Known("ur_description/urdf/ur3_robot.urdf", "tool0"),
    "ur5": Known("ur_description/urdf/ur5_robot.urdf", "tool0", srdf="ur_description/srdf/ur5.srdf"),
    "ur10": Known("ur_description/urdf/ur10_robot.urdf", "tool0"),
    "xarm7": Known("xarm_description/urdf/xarm7.urdf", "link_eef", srdf="xarm_description/srdf/xarm7.srdf"),
    "so100": Known("so_arm_description/urdf/so100.urdf", "gripper"),
    "so101": Known("so_arm_description/urdf/so101.urdf", "gripper_frame_link"),
    "kinova": Known("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
    "z1": Known("z1_description/urdf/z1.urdf", "gripperStator"),
    "tiago": Known("tiago_description/robots/tiago.urdf", "arm_tool_link"),
    "talos": Known(
        "talos_data/robots/talos_reduced.urdf",
        "gripper_left_base_link",
        tuple(f"arm_left_{i}_joint" for i in range(1, 8)),
        "talos_data/srdf/talos.srdf",
    ),
}
KNOWN = (*IN_DATA, *PUBLISHED)


def load_robot(
    source: str | PathLike[str] | ArrayLike | Any,
    tool: str | ArrayLike | None = None,
    joints: Sequence[str] | None = None,
    offset: ArrayLike | None = None,
    base: Chain | ArrayLike | None = None,
    velocity_limit: ArrayLike | None = None,
) -> Chain:
    """An arm from its base to its tool; nothing beyond is modelled.

    Args:
        source: a name ("panda", "ur5", "so101", "xarm7", "kinova", "talos" for its left arm, ... come with the extra
            `robots`; "ur5e", "fr3", "iiwa14", "gen3", "lite6", ... need nothing; the base of a UR's e-Series is the
            maker's, half a turn about z from "ur5" and from ROS's `base_link`), the path of a URDF file, the text of
            one (a `robot_description`), the path or text of an MJCF (extra `sim`), a `pinocchio.Model`, a
            `mujoco.MjModel`, a `yourdfpy.URDF`, or (6, m) joint screws at q = 0 in the base frame.
        tool: name of the tool frame: a link, or of MuJoCo a site or a body; None is the robot's usual one, for a URDF
            or a model the link that the last joint of its longest chain moves, or the last link before a hand, whose
            fingers are held. With screws: the (4, 4) tool pose at q = 0.
        joints: names of the joints that move; None is all between base and tool. The rest are held at zero, or at the
            limit nearest to it. A joint that mimics one that moves moves with it. With screws: their names.
        offset: (4, 4) pose in that frame of what is to be moved: a tool, a camera, a grasped object; None is the frame.
        base: what the arm stands on: a (4, 4) pose of its base, or a chain whose joints then come first, a
            `robots.rail`, a `robots.mobile_base` or another arm; None is the arm's own base frame.
        velocity_limit: (m,) speeds of the arm's own joints, or one for all of them [rad/s, length/s], inf for no limit;
            None is the source's.

    Returns:
        A `Chain`, which has all of `Robot`: .names, .position_lower, .position_upper, .velocity_limit, .pose(q),
        .jacobian(q), .with_tool(offset); besides .with_limits(...), .tool, .links. It can be used in several threads at
        once, pickled and copied.

    Raises:
        UnknownName: no robot, frame or joint of that name; near ones are listed.
        RobotModelError: a URDF that cannot be read or parsed, a joint without a single coordinate, a tool that no joint
            moves.
        MissingExtra: a named robot without the extra `robots`.

    Warns:
        UserWarning: a description without speeds for joints, or with zero for them: those have no velocity limit; with
            equal position limits, or none where they are needed: those joints cannot move. One whose joints turn more
            than two turns away from zero, as in degrees. An offset or a base that is thirty times as far away as the
            arm is long, as one in millimetres is.
    """
    arm = read_arm(source, tool, None if joints is None else arrays.strings(joints, "joints"))
    if velocity_limit is not None:
        arm = arm.with_limits(velocity_limit=velocity_limit)
    elif not is_screws(source) and np.isinf(arm.velocity_limit).any():
        unlimited = [name for name, v in zip(arm.names, arm.velocity_limit.tolist(), strict=True) if v == inf]
        warnings.warn(
            f"no velocity limit for {arrays.names(unlimited)}: the description gives none, or zero. Say "
            "load_robot(..., velocity_limit=[...]) [rad/s, length/s]; inf is none",
            UserWarning,
            stacklevel=2,
        )
    question_still(arm)
    question_range(arm.position_lower, arm.position_upper, angular_speeds(arm.screws) > 0.0, "the description's limits")
    for argument, given in (("offset", offset), ("base", base)):
        if given is not None and not isinstance(given, Chain):
            question_pose(arm, argument, arrays.pose(given, argument))
    arm = arm if offset is None else arm.with_tool(offset)
    return arm if base is None else stand_on(base, arm)


def question_still(arm: Chain) -> None:
    """Warn of joints whose limits leave no way, as CAD exporters write them."""
    still = [
        name for name, low, high in zip(arm.names, arm.position_lower, arm.position_upper, strict=True) if low == high
    ]
    if still:
        warnings.warn(
            f"{arrays.names(still)} cannot move: the description gives equal position limits, or none, which are 0. "
            "Say robot.with_limits(position_lower=[...], position_upper=[...]), or hold them still: "
            "load_robot(..., joints=[...])",
            UserWarning,
            stacklevel=3,
        )


def is_screws(source: object) -> bool:
    """Whether a source is neither a name, a description nor a library's model: joint screws, or nothing of these."""
    return not isinstance(source, (str, PathLike)) and _library(source) is None


def read_arm(source: Any, tool: str | ArrayLike | None, chosen: tuple[str, ...] | None) -> Chain:
    """The arm of a source, as in `load_robot`."""
    if is_screws(source):
        return _chain(source, tool, chosen)
    if tool is not None and not isinstance(tool, str):
        raise BadInput("tool", type(tool).__name__, "the name of a frame", "Move the frame with robot.with_tool(pose).")
    if not isinstance(source, (str, PathLike)):
        return _of_library(source, tool, chosen)
    if isinstance(source, str) and is_text(source):
        return _described(source, tool, chosen)
    if str(source) in PUBLISHED:
        return chain_to_link(published(str(source)), str(source), tool or "tool0", chosen)
    known = IN_DATA.get(str(source))
    if known is not None and tool is None:
        tool, chosen = known.tool, known.joints if chosen is None else chosen
    return _described(urdf_of(source), tool, chosen, known.srdf if known is not None else "")


def _described(source: Path | str, tool: str | None, joints: Sequence[str] | None, srdf: str = "") -> Chain:
    """The arm of a description in XML, and of an SRDF in example-robot-data."""
    name, root = read_xml(source)
    if root.tag == "mujoco":
        require_robot(name, root)
        from invariantqp.robots.mujoco import load_mujoco, read_mjcf

        return load_mujoco(read_mjcf(source), tool, joints)
    joints_in_file = joints_of(name, root)
    parts = parts_of(name, root, source.resolve().parent if isinstance(source, Path) else None)
    apart = disabled(_data_folder() / srdf) if srdf else None
    return chain_to_link(joints_in_file, name, tool, joints, parts, apart)


def _library(source: object) -> str | None:
    """The library that a model is of, recognised without importing any."""
    if isinstance(source, type):
        return None
    marks = {"pinocchio": "createData", "mujoco": "jnt_qposadr", "yourdfpy": "link_map"}
    return next((library for library, name in marks.items() if hasattr(source, name)), None)


def _of_library(model: Any, tool: str | None, joints: Sequence[str] | None) -> Chain:
    """The arm of another library's model; that library is imported only now."""
    if (library := _library(model)) == "pinocchio":
        from invariantqp.robots.models import load_model

        return load_model(model, tool, joints)
    if library == "mujoco":
        from invariantqp.robots.mujoco import load_mujoco

        return load_mujoco(model, tool, joints)
    return chain_to_link(list(map(joint_of_yourdfpy, model.robot.joints)), "the yourdfpy model", tool, joints)


def _chain(screws: ArrayLike, home: str | ArrayLike | None, names: tuple[str, ...] | None) -> Chain:
    """The arm of joint screws."""
    if hasattr(screws, "model"):
        raise BadInput("source", excerpt(screws), SOURCES, "Pass its .model.")
    numbers = arrays.array(screws, "source", SOURCES)
    if numbers.ndim == 0:
        raise BadInput("source", excerpt(screws), SOURCES)
    columns = arrays.columns(numbers, "source")
    if home is None or isinstance(home, str):
        raise BadInput("tool", excerpt(home), "the (4, 4) tool pose at q = 0 when the source is joint screws")
    return Chain(columns, arrays.pose(home, "tool"), names or ())


def urdf_of(source: str | PathLike[str]) -> Path:
    """The URDF file of a known name or a path."""
    known = IN_DATA.get(str(source))
    if known is not None:
        return _data_folder() / known.urdf
    if str(source) in PUBLISHED:
        raise RobotModelError(f"{source}: known by its joints alone; give the path of its URDF where masses are needed")
    path = Path(source)
    try:
        if path.is_file():
            return path
        is_path = bool(path.parts) and (bool(path.suffix) or len(path.parts) != 1 or path.exists())
    except OSError:  # a name that no file can have
        is_path = False
    if is_path:
        folder = f"{path} is a folder; expected the path of a URDF or MJCF file"
        raise RobotModelError(folder if path.is_dir() else f"no file at {path}")
    near = difflib.get_close_matches(str(source).lower(), KNOWN)
    raise UnknownName("robot", str(source), near, [*KNOWN, "or the path of a URDF or MJCF file"])


def _data_folder() -> Path:
    try:
        distribution = metadata.distribution(DATA)
    except metadata.PackageNotFoundError:
        raise MissingExtra(DATA, "robots") from None
    return Path(str(distribution.locate_file("cmeel.prefix/share/example-robot-data/robots")))
