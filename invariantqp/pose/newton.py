"""One try at a pose: damped Newton steps inside the joint limits, none of which leaves the error larger.

    x = argmin 1/2 |r - A x|^2 + 1/2 mu |x|^2   over   q_min <= q + x <= q_max,      mu = lambda |r|^2

Damping that follows the error is quadratic convergence where the target is met and rest where it is not. Where the box
does not matter and six joints or more move the tool, x = A'(AA' + mu)^-1 r, which with mu = 0 is J^{+h} s for every
pitch h, s the twist of r. Exact demands are rows of the same problem with a weight no other row has; f + nu |b| then
judges a step.

Reference: Levenberg 1944; Chan and Lawrence 1988 (damping by the error); Sugihara 2011; Han 1977 (the exact penalty).
"""

from __future__ import annotations

from math import inf, sqrt
from time import perf_counter
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from invariantqp.geometry.arrays import Array
from invariantqp.pose.error import Look, PoseError
from invariantqp.pose.joint_space import JointSpace
from invariantqp.velocity.qp.backends import Daqp, SolverFailure
from invariantqp.velocity.qp.boxqp import BoxQP

# lambda at the start of a try [1 / rad^2], what a step that helped leaves of it, what one that did not makes of it, and
# the least.
DAMPING, EASED, STIFFENED, LEAST = 0.1, 0.5, 4.0, 1e-3
# Shares of the trace of A'A that keep AA' and A'A definite, far below any damping that acts.
FLOOR, QP_FLOOR = 1e-13, 1e-8
# A try is given up where this many steps have not halved the error; it is at rest where so many have gained nothing.
STALLED, FINISHED = 6, 3
# Steps in one try, and where the last digits count; a valley flatter than that is at rest.
LONGEST, PATIENCE = 100, 1000
# A try ends where even steps this small, lambda, do not make the error smaller: rounding is all that is left.
STIFFEST = 1e8
# A merit that fell by no more than this share of itself in so many steps has come to rest.
AT_REST = 1e-12
# What an exact row weighs, over trace A'A: so much less is it missed than all others.
EXACT_WEIGHT = 1e8
# Multipliers of rows that the limits forbid are no prices: none is above this many |A| |r| / |C|.
DEAREST = 10.0
# The penalty is kept above the multipliers of the exact rows by this factor.
PENALTY_MARGIN = 2.0

# Asked without the checks and second opinions of `backends.minimise`: a bad step is known by what the error does.
_SOLVER = Daqp()


class Try(NamedTuple):
    """Where one try ended.

    Attributes:
        look: the last state, the best of the try.
        merit: f, and what is missing of the exact demands at the price it had.
        steps: Newton steps.
        met: whether the error went below the goal.
        at_rest: whether no step would make the error smaller by more than rounding.
    """

    look: Look
    merit: float
    steps: int
    met: bool
    at_rest: bool


def descend(
    error: PoseError,
    space: JointSpace,
    start: Array,
    goal: float,
    deadline: float,
    *,
    turning: bool = True,
    patient: bool = False,
) -> Try:
    """Steps from a start inside the limits until the goal is met or nothing is gained.

    Args:
        error: what is to be made small.
        space: the limits.
        start: (m,) inside them.
        goal: |r| and what is missing of the exact demands, together, where the target is met.
        deadline: of `time.perf_counter` [s].
        turning: whether a joint may leave its limits and be shifted back by whole turns.
        patient: whether to go on to the last digit where the target is not met.
    """
    look = error.at(start)
    damping, penalty = DAMPING, 0.0
    past: list[float] = []
    longest, window, least = (PATIENCE, FINISHED, 0.0) if patient else (LONGEST, STALLED, LEAST)
    for steps in range(longest):
        merit = look.f + penalty * look.unmet
        past.append(merit)
        if look.distance <= goal or perf_counter() > deadline:
            return Try(look, merit, steps, look.distance <= goal, at_rest=False)
        before = past[-1 - window] if steps > window else inf
        if not patient and merit > 0.5 * before:
            return Try(look, merit, steps, met=False, at_rest=False)
        if damping > STIFFEST or before - merit <= AT_REST * merit:
            return Try(look, merit, steps, met=False, at_rest=True)
        H = error.curvature(look) if patient and look.C is None else None
        x, price = _step(look, H, 2.0 * damping * look.f, *space.steps(look.q, turning=turning))
        penalty = max(penalty, PENALTY_MARGIN * price)
        seen = error.at(space.inside(look.q + x))
        if seen.f + penalty * seen.unmet < look.f + penalty * look.unmet:
            look, damping = seen, max(EASED * damping, least)
        else:
            damping *= STIFFENED
    return Try(look, look.f + penalty * look.unmet, longest, met=False, at_rest=True)


def _step(look: Look, H: Array | None, mu: float, lower: Array, upper: Array) -> tuple[Array, float]:
    """The step x (m,) inside the box, by the second derivative H or else A'A, and the multiplier of the exact rows."""
    A, r, C = look.A, look.r, look.C
    m, size = A.shape[1], float(np.vdot(A, A))
    x = None
    if C is None and H is None and m >= 6:
        S = A.dot(A.T)
        S.flat[::7] += mu + FLOOR * size
        _, y, failed = lapack.dposv(S, r)
        x = y.dot(A)
        if not failed and _allowed(x, lower, upper):
            return x, 0.0
    g, unit = r.dot(A), 1.0 / size
    H = A.T.dot(A) if H is None else H
    if C is not None and look.b is not None:
        H += EXACT_WEIGHT * size * C.T.dot(C)
        g += EXACT_WEIGHT * size * look.b.dot(C)
    H.flat[:: m + 1] += max(mu, QP_FLOOR * size)
    if x is None:
        _, x, failed = lapack.dposv(H, g)
        if failed or not _allowed(x, lower, upper):
            x = _boxed(H, g, unit, lower, upper)
    else:
        x = _boxed(H, g, unit, lower, upper)
    if C is None or look.b is None:
        return x, 0.0
    miss = look.b - C.dot(x)
    most = DEAREST * sqrt(2.0 * size * look.f / float(np.vdot(C, C)))
    return x, min(EXACT_WEIGHT * size * sqrt(miss.dot(miss)), most)


def _allowed(x: Array, lower: Array, upper: Array) -> bool:
    """Whether clipping changes no bit: quicker than asking twice."""
    return bool(np.minimum(np.maximum(x, lower), upper).tobytes() == x.tobytes())


def _boxed(H: Array, g: Array, unit: float, lower: Array, upper: Array) -> Array:
    """The minimiser of 1/2 x'Hx - g'x in the box; the clipped gradient step where no solver finds it."""
    try:
        x = _SOLVER.solve(BoxQP(unit * H, unit * g, lower, upper, None))
    except SolverFailure:
        x = unit * g
    return np.minimum(np.maximum(x, lower), upper)
