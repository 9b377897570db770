"""One try at a pose: damped Newton steps inside the joint limits; no step makes the error larger.

    x = argmin 1/2 |r - A x|^2 + 1/2 mu |x|^2   over   q_min <= q + x <= q_max,      mu = lambda |r|^2

Damping that vanishes with the error converges quadratically where the target can be reached and comes to rest where it
cannot. Where no limit is active and six joints or more move the tool, x = A'(AA' + mu)^-1 r. With mu = 0 that is
J^{+h} s for every pitch h, s the twist of r. Exact demands, C x = b, come first, the rest moves only what they leave:

    x_1 = argmin 1/2 |b - C x|^2 + 1/2 lambda |b|^2 |x|^2,     x = argmin of the above over   C x = C x_1

both inside the limits; then a step is accepted if it reduces f + nu |b|.

Reference: Levenberg 1944; Chan and Lawrence 1988 (damping by the error); Sugihara 2011; Han 1977 (the exact penalty).
"""

from __future__ import annotations

from math import inf, sqrt
from time import perf_counter
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from invariantqp.engine import core
from invariantqp.geometry.arrays import NEGLIGIBLE, ROUNDING, Array
from invariantqp.geometry.linear import rank_of
from invariantqp.pose.error import JointSpace, Linearization, PoseError
from invariantqp.velocity.backends import BoxQP, Daqp, SolverFailure
from invariantqp.velocity.exact import ROW_TOLERANCE

# lambda at the start of a try [1 / rad^2], its factors after a step that reduced the error and after one that did not,
# and its least value.
DAMPING, EASED, STIFFENED, LEAST = 0.1, 0.5, 4.0, 1e-3
# Shares of the trace of A'A that keep AA' and A'A definite, far below any damping that acts.
FLOOR, QP_FLOOR = 1e-13, 1e-8
# A try is given up where this many steps have not halved the error; it is at rest where this many have gained nothing.
STALLED, FINISHED = 6, 3
# The most steps in a try, and in one for the last digits; an error that falls more slowly counts as at rest.
LONGEST, PATIENCE = 100, 1000
# A try ends where even steps with this much damping do not make the error smaller: rounding is all that is left.
STIFFEST = 1e8
TINY = float(np.finfo(float).tiny)
# Multipliers are bounded by this many |A| |r| / |C|: those of rows that the limits forbid have no meaning.
DEAREST = 10.0
# The penalty is kept above the multipliers of the exact rows by this factor.
PENALTY_MARGIN = 2.0

# Called without the checks of `backends.minimise`: a bad step shows in the error.
_SOLVER = Daqp()


class Try(NamedTuple):
    """Where one try ended."""

    q: Array  # (m,) the last joint positions, the best of the try
    f: float  # half of |r|^2 there
    unmet: float  # |b| there
    merit: float  # f + nu |b| there
    steps: int  # Newton steps
    met: bool  # whether the error went below the goal
    at_rest: bool  # whether no step would make the error smaller by more than rounding


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
    """Steps from a start (m,) inside the limits until |r| and |b| together meet the goal or no step gains anything.

    They end at the deadline of `time.perf_counter` [s]. With `turning` a joint may leave its limits and is shifted back
    by whole turns; a `patient` search goes on to the last digit where the target cannot be met.
    """
    found = _compiled(error, start, goal, deadline, turning=turning, patient=patient)
    if found is not None:
        return found
    state = error.at(start)
    damping, penalty = DAMPING, 0.0
    past: list[float] = []
    longest, window, least = (PATIENCE, FINISHED, 0.0) if patient else (LONGEST, STALLED, LEAST)
    for steps in range(longest):
        merit = state.f + penalty * state.unmet
        past.append(merit)
        if state.distance <= goal or perf_counter() > deadline:
            return _stopped(state, merit, steps, met=state.distance <= goal, at_rest=False)
        before = past[-1 - window] if steps > window else inf
        if not patient and merit > 0.5 * before:
            return _stopped(state, merit, steps, met=False, at_rest=False)
        if damping > STIFFEST or before - merit <= ROUNDING * merit:
            return _stopped(state, merit, steps, met=False, at_rest=True)
        H = error.curvature(state) if patient and state.C is None else None
        room, price = space.steps(state.q, turning=turning), 0.0
        if state.C is None:
            x = _step(state, H, 2.0 * damping * state.f, *room)
        else:
            x, price = _exact_step(state, state.C, damping, *room)
        penalty = max(penalty, PENALTY_MARGIN * price)
        seen = error.at(space.inside(state.q + x))
        if seen.f + penalty * seen.unmet < state.f + penalty * state.unmet:
            state, damping = seen, max(EASED * damping, least)
        else:
            damping *= STIFFENED
    return _stopped(state, state.f + penalty * state.unmet, longest, met=False, at_rest=True)


def _compiled(
    error: PoseError, start: Array, goal: float, deadline: float, *, turning: bool, patient: bool
) -> Try | None:
    """The try by the compiled core, some steps at a time, since it has no clock; None where Python has to make it."""
    if core is None or error.compiled is None or perf_counter() > deadline:
        return None
    q, known = start, None
    while True:
        found = core.descend(error.compiled, error.matrix, q, goal, turning, patient, known)
        if found is None:
            return None
        *ended, known = found
        if known is None or perf_counter() > deadline:
            return Try._make(ended)
        q = ended[0]


def _stopped(state: Linearization, merit: float, steps: int, *, met: bool, at_rest: bool) -> Try:
    return Try(state.q, state.f, state.unmet, merit, steps, met, at_rest)


def _step(state: Linearization, H: Array | None, mu: float, lower: Array, upper: Array) -> Array:
    """The step x (m,) inside the box, by the second derivative H or else A'A."""
    A, r = state.A, state.r
    m, size = A.shape[1], float(np.vdot(A, A))
    if H is None and m >= 6:
        S = A.dot(A.T)
        S.flat[::7] += mu + FLOOR * size
        _, y, failed = lapack.dposv(S, r)
        x: Array = y.dot(A)
        if not failed and _is_inside(x, lower, upper):
            return x
    g, unit = r.dot(A), 1.0 / size
    H = A.T.dot(A) if H is None else H
    H.flat[:: m + 1] += max(mu, QP_FLOOR * size)
    _, x, failed = lapack.dposv(H, g)
    return _minimum(H, g, unit, lower, upper) if failed or not _is_inside(x, lower, upper) else x


def _exact_step(state: Linearization, C: Array, damping: float, lower: Array, upper: Array) -> tuple[Array, float]:
    """The step x (m,) inside the box that meets the rows C (k, m) as well as that allows, and their multiplier."""
    A, r, b, m = state.A, state.r, np.asarray(state.b), C.shape[1]
    U, singular, Vt, _ = lapack.dgesdd(C)
    rank = rank_of(singular, ROW_TOLERANCE)
    sigma, wanted, size = np.zeros(m), np.zeros(m), float(np.vdot(A, A))
    sigma[:rank], wanted[:rank] = singular[:rank], b.dot(U[:, :rank])
    B = Vt[rank:].T
    weights = sigma * sigma + max(damping * float(b.dot(b)), NEGLIGIBLE * float(singular[0]) ** 2, TINY)
    first = (sigma * wanted / weights).dot(Vt)
    AB = A.dot(B)
    H = AB.T.dot(AB)
    H.flat[:: len(H) + 1] += max(2.0 * damping * state.f, QP_FLOOR * size)
    x: Array = first + B.dot(lapack.dposv(H, (r - A.dot(first)).dot(AB))[1]) if len(H) else first
    if not _is_inside(x, lower, upper):
        if not _is_inside(first, lower, upper):
            unit = 1.0 / float(weights[0])
            first = _minimum((Vt.T * weights).dot(Vt), (sigma * wanted).dot(Vt), unit, lower, upper)
        g = (r - A.dot(first)).dot(AB)
        x = first + B.dot(_minimum(H, g, 1.0 / size, lower - first, upper - first, B)) if len(H) else first
        x = np.clip(x, lower, upper)
    return x, _price(state, C, (r - A.dot(x)).dot(A), x, lower, upper)


def _price(state: Linearization, C: Array, pull: Array, x: Array, lower: Array, upper: Array) -> float:
    """|y|, the multiplier of the rows: C'y is what is left of the gradient where no limit holds a joint."""
    margin = NEGLIGIBLE * (1.0 + np.abs(x))
    free = (x > lower + margin) & (x < upper - margin)
    if not C[:, free].any():
        return 0.0
    _, sizes, ways, _ = lapack.dgesdd(C[:, free], full_matrices=0)
    y = (ways.dot(pull[free]) / np.maximum(sizes, TINY))[: rank_of(sizes, ROW_TOLERANCE)]
    most = DEAREST * sqrt(2.0 * float(np.vdot(state.A, state.A)) * state.f / float(np.vdot(C, C)))
    return min(sqrt(float(y.dot(y))), most)


def _is_inside(x: Array, lower: Array, upper: Array) -> bool:
    return bool(((lower <= x) & (x <= upper)).all())


def _minimum(H: Array, g: Array, unit: float, lower: Array, upper: Array, rows: Array | None = None) -> Array:
    """The minimiser of 1/2 x'Hx - g'x in a box on x or on rows x; where no solver finds it, a gradient step or none."""
    try:
        x = _SOLVER.solve(BoxQP(unit * H, unit * g, lower, upper, rows))
    except SolverFailure:
        x = unit * g if rows is None else np.zeros(len(g))
    return x if rows is not None else np.clip(x, lower, upper)
