"""[DS]'s own problem: the stationary point of the pitch form, made convex, or damped with Lambda as it is printed.

    G = J'Q_h J = V diag(mu) V',  g = J'Q_h s
    convexified   1/2 (z - z*)'H (z - z*),  H = V diag(sqrt(mu^2 + lambda^2)) V',  z* = V mu / (mu^2 + lambda^2) V'g
    printed       x = (G + Lambda)^-1 g,   closed-loop gains: the eigenvalues of (G + Lambda)^-1 G

G is indefinite for every arm of rank 4 or more, so it is no Hessian of a QP; H is positive definite with about the
condition of G and has z* as its optimum without limits. z* is [DS]'s damped formula with Lambda = lambda^2 G^-1, whose
gains mu^2 / (mu^2 + lambda^2) lie in [0, 1). H has no physical meaning for joint velocities, so where limits bind or a
singularity is near, least squares at a point is far more accurate: this is for comparison, and for the paper.

Proof of the gains. The map from a twist to the twist it gets is P = J V f(mu) V'J'Q, f(mu) = mu / (mu^2 + lambda^2).
Its eigenvalues other than zero are those of f(mu) V'(J'QJ)V = diag(mu^2 / (mu^2 + lambda^2)): AB and BA share theirs.

Reference: [DS] Sect. 6.2 and 6.3; H is the fundamental-symmetry majorant of Krein-space theory.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from scipy.linalg import lapack

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import pitch_form
from invariantqp.velocity.damping import Damping
from invariantqp.velocity.objective import NULL_RATIO, NULL_WEIGHT, Objective

# |mu| below this share of |J|^2 |Q| is what rounding leaves of zero in J'QJ.
ROUNDING = 1e-15
# Gains beyond [0, 1] by less than this are rounding.
GAIN_TOLERANCE = 1e-9


def convexified(J: Array, s: Array, h: float, posture: Array | None, damping: Damping) -> Objective:
    """The convex objective whose optimum without limits is the filtered stationary point.

    Args:
        J: (6, n) twists of the free directions.
        s: (6,) twist wanted of them.
        h: pitch.
        posture: (n,) wanted where the form leaves directions free; None is zero.
        damping: the policy, given |mu| for singular values.
    """
    n = J.shape[1]
    if n == 0:
        return Objective(np.empty((0, 0)), np.empty(0), np.empty(0))
    QJ = pitch_form(h).dot(J)
    mu, V, info = lapack.dsyev(J.T.dot(QJ))
    if info != 0:
        raise np.linalg.LinAlgError(f"dsyev returned {info}")
    size = np.abs(mu)
    largest = float(size.max())
    noise = ROUNDING * (1.0 + 2.0 * abs(h)) * float(np.vdot(J, J))
    towards = np.zeros(n) if posture is None else posture.dot(V)
    if largest <= noise:
        return Objective(V, np.ones(n), towards, ratio=0.0)
    pull = s.dot(QJ).dot(V)
    null = size <= max(NULL_RATIO * largest, noise)
    squares = damping.squares(size, np.abs(pull), largest)
    squares[null & (squares == 0.0)] = NULL_WEIGHT * largest * largest
    total = size * size + squares
    rank = min(n, 6)
    return Objective(
        V=V,
        weights=np.sqrt(total),
        optimum=(np.where(null, 0.0, mu * pull) + squares * towards) / total,
        damping=sqrt(float(np.where(null, 0.0, squares).max())),
        ratio=float(np.sort(size)[-rank]) / largest,
    )


def printed(J: Array, s: Array, h: float, Lambda: Array, posture: Array | None) -> tuple[Array, str]:
    """[DS]'s damped formula (m,), unbounded, and its closed-loop gains outside [0, 1], "" for none.

    Raises:
        numpy.linalg.LinAlgError: G + Lambda is singular, the pole itself.
    """
    QJ = pitch_form(h).dot(J)
    G, g = J.T.dot(QJ), s.dot(QJ)
    total = G + Lambda
    x: Array = np.asarray(np.linalg.solve(total, g if posture is None else g + Lambda.dot(posture)), dtype=np.float64)
    gains = np.linalg.eigvals(np.linalg.solve(total, G)).real
    bad = gains[(gains < -GAIN_TOLERANCE) | (gains > 1.0 + GAIN_TOLERANCE)]
    if not len(bad):
        return x, ""
    listed = ", ".join(f"{gain:.3g}" for gain in np.sort(bad))
    return x, listed
