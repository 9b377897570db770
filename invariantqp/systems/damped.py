"""psi, the map from a wanted twist to the twist that [DS]'s damped formula makes of it.

    Psi(x) = (s - J x)'Q_h(s - J x) + x'Lambda x is stationary at x = (G + Lambda)^-1 J'Q_h s,   G = J'Q_h J
    psi(J, h, Lambda) = J (G + Lambda)^-1 J'Q_h,   s -> J x

The eigenvalues of psi are the gains of the closed loop: mu_i / (mu_i + 1) on J v_i, where G v_i = mu_i Lambda v_i, and
0 on every twist that is h-reciprocal to J. A positive definite Lambda therefore damps only where mu_i > 0:

    Lambda = lambda I, mu the eigenvalues of G     gain mu / (mu + lambda)
        mu > 0                                     between 0 and 1: damped
        -lambda < mu < 0                           negative: the tool is driven away
        mu = -lambda                               a pole
        mu < -lambda                               above 1: the tool overshoots
    Lambda = lambda^2 G^-1                         mu^2 / (mu^2 + lambda^2), in [0, 1) whatever the sign of mu

An arm of rank 4 or more has values mu of both signs for every h, since Q_h has signature (3, 3). The velocity law of
this library damps by the last choice (`Fixed`, `Adaptive`, `Selective`).

Reference: [DS] Sect. 6.2, the formulas after Example 4, which have no number; the eigenvalues are ours.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import pitch_form
from invariantqp.systems.gram import gram_matrix

# Above this condition number of G + Lambda its inverse has lost all but three digits.
LARGEST_CONDITION = 1e12


def psi(J: ArrayLike, h: float, Lambda: ArrayLike) -> Array:
    """psi = J (J'Q_h J + Lambda)^-1 J'Q_h, [DS]'s "modified projection operator".

    It tends to the projector J J^{+h} as Lambda tends to 0, where that exists. Q_h psi is symmetric, so psi is its own
    h-adjoint; a rigid change of frame takes psi to Ad psi Ad^-1, so its eigenvalues are the same in every frame. It is
    a projector only for Lambda = 0.

    Args:
        J: (6, m) joint twists as columns.
        h: finite pitch [length/rad], or inf for half the Killing form.
        Lambda: (m, m) symmetric, definite or not; a (m,) vector is its diagonal, a number a multiple of I [unit of G].

    Returns:
        (6, 6) matrix on twists.

    Raises:
        BadInput: shapes, NaN, a Lambda that is not symmetric, or one at a pole, where G + Lambda is singular.

    Reference: [DS] Sect. 6.2.
    """
    twists = arrays.columns(J)
    m = twists.shape[1]
    total = gram_matrix(twists, h) + _symmetric(Lambda, m)
    scale = np.sqrt(np.abs(total).max(axis=0))
    scale[scale == 0.0] = 1.0
    scaled = total / np.outer(scale, scale)
    if not np.linalg.cond(scaled) <= LARGEST_CONDITION:
        raise BadInput(
            "Lambda", "a pole: G + Lambda is singular", "one for which it is not", "Change Lambda or h a little."
        )
    right = twists.T.dot(pitch_form(h)) / scale[:, None]
    return np.asarray((twists / scale).dot(np.linalg.solve(scaled, right)))


def _symmetric(value: ArrayLike, m: int) -> Array:
    expected = f"a symmetric ({m}, {m}) matrix, its {m} diagonal entries, or a number"
    a = arrays.array(value, "Lambda", expected)
    if a.ndim < 2:
        a = np.diag(np.broadcast_to(a, m) if a.ndim == 0 else a)
    if a.shape != (m, m):
        raise BadInput("Lambda", f"shape {np.shape(value)}", expected)
    return arrays.symmetric(a, m, "Lambda", expected, "Pass (A + A.T) / 2 if that is meant.")
