"""The speed along a path from tick to tick, with limited acceleration and jerk.

    dv/dt = a,   |da/dt| <= jerk,   -braking <= a <= acceleration

Each tick takes the largest a from which the speed can still be brought to zero within the same limits and below the
speed that the path allows at each place on the way (`PathPlan.speeds`). Speed, acceleration and place are therefore
smooth where the path allows it; where joint limits need more, they rule.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array

# Candidates for the acceleration of the next tick, between the least and the largest that the jerk allows.
CANDIDATES = 9
# Times at which a stop is compared with what the path allows.
SAMPLES = 24
# Rounding: a speed above what is allowed by this share is allowed.
ROUNDING = 1e-9


class Ramp(NamedTuple):
    """Limits of the speed along a path."""

    acceleration: float  # largest a
    jerk: float  # largest |da/dt|

    def next(
        self,
        v: float,
        a: float,
        wanted: float,
        allowed: Callable[[Array], Array],
        dt: float,
        corners: Array | None = None,
    ) -> float:
        """The acceleration of the next tick.

        Args:
            v: speed now, not negative.
            a: acceleration in the tick before.
            wanted: speed to reach, as soon as the limits allow.
            allowed: largest speeds (k,) at distances (k,) ahead.
            dt: tick [s].
            corners: (k,) distances ahead, increasing, at which what is allowed may dip; None where it is smooth.
        """
        least, most = max(a - self.jerk * dt, -self.acceleration), min(a + self.jerk * dt, self.acceleration)
        if least > most:  # the acceleration before was beyond its limit
            least = most = min(max(a, least), most)
        best = least
        for candidate in np.linspace(most, least, CANDIDATES).tolist():
            after = v + candidate * dt
            if after < 0.0:
                continue
            if self._settles(after, candidate, wanted) and self._stops(v * dt, after, candidate, allowed, corners):
                best = candidate
                break
        return best

    def _settles(self, v: float, a: float, wanted: float) -> bool:
        """Whether the speed ends at or below the wanted one when the acceleration is brought to zero from now on."""
        return v + 0.5 * a * abs(a) / self.jerk <= wanted * (1.0 + ROUNDING)

    def _stops(
        self, before: float, v: float, a: float, allowed: Callable[[Array], Array], corners: Array | None
    ) -> bool:
        """Whether a stop from v and a on is below what is allowed; `before` is the distance driven until then."""
        distance, speed = self.stop(v, a)
        distance += before
        if not (speed <= allowed(distance) * (1.0 + ROUNDING) + ROUNDING).all():
            return False
        if corners is None:
            return True
        inside = corners[(corners > distance[0]) & (corners < distance[-1])]
        squares = np.interp(inside, distance, speed * speed)
        return bool((np.sqrt(squares) <= allowed(inside) * (1.0 + ROUNDING) + ROUNDING).all())

    def stop(self, v: float, a: float) -> tuple[Array, Array]:
        """The shortest stop within the limits: distances and speeds (SAMPLES,) on the way."""
        J, B = self.jerk, self.acceleration
        # Jerk -J for t1, deceleration held for t2, jerk +J for t3 to v = a = 0.
        peak = sqrt(max(0.5 * a * a + J * v, 0.0))
        hold = 0.0
        if peak > B:
            peak = B
            hold = max((v + (0.5 * a * a - B * B) / J) / B, 0.0)
        t1, t3 = max((a + peak) / J, 0.0), peak / J
        ends = np.array((t1, t1 + hold, t1 + hold + t3))
        t = np.linspace(0.0, float(ends[-1]), SAMPLES)
        first, second = np.minimum(t, ends[0]), np.clip(t - ends[0], 0.0, hold)
        third = np.clip(t - ends[1], 0.0, t3)
        v1, a1 = v + a * t1 - 0.5 * J * t1 * t1, a - J * t1
        v2 = v1 + a1 * hold
        speed = v + a * first - 0.5 * J * first * first + a1 * second + a1 * third + 0.5 * J * third * third
        distance = (
            v * first
            + 0.5 * a * first**2
            - J * first**3 / 6.0
            + v1 * second
            + 0.5 * a1 * second**2
            + v2 * third
            + 0.5 * a1 * third**2
            + J * third**3 / 6.0
        )
        return distance, np.maximum(speed, 0.0)
