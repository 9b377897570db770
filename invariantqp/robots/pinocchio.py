"""An arm of a Pinocchio model: its tool pose and its joint twists. Here (v; omega) becomes (omega; v).

This file and `models` beside it are the only ones that import Pinocchio.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pinocchio as pin
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared, own
from invariantqp.robots.kinematics import Sighting, joint_limits
from invariantqp.robots.urdf import UNLIMITED

# Rows of Pinocchio's spatial vectors, linear part first, in the order this library uses, angular part first.
ANGULAR_FIRST = np.array([3, 4, 5, 0, 1, 2])


class Target(pin.SE3):  # type: ignore[misc]
    """A target pose that has been checked."""


class _Workspace(threading.local):
    """Where Pinocchio writes its results: each thread that asks has a `data` of its own."""

    def __init__(self, model: pin.Model) -> None:
        self.data = model.createData()


@frozen(init=False, eq=False, repr=False, slots=False)
class PinocchioRobot(Compared):
    """An arm of a Pinocchio model; made by `load_robot`.

    Attributes:
        model: the reduced `pinocchio.Model`, to look at.
        tool: name of the tool frame.
        names: joint names, base first.
        position_lower: (m,) [rad, m], -inf where there is none.
        position_upper: (m,).
        velocity_limit: (m,) [rad/s, m/s], inf where the model has none.
    """

    model: Any
    tool: str
    names: tuple[str, ...] = field(eq=False)
    position_lower: Array = field(eq=False, converter=own)
    position_upper: Array = field(eq=False, converter=own)
    velocity_limit: Array = field(eq=False, converter=own)
    _frame: int = field(eq=False)
    _workspace: _Workspace = field(eq=False)

    def __init__(self, model: pin.Model, tool: str) -> None:
        """The arm whose joints are all those of a model, each with one coordinate."""
        lower, upper = model.lowerPositionLimit, model.upperPositionLimit
        limits = joint_limits(
            model.nv,
            np.where(np.abs(lower) >= UNLIMITED, -np.inf, lower),
            np.where(np.abs(upper) >= UNLIMITED, np.inf, upper),
            speed_limits(model),
        )
        self.__attrs_init__(model, tool, tuple(model.names)[1:], *limits, model.getFrameId(tool), _Workspace(model))

    def __repr__(self) -> str:
        return f"<PinocchioRobot {self.model.name}: {len(self.names)} joints to {self.tool}>"

    def __hash__(self) -> int:  # type: ignore[override]
        return hash((self.tool, self.names))

    def __reduce__(self) -> tuple[Any, ...]:
        """How a copy is made: from the model, with a workspace of its own."""
        return PinocchioRobot, (self.model, self.tool)

    def pose(self, q: ArrayLike) -> Array:
        """(4, 4) tool pose in the base frame."""
        data = self._workspace.data
        pin.forwardKinematics(self.model, data, self._positions(q))
        T: Array = pin.updateFramePlacement(self.model, data, self._frame).homogeneous.copy()
        return T

    def jacobian(self, q: ArrayLike) -> Array:
        """(6, m) joint twists in the base frame."""
        return joint_twists(self.model, self._workspace.data, self._positions(q))

    def origins(self, q: ArrayLike) -> Array:
        """(m, 3) origins of the joint frames, as the model places them."""
        data = self._workspace.data
        pin.forwardKinematics(self.model, data, self._positions(q))
        return np.array([M.translation for M in data.oMi[1:]])

    def target(self, pose: ArrayLike | pin.SE3) -> Target:
        """A target pose, checked, as the SE3 that `sight` takes.

        Raises:
            BadInput: not a rigid motion.
        """
        return pose if isinstance(pose, Target) else Target(arrays.pose(pose, "target"))

    def sight(self, q: Array, target: ArrayLike | pin.SE3) -> Sighting:
        """Joint twists and tool error, in the base frame.

        Raises:
            BadInput: a target that is not a rigid motion.
        """
        data = self._workspace.data
        J = joint_twists(self.model, data, q)
        M = pin.updateFramePlacement(self.model, data, self._frame)
        wanted: Any = target if type(target) is Target or _is_rigid(target) else self.target(target)
        return Sighting(J, pin.log6(wanted.act(M.inverse())).vector.take(ANGULAR_FIRST), M)

    def points(self, sighting: Sighting, target: ArrayLike | pin.SE3, point: Array) -> tuple[Array, Array]:
        """Where a point (3,) of the tool frame is, and where it should be."""
        wanted = target if isinstance(target, pin.SE3) else self.target(target)
        return sighting.pose.act(point), wanted.act(point)

    def with_tool(self, offset: ArrayLike) -> PinocchioRobot:
        """The same arm with its tool frame moved by a (4, 4) offset in the old tool frame."""
        model = self.model.copy()
        old = model.frames[self._frame]
        place = old.placement * placement(offset, "offset")
        name = f"{self.tool}+offset"
        model.addFrame(pin.Frame(name, old.parentJoint, self._frame, place, pin.FrameType.OP_FRAME))
        return PinocchioRobot(model, name)

    def _positions(self, q: ArrayLike) -> Array:
        return arrays.vector(q, len(self.names), "q")


def speed_limits(model: pin.Model) -> Array:
    """(nv,) velocity limits of a model, inf where it has none."""
    speed = model.velocityLimit
    limits: Array = np.where((speed > 0.0) & (speed < UNLIMITED), speed, np.inf)
    return limits


def joint_twists(model: pin.Model, data: pin.Data, q: Array) -> Array:
    """(6, nv) twists of all joints of a model at its configuration q, in the world frame.

    Where every joint moves the tool, as in a `PinocchioRobot`, this is the tool's Jacobian.
    """
    J: Array = pin.computeJointJacobians(model, data, q).take(ANGULAR_FIRST, axis=0)
    return J if J.ndim == 2 else J.reshape(6, 1)  # Pinocchio leaves the second dimension out for one joint


def _is_rigid(target: object) -> bool:
    """Whether this is an SE3 that is a finite rigid motion: Pinocchio itself takes any matrix for a rotation."""
    return isinstance(target, pin.SE3) and arrays.is_rigid(target.homogeneous)


def placement(pose: ArrayLike | pin.SE3, argument: str) -> pin.SE3:
    """A rigid motion as an SE3.

    Raises:
        BadInput: no rigid motion with finite numbers; names the argument.
    """
    return pin.SE3(arrays.pose(pose, argument))
