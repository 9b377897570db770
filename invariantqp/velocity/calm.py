"""What keeps a loop still where its target is out of reach: damping that follows what the twist misses.

    mu = CALM / 2 dt |b - A x| |A|

A velocity held for a tick of dt turns A by about dt |A x|, so what is missed comes back as a step that long: without
damping the loop rattles at full speed for ever. mu vanishes with what is missed, so nothing is lost where the twist can
be met, and it needs no second spectrum: it adds the same to every direction's weight.

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
CALM_WITH_ROWS = 0.5
# Below this share of |A|^2 it changes no digit that matters; what is above counts, so that it sets in without a jump.
QUIET_SHARE = 1e-6


def calm(A: Array, missed: Array, dt: float, factor: float) -> float:
    """mu >= 0 for measured joint twists A (6, n) and a measured twist (6,) that is missed, in ticks of dt [s]."""
    size = float(np.vdot(A, A))
    return max(0.0, 0.5 * factor * dt * sqrt(float(missed.dot(missed)) * size) - QUIET_SHARE * size)
