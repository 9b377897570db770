"""J^{+h} of the very numbers given, in mpmath's working digits, and how far from it an answer is."""

from __future__ import annotations

import mpmath
import numpy as np


def exact_form(h):
    """Q_h, exactly."""
    Q = mpmath.zeros(6)
    for i in range(3):
        Q[i, i] = -2 * mpmath.mpf(float(h))
        Q[i, i + 3] = Q[i + 3, i] = 1
    return Q


def exact_pseudoinverse(J, h, M=None, C=None):
    """J^{+h} of independent columns, of independent rows (rank 6), or of J C, C of full row rank; M on the joints."""
    A = mpmath.matrix(J.tolist())
    if C is None and A.cols > 6:
        A, C = mpmath.eye(6), J
    Q = exact_form(h)
    left = _inverse(A.T * Q * A) * A.T * Q
    if C is None:
        return left
    C = mpmath.matrix(C.tolist())
    W = mpmath.eye(C.cols) if M is None else mpmath.inverse(mpmath.matrix(M.tolist()))
    return W * C.T * mpmath.inverse(C * W * C.T) * left


def _inverse(G):
    try:
        return mpmath.inverse(G)
    except TypeError as error:  # mpmath finds no pivot in a matrix of exact zeros
        raise ZeroDivisionError("the Gram matrix is singular") from error


def relative_error(P, exact, J):
    """|P - exact| over |exact|, each joint counted in the size of its twist and lengths in the arm's own."""
    unit = np.repeat([1.0, 2.0 ** np.round(np.log2(np.linalg.norm(J[3:]) / np.linalg.norm(J[:3])))], 3)
    sizes = np.linalg.norm(J / unit[:, None], axis=0)[:, None] * unit
    P = P if isinstance(P, mpmath.matrix) else mpmath.matrix(P.tolist())
    difference, whole = (np.array(x.tolist(), dtype=float) * sizes for x in (P - exact, exact))
    return np.linalg.norm(difference) / np.linalg.norm(whole)
