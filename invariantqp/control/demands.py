"""What a controller meets exactly, as values; the form judges the rest.

    ExactPoint    v + omega x p = gain (p_d - p) + v_d(p)                a point of the tool follows its target
    ExactAxis     omega, but for its part about the axis a               a direction of the tool follows its target
    ExactPlane    n.(v + omega x p) = gain n.(p_d - p) + n.v_d(p)        a point keeps its target's height over a plane
    ExactJoints   A x = b                                                a fixed combination of joint velocities

Each becomes rows on the joint velocity in every tick; limits that forbid them slow the motion down along the same
direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.robots.kinematics import Robot, Sighting
from invariantqp.velocity.exact import ExactRows

# Below this sine two directions are parallel: the turn that takes one to the other is none, or any.
PARALLEL = 1e-12


class View(NamedTuple):
    """One tick as a demand sees it.

    Attributes:
        robot: the arm.
        sighting: its state.
        target: where its tool should be, as `robot.target` gave it.
        gain: [1/s].
        feedforward: (6,) twist of the target, base frame.
    """

    robot: Robot
    sighting: Sighting
    target: Any
    gain: float
    feedforward: Array


class Exact(Protocol):
    """A demand; `anchor` is the point (3,) whose motion it fixes, if there is one."""

    def rows(self, view: View) -> tuple[ExactRows, Array | None]:
        """The rows of this tick, and the anchor."""
        ...

    def moved(self, offset: Array) -> Exact:
        """The same demand for a tool frame displaced in itself by a (4, 4) offset."""
        ...


@dataclass(frozen=True, eq=False)
class ExactPoint:
    """A point of the tool follows its target exactly.

    Attributes:
        point: (3,) in the tool frame [length]; its origin by default.
    """

    point: ArrayLike = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", arrays.vector(self.point, 3, "point"))

    def rows(self, view: View) -> tuple[ExactRows, Array | None]:
        """The velocity of the point, three rows."""
        here, there = view.robot.points(view.sighting, view.target, np.asarray(self.point))
        b = view.gain * (there - here) + velocity_at(view.feedforward, there)
        return ExactRows(velocity_at(view.sighting.J, here), b), here

    def moved(self, offset: Array) -> ExactPoint:
        """The same point of the tool in the displaced frame."""
        return ExactPoint(offset[:3, :3].T.dot(np.asarray(self.point) - offset[:3, 3]))


@dataclass(frozen=True, eq=False)
class ExactAxis:
    """A direction of the tool follows its target exactly; the turn about it is left free.

    Attributes:
        axis: (3,) in the tool frame, of any length.
    """

    axis: ArrayLike

    def __post_init__(self) -> None:
        object.__setattr__(self, "axis", arrays.direction(self.axis, "axis"))

    def rows(self, view: View) -> tuple[ExactRows, Array | None]:
        """The angular velocity across the axis, two rows."""
        origin, axis = np.zeros(3), np.asarray(self.axis)
        roots = view.robot.points(view.sighting, view.target, origin)
        tips = view.robot.points(view.sighting, view.target, axis)
        here, there = tips[0] - roots[0], tips[1] - roots[1]
        turn = np.cross(here, there)
        sine, cosine = float(np.linalg.norm(turn)), float(here.dot(there))
        if sine > PARALLEL:
            turn *= np.arctan2(sine, cosine) / sine
        elif cosine < 0.0:  # opposite: any half turn will do, about a fixed one of the axes across
            turn = np.pi * np.linalg.svd(here.reshape(1, 3))[2][1]
        return ExactRows.axis(view.sighting.J, here, view.gain * turn + view.feedforward[:3]), None

    def moved(self, offset: Array) -> ExactAxis:
        """The same direction of the tool in the displaced frame."""
        return ExactAxis(offset[:3, :3].T.dot(np.asarray(self.axis)))


@dataclass(frozen=True, eq=False)
class ExactPlane:
    """A point of the tool keeps its target's height over a plane exactly; along the plane the form judges.

    Attributes:
        normal: (3,) of the plane, in the base frame.
        point: (3,) in the tool frame [length].
    """

    normal: ArrayLike
    point: ArrayLike = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "normal", arrays.direction(self.normal, "normal"))
        object.__setattr__(self, "point", arrays.vector(self.point, 3, "point"))

    def rows(self, view: View) -> tuple[ExactRows, Array | None]:
        """The speed of the point along the normal, one row."""
        n = np.asarray(self.normal)
        here, there = view.robot.points(view.sighting, view.target, np.asarray(self.point))
        speed = n.dot(view.gain * (there - here) + velocity_at(view.feedforward, there))
        return ExactRows.plane(view.sighting.J, here, n, float(speed)), None

    def moved(self, offset: Array) -> ExactPlane:
        """The same point of the tool in the displaced frame."""
        return ExactPlane(self.normal, ExactPoint(self.point).moved(offset).point)


@dataclass(frozen=True, eq=False)
class ExactJoints:
    """A fixed combination of joint velocities: A x = b; b = 0 keeps A q where it is.

    Attributes:
        A: (k, m).
        b: (k,), or one number for all.
    """

    A: ArrayLike
    b: ArrayLike = 0.0

    def __post_init__(self) -> None:
        A = arrays.array(self.A, "A", "a (k, m) matrix")
        A = A.reshape(1, -1) if A.ndim == 1 else A
        b = arrays.array(self.b, "b", "k numbers")
        checked = ExactRows(A, np.full(len(A), float(b)) if b.ndim == 0 else b)
        object.__setattr__(self, "A", checked.A)
        object.__setattr__(self, "b", checked.b)

    def rows(self, view: View) -> tuple[ExactRows, Array | None]:
        """The rows as they are.

        Raises:
            BadInput: they are for another number of joints.
        """
        m = len(view.robot.names)
        if np.shape(self.A)[1] != m:
            raise BadInput("exact", f"rows on {np.shape(self.A)[1]} joints", f"rows on {m}, one for each joint")
        return ExactRows(self.A, self.b), None

    def moved(self, offset: Array) -> ExactJoints:  # noqa: ARG002 (joints know nothing of tool frames)
        """Itself."""
        return self


def demands_of(
    exact: Exact | ExactRows | Sequence[Exact | ExactRows] | Literal["position"] | None,
) -> tuple[Exact, ...]:
    """The demands meant: "position" is the tool frame's origin, ExactRows are ExactJoints of the same A and b.

    Raises:
        BadInput: something that has no rows.
    """
    if exact is None:
        return ()
    if exact == "position":
        return (ExactPoint(),)
    several: tuple[Any, ...] = tuple(exact) if isinstance(exact, (list, tuple)) else (exact,)
    demands = tuple(ExactJoints(one.A, one.b) if isinstance(one, ExactRows) else one for one in several)
    for one in demands:
        if not hasattr(one, "rows"):
            raise BadInput(
                "exact", repr(one), '"position", an ExactPoint, ExactAxis, ExactRows, ... or several of them'
            )
    return demands


def rows_of(demands: tuple[Exact, ...], view: View) -> tuple[ExactRows | None, Array | None]:
    """All rows of one tick together, and the first anchor."""
    together: ExactRows | None = None
    anchor: Array | None = None
    for demand in demands:
        rows, point = demand.rows(view)
        together = rows if together is None else together.with_rows(rows)
        anchor = point if anchor is None else anchor
    return together, anchor
