"""The velocity law written a second time, from its formulas alone, and problems to hold both against each other."""

from __future__ import annotations

from itertools import product

import mpmath
import numpy as np

import invariantqp as iq


def convex_form(J, s, h, damping, metric=None):
    """(H, c) of minimise 1/2 x'Hx - c'x:  H = V diag(a) V', a = sqrt(mu^2 + lambda^2), c = H x*.

    Damped directions get the weight of the null space on top, 1e-6 max|mu| lambda^2 / (mu^2 + lambda^2), which leaves
    the unconstrained optimum where it is and keeps cond(H) below 1e6. With a joint metric M = LL' the spectrum is that
    of L^-1 G L^-T, and H, c go back to x by L.
    """
    L = np.eye(J.shape[1]) if metric is None else np.linalg.cholesky(metric)
    Q = np.block([[-2.0 * h * np.eye(3), np.eye(3)], [np.eye(3), np.zeros((3, 3))]])
    A = J @ np.linalg.inv(L).T
    mu, V = np.linalg.eigh(A.T @ Q @ A)
    optimum = mu / (mu**2 + damping**2) * (V.T @ (A.T @ Q @ s))
    a = np.sqrt(mu**2 + damping**2) + 1e-6 * np.abs(mu).max() * damping**2 / (mu**2 + damping**2)
    H, c = V @ np.diag(a) @ V.T, V @ (a * optimum)
    return L @ H @ L.T, L @ c


def box_minimum(H, c, lower, upper):
    """The minimiser over a box by trying every active set in 40 digits: no solver, no tolerance."""
    with mpmath.workdps(40):
        m = len(c)
        best, value = None, None
        for sides in product((-1, 0, 1), repeat=m):
            fixed = {i: (lower[i] if d < 0 else upper[i]) for i, d in enumerate(sides) if d}
            if any(not np.isfinite(v) for v in fixed.values()):
                continue
            free = [i for i in range(m) if i not in fixed]
            x = mpmath.matrix(m, 1)
            for i, v in fixed.items():
                x[i] = mpmath.mpf(float(v))
            if free:
                A = mpmath.matrix([[mpmath.mpf(H[i, j]) for j in free] for i in free])
                b = mpmath.matrix(
                    [mpmath.mpf(c[i]) - mpmath.fsum(mpmath.mpf(H[i, k]) * x[k] for k in fixed) for i in free]
                )
                for i, v in zip(free, mpmath.lu_solve(A, b), strict=True):
                    x[i] = v
            if all(lower[i] <= x[i] <= upper[i] for i in range(m)):
                f = mpmath.fsum(
                    (mpmath.fsum(mpmath.mpf(H[i, j]) * x[j] for j in range(m)) / 2 - mpmath.mpf(c[i])) * x[i]
                    for i in range(m)
                )
                if value is None or f < value:
                    best, value = x, f
        return np.array([float(v) for v in best])


def regular_problem(rng, m, ratio=1e-3):
    """(J, s, h) whose Gram matrix is well away from singular, so that no policy damps it."""
    while True:
        J, s, h = rng.normal(size=(6, m)), rng.normal(size=6), float(rng.uniform(-1.5, 1.5))
        mu = np.sort(np.abs(np.linalg.eigvalsh(iq.systems.gram_matrix(J, h))))
        if mu[-min(m, 6)] > ratio * mu[-1]:
            return J, s, h


def tight_box(rng, m, x, share=0.6):
    """Bounds with zero inside that the velocity x leaves at about `share` of its joints."""
    reach = np.where(rng.random((2, m)) < share, 0.5, 2.0) * np.abs(x) * rng.uniform(0.4, 1.0, size=(2, m)) + 1e-3
    return iq.Bounds(-reach[0], reach[1])
