"""What noise takes of the joints' acceleration through the force law, and the gain at which that is half of it.

    share = max over joints j of   ABOVE factor sigma |x_j| / (a_j dt)        J x = A (I - P) C (I - P)' for each force

sigma is that of the change of a smoothed force component from tick to tick. The motion along the contact, a path's
above all, has what is left: where both ask for more than there is, the force is exact and the tool leaves its path.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.errors import written
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.measure import root_at

# Changes are reckoned with up to so many standard deviations.
ABOVE = 1.5
# The most that noise may take.
MOST = 0.5
# A gain that is lowered for that below this share of itself is told.
LOWERED = 0.5
# Joints without a limit have this multiple of the largest.
FREE = 10.0
# Below this ratio of singular values joints are not asked for a motion.
SINGULAR = 1e-2


def trembling(
    loop: Controller, J: Array, admittance: Array, place: Array, size: float, noise: float, passed: float
) -> float:
    """The share of the joints' acceleration that noise takes for each unit of the force law's factor.

    Args:
        loop: whose acceleration limits hold.
        J: (6, m) joint twists.
        admittance: (6, 6) from a wrench in the contact's frame to a twist in the base frame.
        place: (3,) of contact, base frame.
        size: of the contact [length].
        noise: standard deviation of a force component [force].
        passed: share of a step that the low-pass passes on in a tick.
    """
    if loop.braking is None or noise == 0.0 or not (finite := np.isfinite(loop.braking.acceleration)).any():
        return 0.0
    a, root = loop.braking.acceleration, root_at(place, size)
    most = np.where(finite, a, FREE * a[finite].max())
    shares = np.linalg.lstsq(root.dot(J) * most, root.dot(admittance[:, 3:]), rcond=SINGULAR)[0]
    change = noise * passed * sqrt(2.0 / (2.0 - passed))
    return ABOVE * change / loop.dt * sqrt(float((shares * shares).sum(axis=1).max()))


def kept_of(factor: float, share: float) -> float:
    """The share of a factor at which noise takes MOST of the joints' acceleration, at most 1."""
    return MOST / (factor * share) if factor * share > MOST else 1.0


def doubt(kept: float, noise: float) -> str:
    """What is wrong where a gain is lowered to this share of itself for noise [force], in words, "" for nothing."""
    if kept >= LOWERED:
        return ""
    said = f"{written(noise, 2)} N of noise would take the joints' acceleration: {written(kept, 2)} of the force gain"
    return f"{said} is left; give the sensor a lower cutoff="
