"""Methods of linear algebra, whose answers are cut to the limits joint by joint unless their rows say otherwise.

    gradient projection   x = J^+ s + (I - J^+ J) x_p                                       (Liegeois 1977)
    task priority         x = C^+ e + (J N_C)^+ (s - J C^+ e) + ...,  C the exact rows       (Nakamura 1987)
    damped                J^+ with J'(JJ' + lambda^2 I)^-1 in its place                      (Wampler 1986)

x_p is the posture, a joint velocity; it fills the null space of all that comes before it.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi

import numpy as np

from invariantqp.compare.laws.saturation import saturate
from invariantqp.compare.method import CANNOT, Method, Question, Setting, Solve, Takes
from invariantqp.geometry.arrays import Array

# lambda as scripts choose it, in mixed units of J; also the largest of Chiaverini's damping.
DLS_DAMPING = 0.05
# Chiaverini's damping starts when the smallest singular value falls below this.
NEARLY_SINGULAR = 0.04
# Singular values below this share of the largest are zero in pseudoinverses of projected Jacobians.
RANK = 1e-9
# gamma_max of SDLS: the largest change of a joint angle in one tick [rad].
LARGEST_STEP = pi / 4.0
# A singular value below this fraction of the largest counts as zero in SDLS, as in numpy.linalg.pinv.
SINGULAR = 1e-15
# An entry below this fraction of the largest of its row or column counts as zero in the unit-consistent inverse.
ZERO = 1e-12
IN_NULL_SPACE, CLIPPED = "in the null space", "clipped"


def damped(J: Array, squared: float) -> Array:
    """J'(JJ' + lambda^2 I)^-1."""
    return np.asarray(np.linalg.solve(J.dot(J.T) + squared * np.eye(len(J)), J).T)


def chiaverini(J: Array) -> Array:
    """The pseudoinverse, damped along the direction of the smallest singular value where that is small."""
    U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
    divisor = sigma * sigma
    near = sigma < NEARLY_SINGULAR
    divisor[near] += DLS_DAMPING**2 * (1.0 - (sigma[near] / NEARLY_SINGULAR) ** 2)
    return np.asarray((Vt.T * (sigma / divisor)).dot(U.T))


def sdls_step(J: Array, e: Array) -> Array:
    """The change theta (m,) of the joint angles in one tick for a wanted displacement e (6,) of the tool in that tick.

        theta_i = clamp((u_i.e) / sigma_i v_i, gamma_i),   theta = clamp(sum theta_i, gamma_max)
        N_i = sum_l |u_i|_l,   M_i = 1 / sigma_i sum_j |v_ij| |J_v,j|,   gamma_i = min(1, N_i / M_i) gamma_max

    The sums over end effectors l have two terms here, the position of the tool and its orientation, with one metre for
    one radian.

    Reference: Buss & Kim 2005, Sect. 3.
    """
    U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
    linear, angular = np.linalg.norm(J[3:], axis=0), np.linalg.norm(J[:3], axis=0)
    step = np.zeros(J.shape[1])
    for u, size, v in zip(U.T, sigma, Vt, strict=True):
        if size <= SINGULAR * sigma[0]:
            continue
        N = np.linalg.norm(u[:3]) + np.linalg.norm(u[3:])
        M = np.abs(v).dot(linear + angular) / size
        step += _clamped(u.dot(e) / size * v, min(1.0, N / M) * LARGEST_STEP)
    return _clamped(step, LARGEST_STEP)


def _clamped(step: Array, largest: float) -> Array:
    """The step scaled down so that no component exceeds `largest`."""
    size = float(np.abs(step).max())
    return step if size <= largest else step * (largest / size)


def scaling(J: Array) -> tuple[Array, Array]:
    """The diagonals (n,) of D and (m,) of E, with which every row and column of |DJE| has the geometric mean 1.

    sum_j log|(DJE)_ij| = 0 = sum_i log|(DJE)_ij|  over the entries that are not zero
    """
    n, m = J.shape
    size = np.abs(J)
    there = (size > ZERO * size.max(axis=1, keepdims=True)) & (size > ZERO * size.max(axis=0, keepdims=True))
    logs = np.log(size, where=there, out=np.zeros_like(size))
    # The normal equations of  min sum (log|J_ij| + u_i + w_j)^2: the graph Laplacian of the nonzero entries.
    laplacian = np.block([[np.diag(there.sum(axis=1)), there], [there.T, np.diag(there.sum(axis=0))]]).astype(float)
    sums = np.concatenate((logs.sum(axis=1), logs.sum(axis=0)))
    u = -np.linalg.lstsq(laplacian, sums, rcond=None)[0]
    return np.exp(u[:n]), np.exp(u[n : n + m])


def unit_consistent_inverse(J: Array) -> Array:
    """(m, n) E (D J E)^+ D, the Moore-Penrose inverse of a matrix whose rows and columns are scaled first.

    It is B^-1 J^-U A^-1 for A J B with all positive diagonal A and B: the answer does not depend on units. It does
    depend on the frame.

    Reference: Uhlmann 2018, A generalized matrix inverse that is consistent with respect to diagonal transformations;
    Zhang & Uhlmann 2018, for robots.
    """
    d, e = scaling(J)
    return np.asarray(e[:, None] * np.linalg.pinv(d[:, None] * J * e) * d)


def _projected(inverse: Callable[[Array], Array]) -> Callable[[Setting], Solve]:
    """Gradient projection with some inverse of J."""

    def velocity(tick: Question) -> Array:
        G = inverse(tick.J)
        return np.asarray(tick.posture + G.dot(tick.s - tick.J.dot(tick.posture)))

    return lambda _: velocity


def _priority(setting: Setting) -> Solve:
    eye = np.eye(setting.m)

    def velocity(tick: Question) -> Array:
        x, N = np.zeros(setting.m), eye
        if len(tick.C):
            G = chiaverini(tick.C)
            x, N = G.dot(tick.e), eye - np.linalg.pinv(tick.C, rcond=RANK).dot(tick.C)
        A = tick.J.dot(N)
        x = x + N.dot(chiaverini(A).dot(tick.s - tick.J.dot(x)))
        return np.asarray(x + (N - np.linalg.pinv(A, rcond=RANK).dot(A)).dot(tick.posture))

    return velocity


def _saturation(*, optimal: bool) -> Callable[[Setting], Solve]:
    return lambda _: (
        lambda tick: saturate(tick.J, tick.s, tick.lower, tick.upper, tick.posture, optimal=optimal).velocity
    )


def _sdls(setting: Setting) -> Solve:
    dt = setting.dt  # SDLS is about joint angles: those of one tick
    return lambda tick: tick.posture + sdls_step(tick.J, dt * (tick.s - tick.J.dot(tick.posture))) / dt


METHODS = [
    Method(
        name="Moore-Penrose",
        family="Moore-Penrose",
        why="gradient projection: J^+ s by numpy's pinv, and the posture in the null space (Liegeois 1977)",
        takes=Takes(IN_NULL_SPACE, CANNOT, CLIPPED, "none"),
        make=_projected(lambda J: np.asarray(np.linalg.pinv(J))),
        problem="least squares",
    ),
    Method(
        name="task priority",
        family="Moore-Penrose",
        why="exact rows first, the twist in their null space, the posture last (Nakamura 1987; Chiaverini 1997)",
        takes=Takes("lowest priority", "first priority", CLIPPED, "along small singular values (Chiaverini 1997)"),
        make=_priority,
    ),
    Method(
        name="DLS",
        family="damped",
        why="damped least squares with lambda = 0.05 (Wampler 1986; Nakamura & Hanafusa 1986)",
        takes=Takes("in the damped null space", CANNOT, CLIPPED, "lambda = 0.05"),
        make=_projected(lambda J: damped(J, DLS_DAMPING**2)),
        problem="damped",
    ),
    Method(
        name="SDLS",
        family="damped",
        why="selectively damped least squares (Buss & Kim 2005)",
        takes=Takes("in the damped null space", CANNOT, CLIPPED, "each singular direction by its own reach"),
        make=_sdls,
        shown=False,
    ),
    Method(
        name="SNS",
        family="Moore-Penrose",
        why="saturation in the null space: joints stay at their limits and others make up for them (Flacco, De Luca "
        "& Khatib 2012)",
        takes=Takes(IN_NULL_SPACE, CANNOT, "inside; slows the twist down", "none"),
        make=_saturation(optimal=False),
        problem="least squares",
    ),
    Method(
        name="OSNS",
        family="Moore-Penrose",
        why="its optimal variant: joints are let go again where that brings the velocity nearer to the posture "
        "(Flacco, De Luca & Khatib 2015)",
        takes=Takes(IN_NULL_SPACE, CANNOT, "inside; slows the twist down", "none"),
        make=_saturation(optimal=True),
        problem="least squares",
        shown=False,
    ),
    Method(
        name="unit-consistent inverse",
        family="Moore-Penrose",
        why="the inverse that does not depend on the unit of any row or joint (Zhang & Uhlmann 2018)",
        takes=Takes(IN_NULL_SPACE, CANNOT, CLIPPED, "none"),
        make=_projected(unit_consistent_inverse),
        shown=False,
    ),
]
