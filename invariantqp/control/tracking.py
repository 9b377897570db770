"""The twist that follows a target: feedback on the tool's error, and the target's own twist.

s = gain log(T_target T^-1) + feedforward
"""

from __future__ import annotations

from math import inf

from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array


def tracking_twist(error: Array, gain: float | Array, feedforward: ArrayLike | None = None) -> Array:
    """(6,) twist to ask for, base frame [rad/s; length/s].

    Args:
        error: (6,) the twist that takes the tool to its target in one unit of time, base frame.
        gain: [1/s], or (6,) of them.
        feedforward: (6,) twist of the target, base frame; None is a target at rest.

    Raises:
        BadInput: a feedforward that is no twist; a target with NaN or with numbers beyond any scale.
    """
    s = error * gain
    if feedforward is not None:
        s += arrays.vector(feedforward, 6, "feedforward")
    if not s.dot(s) < inf:  # NaN is not below infinity either
        raise BadInput("target", "NaN, infinity, or numbers beyond any scale", "a rigid motion with finite numbers")
    return s
