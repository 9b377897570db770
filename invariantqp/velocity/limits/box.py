"""Joint limits as one box on the joint velocity: lower <= x <= upper. It depends on no frame.

    lower = clip((q_min - q) / dt, -v_max, v_max),    upper = clip((q_max - q) / dt, -v_max, v_max)

Inside the position limits zero is always allowed. Outside, the box is the velocity limit towards the range: it is never
empty and has no jump.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf
from typing import Any

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own

# How far outside its position range a joint is told to be [rad, length]; less is rounding and noise of encoders.
OUTSIDE = 1e-3
LIMITS = "a vector of limits, infinite where there is none"


def between(lower: ArrayLike, upper: ArrayLike) -> tuple[Array, Array]:
    """Two vectors of limits with a point between them.

    Raises:
        BadInput: empty, of different lengths, NaN, or lower above upper (the joint is named).
    """
    low, high = arrays.array(lower, "lower", LIMITS), arrays.array(upper, "upper", LIMITS)
    pairs = zip(low.tolist(), high.tolist(), strict=True) if low.ndim == 1 and low.shape == high.shape != (0,) else None
    if pairs and all(a <= b and a < inf and b > -inf for a, b in pairs):  # sooner than numpy for a few
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


def accelerations(value: ArrayLike, m: int) -> Array:
    """(m,) positive acceleration limits, inf where there is none; one number is every joint's."""
    a = arrays.array(value, "acceleration_limit", "numbers above zero")
    a = np.full(m, float(a)) if a.ndim == 0 else a.copy()
    if a.shape != (m,) or not (a > 0.0).all():  # NaN is not above zero either
        found = f"shape {a.shape}" if a.shape != (m,) else f"{a[~(a > 0.0)][0]:g} at joint {int((~(a > 0.0)).argmax())}"
        raise BadInput("acceleration_limit", found, f"{m} limits above zero, inf where there is none, or one for all")
    return a


@frozen(init=False, eq=False, repr=False, slots=False)
class Bounds(Value):
    """Joint velocity limits, lower <= x <= upper.

    Attributes:
        lower: (m,) [rad/s, length/s], -inf where there is none.
        upper: (m,) likewise, +inf where there is none.
    """

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
        self.__attrs_init__(*between(lower, upper))


def bounds_of(bounds: Bounds | tuple[ArrayLike, ArrayLike] | None, m: int) -> Bounds:
    """The bounds of m joints for an argument: `Bounds`, (lower, upper), or None for none.

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
    """The box that keeps q + x dt inside its limits at |x| <= v_max, or moves it back there.

    Attributes:
        position_lower: (m,) [rad, length], -inf where there is none.
        position_upper: (m,).
        velocity_limit: (m,) [rad/s, length/s], positive, inf where there is none.
        dt: [s].
    """

    position_lower: Array = field(converter=own)
    position_upper: Array = field(converter=own)
    velocity_limit: Array = field(converter=own)
    dt: float
    # Precomputed, so that a tick only subtracts and clips.
    _rate: Array = field(converter=own, eq=False, repr=False)
    _low: Array = field(converter=own, eq=False, repr=False)
    _high: Array = field(converter=own, eq=False, repr=False)
    _slowest: Array = field(converter=own, eq=False, repr=False)
    _least: list[float] = field(eq=False, repr=False)
    _most: list[float] = field(eq=False, repr=False)

    def __init__(
        self, position_lower: Array, position_upper: Array, velocity_limit: Array, dt: float, margin: float = 0.0
    ) -> None:
        """From limits (m,) that are already checked [rad, length; per s], inf where there is none, for ticks of dt [s].

        `margin` is kept from position limits; a range too short for it shrinks to its middle.
        """
        low, high = position_lower, position_upper
        if margin:
            kept = np.minimum(margin, 0.5 * (high - low))
            low = low + kept
            high = np.maximum(high - kept, low)
        rate = np.full(len(velocity_limit), 1.0 / dt)
        ends = low.tolist(), high.tolist()
        self.__attrs_init__(low, high, velocity_limit, dt, rate, low / dt, high / dt, -velocity_limit, *ends)

    def at(self, q: Array) -> tuple[Array, Array]:
        """(lower, upper), each (m,), at joint positions q (m,)."""
        place = q * self._rate
        back, ahead = self._slowest, self.velocity_limit
        lower = np.minimum(np.maximum(self._low - place, back), ahead)
        upper = np.maximum(np.minimum(self._high - place, ahead), back)
        return lower, upper

    def placed(self, q: Array) -> tuple[Array, Array]:
        """(lower, upper), each (m,), by the position limits alone; not above what leads back from outside in time."""
        place = q * self._rate
        return np.minimum(self._low - place, self.velocity_limit), np.maximum(self._high - place, self._slowest)

    def outside(self, q: ArrayLike, joints: Iterable[int]) -> tuple[tuple[int, str], ...]:
        """Those of some joints that are outside their range by more than rounding and encoders make of a limit."""
        x: Any = q
        far = ((i, max(x[i] - self._most[i], self._least[i] - x[i])) for i in joints)
        return tuple((i, f"{distance:.3g} outside its position range") for i, distance in far if distance > OUTSIDE)

    def room(self, q: Array) -> tuple[Array, Array]:
        """Distance (m,) to the upper and to the lower position limits [rad, length], negative outside."""
        return self.position_upper - q, q - self.position_lower
