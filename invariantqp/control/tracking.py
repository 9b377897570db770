"""The twist that tracks a target: proportional feedback and feedforward; checks of gains, ticks and delays.

    s = gain log(T_target T^-1) + feedforward

Near half a turn a displacement has two logarithms; a loop keeps the branch of the last tick (`same_turn`).
"""

from __future__ import annotations

import warnings
from math import pi, sqrt
from sys import float_info

from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, in_percent
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import norm

# Default share of the error removed in a tick. A velocity held for dt leaves the path by half of acceleration times
# dt^2, and feedback keeps the sum to 1 / share of it: 25 micrometres at 5 m/s^2 and 1 ms.
TRACKING_SHARE = 0.1
# From this tick, delay or time constant on [s], times are probably in milliseconds, and gains shares of the error.
LONG_TIME = 1.0
# The longest tick [s] for which a gain is checked for being a share of the error.
SHORT_TICK = 0.02
# The default gain times delay; a loop of gain k and dead time d overshoots beyond k d = 1 / e.
DELAY_SHARE = 0.25
# Longest delay in ticks; a longer one is probably in milliseconds.
MOST_DELAY_TICKS = 10_000
# Twists above this have no finite square [rad/s; length/s].
LARGEST_TWIST = sqrt(float_info.max)
# Rotation errors above this [rad] keep the direction of the tick before.
NEAR_HALF_TURN = 0.8 * pi


def tracking_gain(gain: float | None, dt: float, delay: float = 0.0) -> float:
    """The gain [1/s]; None is a tenth of the error in a tick, or less with a delay [s] beyond one tick.

    Raises:
        BadInput: not positive, or above 1/dt.
    """
    if gain is not None:
        k = arrays.number(gain, "gain", positive=True)
        if k * dt > 1.0 + arrays.NEGLIGIBLE:
            raise BadInput("gain", f"{k:g} 1/s with dt = {dt:g} s", "at most 1/dt", "More overshoots.")
        return k
    default = TRACKING_SHARE / dt
    return default if delay == 0.0 else min(default, DELAY_SHARE / delay)


def warn_of_gain(gain: float, dt: float) -> None:
    """Warn of a gain [1/s] that looks like a share of the error in a tick of dt [s]."""
    if gain * LONG_TIME > 1.0 or dt > SHORT_TICK:
        return
    warnings.warn(
        f"gain={gain:g} is {gain:g} 1/s here: a tick of {dt:g} s closes {in_percent(gain * dt, 2)} % of the error. "
        f"Pink's gain={gain:g} closes {in_percent(gain)} % of it in a tick: that is gain={gain / dt:g} here (gain/dt)",
        UserWarning,
        stacklevel=3,
    )


def warn_of_times(dt: float, delay: float) -> None:
    """Warn of a tick or a delay [s] that looks like milliseconds, or a rate."""
    for name, seconds in (("dt", dt), ("delay", delay)):
        if seconds >= LONG_TIME:
            warnings.warn(
                f"{name}={seconds:g} is {seconds:g} s: {seconds:g} ms are {name}={1e-3 * seconds:g}"
                + (f", a rate of {seconds:g} Hz is dt={1.0 / seconds:.3g}" if name == "dt" else ""),
                UserWarning,
                stacklevel=3,
            )


def ticks_of_delay(delay: float, dt: float) -> tuple[int, float]:
    """A delay [s] in whole ticks, and the fraction of one more.

    Raises:
        BadInput: above 10 000 ticks.
    """
    ticks = delay / dt
    if ticks > MOST_DELAY_TICKS:
        raise BadInput("delay", f"{delay:g} s, {ticks:.0f} ticks", f"seconds, at most {MOST_DELAY_TICKS} ticks")
    whole = int(ticks + arrays.NEGLIGIBLE)  # quotients of decimals are nearly whole
    return whole, max(0.0, ticks - whole)


def tracking_twist(error: Array, gain: float | Array, feedforward: ArrayLike | None = None) -> Array:
    """(6,) commanded twist, base frame [rad/s; length/s]: a gain, or (6,) gains, times the error plus the feedforward.

    Raises:
        BadInput: a feedforward that is no twist; NaN or too large numbers in target or feedforward.
    """
    s = error * gain
    if not norm(s) < LARGEST_TWIST:  # also refuses NaN
        raise BadInput("target", "NaN, infinity, or numbers beyond any scale", "a rigid motion with finite numbers")
    if feedforward is not None:
        s += arrays.vector(feedforward, 6, "feedforward")
        if not norm(s) < LARGEST_TWIST:
            raise BadInput("feedforward", "numbers beyond any scale", "a twist in rad/s and lengths a second")
    return s


def same_turn(error: Array, before: Array | None) -> Array:
    """The logarithm (6,) of a displacement whose rotation agrees with the rotation vector (3,) of the tick before.

    `before` is NaN or None in the first tick.
    """
    if before is None:
        return error
    w = error[:3]
    angle = sqrt(float(w.dot(w)))
    if angle < NEAR_HALF_TURN or not before.dot(w) < 0.0:
        return error
    # The same displacement by the opposite rotation: same axis, same translation along it.
    axis, ratio = w / angle, (angle - 2.0 * pi) / angle
    slide = float(axis.dot(error[3:]))
    other: Array = ratio * error
    other[3:] += (1.0 - ratio) * slide * axis
    return other
