"""Methods of linear algebra, whose answers are cut to the limits joint by joint unless their rows say otherwise.

    gradient projection   x = J^+ s + (I - J^+ J) x_p                                       (Liegeois 1977)
    task priority         x = C^+ e + (J N_C)^+ (s - J C^+ e) + ...,  C the exact rows       (Nakamura 1987)
    damped                J^+ with J'(JJ' + lambda^2 I)^-1 in its place                      (Wampler 1986)

x_p is the posture, a joint velocity; it fills the null space of all that comes before it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from invariantqp.compare.laws.saturation import saturate
from invariantqp.compare.laws.sdls import sdls_step
from invariantqp.compare.laws.unit_consistent import unit_consistent_inverse
from invariantqp.compare.method import CANNOT, Method, Question, Setting, Solve, Takes
from invariantqp.geometry.arrays import Array

# lambda as scripts choose it, in mixed units of J; also the largest of Chiaverini's damping.
DLS_DAMPING = 0.05
# Chiaverini's damping starts when the smallest singular value falls below this.
NEARLY_SINGULAR = 0.04
# Singular values below this share of the largest are zero in pseudoinverses of projected Jacobians.
RANK = 1e-9
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
