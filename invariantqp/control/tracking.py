"""The twist that follows a target: feedback on the tool's error, no faster than joints can brake, and the target's own.

    s = b gain log(T_target T^-1) + feedforward,   b = min over joints of  v(d_i) / (gain d_i)
    v(d) = gain d            for d <= a / gain^2,     the loop's own exponential brakes at a or less
           sqrt(2 a d - a^2 / gain^2)      beyond,    braking at a meets it there with the same slope

d_i = |x_i(e)| is what is left for joint i. Near half a turn a displacement has two logarithms; the loop keeps the one
that it has followed.

Where a target is out of reach, what is left is no error but the way to where the error is least, and near a stretched
arm joints are fast there while the tool is not. So a joint that goes on at its velocity keeps room to brake until then,
as before a position limit. With c = x_before - x(feedforward), after a time t about

    1/2 |e - t A c - 1/2 t^2 R b|^2 is least:   t = (|e'A c| + slack |A c|) / (|A c|^2 + max(0, -e'R b))

where A = R J is measured, b = sum over j < i of c_j c_i [J_j, J_i] is how the twist J c turns, and an error within
slack may stay. |x_i - x_i(feedforward)| is then at most the speed from which joint i brakes within t |c_i|: a bound
that is continuous in e and c, whichever way the error changes.
"""

from __future__ import annotations

import warnings
from math import inf, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import lie, norm
from invariantqp.legacy.damping import Adaptive, PaperLambda
from invariantqp.legacy.law import Demand, VelocityLaw
from invariantqp.legacy.objective import least_squares, spectrum_of
from invariantqp.velocity.limits import BrakingBox, braking_speed

# Share of the error removed in a tick where no gain is given. A velocity held for dt leaves the path by half of
# acceleration times dt^2 in every tick, and feedback holds that to 1 / share of it: 25 micrometres at 5 m/s^2 and 1 ms.
TRACKING_SHARE = 0.1
# A tick or a delay of a second or more is none of an arm: milliseconds, or a rate, are questioned [s]. So is a gain by
# which an error takes as long, in ticks of at most the second, hence 50 or more: other gains are shares of it in
# a tick.
QUESTIONED_TIME, QUESTIONED_TICK = 1.0, 0.02
# The largest gain times delay: a loop of gain k and dead time d overshoots beyond k d = 1 / e.
DELAY_SHARE = 0.25
# Share of the joints' acceleration that is used to brake along the joint distances; the rest is a reserve, since joint
# velocities vary along a straight motion of the tool.
BRAKING_SHARE = 0.5
# Of the distances: undamped ones near a singularity would be long.
DISTANCE_DAMPING = Adaptive(0.1, 0.1)
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


def braking_share(distance: Array, acceleration: Array, gain: float) -> float:
    """b in (0, 1]: the share of gain e [1/s] from which the joints can still brake before the target.

    Distances (m,) are those for the whole error [rad, length]; accelerations (m,) inf where there is no limit.
    """
    d, a = np.abs(distance), BRAKING_SHARE * acceleration
    knee = a / (gain * gain)
    far = d > knee
    if not far.any():
        return 1.0
    d, a, knee = d[far], a[far], knee[far]
    share: Array = np.sqrt(a * (2.0 * d - knee)) / (gain * d)
    return min(1.0, float(share.min()))


class Approach(NamedTuple):
    """How fast a loop with acceleration limits approaches its target."""

    share: float  # b, of the gain
    lower: Array  # (m,) joint velocities from which joints brake before the error is least, -inf where there is none
    upper: Array  # (m,) likewise

    def within(self, demand: Demand) -> Demand:
        """The demand with these bounds; beside rows of limits, which may ask joints to go on, as it is."""
        if demand.rows is not None:
            return demand
        lower = np.minimum(np.maximum(demand.lower, self.lower), demand.upper)
        upper = np.maximum(np.minimum(demand.upper, self.upper), demand.lower)
        return demand._replace(lower=lower, upper=upper)


def approach(
    law: VelocityLaw,
    braking: BrakingBox,
    gain: float,
    slack: float,
    J: Array,
    root: Array,
    error: Array,
    feedforward: Array,
    before: Array,
) -> Approach | None:
    """The approach for a law and its acceleration limits; None where its damping is [DS]'s.

    Args:
        law: of the loop.
        braking: its limits.
        gain: of the error [1/s].
        slack: a measured error that may stay [length].
        J: (6, m) joint twists.
        root: (6, 6) of the measure.
        error: (6,) twist that leads to the target.
        feedforward: (6,) the target's own twist.
        before: (m,) the joint velocity now.
    """
    if isinstance(law.damping, PaperLambda):
        return None
    A, e, T = root.dot(J), root.dot(error), law.to_joint
    spectrum = spectrum_of(A if T is None else A.dot(T))
    # Damped: near singularities no joint travels long distances.
    distance = least_squares(spectrum, e, None, DISTANCE_DAMPING).centre()
    follows = least_squares(spectrum, root.dot(feedforward), None, law.damping).centre()
    if T is not None:
        distance, follows = T.dot(distance), T.dot(follows)
    a, dt = braking.acceleration, braking.dt
    c = before - follows
    size, moves, most = np.abs(c), c != 0.0, np.full(len(c), inf)
    slower = np.maximum(size - dt * a, dt * a)  # a joint that can stop in a tick needs no room
    room = time_to_least(J, root, e, c, slack) * size[moves]
    most[moves] = np.maximum(braking_speed(room, BRAKING_SHARE * a[moves], dt), slower[moves])
    lower, upper = np.where(c < 0.0, follows - most, -inf), np.where(c > 0.0, follows + most, inf)
    return Approach(braking_share(distance, a, gain), lower, upper)


def time_to_least(J: Array, root: Array, e: Array, c: Array, slack: float) -> float:
    """t [s] until the measured error e (6,) is least, or greatest, while joints go on at c (m,); inf where it stays."""
    twist, bend = np.zeros(6), np.zeros(6)
    for column in (J * c).T:
        bend += lie(twist, column)
        twist += column
    moved = root.dot(twist)
    change = float(moved.dot(moved)) + max(0.0, -float(e.dot(root.dot(bend))))
    return (abs(float(e.dot(moved))) + slack * norm(moved)) / change if change > 0.0 else inf


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
