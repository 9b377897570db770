"""The twist that follows a target: feedback on the tool's error, and the target's own; gains, times and delays.

    s = gain log(T_target T^-1) + feedforward

Near half a turn a displacement has two logarithms; a loop keeps the one that it has followed (`same_turn`).
"""

from __future__ import annotations

import warnings
from math import pi, sqrt

from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import norm

# Share of the error removed in a tick where no gain is given. A velocity held for dt leaves the path by half of
# acceleration times dt^2 in every tick, and feedback holds that to 1 / share of it: 25 micrometres at 5 m/s^2 and 1 ms.
TRACKING_SHARE = 0.1
# A tick or a delay of a second or more is none of an arm: milliseconds, or a rate, are questioned [s]. So is a gain by
# which an error takes as long, in ticks of at most the second, hence 50 or more: other gains are shares of it in
# a tick.
QUESTIONED_TIME, QUESTIONED_TICK = 1.0, 0.02
# The largest gain times delay: a loop of gain k and dead time d overshoots beyond k d = 1 / e.
DELAY_SHARE = 0.25
# A robot that is later than this many ticks is none: a delay in milliseconds, say.
MOST_LATE = 10_000
# A twist as large as this has no finite square [rad/s; length/s].
BEYOND = 1e154
# Turns beyond this [rad] may keep the direction of the tick before.
HALF_TURN = 0.8 * pi


def tracking_gain(gain: float | None, dt: float, delay: float = 0.0) -> float:
    """The gain [1/s]; None is a tenth of the error in a tick, or less where there is a delay [s] beyond one tick.

    Raises:
        BadInput: not positive, or above 1/dt.
    """
    if gain is not None:
        asked = arrays.number(gain, "gain", positive=True)
        if asked * dt > 1.0 + arrays.NEGLIGIBLE:  # a tick removes all of the error, at most
            raise BadInput("gain", f"{asked:g} 1/s with dt = {dt:g} s", "at most 1/dt", "More overshoots.")
        return asked
    usual = TRACKING_SHARE / dt
    return usual if delay == 0.0 else min(usual, DELAY_SHARE / delay)


def question_gain(gain: float, dt: float) -> None:
    """Warn of a gain [1/s] that looks like a share of the error in a tick of dt [s]."""
    if gain * QUESTIONED_TIME > 1.0 or dt > QUESTIONED_TICK:
        return
    warnings.warn(
        f"gain={gain:g} is {gain:g} 1/s here: a tick of {dt:g} s closes {100.0 * gain * dt:.2g} % of the error. Pink's "
        f"gain={gain:g} closes {100.0 * gain:g} % of it in a tick: that is gain={gain / dt:g} here (gain/dt)",
        UserWarning,
        stacklevel=3,
    )


def question_times(dt: float, delay: float) -> None:
    """Warn of a tick or a delay [s] that looks like milliseconds, or a rate."""
    for name, seconds in (("dt", dt), ("delay", delay)):
        if seconds >= QUESTIONED_TIME:
            warnings.warn(
                f"{name}={seconds:g} is {seconds:g} s: {seconds:g} ms are {name}={1e-3 * seconds:g}"
                + (f", a rate of {seconds:g} Hz is dt={1.0 / seconds:.3g}" if name == "dt" else ""),
                UserWarning,
                stacklevel=3,
            )


def ticks_late(delay: float, dt: float) -> tuple[int, float]:
    """A delay in ticks: the whole ones, and the share of one more."""
    late = delay / dt
    if late > MOST_LATE:
        raise BadInput("delay", f"{delay:g} s, {late:.0f} ticks", f"seconds, at most {MOST_LATE} ticks")
    whole = int(late + arrays.NEGLIGIBLE)  # quotients of decimals are nearly whole
    return whole, max(0.0, late - whole)


def tracking_twist(error: Array, gain: float | Array, feedforward: ArrayLike | None = None) -> Array:
    """(6,) twist to ask for, base frame [rad/s; length/s]: one gain or (6,) times the error, and the feedforward.

    Raises:
        BadInput: a feedforward that is no twist; a target with NaN or with numbers beyond any scale, or a feedforward.
    """
    s = error * gain
    if not norm(s) < BEYOND:  # NaN is not below it either
        raise BadInput("target", "NaN, infinity, or numbers beyond any scale", "a rigid motion with finite numbers")
    if feedforward is not None:
        s += arrays.vector(feedforward, 6, "feedforward")
        if not norm(s) < BEYOND:
            raise BadInput("feedforward", "numbers beyond any scale", "a twist in rad/s and lengths a second")
    return s


def same_turn(error: Array, before: Array | None) -> Array:
    """The logarithm (6,) of a displacement that turns as `before` does, the (3,) rotation vector of the tick before.

    `before` is NaN or None where there was none.
    """
    if before is None:
        return error
    w = error[:3]
    angle = sqrt(float(w.dot(w)))
    if angle < HALF_TURN or not before.dot(w) < 0.0:
        return error
    # The same displacement turning in the other direction: same axis, same translation along it.
    axis, ratio = w / angle, (angle - 2.0 * pi) / angle
    slide = float(axis.dot(error[3:]))
    other: Array = ratio * error
    other[3:] += (1.0 - ratio) * slide * axis
    return other
