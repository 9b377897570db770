"""Methods of linear algebra, whose answers are cut to the limits joint by joint unless their rows say otherwise.

    gradient projection   x = J^+ s + (I - J^+ J) x_p                                       (Liegeois 1977)
    task priority         x = C^+ e + (J N_C)^+ (s - J C^+ e) + ...,  C the exact rows       (Nakamura 1987)
    damped                J^+ with J'(JJ' + lambda^2 I)^-1 in its place                      (Wampler 1986)
    saturation            x = x_N + (J W)^+ (alpha s - J x_N),  W_jj = 0 and x_N,j = limit for saturated joints
                                                                           (Flacco, De Luca & Khatib 2012)

x_p is the posture, a joint velocity; it fills the null space of all that comes before it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from invariantqp.compare.method import (
    CANNOT,
    DLS,
    LAMBDA,
    PENROSE,
    LoopSetting,
    Method,
    Solve,
    Takes,
    TickInputs,
    in_loop,
)
from invariantqp.geometry.arrays import NEGLIGIBLE, Array

# Chiaverini's damping starts when the smallest singular value falls below this.
NEARLY_SINGULAR = 0.04
IN_NULL_SPACE, CLIPPED = "in the null space", "clipped"


def damped(J: Array) -> Array:
    """J'(JJ' + lambda^2 I)^-1."""
    return np.asarray(np.linalg.solve(J.dot(J.T) + LAMBDA**2 * np.eye(len(J)), J).T)


def chiaverini(J: Array) -> Array:
    """The pseudoinverse, damped along the direction of the smallest singular value where that is small."""
    U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
    divisor = sigma * sigma
    near = sigma < NEARLY_SINGULAR
    divisor[near] += LAMBDA**2 * (1.0 - (sigma[near] / NEARLY_SINGULAR) ** 2)
    return np.asarray((Vt.T * (sigma / divisor)).dot(U.T))


def projected(inverse: Callable[[Array], Array]) -> Callable[[LoopSetting], Solve]:
    """Gradient projection with some inverse of J."""

    def velocity(tick: TickInputs) -> Array:
        G = inverse(tick.J)
        return np.asarray(tick.posture + G.dot(tick.s - tick.J.dot(tick.posture)))

    return lambda _: velocity


def priority(setting: LoopSetting) -> Solve:
    """Exact rows, the twist in their null space, the posture in what both leave."""
    eye = np.eye(setting.m)

    def velocity(tick: TickInputs) -> Array:
        x, N = np.zeros(setting.m), eye
        if len(tick.C):
            x, N = chiaverini(tick.C).dot(tick.e), eye - np.linalg.pinv(tick.C, rcond=NEGLIGIBLE).dot(tick.C)
        A = tick.J.dot(N)
        x = x + N.dot(chiaverini(A).dot(tick.s - tick.J.dot(x)))
        return np.asarray(x + (N - np.linalg.pinv(A, rcond=NEGLIGIBLE).dot(A)).dot(tick.posture))

    return velocity


def saturate(tick: TickInputs) -> tuple[Array, float]:
    """A joint that would exceed its limit stays at it, and the other joints make up for it: (m,) inside, and alpha.

    alpha is 1 if they can achieve s, else the largest value found on the way. Where the bounds exclude zero velocity,
    alpha may be 0; the velocity is then zero clipped to the bounds.

    Reference: Flacco, De Luca & Khatib 2012, Algorithm 1.
    """
    J, s, lower, upper = tick.J, tick.s, tick.lower, tick.upper
    size, m = float(np.linalg.norm(J, 2)), J.shape[1]
    free, fixed = np.ones(m, dtype=bool), tick.posture.copy()
    limits = np.abs(np.concatenate((lower, upper)))
    edge = NEGLIGIBLE * float(limits[np.isfinite(limits)].max(initial=0.0))
    best, most = np.minimum(np.maximum(np.zeros(m), lower), upper), 0.0
    full = _rank(J, size)
    while _rank(J * free, size) == full:
        inverse = np.linalg.pinv(J * free, rcond=NEGLIGIBLE)
        along = inverse.dot(s)
        offset = fixed - inverse.dot(J.dot(fixed))
        x = along + offset
        if not ((x < lower - edge) | (x > upper + edge)).any():
            return np.minimum(np.maximum(x, lower), upper), 1.0
        scale, critical = _largest_share(along, offset, lower, upper)
        if scale > most:
            best, most = np.minimum(np.maximum(scale * along + offset, lower), upper), scale
        if not free[critical]:
            break
        free[critical] = False
        fixed[critical] = upper[critical] if x[critical] > upper[critical] else lower[critical]
    return best, most


def _largest_share(along: Array, offset: Array, lower: Array, upper: Array) -> tuple[float, int]:
    """The largest alpha in [0, 1] with lower <= alpha along + offset <= upper, and the joint that limits it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack(((lower - offset) / along, (upper - offset) / along))
    still = along == 0.0
    ends[0, still], ends[1, still] = -np.inf, np.inf
    low, high = np.minimum(*ends), np.maximum(*ends)
    critical = int(np.argmin(high))
    most, least = min(1.0, float(high[critical])), max(0.0, float(low.max()))
    return (most if least <= most else 0.0), critical


def _rank(A: Array, size: float) -> int:
    return int(np.count_nonzero(np.linalg.svd(A, compute_uv=False) > NEGLIGIBLE * size))


METHODS = [
    Method(
        name=PENROSE,
        family="Moore-Penrose",
        why="gradient projection: J^+ s by numpy's pinv, and the posture in the null space (Liegeois 1977)",
        takes=Takes(IN_NULL_SPACE, CANNOT, CLIPPED, "none"),
        loop=in_loop(projected(lambda J: np.asarray(np.linalg.pinv(J)))),
    ),
    Method(
        name="task priority",
        family="Moore-Penrose",
        why="exact rows first, the twist in their null space, the posture last (Nakamura 1987; Chiaverini 1997)",
        takes=Takes("lowest priority", "first priority", CLIPPED, "along small singular values (Chiaverini 1997)"),
        loop=in_loop(priority),
    ),
    Method(
        name=DLS,
        family="damped",
        why="damped least squares with lambda = 0.05 (Wampler 1986; Nakamura & Hanafusa 1986)",
        takes=Takes("in the damped null space", CANNOT, CLIPPED, "lambda = 0.05"),
        loop=in_loop(projected(damped)),
    ),
    Method(
        name="SNS",
        family="Moore-Penrose",
        why="saturation in the null space: joints stay at their limits and others make up for them (Flacco, De Luca "
        "& Khatib 2012)",
        takes=Takes(IN_NULL_SPACE, CANNOT, "inside; slows the twist down", "none"),
        loop=in_loop(lambda _: lambda tick: saturate(tick)[0]),
    ),
]
