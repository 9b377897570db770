"""Limits on the joint velocity x of a tick: a box for the joints, rows on combinations of them, the speed of a point.

    Bounds       lower <= x <= upper
    JointBox     from position and velocity limits: lower = clip((q_min - q) / dt, -v_max, v_max), upper likewise
    LimitRows    lower <= C x <= upper
    ToolSpeed    |v + omega x p| <= limit, a second-order cone (250 mm/s beside a person)

Inside the position limits zero velocity is always allowed. Outside, the bounds lead back to the range: they are never
empty, and continuous.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.velocity.backends import UNBOUNDED

VECTOR = "a vector of limits, infinite where there is none"


def checked_bounds(lower: ArrayLike, upper: ArrayLike) -> tuple[Array, Array]:
    """Two vectors of limits with lower <= upper.

    Raises:
        BadInput: empty, of different lengths, NaN, or lower above upper (the joint is named).
    """
    low, high = arrays.array(lower, "lower", VECTOR), arrays.array(upper, "upper", VECTOR)
    pairs = zip(low.tolist(), high.tolist(), strict=True) if low.ndim == 1 and low.shape == high.shape != (0,) else None
    if pairs and all(a <= b and a < inf and b > -inf for a, b in pairs):  # faster than NumPy for a few
        return low, high
    for a, argument in ((low, "lower"), (high, "upper")):
        if a.ndim != 1 or len(a) == 0:
            raise BadInput(argument, f"shape {a.shape}", "one limit a joint: shape (m,), m >= 1")
        if np.isnan(a).any():
            raise BadInput(argument, f"NaN at index {int(np.isnan(a).argmax())}", "numbers, or +-inf for no limit")
    if low.shape != high.shape:
        raise BadInput("upper", f"{len(high)} limits", f"{len(low)}, one for each lower limit")
    crossed = low > high
    if crossed.any():
        i = int(crossed.argmax())
        found = f"lower {low[i]:g} above upper {high[i]:g} at joint {i}"
        raise BadInput("lower", found, "lower <= upper for every joint", "No velocity satisfies both.")
    raise BadInput("lower", "a lower limit of +inf or an upper limit of -inf", "a box with points in it")


def accelerations(value: ArrayLike, m: int, argument: str = "acceleration_limit") -> Array:
    """(m,) positive acceleration limits, inf where there is none; one number is every joint's."""
    a = arrays.array(value, argument, "numbers above zero")
    a = np.full(m, float(a)) if a.ndim == 0 else a.copy()
    if a.shape != (m,) or not (a > 0.0).all():  # NaN is not above zero either
        found = f"shape {a.shape}" if a.shape != (m,) else f"{a[~(a > 0.0)][0]:g} at joint {int((~(a > 0.0)).argmax())}"
        raise BadInput(argument, found, f"{m} limits above zero, inf where there is none, or one for all")
    return a


@frozen(init=False, eq=False, repr=False, slots=False)
class Bounds(Value):
    """Joint velocity limits, lower <= x <= upper."""

    lower: Array = field(converter=own)
    upper: Array = field(converter=own)

    def __init__(self, lower: ArrayLike, upper: ArrayLike) -> None:
        """Limits.

        Args:
            lower: (m,) [rad/s, length/s], -inf where there is none.
            upper: (m,) likewise, +inf where there is none.

        Raises:
            BadInput: empty, of different lengths, NaN, or lower above upper (the joint is named).
        """
        self.__attrs_init__(*checked_bounds(lower, upper))


def bounds_of(bounds: Bounds | tuple[ArrayLike, ArrayLike] | None, m: int) -> Bounds:
    """The bounds of m joints of an argument: `Bounds`, (lower, upper), or None for none.

    Raises:
        BadInput: neither of these, or of another number of joints.
    """
    if bounds is None:
        return Bounds(np.full(m, -np.inf), np.full(m, np.inf))
    if isinstance(bounds, (tuple, list)) and len(bounds) == 2:
        try:
            bounds = Bounds(*bounds)
        except BadInput as error:
            raise BadInput(f"bounds[{int(error.argument == 'upper')}]", error.found, error.expected) from error
    if not isinstance(bounds, Bounds):
        raise BadInput("bounds", type(bounds).__name__, "Bounds(lower, upper), (lower, upper), or None")
    if len(bounds.lower) != m:
        raise BadInput("bounds", f"{len(bounds.lower)} limits", f"{m}, one for each column of J")
    return bounds


@frozen(init=False, eq=False, repr=False, slots=False)
class JointBox(Value):
    """Velocity bounds that approach position limits at a rate, within the velocity limits.

        |x| <= v_max,     rate (lower - q) <= x <= rate (upper - q)

    At rate 1/dt joints reach the limits in a tick, and a lag or noise of encoders makes them chatter.

    Attributes:
        position_lower: (m,) [rad, length], -inf where there is none.
        position_upper: (m,).
        velocity_limit: (m,) [rad/s, length/s], positive, inf where there is none.
        rate: [1/s], at most 1/dt.
    """

    position_lower: Array = field(converter=own)
    position_upper: Array = field(converter=own)
    velocity_limit: Array = field(converter=own)
    rate: float

    def __init__(
        self, position_lower: Array, position_upper: Array, velocity_limit: Array, rate: float, margin: float = 0.0
    ) -> None:
        """From limits (m,) that are already checked [rad, length; per s], inf where there is none, and a rate [1/s].

        `margin`, less than half of any range, is subtracted from it; not for a locked joint.
        """
        low, high = position_lower, position_upper
        if margin:
            kept = np.where(high > low, margin, 0.0)
            low, high = low + kept, high - kept
        self.__attrs_init__(low, high, velocity_limit, rate)

    def at(self, q: Array) -> tuple[Array, Array]:
        """(lower, upper), each (m,), at joint positions q (m,)."""
        low, high = self._speeds(q)
        fastest = self.velocity_limit
        return np.minimum(np.maximum(low, -fastest), fastest), np.maximum(np.minimum(high, fastest), -fastest)

    def _speeds(self, q: Array) -> tuple[Array, Array]:
        """The velocities (m,) that lead to the position limits at the rate."""
        return self.rate * (self.position_lower - q), self.rate * (self.position_upper - q)

    def distances(self, q: Array) -> tuple[Array, Array]:
        """Distance (m,) to the upper and to the lower position limits [rad, length], negative outside."""
        return self.position_upper - q, q - self.position_lower


def braking_speed(distance: Array, acceleration: Array, dt: float, rate: float | None = None) -> Array:
    """The largest x >= 0 with D(x) <= distance, for each joint; inf where that is, 0 where it is negative.

        D(x) = dt (x + (x - a dt) + (x - 2 a dt) + ... ) + y / rate

    D is the stopping distance of a joint that moves at x in this tick, then brakes at a until its velocity y is so low
    that it can approach the limit at the rate [1/s]; without a rate the last tick covers the rest.
    """
    a = np.minimum(acceleration, UNBOUNDED)  # infinity times zero would be NaN
    k = 1.0 if rate is None else 1.0 / (rate * dt)  # ticks of the last part
    # Distance in units of a dt^2, of which n ticks of braking need n (n + 1) / 2.
    r = np.minimum(np.maximum(distance, 0.0), UNBOUNDED) / (a * dt * dt)
    n = np.maximum(np.ceil(np.sqrt(np.maximum(2.0 * r - k * k + k + 0.25, 0.0)) - k - 0.5), 0.0)
    return np.where(np.isinf(distance), np.inf, a * dt * (r + n * (0.5 * (n - 1.0) + k)) / (n + k))


@frozen(init=False, eq=False, repr=False, slots=False)
class LimitRows(Value):
    """lower <= C x <= upper: a coupling of joints, the distance to an obstacle, one direction of a point's velocity.

    Where bounds and rows are infeasible, the rows are relaxed by the least sum of squares, in units of their norms; the
    bounds never are.
    """

    C: Array = field(converter=own)
    lower: Array = field(converter=own)
    upper: Array = field(converter=own)
    names: tuple[str, ...] = ()

    def __init__(self, C: ArrayLike, lower: ArrayLike, upper: ArrayLike, names: Sequence[str] | str = ()) -> None:
        """Rows.

        Args:
            C: (k, m) rows on the joint velocity.
            lower: (k,), -inf where there is none.
            upper: (k,), +inf where there is none.
            names: (k,) names of the rows in reasons, "the cable" for instance; one name for a single row.

        Raises:
            BadInput: shapes that do not fit, NaN, lower above upper (the row is named), as many names as rows.
        """
        matrix = arrays.array(C, "C", "a (k, m) matrix")
        if matrix.ndim != 2 or 0 in matrix.shape:
            raise BadInput("C", f"shape {matrix.shape}", "(k, m), one row a limit")
        matrix = arrays.matrix(matrix, (None, matrix.shape[1]), "C")
        try:
            low, high = checked_bounds(lower, upper)
        except BadInput as error:
            raise BadInput(
                error.argument, error.found.replace("joint", "row"), "lower <= upper for each row"
            ) from error
        if len(low) != len(matrix):
            raise BadInput("lower", f"{len(low)} limits", f"{len(matrix)}, one for each row of C")
        given = (names,) if isinstance(names, str) and names else arrays.strings(names, "names")
        if given and len(given) != len(matrix):
            raise BadInput("names", f"{len(given)} names", f"{len(matrix)}, one for each row of C")
        self.__attrs_init__(matrix, low, high, given)

    @classmethod
    def trusted(cls, C: Array, lower: Array, upper: Array, names: Sequence[str] = ()) -> LimitRows:
        """Rows of valid float64 arrays that are not shared: nothing is checked or copied."""
        made = cls.__new__(cls)
        made.__setstate__({"C": C, "lower": lower, "upper": upper, "names": tuple(names)})
        return made

    def renamed(self, names: Sequence[str]) -> LimitRows:
        """The same rows with other names (k,)."""
        made = LimitRows.__new__(LimitRows)
        vars(made).update(vars(self), names=tuple(names))
        return made

    def excess(self, x: Array) -> Array:
        """(k,) excess of C x over the upper limit (positive) or under the lower one (negative); 0 inside."""
        y = self.C.dot(x)
        over, under = y - self.upper, y - self.lower
        return np.asarray(np.maximum(over, 0.0) + np.minimum(under, 0.0), dtype=np.float64)


@frozen(init=False, eq=False, repr=False, slots=False)
class ToolSpeed(Value):
    """The speed limit of a point of the tool; relaxed by the least where bounds or rows force it to move faster."""

    limit: float
    point: Array | None = field(converter=optional(own))

    def __init__(self, limit: float, point: ArrayLike | None = None) -> None:
        """A speed limit.

        Args:
            limit: [length/s], positive.
            point: (3,) in the frame of J for `solve_velocity`, in the tool frame for a controller; None is its point.

        Raises:
            BadInput: a limit that is not positive, a point that is none.
        """
        speed = arrays.number(limit, "limit", "a speed", positive=True)
        where = None if point is None else arrays.vector(point, 3, "point")
        self.__attrs_init__(speed, where)
