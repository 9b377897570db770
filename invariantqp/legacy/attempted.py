"""What a form attempts of a twist that the joints cannot do (`velocity/forms.py`).

    A = U diag(sigma) V' measured joint twists, b the measured twist, r = b - U U'b what least squares leaves of it:
    U'M (U y - r) = 0,   attempt U (U'b + y),   M the form on measured twists

Where the joints can do the whole twist, no form changes anything; else, in exact arithmetic, A x = P b, P the form's
projector. Where a form has no projector (a principal pitch, a planar arm) or |P| is large, small eigenvalues of U'MU
are filtered, and each direction counts only as far as damping leaves it: the attempt goes over to least squares (y = 0)
without a jump. So the law works for every type of arm, and rounding never decides between two laws.

Descent: |b - A x|^2 = |r|^2 + |y|^2 where the attempt is met. At least the share eta of the least-squares decrease is
kept if |y|^2 <= (1 - eta) |U U'b|^2; a longer y is shortened to that.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from scipy.linalg import lapack

from invariantqp.geometry.arrays import Array
from invariantqp.legacy.damping import Damping
from invariantqp.legacy.objective import Spectrum
from invariantqp.velocity.forms import Form

# Eigenvalues of U'MU below this share of |MU| are filtered. Their inverses are the gains of P: those above three cost
# accuracy when the arm passes a principal pitch, smaller ones do not.
FORM_THRESHOLD = 0.3
# Least size of a direction in |MU|, relative to |M|: its inverse is by how much rounding may be enlarged.
UNSEEN = 1e-7
# A direction of a smaller size is one that M leaves to itself, but for rounding; it fades in, so that there is no jump.
UNTOUCHED = 1e-11


def attempted(
    form: Form, inverse_root: Array, spectrum: Spectrum, b: Array, damping: Damping, fraction: float | None
) -> Array:
    """(6,) the measured twist to attempt.

    Args:
        form: decides on the part that the joints cannot do.
        inverse_root: (6, 6) of the measure's root.
        spectrum: of the measured joint twists A (6, n).
        b: (6,) measured twist wanted.
        damping: the policy near singularities.
        fraction: eta, the share of the least-squares decrease that is kept; None is no such bound.
    """
    sigma, largest = spectrum.sigma, spectrum.largest
    if largest == 0.0:
        return b
    U = spectrum.U[:, : len(sigma)]
    wanted = b.dot(U)
    squares = damping.squares(sigma, wanted, largest)
    share = sigma * sigma / (sigma * sigma + squares + np.finfo(float).tiny)
    done = U.dot(share * wanted)
    r = b - done
    M = form.matrix(inverse_root)
    V = U * np.sqrt(share)
    norm = float(np.linalg.norm(M)) or 1.0
    seen, sizes, own, _ = lapack.dgesdd(M.dot(V), full_matrices=0)  # |MV| = own' sizes own
    counts = np.clip(sizes / (UNTOUCHED * norm) - 1.0, 0.0, 1.0)
    V, MV = V.dot(own.T), seen * (counts * sizes)
    # A direction that is damped, or untouched, gets a large size, hence an eigenvalue near zero, and is filtered.
    size = np.diag(sizes + (UNSEEN + 1.0 - counts) * norm) + (own * (1.0 - share)).dot(own.T) * norm
    mu, axes, _ = lapack.dsygv(counts[:, None] * V.T.dot(MV), size)
    pull = r.dot(MV).dot(axes)
    left = np.maximum(0.0, 1.0 - (mu / FORM_THRESHOLD) ** 2)
    divisor = mu * mu + (FORM_THRESHOLD * left) ** 2
    y = V.dot(axes.dot(np.divide(mu * pull, divisor, out=np.zeros(len(mu)), where=divisor > 0.0)))
    if fraction is not None:
        most, length = sqrt((1.0 - fraction) * float(done.dot(done))), sqrt(float(y.dot(y)))
        y *= most / max(most, length) if length > 0.0 else 1.0
    attempt: Array = U.dot(wanted) + y
    return attempt
