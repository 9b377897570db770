"""The speed along a path that is asked for in a tick, and what rules it.

    v = what was asked for, what limits allow here and ahead, or less: off the path, before a pause or a turn

With a jerk, the speed follows an S-curve (`time_law`).
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from invariantqp.control.path_orders import FASTEST
from invariantqp.control.path_plan import EASY_SHARE, PathPlan
from invariantqp.control.path_state import PathState
from invariantqp.control.time_law import Ramp
from invariantqp.geometry import arrays

# An S-curve stays below this share of what limits allow: at their edge joint accelerations leave no choice of speed.
SMOOTH_SHARE = 0.95
# Of the speed that its jerk allows to a tool at rest for a single tick, the share below which it is at rest.
RESTING = 1e-3
# A plan is for so much more than the rate: rounding must not rule it.
ABOVE_RATE = 1.0001
# What rules a tick where limits do not.
ON_TIME, OVERRIDDEN, ASTRAY = "the rate asked for", "the override", "the arm is off its path"


class Pace(NamedTuple):
    """How a path is meant to be driven."""

    dt: float  # tick [s]
    rate: float | None  # of the path's parameter [1/s]; None is as fast as limits allow
    acceleration: float  # along the path, inf where there is no limit
    jerk: float | None  # along the path; None is no limit

    @classmethod
    def of(cls, dt: float, rate: float | None, acceleration: float | None, jerk: float | None) -> Pace:
        """As a caller gives it.

        Raises:
            BadInput: a number that is not positive.
        """
        fast = None if rate is None else arrays.number(rate, "rate", "a rate in 1/s", positive=True)
        most = inf
        if acceleration is not None:
            most = arrays.number(acceleration, "acceleration", "an acceleration", positive=True)
        return cls(dt, fast, most, None if jerk is None else arrays.number(jerk, "jerk", "a jerk", positive=True))

    def overrides(self, override: float) -> tuple[float, float]:
        """Above and up to which overrides a plan is that suits one of them."""
        if self.rate is None:
            return -1.0, FASTEST
        return (1.0, FASTEST) if override > 1.0 else (-1.0, 1.0)

    def fastest(self, override: float) -> float:
        """The largest speed of such a plan, inf where that is limits' affair."""
        return inf if self.rate is None else ABOVE_RATE * self.overrides(override)[1] * self.rate

    @property
    def smooth(self) -> float | None:
        """The largest acceleration along the path where its jerk is limited; None where it is not."""
        return None if self.jerk is None else self.acceleration

    def speed(
        self,
        plan: PathPlan,
        state: PathState,
        place: float,
        *,
        near: float,
        override: float,
        stop: str,
        room: float = 1.0,
    ) -> tuple[float, float, str]:
        """The speed of this tick at a place, not negative, the largest that limits allow, and what rules it.

        `near` is the share of the speed for an arm this near its path, 0 to 1, `override` that of the speed asked for,
        `room` that of the joints' acceleration that is left to the path, and `stop` says why the tool is to come to
        rest, "" where it is not.
        """
        slow = sqrt(room)
        dt, back = self.dt, state.back
        part = slow * (min(1.0, override) if self.rate is None else 1.0)
        most_now = plan.speed(place, dt, slow, back=back)
        possible = most_now if part == slow else plan.speed(place, dt, part, back=back)
        wanted, ruling = possible, plan.ruling[plan.nearest(place)]
        if self.rate is not None and self.rate * override <= wanted:
            wanted, ruling = self.rate * override, ON_TIME
        elif part < slow:
            ruling = OVERRIDDEN
        if near < 1.0:
            wanted, ruling = near * wanted, ASTRAY
        if stop:
            wanted, ruling = 0.0, stop
        if self.jerk is None:
            most = state.speed + self.acceleration * dt
            least = max(state.speed - self.acceleration * dt, 0.0) if wanted < possible else 0.0
            return max(min(wanted, most), min(least, possible)), most_now, ruling
        ramp = Ramp(min(self.acceleration, EASY_SHARE * room * plan.braking), self.jerk)
        sign, part = -1.0 if back else 1.0, SMOOTH_SHARE * part
        a = ramp.next(
            state.speed,
            state.acceleration,
            min(wanted, SMOOTH_SHARE * possible),
            lambda ahead: part * plan.speeds(place + sign * ahead, back=back),
            dt,
            sign * (np.array(plan.at[::-1] if back else plan.at) - place),
        )
        v = max(state.speed + a * dt, 0.0)
        left = place - plan.start if back else plan.end - place
        crawl = 0.5 * self.jerk * dt * dt
        if max(v, state.speed) <= RESTING * crawl:  # an S-curve of ticks would go too far
            v = min(left / dt, wanted, crawl)
        return min(v, possible), most_now, ruling
