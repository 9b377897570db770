"""The speed of approach to a target: no faster than the joints can brake within their remaining distance.

    s = b gain e + feedforward,   b = min over joints of  v(d_i) / (gain d_i),   d_i = |x_i(e)| left for joint i
    v(d) = gain d            for d <= a / gain^2,     the loop's own exponential brakes at a or less
           sqrt(2 a d - a^2 / gain^2)      beyond,    braking at a meets it there with the same slope

And the direction of a turn: near half a turn a displacement has two logarithms; the loop keeps the one it has followed.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.damping import Adaptive, PaperLambda
from invariantqp.velocity.law import VelocityLaw
from invariantqp.velocity.limits import BrakingBox
from invariantqp.velocity.objective import least_squares, spectrum_of

# Share of the joints' acceleration that is used to brake along the joint distances; the rest is a reserve, since joint
# velocities vary along a straight motion of the tool.
BRAKING_SHARE = 0.5
# Of the distances: undamped ones near a singularity would be long.
DISTANCE_DAMPING = Adaptive(0.1, 0.1)
# Turns beyond this [rad] may keep the direction of the tick before.
HALF_TURN = 0.8 * pi


def distances(A: Array, error: Array) -> Array:
    """(n,) joint displacements for the whole error (6,), by measured joint twists A (6, n).

    They are damped: near singularities no joint travels long ones.
    """
    return least_squares(spectrum_of(A), error, None, DISTANCE_DAMPING).centre()


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


def share_of_gain(law: VelocityLaw, braking: BrakingBox, gain: float, A: Array, error: Array) -> float:
    """b for a law and its acceleration limits, 1 where its damping is [DS]'s; A (6, m) and error (6,) are measured."""
    if isinstance(law.damping, PaperLambda):
        return 1.0
    T = law.to_joint
    distance = distances(A, error) if T is None else T.dot(distances(A.dot(T), error))
    return braking_share(distance, braking.acceleration, gain)


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
