"""The velocity law written a second time, from its formulas alone, and problems to hold both against each other."""

from __future__ import annotations

from itertools import product

import mpmath
import numpy as np

import invariantqp as iq

# What the law says of itself, repeated here on purpose.
UNLIMITED = (1e-2, 1e-2)  # threshold and ceiling of the damping where some joint has no bound
LIMITED = (1e-2, 2e-3)
NULL_WEIGHT = 1e-8


def skew(p):
    return np.array(((0.0, -p[2], p[1]), (p[2], 0.0, -p[0]), (-p[1], p[0], 0.0)))


def root_of(point, length):
    """root with |root s|^2 = L^2 |omega|^2 + |v + omega x p|^2."""
    return np.block([[length * np.eye(3), np.zeros((3, 3))], [-skew(point), np.eye(3)]])


def reach_of(J, point):
    """The broken line from the point to its foot on each turning axis, the last joint first."""
    here, length = np.array(point, dtype=float), 0.0
    for column in J.T[::-1]:
        w, v = column[:3], column[3:]
        if np.linalg.norm(w) > 0.0:
            foot = skew(w) @ v / (w @ w)
            foot = foot + w * (w @ (here - foot)) / (w @ w)
            length += np.linalg.norm(foot - here)
            here = foot
    return length


def adaptive(sigma, largest, threshold, ceiling):
    """lambda^2: (ceiling largest (1 - (sigma / (threshold largest))^2))^2 below the threshold, 0 above."""
    share = min(sigma / (threshold * largest), 1)
    return (ceiling * largest * (1 - share * share)) ** 2


def damped_velocity(A, b, posture, policy, digits=40):
    """x = sum of v_i (sigma_i u_i'b + lambda_i^2 v_i'x_p) / (sigma_i^2 + lambda_i^2), every digit of it.

    `policy(sigma, largest)` is lambda^2; a direction that moves nothing goes to the posture whole.
    """
    m = A.shape[1]
    with mpmath.workdps(digits):
        M, wanted = mpmath.matrix(A.tolist()), mpmath.matrix(b.tolist())
        towards = mpmath.matrix(np.zeros(m).tolist() if posture is None else posture.tolist())
        gram, pull = M.T * M, M.T * wanted
        squares, V = mpmath.eigsy(gram)
        largest = mpmath.sqrt(max(squares))
        x = mpmath.matrix(m, 1)
        for i in range(m):
            v = V[:, i]
            sigma = mpmath.sqrt(max(squares[i], 0))
            along = (v.T * towards)[0]
            if sigma > mpmath.mpf(10) ** -12 * largest:
                lam = policy(sigma, largest)
                along = ((v.T * pull)[0] + lam * along) / (squares[i] + lam)
            x += v * along
        return np.array([float(value) for value in x])


def least_squares_form(A, b, posture=None, damping=LIMITED):
    """(H, c) of minimise 1/2 x'Hx - c'x: damped least squares, (1e-4)^2 of the largest where nothing is moved."""
    U, sigma, Vt = np.linalg.svd(A)
    m, k = A.shape[1], len(sigma)
    sizes, pull = np.zeros(m), np.zeros(m)
    sizes[:k], pull[:k] = sigma, sigma * (U.T @ b)[:k]
    squares = np.full(m, damping**2) if np.ndim(damping) == 0 else None
    if squares is None:
        squares = np.array([adaptive(value, sigma[0], *damping) for value in sizes])
    null = sizes <= 1e-12 * sigma[0]
    squares[null & (squares == 0.0)] = NULL_WEIGHT * sigma[0] ** 2  # where the policy damps nothing
    sizes[null], pull[null] = 0.0, 0.0
    wanted = np.zeros(m) if posture is None else Vt @ posture
    return Vt.T @ np.diag(sizes**2 + squares) @ Vt, Vt.T @ (pull + squares * wanted)


def convex_form(J, s, h, damping, metric=None):
    """(H, c) of [DS]'s problem made convex: H = V diag(a) V', a = sqrt(mu^2 + lambda^2), c = H x*.

    With a joint metric M = LL' the spectrum is that of L^-1 G L^-T, and H, c go back to x by L.
    """
    L = np.eye(J.shape[1]) if metric is None else np.linalg.cholesky(metric)
    Q = np.block([[-2.0 * h * np.eye(3), np.eye(3)], [np.eye(3), np.zeros((3, 3))]])
    A = J @ np.linalg.inv(L).T
    mu, V = np.linalg.eigh(A.T @ Q @ A)
    optimum = mu / (mu**2 + damping**2) * (V.T @ (A.T @ Q @ s))
    a = np.sqrt(mu**2 + damping**2)
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


def quadprog_minimum(H, c, lower, upper, C=None, low=None, high=None):
    """The same by quadprog, with rows low <= C x <= high; all limits finite."""
    import quadprog

    m = len(c)
    normals, sides = [np.eye(m), -np.eye(m)], [np.asarray(lower), -np.asarray(upper)]
    if C is not None:
        normals, sides = [*normals, np.asarray(C).T, -np.asarray(C).T], [*sides, np.asarray(low), -np.asarray(high)]
    return quadprog.solve_qp(0.5 * (H + H.T), c, np.hstack(normals), np.concatenate(sides))[0]


def eliminated(A, b, C, e, digits=40):
    """argmin |A x - b| with C x = e, from its own linear equations in 40 digits; C and [A; C] of full rank."""
    m, k = A.shape[1], len(C)
    with mpmath.workdps(digits):
        M, rows = mpmath.matrix(A.tolist()), mpmath.matrix(C.tolist())
        kkt, right = mpmath.zeros(m + k), mpmath.zeros(m + k, 1)
        kkt[:m, :m], kkt[:m, m:], kkt[m:, :m] = M.T * M, rows.T, rows
        right[:m, 0], right[m:, 0] = M.T * mpmath.matrix(b.tolist()), mpmath.matrix(list(map(float, e)))
        return np.array([float(v) for v in mpmath.lu_solve(kkt, right)[:m]])


def regular_problem(rng, m, ratio=2e-2):
    """(J, s, h) well away from singular in any sense: nothing is damped, and the pitch form is not filtered."""
    while True:
        J, s, h = rng.normal(size=(6, m)), rng.normal(size=6), float(rng.uniform(-1.5, 1.5))
        own = iq.systems.centre(J, s).point
        A = root_of(own, reach_of(J, own)) @ J
        sigma = np.linalg.svd(A, compute_uv=False)
        mu = np.sort(np.abs(np.linalg.eigvalsh(iq.systems.gram_matrix(J, h))))
        if sigma[-1] > ratio * sigma[0] and mu[-min(m, 6)] > ratio * mu[-1]:
            return J, s, h


def tight_box(rng, m, x, share=0.6):
    """Bounds with zero inside that the velocity x leaves at about `share` of its joints."""
    reach = np.where(rng.random((2, m)) < share, 0.5, 2.0) * np.abs(x) * rng.uniform(0.4, 1.0, size=(2, m)) + 1e-3
    return iq.Bounds(-reach[0], reach[1])
