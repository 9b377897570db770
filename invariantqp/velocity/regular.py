"""Where the joints can move the tool in all six directions every form agrees, and one Cholesky factor is enough.

    x = x_p + J'(JJ')^-1 (s - J x_p)          J^{+h} = J^+ for every h

Nothing here depends on the form; it only has to be certain that the form's own spectrum asks for no damping, since then
the general way would end at the same x. The eigenvalues of J'QJ other than zero are those of Q JJ', hence

    |mu|_min >= 1 / (|(JJ')^-1| |Q^-1|),      |mu|_max <= |JJ'| |Q|

Reference: [DS] (2.14).
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from scipy.linalg import lapack

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.damping import Selective
from invariantqp.velocity.law import Demand, VelocityLaw

# The bound on |mu|_min / |mu|_max above which the normal equations keep twelve digits.
ACCURATE_RATIO = 1e-4


def regular_velocity(law: VelocityLaw, demand: Demand) -> Array | None:
    """The undamped velocity (m,) that meets the twist; None where that is not certain to be the law's answer."""
    norms = law.form.norms
    if norms is None or law.metric is not None or demand.J.shape[1] < 6:
        return None
    if demand.exact is not None and not demand.implied:
        return None
    if isinstance(law.damping, Selective):  # it looks at each direction of the spectrum
        return None
    J, s, posture = demand.J, demand.s, demand.posture
    S = J.dot(J.T)
    factor, info = lapack.dpotrf(S)
    if info != 0:
        return None
    # trace (JJ')^-1 = |U^-1|_F^2 bounds its norm. Not dpotri: OpenBLAS gives that to all its threads whatever the size,
    # and six rows then wait milliseconds for a busy core.
    inverse, _ = lapack.dtrtri(factor)
    smallest = 1.0 / (np.vdot(inverse, inverse) * norms.inverse)
    largest = sqrt(np.vdot(S, S)) * norms.form
    if smallest < ACCURATE_RATIO * largest or law.damping(smallest, largest) > 0.0:
        return None
    y, _ = lapack.dpotrs(factor, s if posture is None else s - J.dot(posture))
    x: Array = y.dot(J)
    return x if posture is None else posture + x
