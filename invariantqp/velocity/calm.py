"""Damping that brings a loop to rest where its target is out of reach or near a singularity.

    mu = CALM / 2 dt (|b - A x| + max(0, 1/4 dt |A| |x|^2 - |b|)) |A|

A velocity x held for a tick dt changes A by up to about dt |A| |x|. This has two effects that a single tick ignores:
a residual |b - A x| asks for another velocity in the next tick, and the motion differs from dt A x by up to
1/2 dt^2 |A| |x|^2. Where either is large the loop overshoots and oscillates at full speed. The second one counts where
half of that difference, per unit of time, exceeds the twist itself. mu is zero where the twist is met at moderate joint
speeds, so such ticks are unchanged. It adds the same to the weight of every direction, so no second singular value
decomposition is needed.

Reference: Sugihara 2011 (Levenberg-Marquardt, damping by the residual).
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import norm

# Measured on the stability problems and random tasks (`examples/14_defaults.py`): with 1 loops come to rest but slowly;
# with 0.25 they come to rest too, and arrive as fast as without this damping.
CALM = 0.25
# Share of dt |A| |x|^2 that is compared with the twist. 0.5 is the largest possible deviation; measured: 0.25 loses no
# accuracy with long ticks, and loops come to rest as well.
DEVIATION_SHARE = 0.25
# mu below this share of |A|^2 changes no digit that matters; it is subtracted, so that mu sets in without a jump.
QUIET_SHARE = 1e-9


def calm(A: Array, wanted: Array, achieved: Array, speed: float, dt: float, factor: float) -> float:
    """mu >= 0 for measured joint twists A (6, n), the measured twist (6,) and A x (6,), in a tick of dt [s].

    `speed` is |x| without its part that moves nothing; `factor` stands in place of CALM.
    """
    size = sqrt(float(np.vdot(A, A)))
    error = norm(wanted - achieved) + excess_deviation(A, wanted, speed, dt)
    return max(0.0, 0.5 * factor * dt * error * size - QUIET_SHARE * size * size)


def excess_deviation(A: Array, wanted: Array, speed: float, dt: float) -> float:
    """How far the motion of a tick at `speed` deviates from A x beyond the size of the twist; 0 where it does not."""
    size = sqrt(float(np.vdot(A, A)))
    return max(0.0, DEVIATION_SHARE * dt * size * speed * speed - norm(wanted))
