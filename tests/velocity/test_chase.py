"""The slowed chase is the minimum of one convex function, here written down and given to another solver.

1/2 |K (z - z0 - p (z1 - z0))|^2 + delta |K (z1 - z0)| (1 - p)      over z inside the limits and 0 <= p <= 1
"""

import re

import numpy as np
import pytest
import qpsolvers
from scipy.sparse import csc_matrix
from support.velocity_reference import LIMITED, least_squares_form, regular_problem, root_of

from invariantqp.velocity import Adaptive
from invariantqp.velocity.law import Chase, Demand, VelocityLaw
from invariantqp.velocity.limits import LimitRows
from invariantqp.velocity.solve import solve

# What the other solver is off, relative; ours is the lower of the two.
AGREE = 2e-6


def drawn(seed, m, rows):
    """A demand with a chase, and its law: velocity limits that bind, wider position limits that sometimes do."""
    rng = np.random.default_rng([seed, m])
    J, s, _ = regular_problem(rng, m)
    root = root_of(rng.normal(size=3), 0.6)
    ahead = (0.0, 0.2, 1.0)[seed % 3] * rng.normal(size=6)
    A = root @ J
    free = np.linalg.lstsq(A, root @ s, rcond=None)[0]
    tight = np.abs(free).max() * rng.uniform(0.1, 0.8, (2, m))
    wide = tight * rng.uniform(1.0, 6.0, (2, m))
    posture = rng.normal(size=m) if m > 6 else None
    slack = np.linalg.norm(root @ s) * 10.0 ** rng.uniform(-4.0, -1.0)
    limits = None
    if rows:
        C = rng.normal(size=(2, m))
        limits = LimitRows(C, -np.abs(C @ free) * rng.uniform(0.2, 0.9, 2), np.abs(C @ free) * rng.uniform(0.2, 0.9, 2))
    chase = Chase(ahead, None, -wide[0], wide[1], slack, apart=True)
    demand = Demand(J, s, root, -tight[0], tight[1], posture=posture, rows=limits, chase=chase)
    return VelocityLaw(damping=Adaptive()), demand


def minimum(H, c, lower, upper, rows):
    """Of 1/2 z'Hz - c'z in a box and rows, by quadprog."""
    C = np.empty((0, len(c))) if rows is None else np.asarray(rows.C)
    G = np.vstack((np.eye(len(c)), -np.eye(len(c)), C, -C))
    sides = (np.empty(0),) * 2 if rows is None else (np.asarray(rows.upper), -np.asarray(rows.lower))
    return qpsolvers.solve_qp(H, -c, G, np.concatenate((upper, -lower, *sides)), solver="quadprog")


def by_definition(demand):
    """The velocity and the pace."""
    A, b, f = demand.root @ demand.J, demand.root @ demand.s, demand.root @ demand.chase.ahead
    chase, rows, m = demand.chase, demand.rows, demand.J.shape[1]
    (H, c), (_, still) = (least_squares_form(A, v, demand.posture, LIMITED) for v in (b, f))
    z1, z0 = (minimum(H, v, chase.lower, chase.upper, rows) for v in (c, still))
    d = z1 - z0
    # Over (z, p): K z - K z0 - p K d, shifted to w = z - z0 - p d.
    shift = np.column_stack((np.eye(m), -d))
    P, still_cost = shift.T @ H @ shift, -shift.T @ H @ z0
    C = np.empty((0, m)) if rows is None else np.asarray(rows.C)
    G = np.vstack((np.eye(m), -np.eye(m), C, -C))
    G = np.column_stack((G, np.zeros(len(G))))
    h = np.concatenate(
        (demand.upper, -demand.lower, *((rows.upper, -np.asarray(rows.lower)) if rows is not None else ()))
    )
    ends = np.zeros((2, m + 1))
    ends[0, m], ends[1, m] = 1.0, -1.0
    tight = {"tol_gap_abs": 1e-13, "tol_gap_rel": 1e-13, "tol_feas": 1e-13, "max_iter": 500}
    size = np.sqrt(np.diag(H).max())
    P, G, pace = csc_matrix(P / size**2), csc_matrix(np.vstack((G, ends))), 1.0
    for _ in range(2):  # what may be missed of a slowed chase is its share of the slack
        q = still_cost - (np.linalg.norm(f) + pace * chase.slack) * np.sqrt(d @ H @ d) * np.eye(m + 1)[m]
        found = qpsolvers.solve_qp(P, q / size**2, G, np.concatenate((h, [1.0, 0.0])), solver="clarabel", **tight)
        pace = float(np.clip(found[m], 0.0, 1.0))
    return minimum(H, still + pace * (c - still), demand.lower, demand.upper, rows), pace


@pytest.mark.cases(5)
@pytest.mark.parametrize("rows", [False, True], ids=["box", "rows"])
@pytest.mark.parametrize("m", [3, 5, 6, 7, 8])
def test_the_slowed_chase_by_its_definition(m, rows):
    pytest.importorskip("clarabel")
    slowed = 0
    for seed in range(12):
        law, demand = drawn(seed, m, rows)
        solution = solve(law, demand)
        x, pace = by_definition(demand)
        np.testing.assert_allclose(solution.velocity, x, rtol=0.0, atol=AGREE * np.abs(x).max())
        told = re.search(r"limits allow (\S+) of the approach's speed", solution.reason)
        assert (float(told[1]) if told else 1.0) == pytest.approx(pace, abs=2e-3)
        slowed += told is not None
    assert slowed >= 4
