"""What a controller meets exactly, as values; the rest of the twist is least squares.

    ExactTwist    (omega; v) = gain log(T_d T^-1) + twist_d              the whole twist, which limits scale
    ExactPoint    v + omega x p = gain (p_d - p) + v_d(p_d)              a point of the tool follows its target
    ExactAxis     omega without its part about the axis a                a direction of the tool follows its target
    ExactPlane    n.(v + omega x p) = gain n.(p_d - p) + n.v_d(p_d)      a point keeps its target's height over a plane
    ExactJoints   A x = b                                                a fixed combination of joint velocities

Each becomes rows on the joint velocity in every tick; limits that forbid them slow the motion down along the same
direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.se3 import shortest_turn, velocity_at
from invariantqp.robots.kinematics import Robot, RobotState
from invariantqp.velocity.exact import ExactRows

# Random states in which rows are counted: one that is not singular is enough.
STATES = 4
# A singular value of rows below this share of the terms they sum is rounding, that of a rounded robot model included.
ROW_TOLERANCE = 1e-5


class View(NamedTuple):
    """What a demand reads of one tick.

    Attributes:
        robot: the arm.
        state: its state, as `robot.state` returned it.
        target: where its tool should be, as `robot.target` gave it.
        gain: [1/s].
        feedforward: (6,) twist of the target, base frame.
    """

    robot: Robot
    state: RobotState
    target: Any
    gain: float
    feedforward: Array


# The demands that have a name.
Named = Literal["position", "twist"]


class Exact(Protocol):
    """A demand on the tool or the joints, met exactly in every tick; implement it to bring one."""

    def rows(self, view: View) -> ExactRows:
        """The rows of this tick."""
        ...


@frozen(eq=False, repr=False, slots=False)
class ExactTwist(Value):
    """The whole twist is followed exactly: limits scale its speed, and the tool stays on the same screw.

    It needs an arm that moves its tool in all six directions. A joint at its position limit stops the tool while the
    twist pushes it further; an arm that stretches out stops before it is singular.
    """

    def rows(self, view: View) -> ExactRows:
        """The angular velocity and the velocity at the base origin, six rows."""
        twist = view.gain * view.state.error + view.feedforward
        return ExactRows.of(view.state.J, np.eye(6), twist)


@frozen(init=False, eq=False, repr=False, slots=False)
class ExactPoint(Value):
    """A point of the tool follows its target exactly.

    Attributes:
        point: (3,) in the tool frame [length]; its origin by default.
    """

    point: Array = field(converter=own)

    def __init__(self, point: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """As its attributes."""
        self.__attrs_init__(arrays.vector(point, 3, "point"))

    def rows(self, view: View) -> ExactRows:
        """The velocity of the point, three rows."""
        here, there = view.robot.points(view.state, view.target, self.point)
        b = view.gain * (there - here) + velocity_at(view.feedforward, there)
        return ExactRows.point(view.state.J, here, b)


@frozen(init=False, eq=False, repr=False, slots=False)
class ExactAxis(Value):
    """A direction of the tool follows its target exactly; the turn about it is left free.

    Attributes:
        axis: (3,) unit direction in the tool frame.
    """

    axis: Array = field(converter=own)

    def __init__(self, axis: ArrayLike) -> None:
        """A direction (3,) in the tool frame, of any length but zero."""
        self.__attrs_init__(arrays.direction(axis, "axis"))

    def rows(self, view: View) -> ExactRows:
        """The angular velocity across the axis, two rows."""
        roots = view.robot.points(view.state, view.target, np.zeros(3))
        tips = view.robot.points(view.state, view.target, self.axis)
        here, there = tips[0] - roots[0], tips[1] - roots[1]
        turn = shortest_turn(here, there)
        return ExactRows.axis(view.state.J, here, view.gain * turn + view.feedforward[:3])


@frozen(init=False, eq=False, repr=False, slots=False)
class ExactPlane(Value):
    """A point of the tool keeps its target's height over a plane exactly; its motion along the plane is left free.

    Attributes:
        normal: (3,) unit normal of the plane, in the base frame.
        point: (3,) in the tool frame [length]; its origin by default.
    """

    normal: Array = field(converter=own)
    point: Array = field(converter=own)

    def __init__(self, normal: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """A normal (3,) of any length but zero, and the point."""
        self.__attrs_init__(arrays.direction(normal, "normal"), arrays.vector(point, 3, "point"))

    def rows(self, view: View) -> ExactRows:
        """The speed of the point along the normal, one row."""
        n = self.normal
        here, there = view.robot.points(view.state, view.target, self.point)
        speed = n.dot(view.gain * (there - here) + velocity_at(view.feedforward, there))
        return ExactRows.plane(view.state.J, here, n, float(speed))


@frozen(init=False, eq=False, repr=False, slots=False)
class ExactJoints(Value):
    """A fixed combination of joint velocities: A x = b; b = 0 keeps A q where it is.

    Attributes:
        A: (k, m).
        b: (k,) [rad/s, length/s].
    """

    A: Array = field(converter=own)
    b: Array = field(converter=own)

    def __init__(self, A: ArrayLike, b: ArrayLike = 0.0) -> None:
        """Rows (k, m), or (m,) for one, and (k,) numbers, or one for all."""
        rows = arrays.array(A, "A", "a (k, m) matrix")
        rows = rows.reshape(1, -1) if rows.ndim == 1 else rows
        demands = arrays.array(b, "b", "k numbers")
        if demands.ndim == 0 and rows.ndim == 2:
            demands = np.full(len(rows), float(demands))
        checked = ExactRows(rows, demands)
        self.__attrs_init__(np.asarray(checked.A), np.asarray(checked.b))

    def rows(self, view: View) -> ExactRows:
        """The rows as they are."""
        m = len(view.robot.names)
        if self.A.shape[1] != m:
            raise BadInput("exact", f"rows on {self.A.shape[1]} joints", f"rows on {m}, one for each joint")
        return ExactRows(self.A, self.b)


def demand_fields(demands: tuple[Exact, ...]) -> tuple[tuple[str, Any, Any], ...] | None:
    """The demands as the engine takes them; None where one is of another kind, which is asked in each tick."""
    found: list[tuple[str, Any, Any]] = []
    for demand in demands:
        if type(demand) is ExactTwist:
            found.append(("twist", None, None))
        elif type(demand) is ExactPoint:
            found.append(("point", demand.point, None))
        elif type(demand) is ExactAxis:
            found.append(("axis", demand.axis, None))
        elif type(demand) is ExactPlane:
            found.append(("plane", demand.point, demand.normal))
        elif type(demand) is ExactJoints:
            found += [("joints", row, float(b)) for row, b in zip(demand.A, demand.b, strict=True)]
        else:
            return None
    return tuple(found)


def require_rows(rows: object, m: int) -> None:
    """Refuse what is not exact rows on m joints."""
    if not isinstance(rows, ExactRows):
        raise BadInput("rows", excerpt(rows), "ExactRows(A, b)")
    if np.shape(rows.A)[1] != m:
        raise BadInput("rows", f"rows on {np.shape(rows.A)[1]} joints", f"rows on {m}, one for each joint")


def demands_of(exact: Exact | ExactRows | Sequence[Exact | ExactRows | Named] | Named | None) -> tuple[Exact, ...]:
    """The demands as a tuple.

    "position" is an ExactPoint at the tool frame's origin, "twist" an ExactTwist, ExactRows are ExactJoints.
    """
    if exact is None:
        return ()
    several: tuple[Any, ...] = tuple(exact) if isinstance(exact, (list, tuple)) else (exact,)
    by_name: dict[str, Exact] = {"position": ExactPoint(), "twist": ExactTwist()}
    meant: list[Any] = [by_name.get(one, one) if isinstance(one, str) else one for one in several]
    demands = tuple(ExactJoints(one.A, one.b) if isinstance(one, ExactRows) else one for one in meant)
    for one in demands:
        if isinstance(one, type) or not hasattr(one, "rows"):
            expected = '"position", "twist", an ExactPoint, ExactAxis, ExactRows, ... or several of them'
            raise BadInput("exact", excerpt(one), expected)
    return demands


def require_all_directions(demands: tuple[Exact, ...], robot: Robot) -> None:
    """Refuse an ExactTwist of an arm that does not move its tool in all six directions."""
    if not any(isinstance(demand, ExactTwist) for demand in demands):
        return
    m, k = len(robot.names), row_rank((ExactTwist(),), robot)
    if k < 6:
        moves = f"{m} joints" if m < 6 else f"{m} joints that move the tool in {k} directions"
        raise BadInput(
            "exact",
            f'"twist" of an arm with {moves}, which cannot follow a whole twist',
            "an arm that moves its tool in all six directions",
            'exact="position" follows the velocity of the tool point.',
        )


def row_rank(demands: tuple[Exact, ...], robot: Robot) -> int:
    """How many independent rows the arm can keep in its best state.

    A point of a hinge moves along one direction, one of a spherical wrist on a sphere, in every state: three exact rows
    are then one or two, and no singularity.
    """
    lower, upper = np.maximum(robot.position_lower, -np.pi), np.minimum(robot.position_upper, np.pi)
    rng = np.random.default_rng(0)
    best, rows = 0, ExactRows(np.zeros((1, len(lower))), np.zeros(1))
    for _ in range(STATES):
        q = rng.uniform(np.minimum(lower, upper), np.maximum(lower, upper))
        target = robot.target(robot.pose(q))
        rows = rows_of(demands, View(robot, robot.state(q, target), target, 1.0, np.zeros(6)))
        sizes = np.abs(rows.A)
        if rows.of_twist is not None:  # the size of the terms that A = D J sums
            sizes = np.maximum(sizes, np.abs(rows.of_twist).dot(np.abs(robot.jacobian(q))))
        joint = sizes.max(axis=0)  # hinges and slides have units of their own, and so have rows
        joint[joint == 0.0] = 1.0
        row = (sizes / joint).max(axis=1, keepdims=True)
        row[row == 0.0] = 1.0
        best = max(best, int(np.linalg.matrix_rank(rows.A / joint / row, tol=ROW_TOLERANCE)))
    return best


def rows_of(demands: tuple[Exact, ...], view: View, more: ExactRows | None = None) -> ExactRows:
    """All rows of one tick together, and `more`; there is at least one demand."""
    together = demands[0].rows(view)
    for demand in demands[1:]:
        together = together.with_rows(demand.rows(view))
    return together if more is None else together.with_rows(more)
