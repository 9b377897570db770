"""Parts of the velocity law computed independently in many digits, and random problems to compare with."""

from __future__ import annotations

import mpmath
import numpy as np
from scipy.optimize import linprog

import invariantqp as iq


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


def damped_velocity(A, b, posture, damping, digits=40):
    """argmin |A x - b|^2 + damping |x - x_p|^2 to 40 digits; the null space moves by the posture x_p alone."""
    m = A.shape[1]
    with mpmath.workdps(digits):
        M, wanted = mpmath.matrix(A.tolist()), mpmath.matrix(b.tolist())
        towards = mpmath.matrix(np.zeros(m).tolist() if posture is None else posture.tolist())
        gradient = M.T * wanted
        squares, V = mpmath.eigsy(M.T * M)
        largest, x = max(squares), mpmath.matrix(m, 1)
        for i in range(m):
            v = V[:, i]
            along = (v.T * towards)[0]
            if squares[i] > mpmath.mpf(10) ** -24 * largest:
                along = ((v.T * gradient)[0] + damping * along) / (squares[i] + damping)
            x += v * along
        return np.array([float(value) for value in x])


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


def largest_share(A, b, lower, upper):
    """max a in [0, 1] with A x = a b inside the box, on x itself; None where there is none."""
    k, m = A.shape
    result = linprog(
        [-1.0] + [0.0] * m,
        A_eq=np.column_stack((-b, A)),
        b_eq=np.zeros(k),
        bounds=[(0.0, 1.0), *zip(lower, upper, strict=True)],
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    return result.x[0] if result.status == 0 else None
