"""The twist that follows a target: feedback on the tool's error, and the target's own.

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

from math import inf
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import lie, norm
from invariantqp.legacy.damping import Adaptive, PaperLambda
from invariantqp.legacy.law import Demand, VelocityLaw
from invariantqp.legacy.objective import least_squares, spectrum_of
from invariantqp.velocity.limits import BrakingBox, braking_speed

# Share of the joints' acceleration that is used to brake along the joint distances; the rest is a reserve, since joint
# velocities vary along a straight motion of the tool.
BRAKING_SHARE = 0.5
# Of the distances: undamped ones near a singularity would be long.
DISTANCE_DAMPING = Adaptive(0.1, 0.1)


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
