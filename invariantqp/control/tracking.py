"""The twist that follows a target: feedback on the tool's error, and the target's own twist.

s = gain log(T_target T^-1) + feedforward
"""

from __future__ import annotations

import warnings
from math import inf

from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array

# Share of the error removed in a tick where no gain is given. A velocity held for dt leaves the path by half of
# acceleration times dt^2 in every tick, and feedback holds that to 1 / share of it: 25 micrometres at 5 m/s^2 and 1 ms.
TRACKING_SHARE = 0.1
# The largest share of the error that a tick may remove: all of it, give or take the rounding of gain * dt.
WHOLE_ERROR = 1.0 + 1e-9
# A gain of at most this [1/s] beside a tick of at most this [s] takes a second or more to close an error, in 50 ticks
# or more: it is questioned, since other libraries' gains are shares of the error in a tick.
QUESTIONED_GAIN, QUESTIONED_TICK = 1.0, 0.02
# The largest gain times delay: a loop of gain k and dead time d overshoots beyond k d = 1 / e.
DELAY_SHARE = 0.25


def tracking_gain(gain: float | None, dt: float, delay: float = 0.0) -> float:
    """The gain [1/s]; None is a tenth of the error in a tick, or less where there is a delay [s] beyond one tick.

    Raises:
        BadInput: not positive, or above 1/dt.
    """
    if gain is not None:
        asked = arrays.number(gain, "gain", positive=True)
        if asked * dt > WHOLE_ERROR:
            raise BadInput("gain", f"{asked:g} 1/s with dt = {dt:g} s", "at most 1/dt", "More overshoots.")
        return asked
    usual = TRACKING_SHARE / dt
    return usual if delay == 0.0 else min(usual, DELAY_SHARE / delay)


def question_gain(gain: float, dt: float) -> None:
    """Warn of a gain [1/s] that looks like a share of the error in a tick of dt [s]."""
    if gain > QUESTIONED_GAIN or dt > QUESTIONED_TICK:
        return
    warnings.warn(
        f"gain={gain:g} is {gain:g} 1/s here: a tick of {dt:g} s closes {100.0 * gain * dt:.2g} % of the error. Pink's "
        f"gain={gain:g} closes {100.0 * gain:g} % of it in a tick: that is gain={gain / dt:g} here (gain/dt)",
        UserWarning,
        stacklevel=3,
    )


def tracking_twist(error: Array, gain: float | Array, feedforward: ArrayLike | None = None) -> Array:
    """(6,) twist to ask for, base frame [rad/s; length/s]: one gain or (6,) times the error, and the feedforward.

    Raises:
        BadInput: a feedforward that is no twist; a target with NaN or with numbers beyond any scale.
    """
    s = error * gain
    if feedforward is not None:
        s += arrays.vector(feedforward, 6, "feedforward")
    if not s.dot(s) < inf:  # NaN is not below infinity either
        raise BadInput("target", "NaN, infinity, or numbers beyond any scale", "a rigid motion with finite numbers")
    return s
