"""Robots from URDF, through Pinocchio: the one file that imports it, and the one where (v; omega) becomes (omega; v).

Only the joints between base and tool are modelled, without meshes: a humanoid's arm is a seven-joint robot.
"""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from invariantqp.errors import BadInput, RobotModelError, UnknownName
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Sighting, checked_limits

# Rows of Pinocchio's spatial vectors, linear part first, in the order this library uses, angular part first.
ANGULAR_FIRST = np.array([3, 4, 5, 0, 1, 2])
# URDF knows no unlimited revolute joint but "continuous", which Pinocchio parametrises by two numbers; read as revolute
# with this range [rad], which no angle in use reaches, it has one.
UNLIMITED = 1e9


class PinocchioRobot:
    """An arm of a Pinocchio model; made by `load_urdf`.

    Attributes:
        names: joint names, base first.
        position_lower: (m,) [rad, m], -inf where there is none.
        position_upper: (m,).
        velocity_limit: (m,) [rad/s, m/s], inf where the URDF has none.
        tool: name of the tool frame.
        model: the reduced `pinocchio.Model`, to look at.
    """

    names: tuple[str, ...]
    position_lower: Array
    position_upper: Array
    velocity_limit: Array

    def __init__(self, model: pin.Model, tool: str) -> None:
        self.model = model
        self.tool = tool
        self._data = model.createData()
        self._frame = model.getFrameId(tool)
        self.names = tuple(model.names)[1:]
        unlimited = np.abs(np.stack((model.lowerPositionLimit, model.upperPositionLimit))) >= UNLIMITED
        speed = np.where(model.velocityLimit > 0.0, model.velocityLimit, np.inf)
        self.position_lower, self.position_upper, self.velocity_limit = checked_limits(
            model.nv,
            np.where(unlimited[0], -np.inf, model.lowerPositionLimit),
            np.where(unlimited[1], np.inf, model.upperPositionLimit),
            speed,
        )

    def __repr__(self) -> str:
        return f"<PinocchioRobot {self.model.name}: {len(self.names)} joints to {self.tool}>"

    def pose(self, q: ArrayLike) -> Array:
        """(4, 4) tool pose in the base frame."""
        pin.forwardKinematics(self.model, self._data, self._checked(q))
        T: Array = pin.updateFramePlacement(self.model, self._data, self._frame).homogeneous.copy()
        return T

    def jacobian(self, q: ArrayLike) -> Array:
        """(6, m) joint twists in the base frame."""
        return self._jacobian(self._checked(q))

    def origins(self, q: ArrayLike) -> Array:
        """(m, 3) origins of the joint frames, as the URDF places them."""
        pin.forwardKinematics(self.model, self._data, self._checked(q))
        return np.array([M.translation for M in self._data.oMi[1:]])

    def target(self, pose: ArrayLike | pin.SE3) -> pin.SE3:
        """A target pose as the SE3 that `sight` takes."""
        return placement(pose, "target")

    def sight(self, q: Array, target: ArrayLike | pin.SE3) -> Sighting:
        """Joint twists and tool error, in the base frame."""
        J = self._jacobian(q)
        M = pin.updateFramePlacement(self.model, self._data, self._frame)
        wanted = target if isinstance(target, pin.SE3) else self.target(target)
        return Sighting(J, pin.log6(wanted.act(M.inverse())).vector.take(ANGULAR_FIRST), M)

    def points(self, sighting: Sighting, target: ArrayLike | pin.SE3, point: Array) -> tuple[Array, Array]:
        """Where a point (3,) of the tool frame is, and where it should be."""
        wanted = target if isinstance(target, pin.SE3) else self.target(target)
        return sighting.pose.act(point), wanted.act(point)

    def with_tool(self, offset: ArrayLike) -> PinocchioRobot:
        """The same arm with its tool frame moved by a (4, 4) offset in the old tool frame."""
        model = self.model.copy()
        old = model.frames[self._frame]
        placement = old.placement * pin.SE3(arrays.pose(offset, "offset"))
        name = f"{self.tool}+offset"
        model.addFrame(pin.Frame(name, old.parentJoint, self._frame, placement, pin.FrameType.OP_FRAME))
        return PinocchioRobot(model, name)

    def _checked(self, q: ArrayLike) -> Array:
        return arrays.vector(q, len(self.names), "q")

    def _jacobian(self, q: Array) -> Array:
        # Every joint of the reduced model moves the tool, so the joint Jacobian in the world frame is the tool's.
        J: Array = pin.computeJointJacobians(self.model, self._data, q).take(ANGULAR_FIRST, axis=0)
        return J


def load_urdf(path: Path, tool: str | None, joints: Sequence[str] | None) -> PinocchioRobot:
    """The arm from a URDF's root to a tool frame.

    Args:
        path: the URDF file.
        tool: a frame (link) name; None is the last link of the longest chain of moving joints.
        joints: the joints that move, all between base and tool; None is every one of them. The rest are held at zero,
            or at the limit nearest to it.

    Raises:
        RobotModelError: the file cannot be read or parsed, the tool is fixed to the base.
        UnknownName: a frame or joint is not in the model.
        BadInput: a joint that does not move the tool.
    """
    model = _parsed(path)
    frames = [f.name for f in model.frames]
    if tool is None:
        tool = max(model.frames, key=lambda f: (len(_support(model, f.parentJoint)), f.type == pin.FrameType.BODY)).name
    if tool not in frames:
        raise UnknownName("frame", tool, difflib.get_close_matches(tool, frames), frames)
    tool = _told_apart(model, tool)
    moving = _support(model, model.frames[model.getFrameId(tool)].parentJoint)
    if not moving:
        remedy = "choose a frame beyond the first joint"
        raise RobotModelError(f"{path.name}: no joint moves the tool frame {tool!r}; {remedy}")
    if joints is not None:
        for name in joints:
            if name not in model.names:
                raise UnknownName("joint", name, difflib.get_close_matches(name, model.names), moving)
            if name not in moving:
                raise BadInput("joints", f"{name!r}, which does not move {tool!r}", f"some of {arrays.names(moving)}")
        if not joints:
            raise BadInput("joints", "none", f"some of {arrays.names(moving)}")
        moving = [name for name in moving if name in joints]
    held = [i for i, name in enumerate(model.names) if i > 0 and name not in moving]
    rest = np.clip(pin.neutral(model), model.lowerPositionLimit, model.upperPositionLimit)
    return PinocchioRobot(pin.buildReducedModel(model, held, rest), tool)


def placement(pose: ArrayLike | pin.SE3, argument: str) -> pin.SE3:
    """A rigid motion as an SE3.

    Raises:
        BadInput: no rigid motion with finite numbers; names the argument.
    """
    return pin.SE3(arrays.pose(pose, argument))


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
    J = pin.computeJointJacobians(model, data, neutral).take(ANGULAR_FIRST, axis=0)
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
    return Chain(J[:, moving], home, position_lower=lower, position_upper=upper), moving


def _told_apart(model: pin.Model, tool: str) -> str:
    """The tool's name after links that share theirs with a joint are renamed: Pinocchio finds frames by name alone."""
    count = Counter(frame.name for frame in model.frames)
    shared = {f.name for f in model.frames if f.type == pin.FrameType.BODY and count[f.name] > 1}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.name in shared:
            frame.name += " link"
    return f"{tool} link" if tool in shared else tool


def _support(model: pin.Model, joint: int) -> list[str]:
    """Names of the joints between base and joint, base first."""
    chain: list[str] = []
    while joint > 0:
        chain.insert(0, model.names[joint])
        joint = model.parents[joint]
    return chain


def _parsed(path: Path) -> pin.Model:
    try:
        tree = ET.parse(path)  # noqa: S314 (robot descriptions are the user's own files)
    except OSError as error:
        raise RobotModelError(f"{path}: cannot be read ({error.strerror or error})") from error
    except ET.ParseError as error:
        raise RobotModelError(f"{path}: not XML ({error}); expected a URDF <robot>") from error
    root = tree.getroot()
    if root.tag != "robot" or root.find("joint") is None:
        raise RobotModelError(f"{path}: found <{root.tag}> without joints; expected a URDF <robot> with <joint>s")
    for joint in root.iter("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            limit = ET.SubElement(joint, "limit", effort="0", velocity="0") if limit is None else limit
            limit.set("lower", str(-UNLIMITED))
            limit.set("upper", str(UNLIMITED))
    try:
        model = pin.buildModelFromXML(ET.tostring(root, encoding="unicode"))
    except Exception as error:
        raise RobotModelError(f"{path}: Pinocchio cannot build a model from it ({error})") from error
    if model.nq != model.nv:
        wide = next(j.shortname() for j in model.joints if j.nq != j.nv)
        raise RobotModelError(
            f"{path}: a {wide} joint has no single coordinate; only revolute and prismatic joints are"
        )
    return model
