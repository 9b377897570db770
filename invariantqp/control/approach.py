"""How fast the tool may come to its target: no faster than the joints can brake on what is left of the way.

    s = b gain e + feedforward,   b = min over joints of  v(d_i) / (gain d_i),   d_i = |x_i(e)| what joint i has to go
    v(d) = gain d            for d <= a / gain^2,     the loop's own exponential brakes at a or less
           sqrt(2 a d - a^2 / gain^2)      beyond,    braking at a meets it there with the same slope

And which way round: a turn by nearly pi has two logarithms, and the one that the loop has followed so far is kept.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np

from invariantqp.geometry.arrays import Array

# Of the joints' acceleration, what braking for a straight way of the tool may count on: the rest is for what joints
# need beyond it, since their way is not straight.
BRAKING_SHARE = 0.5
# A turn beyond this has another logarithm near enough to be the one followed so far [rad].
HALF_TURN = 0.8 * pi


def braking_share(way: Array, acceleration: Array, gain: float) -> float:
    """b in (0, 1]: how much of gain e the joints can brake from.

    Args:
        way: (m,) what each joint has to go for the whole error [rad, length].
        acceleration: (m,) limits [rad/s^2, length/s^2], inf where there is none.
        gain: [1/s].
    """
    d, a = np.abs(way), BRAKING_SHARE * acceleration
    knee = a / (gain * gain)
    far = d > knee
    if not far.any():
        return 1.0
    d, a, knee = d[far], a[far], knee[far]
    share: Array = np.sqrt(a * (2.0 * d - knee)) / (gain * d)
    return min(1.0, float(share.min()))


def same_way(error: Array, before: Array | None) -> Array:
    """The logarithm of the same displacement that turns the way the last one did.

    Args:
        error: (6,) twist that takes the tool to its target in unit time, of the shorter turn.
        before: (3,) rotation vector of the tick before, or None.
    """
    if before is None:
        return error
    w = error[:3]
    angle = sqrt(float(w.dot(w)))
    if angle < HALF_TURN or before.dot(w) >= 0.0:
        return error
    # The same screw the other way round: the axis stays, so does the slide along it.
    axis, ratio = w / angle, (angle - 2.0 * pi) / angle
    slide = float(axis.dot(error[3:]))
    other: Array = ratio * error
    other[3:] += (1.0 - ratio) * slide * axis
    return other
