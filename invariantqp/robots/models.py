"""Arms cut out of Pinocchio models: only the joints between base and tool, without meshes.

A humanoid's arm is a seven-joint robot.
"""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from invariantqp.errors import BadInput, RobotModelError, UnknownName, excerpt
from invariantqp.geometry import arrays
from invariantqp.robots.chain import Chain
from invariantqp.robots.pinocchio import PinocchioRobot, joint_twists, speed_limits
from invariantqp.robots.urdf import UNLIMITED, read_urdf


def load_urdf(source: Path | str, tool: str | None, joints: Sequence[str] | None) -> PinocchioRobot:
    """The arm from a URDF's root to a tool frame.

    Args:
        source: the path of a URDF file, or its text.
        tool: as in `load_model`.
        joints: as in `load_model`.

    Raises:
        RobotModelError: the URDF cannot be read or parsed, and what `load_model` refuses.
        UnknownName, BadInput: as `load_model`.
    """
    name, xml = read_urdf(source)
    try:
        model = pin.buildModelFromXML(xml)
    except Exception as error:
        raise RobotModelError(f"{name}: Pinocchio cannot build a model from it ({error})") from error
    return _reduce(model, name, tool, joints)


def load_model(model: pin.Model, tool: str | None, joints: Sequence[str] | None) -> PinocchioRobot:
    """The arm from a model's root to a tool frame; the model itself is left as it is.

    Args:
        model: a `pinocchio.Model`.
        tool: name of a frame (link); None is the last link of the longest chain of moving joints.
        joints: the joints that move, all between base and tool; None is every one of them. The rest are held at zero,
            or at the limit nearest to it.

    Raises:
        RobotModelError: no joint moves the tool, or one that moves has not one coordinate.
        UnknownName: a frame or joint is not in the model.
        BadInput: no model, or a joint that does not move the tool.
    """
    if not isinstance(model, pin.Model):
        raise BadInput("source", excerpt(model), "a pinocchio.Model")
    return _reduce(model.copy(), f"the model {model.name!r}", tool, joints)


def _reduce(model: pin.Model, name: str, tool: str | None, joints: Sequence[str] | None) -> PinocchioRobot:
    """As `load_model`, for a model that may be changed, and its name for messages."""
    frames = [f.name for f in model.frames]
    if tool is None:
        tool = max(model.frames, key=lambda f: (len(_support(model, f.parentJoint)), f.type == pin.FrameType.BODY)).name
    if tool not in frames:
        raise UnknownName("frame", tool, difflib.get_close_matches(tool, frames), frames)
    tool = _rename_links(model, tool)
    moving = _support(model, model.frames[model.getFrameId(tool)].parentJoint)
    if not moving:
        raise RobotModelError(f"{name}: no joint moves the tool frame {tool!r}; choose a frame beyond the first joint")
    moving = moving if joints is None else _select(model, tool, moving, joints)
    for joint in moving:
        kind = model.joints[model.getJointId(joint)]
        if (kind.nq, kind.nv) != (1, 1):
            raise RobotModelError(
                f"{name}: joint {joint!r} ({kind.shortname()}) has no single coordinate; only revolute and prismatic "
                "joints are modelled. Leave it out of `joints` to hold it still, or pass the URDF for a continuous one."
            )
    held = [i for i, joint in enumerate(model.names) if i > 0 and joint not in moving]
    rest = np.clip(pin.neutral(model), model.lowerPositionLimit, model.upperPositionLimit)
    return PinocchioRobot(pin.buildReducedModel(model, held, rest), tool)


def chain_to(model: pin.Model, frame: str) -> tuple[Chain, NDArray[np.intp]]:
    """The joints of any model that move a frame, as screws from the neutral configuration, and their tangent indices.

    A free flyer, a ball or a planar joint is as many screws as it has degrees of freedom; without limits, like every
    joint whose coordinate is not one number.

    Raises:
        UnknownName: no such frame.
        RobotModelError: no joint moves it.
    """
    known = [f.name for f in model.frames]
    if frame not in known:
        raise UnknownName("frame", frame, difflib.get_close_matches(frame, known), known)
    index = model.getFrameId(frame)
    joints = [i for i in model.supports[model.frames[index].parentJoint] if model.nvs[i] > 0]
    if not joints:
        raise RobotModelError(f"no joint moves the frame {frame!r}; choose one beyond the first joint")
    data, neutral = model.createData(), pin.neutral(model)
    J = joint_twists(model, data, neutral)
    home = pin.updateFramePlacement(model, data, index).homogeneous
    tangent = [np.arange(model.idx_vs[i], model.idx_vs[i] + model.nvs[i]) for i in joints]
    lower, upper = [], []
    for i in joints:
        single = model.nqs[i] == model.nvs[i] == 1
        low, high = (limits[model.idx_qs[i]] for limits in (model.lowerPositionLimit, model.upperPositionLimit))
        bounded = single and low < high and max(-low, high) < UNLIMITED
        lower += [low if bounded else -np.inf] * model.nvs[i]
        upper += [high if bounded else np.inf] * model.nvs[i]
    moving = np.concatenate(tangent).astype(np.intp)
    speed = speed_limits(model)[moving]
    return Chain(J[:, moving], home, position_lower=lower, position_upper=upper, velocity_limit=speed), moving


def _select(model: pin.Model, tool: str, moving: list[str], joints: Sequence[str]) -> list[str]:
    """Those of the moving joints that are in `joints`, base first."""
    for joint in joints:
        if joint not in model.names:
            raise UnknownName("joint", joint, difflib.get_close_matches(joint, model.names), moving)
        if joint not in moving:
            raise BadInput("joints", f"{joint!r}, which does not move {tool!r}", f"some of {arrays.names(moving)}")
    if not joints:
        raise BadInput("joints", "none", f"some of {arrays.names(moving)}")
    return [joint for joint in moving if joint in joints]


def _rename_links(model: pin.Model, tool: str) -> str:
    """Rename links that share their name with a joint, since Pinocchio finds frames by name alone; the tool's name."""
    count = Counter(frame.name for frame in model.frames)
    shared = {f.name for f in model.frames if f.type == pin.FrameType.BODY and count[f.name] > 1}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.name in shared:
            frame.name += " link"
    return f"{tool} link" if tool in shared else tool


def _support(model: pin.Model, joint: int) -> list[str]:
    """Names of the joints from the base up to and with `joint`."""
    chain: list[str] = []
    while joint > 0:
        chain.insert(0, model.names[joint])
        joint = model.parents[joint]
    return chain
