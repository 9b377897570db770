"""Partial targets: the position of a point, the direction of an axis, or both without the rotation about the axis."""

from __future__ import annotations

from numbers import Real
from typing import Any, TypeAlias

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own

# Point, axis, tool_point and tool_axis as the engine takes them; unit axes.
TargetFields: TypeAlias = tuple[Any, Any, Array, Array]
# Kinds of targets, in messages.
TARGETS = "a (4, 4) pose, a pinocchio.SE3, a point (3,), or an iq.Target"
TOOL_ORIGIN, TOOL_Z = own(np.zeros(3)), own(np.array([0.0, 0.0, 1.0]))


@frozen(init=False, eq=False, repr=False, slots=False)
class Target(Value):
    """A partial target: the position of a point of the tool, the direction of an axis of the tool, or both.

    Attributes:
        point: (3,) in the base frame [length], or None: the position is free.
        axis: (3,) unit direction in the base frame, or None: the orientation is free.
        tool_point: (3,) the point, in the tool frame [length].
        tool_axis: (3,) the axis, a unit direction in the tool frame.
    """

    point: Array | None = field(converter=optional(own))
    axis: Array | None = field(converter=optional(own))
    tool_point: Array = field(converter=own)
    tool_axis: Array = field(converter=own)

    def __init__(
        self,
        point: ArrayLike | None = None,
        axis: ArrayLike | None = None,
        *,
        tool_point: ArrayLike = (0.0, 0.0, 0.0),
        tool_axis: ArrayLike = (0.0, 0.0, 1.0),
    ) -> None:
        """A point, an axis of any length but zero, or both; by default of the tool frame's origin and z axis."""
        if point is None and axis is None:
            raise BadInput("point", "None, as axis is", "a point, an axis, or both", "What is None is free.")
        self.__attrs_init__(
            None if point is None else arrays.vector(point, 3, "point"),
            None if axis is None else arrays.direction(axis, "axis"),
            arrays.vector(tool_point, 3, "tool_point"),
            arrays.direction(tool_axis, "tool_axis"),
        )

    @property
    def fields(self) -> TargetFields:
        """As the engine takes it."""
        return self.point, self.axis, self.tool_point, self.tool_axis

    @property
    def size(self) -> int:
        """The number of constrained directions: three of the point, two of the axis."""
        return (0 if self.point is None else 3) + (0 if self.axis is None else 2)

    def met_by(self, pose: ArrayLike) -> Target:
        """The target of the same kind that a tool at a pose (4, 4) meets."""
        return met_by(self, arrays.pose(pose, "pose"))

    def errors(self, pose: ArrayLike) -> tuple[float, float]:
        """Distance of the point [length] and angle of the axis [rad] of a pose (4, 4) from the target, 0 if free."""
        return target_errors(self, arrays.pose(pose, "pose"))

    def relabelled(self, tool_offset: ArrayLike) -> Target:
        """The same target for a tool frame that is displaced by a pose (4, 4) in itself."""
        back = se3.inverse(arrays.pose(tool_offset, "tool_offset"))
        tool_axis = back[:3, :3].dot(self.tool_axis)
        return Target(self.point, self.axis, tool_point=_transformed(back, self.tool_point), tool_axis=tool_axis)


def _transformed(pose: Array, point: Array) -> Array:
    """(3,) a point (3,) of a frame with a pose (4, 4), in the frame of the pose."""
    moved: Array = pose[:3, :3].dot(point) + pose[:3, 3]
    return moved


def met_by(target: Target, pose: Array) -> Target:
    """The target of the same kind that a tool at a pose (4, 4) meets."""
    return Target(
        None if target.point is None else _transformed(pose, target.tool_point),
        None if target.axis is None else pose[:3, :3].dot(target.tool_axis),
        tool_point=target.tool_point,
        tool_axis=target.tool_axis,
    )


def nearest_pose(target: Target, pose: Array) -> Array:
    """(4, 4) the pose that meets the target after the smallest rotation of `pose`."""
    R = pose[:3, :3]
    if target.axis is not None:
        R = se3.rotation(se3.shortest_turn(R.dot(target.tool_axis), target.axis)).dot(R)
    point = _transformed(pose, target.tool_point) if target.point is None else target.point
    return se3.transform(R, point - R.dot(target.tool_point))


def displacement_to(target: Target, start: Array, end: Array) -> Array:
    """(6,) the twist that takes the constrained part of a pose (4, 4) to that of another in unit time."""
    return se3.displacement(start, nearest_pose(met_by(target, end), start))


def target_errors(target: Target, pose: Array) -> tuple[float, float]:
    """Distance of the point [length] and angle of the axis [rad] of a pose (4, 4) from the target, 0 if free."""
    here = met_by(target, pose)
    distance = 0.0 if target.point is None or here.point is None else se3.norm(target.point - here.point)
    turn = None if target.axis is None or here.axis is None else se3.shortest_turn(here.axis, target.axis)
    return distance, 0.0 if turn is None else se3.norm(turn)


def constrained_root(target: Target, root: Array, pose: Array) -> Array:
    """(k, 6) the rows of the root (6, 6) of a metric that measure the constrained directions at a pose (4, 4)."""
    a, n = _transformed(pose, target.tool_point), pose[:3, :3].dot(target.tool_axis)
    turns = np.eye(3) if target.axis is None else n[None]
    free = np.hstack((turns, turns.dot(se3.cross_matrix(a).T)))  # unconstrained twists
    if target.point is None:
        free = np.vstack((free, np.eye(6)[3:]))
    Q = np.linalg.qr(root.dot(free.T), mode="complete")[0]
    constrained: Array = Q[:, len(free) :].T.dot(root)
    return constrained


def partial_target(target: Any) -> TargetFields | None:
    """The fields of a `Target` or a point (3,), not checked; None for any other target."""
    if isinstance(target, Target):
        return target.fields
    if isinstance(target, np.ndarray):
        is_point = target.shape == (3,)
    else:
        is_point = type(target) in {list, tuple} and len(target) == 3 and all(isinstance(x, Real) for x in target)
    return (target, None, TOOL_ORIGIN, TOOL_Z) if is_point else None


def checked_target(target: Any, argument: str = "target") -> Target:
    """A `Target`, also from a point (3,) for the tool frame's origin.

    Raises:
        BadInput: anything else.
    """
    return target if isinstance(target, Target) else Target(point=arrays.vector(target, 3, argument))
