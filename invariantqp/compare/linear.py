"""Methods of linear algebra, whose answers are cut to the limits joint by joint unless their rows say otherwise.

    gradient projection   x = J^+ s + (I - J^+ J) x_p                                       (Liegeois 1977)
    task priority         x = C^+ e + (J N_C)^+ (s - J C^+ e) + ...,  C the exact rows       (Nakamura 1987)
    damped                J^+ with J'(JJ' + lambda^2 I)^-1 in its place                      (Wampler 1986)

x_p is the posture, a joint velocity; it fills the null space of all that comes before it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from invariantqp.compare.method import CANNOT, DLS, LAMBDA, PENROSE, LoopSetting, Method, Question, Solve, Takes
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

    def velocity(tick: Question) -> Array:
        G = inverse(tick.J)
        return np.asarray(tick.posture + G.dot(tick.s - tick.J.dot(tick.posture)))

    return lambda _: velocity


def priority(setting: LoopSetting) -> Solve:
    """Exact rows, the twist in their null space, the posture in what both leave."""
    eye = np.eye(setting.m)

    def velocity(tick: Question) -> Array:
        x, N = np.zeros(setting.m), eye
        if len(tick.C):
            x, N = chiaverini(tick.C).dot(tick.e), eye - np.linalg.pinv(tick.C, rcond=NEGLIGIBLE).dot(tick.C)
        A = tick.J.dot(N)
        x = x + N.dot(chiaverini(A).dot(tick.s - tick.J.dot(x)))
        return np.asarray(x + (N - np.linalg.pinv(A, rcond=NEGLIGIBLE).dot(A)).dot(tick.posture))

    return velocity


METHODS = [
    Method(
        name=PENROSE,
        family="Moore-Penrose",
        why="gradient projection: J^+ s by numpy's pinv, and the posture in the null space (Liegeois 1977)",
        takes=Takes(IN_NULL_SPACE, CANNOT, CLIPPED, "none"),
        make=projected(lambda J: np.asarray(np.linalg.pinv(J))),
    ),
    Method(
        name="task priority",
        family="Moore-Penrose",
        why="exact rows first, the twist in their null space, the posture last (Nakamura 1987; Chiaverini 1997)",
        takes=Takes("lowest priority", "first priority", CLIPPED, "along small singular values (Chiaverini 1997)"),
        make=priority,
    ),
    Method(
        name=DLS,
        family="damped",
        why="damped least squares with lambda = 0.05 (Wampler 1986; Nakamura & Hanafusa 1986)",
        takes=Takes("in the damped null space", CANNOT, CLIPPED, "lambda = 0.05"),
        make=projected(damped),
    ),
]
