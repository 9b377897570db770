"""`load_robot`: a `Chain` from a known name, a URDF or MJCF, a model of another library, or joint screws."""

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
from invariantqp.robots.kinematics import warn_if_implausible_pose, warn_if_implausible_range
from invariantqp.robots.published import PUBLISHED, published
from invariantqp.robots.tree import chain_to_link
from invariantqp.robots.urdf import collision_geometry, joint_of_yourdfpy, joints_of, srdf_exclusions

DATA = "example-robot-data"
SOURCES = (
    "a robot's name, the path or the text of a URDF or MJCF, a model of Pinocchio, MuJoCo or yourdfpy, or (6, m) joint "
    "screws"
)


class KnownRobot(NamedTuple):
    """A named robot of example-robot-data: URDF file, tool frame, joints (None: all), SRDF file."""

    urdf: str
    tool: str
    joints: tuple[str, ...] | None = None
    srdf: str = ""


EXAMPLE_ROBOTS = {
    "panda": KnownRobot(
        "panda_description/urdf/panda.urdf", "panda_hand_tcp", srdf="panda_description/srdf/panda.srdf"
    ),
    "ur3": KnownRobot("ur_description/urdf/ur3_robot.urdf", "tool0"),
    "ur5": KnownRobot("ur_description/urdf/ur5_robot.urdf", "tool0", srdf="ur_description/srdf/ur5.srdf"),
    "ur10": KnownRobot("ur_description/urdf/ur10_robot.urdf", "tool0"),
    "xarm7": KnownRobot("xarm_description/urdf/xarm7.urdf", "link_eef", srdf="xarm_description/srdf/xarm7.srdf"),
    "so100": KnownRobot("so_arm_description/urdf/so100.urdf", "gripper"),
    "so101": KnownRobot("so_arm_description/urdf/so101.urdf", "gripper_frame_link"),
    "kinova": KnownRobot("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
    "z1": KnownRobot("z1_description/urdf/z1.urdf", "gripperStator"),
    "tiago": KnownRobot("tiago_description/robots/tiago.urdf", "arm_tool_link"),
    "talos": KnownRobot(
        "talos_data/robots/talos_reduced.urdf",
        "gripper_left_base_link",
        tuple(f"arm_left_{i}_joint" for i in range(1, 8)),
        "talos_data/srdf/talos.srdf",
    ),
}
KNOWN = (*EXAMPLE_ROBOTS, *PUBLISHED)


def load_robot(
    source: str | PathLike[str] | ArrayLike | Any,
    tool: str | ArrayLike | None = None,
    joints: Sequence[str] | None = None,
    offset: ArrayLike | None = None,
    base: Chain | ArrayLike | None = None,
    velocity_limit: ArrayLike | None = None,
) -> Chain:
    """The kinematic chain of an arm from its base to its tool.

    Args:
        source: a name, the path or text of a URDF or MJCF (extra `sim`), a `pinocchio.Model`, a `mujoco.MjModel`, a
            `yourdfpy.URDF`, or (6, m) joint screws at q = 0 in the base frame. The names "panda", "ur5", "so101",
            "xarm7", "kinova", "talos" (its left arm), ... need the extra `robots`; "ur5e", "fr3", "iiwa14", "gen3",
            "lite6", ... need nothing. The base frame of a UR e-Series arm is the maker's, turned by pi about z from
            that of "ur5" and from ROS's `base_link`.
        tool: name of the tool frame: a link, in MuJoCo a site or a body. None is the robot's usual one: the link that
            the last joint of the longest chain moves, or the last link before a hand. With screws: the (4, 4) tool
            pose at q = 0.
        joints: names of the joints that move; None is all between base and tool. The others are held at zero, or at the
            limit nearest to zero. A mimic joint moves with its driver. With screws: their names.
        offset: (4, 4) pose of the new tool frame in `tool`, such as a gripper's or a camera's; None is no offset.
        base: what the arm stands on: the (4, 4) pose of its base, or a chain whose joints come first, such as
            `robots.rail`, `robots.mobile_base` or another arm; None is the arm's own base frame.
        velocity_limit: (m,) for the arm's own joints, or one for all [rad/s, length/s], inf for no limit; None keeps
            those of the source.

    Returns:
        A `Chain`: .names, .position_lower, .position_upper, .velocity_limit, .pose(q), .jacobian(q), .tool, .links,
        .with_tool(offset), .with_limits(...). It can be shared by threads, pickled and copied.

    Raises:
        UnknownName: no robot, frame or joint of that name; similar names are listed.
        RobotModelError: a description that cannot be read, a joint without a single coordinate, a tool that no joint
            moves.
        MissingExtra: a named robot without the extra `robots`.

    Warns:
        UserWarning: joints without a velocity limit; joints with equal position limits, which cannot move; position
            limits beyond two turns, as in degrees; an offset or a base more than thirty arm lengths away, as in
            millimetres.
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
    _warn_of_fixed_joints(arm)
    warn_if_implausible_range(
        arm.position_lower, arm.position_upper, angular_speeds(arm.screws) > 0.0, "the description's limits"
    )
    for argument, given in (("offset", offset), ("base", base)):
        if given is not None and not isinstance(given, Chain):
            warn_if_implausible_pose(arm, argument, arrays.pose(given, argument))
    arm = arm if offset is None else arm.with_tool(offset)
    return arm if base is None else stand_on(base, arm)


def _warn_of_fixed_joints(arm: Chain) -> None:
    """Warn of joints with equal position limits, as CAD exporters write them."""
    fixed = [
        name for name, low, high in zip(arm.names, arm.position_lower, arm.position_upper, strict=True) if low == high
    ]
    if fixed:
        warnings.warn(
            f"{arrays.names(fixed)} cannot move: the description gives equal position limits, or none, which are 0. "
            "Say robot.with_limits(position_lower=[...], position_upper=[...]), or hold them still: "
            "load_robot(..., joints=[...])",
            UserWarning,
            stacklevel=3,
        )


def is_screws(source: object) -> bool:
    """Whether a source is neither text, nor a path, nor a library's model: joint screws, or nothing valid."""
    return not isinstance(source, (str, PathLike)) and _library(source) is None


def read_arm(source: Any, tool: str | ArrayLike | None, joints: tuple[str, ...] | None) -> Chain:
    """The arm of a source, as in `load_robot`."""
    if is_screws(source):
        return _from_screws(source, tool, joints)
    if tool is not None and not isinstance(tool, str):
        raise BadInput("tool", type(tool).__name__, "the name of a frame", "Move the frame with robot.with_tool(pose).")
    if not isinstance(source, (str, PathLike)):
        return _from_model(source, tool, joints)
    if isinstance(source, str) and is_text(source):
        return _from_description(source, tool, joints)
    if str(source) in PUBLISHED:
        return chain_to_link(published(str(source)), str(source), tool or "tool0", joints)
    example = EXAMPLE_ROBOTS.get(str(source))
    if example is not None and tool is None:
        tool = example.tool
        joints = example.joints if joints is None else joints
    return _from_description(urdf_of(source), tool, joints, example.srdf if example is not None else "")


def _from_description(source: Path | str, tool: str | None, joints: Sequence[str] | None, srdf: str = "") -> Chain:
    """The arm of a URDF or MJCF, with the exclusions of an SRDF in example-robot-data."""
    name, root = read_xml(source)
    if root.tag == "mujoco":
        require_robot(name, root)
        from invariantqp.robots.mujoco import load_mujoco, read_mjcf

        return load_mujoco(read_mjcf(source), tool, joints)
    joints_in_file = joints_of(name, root)
    parts = collision_geometry(name, root, source.resolve().parent if isinstance(source, Path) else None)
    exclusions = srdf_exclusions(_example_data_folder() / srdf) if srdf else None
    return chain_to_link(joints_in_file, name, tool, joints, parts, exclusions)


def _library(source: object) -> str | None:
    """The library of a model, recognised by an attribute, so that no library is imported."""
    if isinstance(source, type):
        return None
    marks = {"pinocchio": "createData", "mujoco": "jnt_qposadr", "yourdfpy": "link_map"}
    return next((library for library, name in marks.items() if hasattr(source, name)), None)


def _from_model(model: Any, tool: str | None, joints: Sequence[str] | None) -> Chain:
    """The arm of another library's model; the library is imported only here."""
    if (library := _library(model)) == "pinocchio":
        from invariantqp.robots.pinocchio_arms import load_model

        return load_model(model, tool, joints)
    if library == "mujoco":
        from invariantqp.robots.mujoco import load_mujoco

        return load_mujoco(model, tool, joints)
    return chain_to_link(list(map(joint_of_yourdfpy, model.robot.joints)), "the yourdfpy model", tool, joints)


def _from_screws(screws: ArrayLike, home: str | ArrayLike | None, names: tuple[str, ...] | None) -> Chain:
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
    """The path of the URDF file of a named robot (extra `robots`), or the given path of a URDF or MJCF.

    Raises:
        BadInput: neither text nor a path.
        UnknownName: no robot of that name; similar names are listed.
        RobotModelError: no file at that path, or a robot that is known by its joint screws alone.
        MissingExtra: a named robot without the extra `robots`.
    """
    arrays.instance(source, (str, PathLike), "source", "a robot's name or a path")
    known = EXAMPLE_ROBOTS.get(str(source))
    if known is not None:
        return _example_data_folder() / known.urdf
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


def _example_data_folder() -> Path:
    try:
        distribution = metadata.distribution(DATA)
    except metadata.PackageNotFoundError:
        raise MissingExtra(DATA, "robots") from None
    return Path(str(distribution.locate_file("cmeel.prefix/share/example-robot-data/robots")))
