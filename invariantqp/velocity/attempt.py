"""The measured twist to attempt with a form: the part that the joints can do, and what the form makes of the rest.

    A = U diag(sigma) V',  r = b - U U'b:     U'M (U y - r) = 0,     attempt U (U'b + y)

M is the form on measured twists. The part U U'b is attempted whatever the form. In exact arithmetic A x = P b, P the
form's projector. Eigenvalues of U'MU that are small beside |MU| (a principal pitch, a planar arm, |P| large) are
filtered, and each direction counts only as far as damping leaves it. So where the form is ill-conditioned, or the arm
singular, the attempt goes over to least squares (y = 0) without a jump.

Descent: |b - A x|^2 = |r|^2 + |y|^2 where the attempt is met. At least the share eta of the least-squares decrease is
kept if |y|^2 <= (1 - eta) |U U'b|^2; a longer y is shortened to that.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from scipy.linalg import lapack

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.damping import Damping
from invariantqp.velocity.forms import Form

# Eigenvalues of U'MU below this share of |MU|, are filtered. Their inverses are the
# gains of P: those above three cost accuracy when the arm passes a principal pitch, smaller ones do not.
FORM_THRESHOLD = 0.3
FORM_CEILING = 0.3
# Least size of a direction in |MU|, relative to |M|: the square root of the rounding of an eigenvalue that is zero.
UNSEEN = 1e-7


def attempted(form: Form, inverse_root: Array, A: Array, b: Array, damping: Damping, fraction: float | None) -> Array:
    """(6,) the measured twist to attempt.

    Args:
        form: decides on the part that the joints cannot do.
        inverse_root: (6, 6) of the measure's root.
        A: (6, n) measured joint twists.
        b: (6,) measured twist wanted.
        damping: the policy near singularities.
        fraction: eta, the share of the least-squares decrease that is kept; None is no such bound.
    """
    U, sigma, _, info = lapack.dgesdd(A, full_matrices=0)
    if info != 0:
        raise np.linalg.LinAlgError(f"dgesdd returned {info}")
    largest = float(sigma.max(initial=0.0))
    if largest == 0.0:
        return b
    wanted = b.dot(U)
    squares = damping.squares(sigma, wanted, largest)
    share = sigma * sigma / (sigma * sigma + squares + np.finfo(float).tiny)
    done = U.dot(share * wanted)
    r = b - done
    M = form.matrix(inverse_root)
    V = U * np.sqrt(share)
    MV = M.dot(V)
    squared, vectors, _ = lapack.dsyev(MV.T.dot(MV))
    norm = float(np.linalg.norm(M)) or 1.0
    size = (vectors * (np.sqrt(np.maximum(squared, 0.0)) + UNSEEN * norm)).dot(vectors.T)
    # A damped direction gets a large size, hence an eigenvalue near zero, and is filtered.
    mu, axes, _ = lapack.dsygv(V.T.dot(MV), size + np.diag((1.0 - share) * norm))
    pull = M.dot(r).dot(V).dot(axes)
    left = np.maximum(0.0, 1.0 - (mu / FORM_THRESHOLD) ** 2)
    divisor = mu * mu + (FORM_CEILING * left) ** 2
    y = V.dot(axes.dot(np.divide(mu * pull, divisor, out=np.zeros(len(mu)), where=divisor > 0.0)))
    if fraction is not None:
        most, length = sqrt((1.0 - fraction) * float(done.dot(done))), sqrt(float(y.dot(y)))
        y *= most / max(most, length) if length > 0.0 else 1.0
    attempt: Array = U.dot(wanted) + y
    return attempt
