"""Exact demands of a controller; the rest of the twist is least squares.

    ExactTwist    (omega; v) = gain log(T_d T^-1) + twist_d              the whole twist
    ExactPoint    v + omega x p = gain (p_d - p) + v_d(p_d)              a point of the tool
    ExactAxis     omega without its part about the axis a                a direction of the tool
    ExactPlane    n.(v + omega x p) = gain n.(p_d - p) + n.v_d(p_d)      the height of a point over a plane
    ExactJoints   A x = b                                                a fixed combination of joint velocities

Each is rows on the joint velocity of a tick. Limits scale their speed and keep their direction.
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

# Number of random joint positions in which the rank of rows is measured: one that is not singular is enough.
RANK_SAMPLES = 4
# Singular values of scaled rows below this are rounding, of rounded numbers in a robot description too.
RANK_TOLERANCE = 1e-5


class View(NamedTuple):
    """The inputs of a demand in one tick.

    Attributes:
        robot: the arm.
        state: its state, from `robot.state`.
        target: the target of its tool, from `robot.target`.
        gain: tracking gain [1/s].
        feedforward: (6,) twist of the target, base frame.
    """

    robot: Robot
    state: RobotState
    target: Any
    gain: float
    feedforward: Array


# Demands given by a name.
Named = Literal["position", "twist"]


class Exact(Protocol):
    """A demand on the tool or the joints that is met exactly in every tick; the protocol for a demand of your own."""

    def rows(self, view: View) -> ExactRows:
        """The rows of this tick."""
        ...


@frozen(eq=False, repr=False, slots=False)
class ExactTwist(Value):
    """The whole twist is exact: limits scale its speed, and the tool stays on the same screw.

    The arm must move its tool in all six directions. The tool stops while the twist pushes a joint against its position
    limit, and before the arm is singular.
    """

    def rows(self, view: View) -> ExactRows:
        """The angular velocity and the velocity at the base origin, six rows."""
        twist = view.gain * view.state.error + view.feedforward
        return ExactRows.of(view.state.J, np.eye(6), twist)


@frozen(init=False, eq=False, repr=False, slots=False)
class ExactPoint(Value):
    """A point of the tool tracks its target exactly.

    Attributes:
        point: (3,) in the tool frame [length]; its origin by default.
    """

    point: Array = field(converter=own)

    def __init__(self, point: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """See the attributes."""
        self.__attrs_init__(arrays.vector(point, 3, "point"))

    def rows(self, view: View) -> ExactRows:
        """The velocity of the point, three rows."""
        p, target = view.robot.points(view.state, view.target, self.point)
        b = view.gain * (target - p) + velocity_at(view.feedforward, target)
        return ExactRows.point(view.state.J, p, b)


@frozen(init=False, eq=False, repr=False, slots=False)
class ExactAxis(Value):
    """A direction of the tool tracks its target exactly; the rotation about it is free.

    Attributes:
        axis: (3,) unit direction in the tool frame.
    """

    axis: Array = field(converter=own)

    def __init__(self, axis: ArrayLike) -> None:
        """A direction (3,) in the tool frame, of any length but zero."""
        self.__attrs_init__(arrays.direction(axis, "axis"))

    def rows(self, view: View) -> ExactRows:
        """The angular velocity perpendicular to the axis, two rows."""
        origins = view.robot.points(view.state, view.target, np.zeros(3))
        tips = view.robot.points(view.state, view.target, self.axis)
        axis, target_axis = tips[0] - origins[0], tips[1] - origins[1]
        rotation = shortest_turn(axis, target_axis)
        return ExactRows.axis(view.state.J, axis, view.gain * rotation + view.feedforward[:3])


@frozen(init=False, eq=False, repr=False, slots=False)
class ExactPlane(Value):
    """A point of the tool keeps its target's height over a plane exactly; its motion along the plane is free.

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
        p, target = view.robot.points(view.state, view.target, self.point)
        speed = n.dot(view.gain * (target - p) + velocity_at(view.feedforward, target))
        return ExactRows.plane(view.state.J, p, n, float(speed))


@frozen(init=False, eq=False, repr=False, slots=False)
class ExactJoints(Value):
    """A fixed combination of joint velocities, A x = b; b = 0 keeps A q constant.

    Attributes:
        A: (k, m).
        b: (k,) [rad/s, length/s].
    """

    A: Array = field(converter=own)
    b: Array = field(converter=own)

    def __init__(self, A: ArrayLike, b: ArrayLike = 0.0) -> None:
        """See the attributes; A is also (m,) for one row, b one number for all rows."""
        rows = arrays.array(A, "A", "a (k, m) matrix")
        rows = rows.reshape(1, -1) if rows.ndim == 1 else rows
        demands = arrays.array(b, "b", "k numbers")
        if demands.ndim == 0 and rows.ndim == 2:
            demands = np.full(len(rows), float(demands))
        checked = ExactRows(rows, demands)
        self.__attrs_init__(np.asarray(checked.A), np.asarray(checked.b))

    def rows(self, view: View) -> ExactRows:
        """The rows A, b."""
        m = len(view.robot.names)
        if self.A.shape[1] != m:
            raise BadInput("exact", f"rows on {self.A.shape[1]} joints", f"rows on {m}, one for each joint")
        return ExactRows(self.A, self.b)


def demand_fields(demands: tuple[Exact, ...]) -> tuple[tuple[str, Any, Any], ...] | None:
    """The demands as the engine takes them; None if one is the user's own, whose rows are called for in each tick."""
    fields: list[tuple[str, Any, Any]] = []
    for demand in demands:
        if type(demand) is ExactTwist:
            fields.append(("twist", None, None))
        elif type(demand) is ExactPoint:
            fields.append(("point", demand.point, None))
        elif type(demand) is ExactAxis:
            fields.append(("axis", demand.axis, None))
        elif type(demand) is ExactPlane:
            fields.append(("plane", demand.point, demand.normal))
        elif type(demand) is ExactJoints:
            fields += [("joints", row, float(b)) for row, b in zip(demand.A, demand.b, strict=True)]
        else:
            return None
    return tuple(fields)


def require_rows(rows: object, m: int) -> None:
    """Raise BadInput for anything but exact rows on m joints."""
    if not isinstance(rows, ExactRows):
        raise BadInput("rows", excerpt(rows), "ExactRows(A, b)")
    if np.shape(rows.A)[1] != m:
        raise BadInput("rows", f"rows on {np.shape(rows.A)[1]} joints", f"rows on {m}, one for each joint")


def demands_of(exact: Exact | ExactRows | Sequence[Exact | ExactRows | Named] | Named | None) -> tuple[Exact, ...]:
    """The argument exact= as demands.

    "position" is an ExactPoint at the tool frame's origin, "twist" an ExactTwist, ExactRows are ExactJoints.
    """
    if exact is None:
        return ()
    by_name: dict[str, Exact] = {"position": ExactPoint(), "twist": ExactTwist()}
    demands: list[Exact] = []
    for one in exact if isinstance(exact, (list, tuple)) else (exact,):
        demand: Any = by_name.get(one, one) if isinstance(one, str) else one
        if isinstance(demand, type) or not (isinstance(demand, ExactRows) or hasattr(demand, "rows")):
            expected = '"position", "twist", an ExactPoint, ExactAxis, ExactRows, ... or several of them'
            raise BadInput("exact", excerpt(demand), expected)
        demands.append(ExactJoints(demand.A, demand.b) if isinstance(demand, ExactRows) else demand)
    return tuple(demands)


def require_all_directions(demands: tuple[Exact, ...], robot: Robot) -> None:
    """Raise BadInput for an ExactTwist on an arm that does not move its tool in all six directions."""
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
    """The largest rank of the rows over random joint positions; a lower rank in a tick is a singularity.

    A point of a single hinge moves along one direction in every state: its three rows have rank one.
    """
    lower, upper = np.maximum(robot.position_lower, -np.pi), np.minimum(robot.position_upper, np.pi)
    rng = np.random.default_rng(0)
    rank = 0
    for _ in range(RANK_SAMPLES):
        q = rng.uniform(np.minimum(lower, upper), np.maximum(lower, upper))
        target = robot.target(robot.pose(q))
        rows = rows_of(demands, View(robot, robot.state(q, target), target, 1.0, np.zeros(6)))
        sizes = np.abs(rows.A)
        if rows.of_twist is not None:  # the size of the terms that A = D J sums
            sizes = np.maximum(sizes, np.abs(rows.of_twist).dot(np.abs(robot.jacobian(q))))
        columns = sizes.max(axis=0)  # scaled: hinges, slides and rows have different units
        columns[columns == 0.0] = 1.0
        scales = (sizes / columns).max(axis=1, keepdims=True)
        scales[scales == 0.0] = 1.0
        rank = max(rank, int(np.linalg.matrix_rank(rows.A / columns / scales, tol=RANK_TOLERANCE)))
    return rank


def rows_of(demands: tuple[Exact, ...], view: View, more: ExactRows | None = None) -> ExactRows:
    """The rows of at least one demand in a tick, and `more`."""
    rows = demands[0].rows(view)
    for demand in demands[1:]:
        rows = rows.with_rows(demand.rows(view))
    return rows if more is None else rows.with_rows(more)
