"""The measured twist that is attempted: the wanted one, but for what a form makes of the part that no joint can do.

    A = U diag(sigma) V',  r = b - U U'b:     U'M (U y - r) = 0,     attempt U (U'b + y)

M is the form on measured twists, the wanted twist's own part U U'b is attempted whatever the form. In exact arithmetic
A x = P b with P the form's projector; a spectrum of U'MU near zero beside |MU| (a principal pitch, a planar arm, |P|
large) is filtered, and a direction that the arm is losing counts for as much of it as it can still do. So a form that
cannot tell, or an arm at a singularity, fades to least squares without a jump.

Descent: |b - A x|^2 = |r|^2 + |y|^2 where the attempt is met, so the least-squares decrease is kept to the share eta if
|y|^2 <= (1 - eta) |U U'b|^2; y is shortened to that.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from scipy.linalg import lapack

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.damping import Damping
from invariantqp.velocity.forms import Form

# Eigenvalues of U'MU below this share of |MU|, which are one over those of |P|, are filtered: a projector with |P| of
# three or more costs accuracy on the way past a principal pitch, where one below saves some.
FORM_THRESHOLD = 0.3
FORM_CEILING = 0.3
# What a direction that M does not see counts in |MU|, beside |M|: what rounding leaves of the root of a zero.
UNSEEN = 1e-7


def attempted(form: Form, inverse_root: Array, A: Array, b: Array, damping: Damping, fraction: float | None) -> Array:
    """(6,) the measured twist to attempt.

    Args:
        form: what decides on the part that no joint can do.
        inverse_root: (6, 6) of the measure's root.
        A: (6, n) measured joint twists.
        b: (6,) measured twist wanted.
        damping: the policy that says which directions the arm is losing.
        fraction: eta, the share of the least-squares decrease that is kept; None keeps none.
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
    # A direction that is lost counts as none of those that are left: which one it is, is anybody's choice.
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
