"""Least squares inside the limits by one QP a tick, in its usual variants; and scaling that keeps a direction.

    minimise |A x - b|^2 + eps |x - x_p|^2 + mu |x|^2    inside the limits, with the exact rows C x = e
    A = J, b = s with metres and radians alike;  or root J, root s at the told point with the told length
    eps = 1e-6, mu = 0;  or eps = 1e-9 |A|^2, mu = 1/8 dt |b - A x_0| |A|, x_0 that for mu = 0        (Sugihara)

The posture x_p is zero for arms with up to six joints: eps is then the usual damping.

Limits that forbid exact rows slow them down by halves. All are solved by DAQP.

Reference: Escande, Mansard & Wieber 2014; Arnstrom, Bemporad & Axehill 2022 (DAQP); Sugihara 2011; Faverjon &
Tournassoud 1987 (velocity dampers).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from daqp import solve as solve_levels

from invariantqp.compare.method import Method, Question, Setting, Solve, Takes
from invariantqp.compare.names import TOLD_LEAST_SQUARES
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.backends import BoxQP, Daqp, SolverFailure
from invariantqp.velocity.measure import root_at

# eps where it is fixed; a usual value in scripts, and the square of Pink's cost of a posture task.
FIXED_WEIGHT = 1e-6
# Sugihara's factor, as measured to be calm and quick: of 1/2 dt |missed| |A|.
CALM = 0.25
# mu below this share of |A|^2 is not worth a second QP.
NEGLIGIBLE = 1e-6
# eps over |A|^2 where mu takes over near singularities.
SMALL_WEIGHT = 1e-9
# Shares of the exact rows' speed that are tried one after the other.
SHARES = (1.0, 0.5, 0.25, 0.125, 0.0)
# Velocity dampers act within this distance of a position limit, and stop a joint at this one [rad, m].
INFLUENCE, SECURITY = 0.1, 0.0
# Their gain [1/s].
DAMPER = 10.0
# What scaling prefers to posture: the whole of the twist.
WHOLE_TWIST = 1e3


def least_squares(
    *, told_length: bool = False, calm: bool = False, dampers: bool = False
) -> Callable[[Setting], Solve]:
    """A maker of least squares inside the limits: measured at the told point with the told length; with a mu that grows
    with what is missed; with bounds that shrink near position limits.
    """

    def make(setting: Setting) -> Solve:
        root = root_at(setting.point, setting.length) if told_length else None
        daqp, eye = Daqp(), np.eye(setting.m)

        def velocity(tick: Question) -> Array:
            A, b = (tick.J, tick.s) if root is None else (root.dot(tick.J), root.dot(tick.s))
            lower, upper = damper_bounds(tick, setting) if dampers else (tick.lower, tick.upper)
            size = float(np.vdot(A, A))
            weight = SMALL_WEIGHT * size if calm else FIXED_WEIGHT
            H, c = A.T.dot(A) + weight * eye, A.T.dot(b) + weight * tick.posture

            def best(mu: float) -> Array:
                K = (H + mu * eye) / size
                if not len(tick.C):
                    return daqp.solve(BoxQP(K, c / size, lower, upper, None))
                return slowed(daqp, K, c / size, lower, upper, tick)

            x = best(0.0)
            mu = 0.5 * CALM * setting.dt * float(np.linalg.norm(b - A.dot(x))) * np.sqrt(size) if calm else 0.0
            return best(mu) if mu > NEGLIGIBLE * size else x

        return velocity

    return make


def slowed(daqp: Daqp, H: Array, c: Array, lower: Array, upper: Array, tick: Question) -> Array:
    """The minimiser with exact rows, slowed down by halves where limits forbid them."""
    rows = np.vstack((np.eye(len(c)), tick.C))
    for share in SHARES:
        try:
            return daqp.solve(BoxQP(H, c, np.append(lower, share * tick.e), np.append(upper, share * tick.e), rows))
        except SolverFailure:
            continue
    return np.zeros(len(c))


def damper_bounds(tick: Question, setting: Setting) -> tuple[Array, Array]:
    """Velocity bounds that fall to zero in proportion to the distance from a position limit."""
    above = DAMPER * np.maximum(setting.high - tick.q - SECURITY, 0.0)
    below = DAMPER * np.maximum(tick.q - setting.low - SECURITY, 0.0)
    near_top, near_bottom = setting.high - tick.q < INFLUENCE, tick.q - setting.low < INFLUENCE
    upper = np.where(near_top, np.minimum(tick.upper, above), tick.upper)
    lower = np.where(near_bottom, np.maximum(tick.lower, -below), tick.lower)
    return np.minimum(lower, tick.upper), np.maximum(upper, tick.lower)


def _scaling(setting: Setting) -> Solve:
    """maximise alpha with J x = alpha s inside the limits, alpha <= 1; the posture in what is left.

    Where limits exclude every share, as those of accelerations may, it stops.
    """
    m, daqp = setting.m, Daqp()
    H = np.diag(np.r_[np.full(m, 1e-3), WHOLE_TWIST])

    def velocity(tick: Question) -> Array:
        c = np.r_[1e-3 * tick.posture, WHOLE_TWIST]
        rows = np.vstack((np.eye(m + 1), np.column_stack((tick.J, -tick.s))))
        low, high = np.r_[tick.lower, 0.0, np.zeros(6)], np.r_[tick.upper, 1.0, np.zeros(6)]
        try:
            return daqp.solve(BoxQP(H, c, low, high, rows))[:m]
        except SolverFailure:
            return np.zeros(m)

    return velocity


def levels(setting: Setting) -> Solve:
    """Limits > exact rows > J x = s > x = x_p, each level as far as those above allow, by DAQP's own hierarchies.

    Within a level DAQP weighs every row by one over its norm: what it misses of a twist is least in these units.
    """
    m, eye = setting.m, np.eye(setting.m)

    def velocity(tick: Question) -> Array:
        k = len(tick.C)
        # With exact rows the turn alone is left of the twist; rows told twice would take the posture's level away.
        rest = slice(0, 3 if k else 6)
        ends = np.cumsum([m, k, 3 if k else 6, m])[[0, 1, 2, 3] if k else [0, 2, 3]]
        rows = np.vstack((tick.C, tick.J[rest], eye))
        wanted = np.concatenate((tick.e, tick.s[rest], tick.posture))
        x, _, flag, _ = solve_levels(
            None,
            None,
            rows,
            np.concatenate((tick.upper, wanted)),
            np.concatenate((tick.lower, wanted)),
            np.zeros(ends[-1], dtype=np.intc),
            ends.astype(np.intc),
        )
        if flag <= 0:
            raise SolverFailure("daqp", f"exit flag {flag}")
        return np.asarray(x)

    return velocity


IN_OBJECTIVE, EQUALITY, INSIDE = "in the objective", "equality rows", "inside the QP"
FIXED, GROWS = "weight 1e-6", "grows with what is missed (Sugihara 2011)"

METHODS = [
    Method(
        name="least-squares QP",
        family="QP",
        why="least squares inside the limits, metres and radians alike, as scripts write it",
        takes=Takes(IN_OBJECTIVE, EQUALITY, INSIDE, FIXED),
        make=least_squares(),
        problem="ridge",
        shown=False,
    ),
    Method(
        name="QP with LM",
        family="QP",
        why="the same with Levenberg and Marquardt's damping (Sugihara 2011)",
        takes=Takes(IN_OBJECTIVE, EQUALITY, INSIDE, GROWS),
        make=least_squares(calm=True),
        shown=False,
    ),
    Method(
        name="QP with length",
        family="QP",
        why="the same with a radian counting as the arm's reach, its characteristic length, at the told point",
        takes=Takes(IN_OBJECTIVE, EQUALITY, INSIDE, FIXED),
        make=least_squares(told_length=True),
        shown=False,
    ),
    Method(
        name=TOLD_LEAST_SQUARES,
        family="QP",
        why="both: the told point and length, and Levenberg and Marquardt's damping; the nearest to this library's law",
        takes=Takes(IN_OBJECTIVE, EQUALITY, INSIDE, GROWS),
        make=least_squares(told_length=True, calm=True),
    ),
    Method(
        name="velocity dampers",
        family="QP",
        why="least squares with velocity bounds that shrink within 0.1 rad of position limits (Faverjon & Tournassoud)",
        takes=Takes(IN_OBJECTIVE, EQUALITY, "inside the QP, damped", FIXED),
        make=least_squares(dampers=True),
        shown=False,
    ),
    Method(
        name="hierarchical QP",
        family="QP",
        why="DAQP's own strict hierarchy: limits, exact rows, twist, posture (Escande, Mansard & Wieber 2014)",
        takes=Takes("lowest level", "second level", "first level", "none"),
        make=levels,
        shown=False,
    ),
    Method(
        name="scaling",
        family="QP",
        why="the largest share of the twist in its own direction inside the limits, as Drake's function does",
        takes=Takes("in what is left", "a part of the twist, with it", "inside; slows the twist down", "none"),
        make=_scaling,
    ),
]
