"""Limits on combinations of joints, what every limit costs, and which of them are in the way."""

import numpy as np
import pytest
from support.velocity_reference import regular_problem, root_of, tight_box

import invariantqp as iq
from invariantqp.geometry.se3 import velocity_at
from invariantqp.velocity.definition import NULL_WEIGHT, ROUNDING
from invariantqp.velocity.solution import ACTIVE_TOLERANCE


def test_crossed_limits_are_refused():
    with pytest.raises(iq.BadInput, match=r"lower: found lower 1 above upper 0\.5 at row 1"):
        iq.limits.LimitRows(np.eye(2), [0.0, 1.0], [1.0, 0.5])


def test_rows_for_other_joints_are_refused():
    J, s = np.eye(6), np.ones(6)
    for rows in (iq.limits.LimitRows([[1.0] * 5], [0.0], [1.0]), np.eye(6)):
        with pytest.raises(iq.BadInput, match="rows"):
            iq.solve_velocity(J, s, form=0.4, rows=rows)


POINT, LENGTH = np.array([0.2, -0.3, 0.5]), 0.6
AT = {"point": POINT, "length": LENGTH}


def limited(rng, m, k=3):
    """A problem whose box and rows both bind, zero inside them."""
    J, s, _ = regular_problem(rng, m)
    A, b = root_of(POINT, LENGTH) @ J, root_of(POINT, LENGTH) @ s
    free = np.linalg.lstsq(A, b, rcond=None)[0]
    C = rng.normal(size=(k, m))
    reach = np.abs(C @ free) * rng.uniform(0.2, 1.5, k)
    return J, s, free, tight_box(rng, m, free, share=0.4), iq.limits.LimitRows(C, -reach, reach)


def objective(J, s, damping=0.0, metric=None, posture=None):
    """(H, c) of the law on the joints themselves: |A x - b|^2, damping, and the null space's pull to the posture."""
    A, M = root_of(POINT, LENGTH) @ J, np.eye(J.shape[1]) if metric is None else metric
    T = np.linalg.inv(np.linalg.cholesky(M)).T
    N = np.linalg.svd(A @ T)[2][6:] @ np.linalg.inv(T)
    pull = NULL_WEIGHT * np.linalg.norm(A @ T) ** 2 * N.T @ N
    wanted = np.zeros(len(M)) if posture is None else posture
    return A.T @ A + damping**2 * M + pull, A.T @ root_of(POINT, LENGTH) @ s + pull @ wanted


def inside(x, bounds, rows):
    boxed = (x >= bounds.lower).all() and (x <= bounds.upper).all()
    return boxed and (rows is None or (np.abs(rows.excess(x)) <= 1e-9).all())


@pytest.mark.parametrize("rows", [False, True], ids=["box", "box and rows"])
@pytest.mark.parametrize("metric", [False, True], ids=["identity", "joint metric"])
def test_multipliers_balance_the_objective(metric, rows):
    """H x - c + y + C'w = 0 on a second construction of H and c; signs by side, zero away from limits.

    Of a convex problem that is the optimum.
    """
    rng = np.random.default_rng(5)
    bound = 0
    for m in (3, 3, 4, 4, 6, 6, 6, 8, 8):
        J, s, _, bounds, limits = limited(rng, m)
        damping, posture, M = (0.05, 0.3)[bound % 2], rng.normal(size=m), rng.normal(size=(m, m))
        M = M @ M.T + 0.5 * np.eye(m) if metric else None
        options = {"damping": damping, "joint_metric": M, "posture": posture, **AT}
        solution = iq.solve_velocity(J, s, bounds=bounds, rows=limits if rows else None, **options)
        if solution.method != "qp":
            assert solution.multipliers is None
            continue
        bound += 1
        H, c = objective(J, s, damping, M, posture)
        assert inside(solution.velocity, bounds, limits if rows else None)
        x, y = solution.velocity, solution.multipliers
        left, small = H @ x - c + y, 1e-9 * np.abs(c).max()
        assert (y[np.setdiff1d(np.arange(m), solution.active)] == 0.0).all()
        if rows:
            w = solution.row_multipliers
            left += limits.C.T @ w
            value = limits.C @ x
            assert (np.abs(value - limits.upper)[w > small] < 1e-9).all()
            assert (np.abs(value - limits.lower)[w < -small] < 1e-9).all()
        else:
            assert solution.row_multipliers is None
        assert np.abs(left).max() < small
        np.testing.assert_allclose(x[y > small], bounds.upper[y > small], rtol=1e-12)
        np.testing.assert_allclose(x[y < -small], bounds.lower[y < -small], rtol=1e-12)
    assert bound >= 4


def test_a_multiplier_is_the_gain_of_loosening_the_limit():
    rng = np.random.default_rng(6)
    J, s, _, bounds, rows = limited(rng, 5)
    solution = iq.solve_velocity(J, s, bounds=bounds, rows=rows, **AT)
    H, c = objective(J, s)
    i = int(np.abs(solution.multipliers).argmax())
    e = 1e-6
    lower, upper = np.array(bounds.lower), np.array(bounds.upper)
    lower[i], upper[i] = lower[i] - e, upper[i] + e
    looser = iq.solve_velocity(J, s, bounds=(lower, upper), rows=rows, **AT)

    def cost(z):
        return 0.5 * z @ H @ z - c @ z

    gain = (cost(solution.velocity) - cost(looser.velocity)) / e
    assert gain == pytest.approx(abs(solution.multipliers[i]), rel=1e-3)


def test_inactive_rows_change_nothing_and_have_no_multiplier():
    rng = np.random.default_rng(7)
    J, s, h = regular_problem(rng, 6)
    far = iq.limits.LimitRows(rng.normal(size=(2, 6)), [-1e3, -np.inf], [1e3, np.inf])
    free, solution = (iq.solve_velocity(J, s, form=h, rows=r) for r in (None, far))
    np.testing.assert_array_equal(solution.velocity, free.velocity)
    assert solution.method == "closed-form"
    assert solution.multipliers is None
    near = iq.solve_velocity(J, s, form=h, rows=iq.limits.LimitRows(far.C, [-1e-3] * 2, [1e-3] * 2))
    assert near.method == "qp"
    assert near.reason.endswith(("at the limits of rows 0, 1", "at the limits of rows 1, 0"))


def test_the_conflicting_joint_and_the_relaxed_row_are_named():
    J, s, h = regular_problem(np.random.default_rng(20), 4)
    bounds = iq.Bounds([-1.0] * 4, [1.0, 1.0, 0.5, 1.0])
    rows = iq.limits.LimitRows([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0]], [-0.2, 1.5], [0.2, 9.0])
    solution = iq.solve_velocity(J, s, form=h, bounds=bounds, rows=rows)
    assert solution.status == "degraded"
    assert "limit rows conflict with the bounds of joint 2: exceeded at row 1 by 0.5" in solution.reason
    assert solution.velocity[2] == pytest.approx(0.5, abs=1e-6)
    assert abs(solution.velocity[0]) <= 0.2 + 1e-9  # a row that is in nobody's way does not give way


def scaled_rows(rows, scale):
    return iq.limits.LimitRows(scale[:, None] * rows.C, scale * rows.lower, scale * rows.upper)


def test_the_scaling_of_a_row_changes_nothing():
    """Neither whether rows that some velocity satisfies are kept, nor which give way, nor by how much."""
    rng, contrary, kept = np.random.default_rng(25), 0, 0
    for k in range(60):
        m = 2 + k % 6
        J, s, h = regular_problem(rng, m)
        bounds = iq.Bounds(-rng.uniform(0.1, 1.0, m), rng.uniform(0.1, 1.0, m))
        C = rng.normal(size=(3, m))
        C[2] = (C[0], C[2], -C[1])[k % 3]
        inside = rng.uniform(bounds.lower, bounds.upper)
        low = C @ inside - rng.uniform(0.0, 0.1, 3) + (k % 2) * rng.uniform(0.0, 2.0, 3)
        rows, scale = iq.limits.LimitRows(C, low, low + 0.2), 10.0 ** rng.uniform(-6.0, 6.0, 3)
        one, other = (iq.solve_velocity(J, s, form=h, bounds=bounds, rows=r) for r in (rows, scaled_rows(rows, scale)))
        size = np.abs(one.velocity).max()
        assert (one.status, one.active) == (other.status, other.active)
        np.testing.assert_allclose(other.velocity, one.velocity, rtol=0.0, atol=1e-8 * size)
        if k % 2 == 0:
            kept += 1
            assert "conflict" not in one.reason
            assert (np.abs(rows.excess(one.velocity)) <= 1e-9 * size).all()
        contrary += "conflict" in one.reason
    assert kept > 20
    assert contrary > 10


def test_rows_that_conflict_with_each_other():
    J, s, h = regular_problem(np.random.default_rng(21), 4)
    rows = iq.limits.LimitRows([[1.0, 1.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0]], [1.0, -np.inf], [np.inf, 0.0])
    solution = iq.solve_velocity(J, s, form=h, rows=rows)
    assert "limit rows conflict with each other: exceeded at row 0 by 0.5, row 1 by 0.5" in solution.reason
    widened = 0.5 * ROUNDING**0.5  # of what gives way
    assert solution.velocity[:2].sum() == pytest.approx(0.5, abs=widened)


@pytest.mark.parametrize("side", [0.0, 5e-18, 1e-12, -1e-12])
def test_a_row_with_a_nearly_zero_limit_is_kept(side):
    """A bound of no size says nothing of how fast the joints are, and must not scale the problem."""
    rng = np.random.default_rng(24)
    for _ in range(20):
        J, s = rng.normal(size=(6, 7)), rng.normal(size=6)
        bounds = iq.Bounds(np.full(7, -0.4), np.full(7, 0.4))
        C = np.vstack((np.eye(7), rng.normal(size=(1, 7))))
        upper = np.full(8, 0.06)
        upper[rng.permutation(8)[:4]] = side
        at_zero, near = (
            iq.solve_velocity(J, s, form=0.4, bounds=bounds, rows=iq.limits.LimitRows(C, np.full(8, -np.inf), u))
            for u in (np.where(upper == side, 0.0, upper), upper)
        )
        assert (near.status, at_zero.status) == ("limited", "limited"), near.reason
        assert "conflict" not in near.reason
        # All of a velocity is shortened by what rounding is over a row, relative to it: ACTIVE_TOLERANCE at most.
        np.testing.assert_allclose(near.velocity, at_zero.velocity, rtol=ACTIVE_TOLERANCE, atol=1e-9)
        assert (C @ near.velocity <= upper + 1e-12).all()


def test_a_row_holds_to_rounding_while_a_joint_has_to_move():
    """Shortened by the rounding of a small difference, and that joint back in its range, the row would be exceeded."""
    rng = np.random.default_rng(26)
    for _ in range(30):
        J, s, least = rng.normal(size=(6, 6)), rng.normal(size=6), rng.uniform(0.05, 0.3)
        bounds = iq.Bounds([least, *[-1.0] * 5], [2.0 * least, *[1.0] * 5])
        C = 1e7 * np.array([[1.0, -1.0, 0.0, 0.0, 0.0, 0.0]])
        x = iq.solve_velocity(J, s, bounds=bounds, rows=iq.limits.LimitRows(C, [-0.01], [0.01])).velocity
        assert np.abs(C @ x) <= 0.01 + 1e-14 * np.linalg.norm(C) * np.linalg.norm(x)


def test_limits_that_scale_exact_rows_are_named():
    J, s, h = regular_problem(np.random.default_rng(22), 5)
    bounds = iq.Bounds([-9.0] * 5, [9.0, 9.0, 0.25, 9.0, 9.0])
    exact = iq.ExactRows([[0.0, 0.0, 1.0, 0.0, 0.0]], [1.0])
    solution = iq.solve_velocity(J, s, form=h, bounds=bounds, exact=exact)
    assert solution.status == "scaled"
    assert "limits allow 0.25 of the exact rows' speed; at the limits of joint 2" in solution.reason
    rows = iq.limits.LimitRows([[0.0, 0.0, 1.0, 0.0, 0.0]], [-0.1], [0.1])
    solution = iq.solve_velocity(J, s, form=h, bounds=bounds, rows=rows, exact=exact)
    assert "limits allow 0.1 of the exact rows' speed; at the limits of row 0" in solution.reason
    assert solution.scale == pytest.approx(0.1, rel=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_all_kinds_of_limits_together_are_kept(seed):
    rng = np.random.default_rng(100 + seed)
    seen = set()
    for k in range(60):
        m = 2 + k % 7
        J, s, p = rng.normal(size=(6, m)), rng.normal(size=6), rng.normal(size=3)
        bounds = iq.Bounds(-rng.uniform(0.0, 1.0, m), rng.uniform(0.0, 1.0, m))
        C = rng.normal(size=(1 + k % 3, m))
        rows = iq.limits.LimitRows(C, -rng.uniform(0.0, 0.3, len(C)), rng.uniform(0.0, 0.3, len(C)))
        exact = iq.ExactRows(J[3:4], s[3:4]) if k % 4 == 0 else None
        slow = iq.limits.ToolSpeed(rng.uniform(0.05, 0.5), p) if k % 5 < 3 else None
        given = {"bounds": bounds, "rows": rows, "exact": exact, "tool_speed": slow, "guard": True}
        solution = iq.solve_velocity(J, s, form=(None, 0.4)[k % 2], posture=rng.normal(size=m), **given)
        assert solution.status in {"ok", "limited", "guarded", "scaled"}, solution.reason
        told = any(why in solution.reason for why in ("no velocity reduces", "of the twist is missed", "six joints"))
        assert told or solution.status != "limited"
        assert inside(solution.velocity, bounds, rows)
        assert slow is None or np.linalg.norm(velocity_at(J, p) @ solution.velocity) <= slow.limit + 1e-9
        seen.add(solution.status)
    assert {"limited", "scaled"} <= seen
