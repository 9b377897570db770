"""Where limits leave no velocity as asked: how much of it they do, which of them hold it there, what has to give way.

largest alpha in [0, 1] with lower <= A (alpha x0 + B z) <= upper        a linear program; its duals name the limits
least sum of squares of t with lower <= C x - t <= upper in the box      what rows have to give way by
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.exact import Reduction
from invariantqp.velocity.limits.rows import LimitRows, Polytope, polytope
from invariantqp.velocity.limits.toolspeed import CONE_TOLERANCE, Cone
from invariantqp.velocity.qp.backends import Daqp, minimise
from invariantqp.velocity.qp.tangents import with_plane

# A dual this small beside the largest is rounding: that limit holds nothing.
DUAL_TOLERANCE = 1e-7
# What a joint velocity costs beside a violation of the same size: only to make the problem strictly convex. The rows
# give way by at most about this share more than they have to.
REGULARISATION = 1e-8
# Rows that would have to give way by less than this, relative to their size, need not.
VIOLATION_TOLERANCE = 1e-9


# Tangent planes for the exact rows' share, each a linear program; what is left is shortened away.
SHARE_PLANES = 8
# A bound holds rows back where they pull at it with more than this share of what they pull with in all.
HOLDING_TOLERANCE = 1e-6


class Share(NamedTuple):
    """How much of the exact rows' speed is possible.

    Attributes:
        alpha: in [0, 1]; None where not even standing still along the rows is.
        held_by: limits (indices of the polytope on x) that hold it there.
        velocity: (m,) one that has it; empty where there is none.
    """

    alpha: float | None
    held_by: list[int]
    velocity: Array


def largest_share(reduction: Reduction, limits: Polytope) -> Share:
    """The largest alpha in [0, 1] with lower <= A (alpha x0 + B z) <= upper for some z.

    A linear program, solved by HiGHS through SciPy.
    """
    if reduction.basis is None:
        return Share(1.0, [], np.empty(0))
    on_x = np.column_stack((reduction.origin, reduction.basis))
    A = on_x if limits.A is None else limits.A.dot(on_x)
    best, held_by = _program(A, limits, np.zeros(len(A)))
    if best is not None:
        return Share(float(best[0]), held_by, on_x.dot(best))
    # Nothing at all: the limits that cannot be moved apart any less are the ones in each other's way.
    _, held_by = _program(np.column_stack((np.zeros(len(A)), A)), limits, np.ones(len(A)))
    return Share(None, held_by, np.empty(0))


def share_in_cone(reduction: Reduction, limits: Polytope, cone: Cone | None) -> Share:
    """`largest_share` inside a speed limit too: tangent planes one after another, then shortened by what is left.

    Limits in `held_by` beyond the polytope's own are the cone's planes.
    """
    share = largest_share(reduction, limits)
    if cone is None:
        return share
    for _ in range(SHARE_PLANES):
        if share.alpha is None or cone.speed(share.velocity) <= cone.limit * (1.0 + CONE_TOLERANCE):
            break
        limits = with_plane(limits, cone, share.velocity)
        share = largest_share(reduction, limits)
    if share.alpha is None:
        return share
    return share._replace(alpha=share.alpha / max(1.0, cone.speed(share.velocity) / cone.limit))


def _program(A: Array, limits: Polytope, slack: Array) -> tuple[Array | None, list[int]]:
    """Without slack the largest first variable in [0, 1]; with it, the least one that all limits yield by."""
    from scipy.optimize import linprog

    above, below = np.flatnonzero(np.isfinite(limits.upper)), np.flatnonzero(np.isfinite(limits.lower))
    yields = bool(slack.any())
    cost = np.zeros(A.shape[1])
    cost[0] = 1.0 if yields else -1.0
    upper, lower = A[above].copy(), -A[below]
    upper[:, 0] -= slack[above]
    lower[:, 0] -= slack[below]
    first = [(0.0, None), (0.0, 1.0)] if yields else [(0.0, 1.0)]
    result = linprog(
        cost,
        A_ub=np.vstack((upper, lower)),
        b_ub=np.concatenate((limits.upper[above], -limits.lower[below])),
        bounds=[*first, *[(None, None)] * (A.shape[1] - len(first))],
        method="highs",
    )
    if result.status != 0:
        return None, []
    duals = np.abs(np.asarray(result.ineqlin.marginals))
    holding = duals > DUAL_TOLERANCE * max(duals.max(initial=0.0), np.finfo(float).tiny)
    return np.asarray(result.x), sorted({int(i) for i in np.concatenate((above, below))[holding]})


class Relaxed(NamedTuple):
    """Rows moved out of the box's way.

    Attributes:
        rows: with the limits where they have to be.
        violation: (k,) by how much, positive above and negative below.
        held_by: joints whose bounds ask for it, and the rows that gave way (indices of the polytope on x).
    """

    rows: LimitRows
    violation: Array
    held_by: list[int]

    def widened(self, margin: float) -> LimitRows:
        """The moved limits let go by a share of the violation more, for a solver to find an inside."""
        more = margin * float(np.abs(self.violation).max())
        let_go = np.where(self.violation != 0.0, more, 0.0)
        return LimitRows(self.rows.C, np.asarray(self.rows.lower) - let_go, np.asarray(self.rows.upper) + let_go)


def relaxed(rows: LimitRows, lower: Array, upper: Array) -> Relaxed:
    """The rows, given way by the least sum of squares that leaves a velocity in the box.

    Raises:
        SolverFailure: nobody found one.
    """
    C = np.asarray(rows.C)
    k, m = C.shape
    size = float(np.abs(C).max()) or 1.0
    H = np.diag(np.concatenate((np.full(m, REGULARISATION * size * size), np.ones(k))))
    free = np.full(k, np.inf)
    apart = LimitRows(np.hstack((C, -np.eye(k))), rows.lower, rows.upper)
    limits = polytope(np.concatenate((lower, -free)), np.concatenate((upper, free)), apart)
    z = minimise(Daqp(), H, np.zeros(m + k), limits).z
    t, edge = z[m:], HOLDING_TOLERANCE * (1.0 + np.abs(z[:m]))
    x = np.minimum(np.maximum(z[:m], lower), upper)
    violation = rows.excess(x)
    reach = np.abs(C).dot(np.abs(x)) + np.abs(violation)
    violation[np.abs(violation) <= VIOLATION_TOLERANCE * reach] = 0.0
    pull = np.abs(t.dot(C)) > HOLDING_TOLERANCE * np.abs(t).dot(np.abs(C))  # C't balances the multipliers of the box
    holding = np.flatnonzero(pull & (violation.any() & ((x <= lower + edge) | (x >= upper - edge))))
    low, high = np.asarray(rows.lower), np.asarray(rows.upper)
    moved = LimitRows(C, low + np.minimum(violation, 0.0), high + np.maximum(violation, 0.0))
    held_by = [int(i) for i in holding] + [m + int(i) for i in np.flatnonzero(violation)]
    return Relaxed(moved, violation, held_by)


def slowest(cone: Cone, limits: Polytope) -> float:
    """The least speed of the cone's point inside the limits on x [length/s], to rounding from above.

    Raises:
        SolverFailure: nobody found it.
    """
    m = cone.J.shape[1]
    H = cone.J.T.dot(cone.J)
    H = H + REGULARISATION * (float(H.max()) or 1.0) * np.eye(m)
    return cone.speed(minimise(Daqp(), H, np.zeros(m), limits).z)
