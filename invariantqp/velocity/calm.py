"""What keeps a loop still where its target is out of reach or near a singularity: damping by what a tick spoils.

    mu = CALM / 2 dt (|b - A x| + max(0, 1/4 dt |A| |x|^2 - |b|)) |A|

A velocity held for a tick of dt turns A by about dt |A x|, so what is missed comes back as a step that long, and what
is met is off by up to half of dt |A| |x|^2: where half of that is more than was asked for, a tick spoils what it mends.
Without damping the loop then rattles at full speed for ever. mu vanishes with both, so nothing is lost where the twist
can be met at speeds in proportion to it, and it needs no second spectrum: it adds the same to every direction's weight.

Reference: Sugihara 2011 (Levenberg-Marquardt, damping by the residual).
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from invariantqp.geometry.arrays import Array

# Measured on the stability problems and random tasks (`examples/14_defaults.py`): 1 is calm and creeps, a quarter is as
# calm and arrives as fast as without.
CALM = 0.25
# With exact rows what is left to the twist bends with them: twice as much.
CALM_WITH_ROWS = 0.25
# Of dt |A| |x|^2, half of which is the worst case: a half of that costs no accuracy at coarse ticks, and is as calm.
SPOILT = 0.25
# Below this share of |A|^2 it changes no digit that matters; what is above counts, so that it sets in without a jump.
QUIET_SHARE = 1e-9


def calm(A: Array, wanted: Array, achieved: Array, speed: float, dt: float, factor: float) -> float:
    """mu >= 0.

    Args:
        A: (6, n) measured joint twists.
        wanted: (6,) measured twist.
        achieved: (6,) A x.
        speed: |x|, but for what of it moves nothing.
        dt: tick [s].
        factor: in place of CALM.
    """
    size = sqrt(float(np.vdot(A, A)))
    r = wanted - achieved
    missed = sqrt(float(r.dot(r))) + spoilt(A, wanted, speed, dt)
    return max(0.0, 0.5 * factor * dt * missed * size - QUIET_SHARE * size * size)


def spoilt(A: Array, wanted: Array, speed: float, dt: float) -> float:
    """What a tick at `speed` bends of the motion beyond what was asked for, measured; 0 where it bends less."""
    size = sqrt(float(np.vdot(A, A)))
    return max(0.0, SPOILT * dt * size * speed * speed - sqrt(float(wanted.dot(wanted))))
