"""Rows met exactly: to rounding where limits allow it, along their direction and more slowly where they do not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from support.arms import arm
from support.repeats import repeats
from support.velocity_reference import eliminated, largest_share, regular_problem, root_of, tight_box

import invariantqp as iq
from invariantqp.velocity.limits import bounds_of
from invariantqp.velocity.solution import ACTIVE_TOLERANCE

# The share is at most this far from the largest, by what regularises it and keeps an inside.
SHARE_TOLERANCE = 1e-6


@pytest.mark.cases(3)
@pytest.mark.parametrize("m", [3, 4, 5, 6, 7, 8])
def test_exact_rows_constrain_the_least_squares_solution(m):
    """In 40 digits, from the optimum's own linear equations."""
    rng = np.random.default_rng(m)
    for k in range(10):
        J, s, _ = regular_problem(rng, m)
        count, p = min(3, m - 1), rng.normal(size=3)
        A, b = J[3 : 3 + count], s[3 : 3 + count]
        root = root_of(p, 0.7)
        posture = rng.normal(size=m) if m > 6 and k % 2 else None
        solution = iq.solve_velocity(J, s, exact=iq.ExactRows(A, b), damping=0.0, point=p, length=0.7, posture=posture)
        M, wanted = root @ J, root @ s
        if m > 6:  # spare joints go to the posture: far below what the twist asks, far above rounding
            M = np.vstack((M, 1e-10 * np.eye(m)))
            wanted = np.concatenate((wanted, 1e-10 * (np.zeros(m) if posture is None else posture)))
        expected = eliminated(M, wanted, A, b)
        np.testing.assert_allclose(solution.velocity, expected, atol=1e-9 * (1.0 + np.linalg.norm(expected)))
        assert np.abs(A @ solution.velocity - b).max() <= 1e-13 * (1.0 + np.abs(solution.velocity).max()) * m
        assert (solution.status, solution.scale) == ("ok", 1.0)


@pytest.mark.cases(2)
@pytest.mark.parametrize("m", [3, 5, 6, 7, 8])
def test_exact_rows_hold_at_the_largest_feasible_scale(m):
    rng = np.random.default_rng(m)
    bound = slowed = 0
    for k in range(60):
        J, s, h = regular_problem(rng, m)
        A, b = J[3:], s[3:]
        A, b = A[: min(3, m - 1)], b[: min(3, m - 1)]
        rows = iq.ExactRows(A, b)
        options = {"form": (None, h)[k % 2], "guard": bool(k % 3)}
        free = iq.solve_velocity(J, s, exact=rows, **options)
        bounds = tight_box(rng, m, free.velocity, share=0.3)
        solution = iq.solve_velocity(J, s, exact=rows, bounds=bounds, **options)
        bound += solution.method == "qp" and solution.scale == 1.0
        slowed += solution.status == "scaled"
        share = largest_share(A, b, bounds.lower, bounds.upper)
        assert 0.0 <= solution.scale <= 1.0
        assert share * (1.0 - SHARE_TOLERANCE) - 1e-12 <= solution.scale <= share + 1e-9
        assert solution.scale < 1.0 or share > 1.0 - SHARE_TOLERANCE
        assert share < 1.0 or solution.status != "scaled"
        size = 1.0 + np.abs(solution.velocity).max()
        assert np.abs(A @ solution.velocity - solution.scale * b).max() <= 1e-11 * size
        assert ((bounds.lower <= solution.velocity) & (solution.velocity <= bounds.upper)).all()
        if solution.scale < 1.0:
            told = f"limits allow {solution.scale:.3g} of the exact rows' speed" in solution.reason
            assert told == (solution.scale < 1.0 - 1e-6)
    assert bound or m == 3
    assert slowed


@given(
    seed=st.integers(0, 10**9), m=st.integers(1, 9), kind=st.sampled_from(["general", "planar", "concurrent", "mixed"])
)
@settings(max_examples=150, deadline=None, derandomize=True)
def test_never_held_where_a_velocity_exists(seed, m, kind):
    """Joints at their limits, on the way back from outside, rows near singular: something is always commanded."""
    rng = np.random.default_rng(seed)
    J = arm(rng, kind, m).J
    p = rng.normal(size=3)
    rows = (iq.ExactRows.point(J, p, rng.normal(size=3)), iq.ExactRows.plane(J, p, rng.normal(size=3), 0.3))[seed % 2]
    reach = rng.uniform(0.0, 2.0, m)
    lower, upper = -reach.copy(), reach.copy()
    at = rng.random(m)
    upper[at < 0.25] = 0.0  # at its limit
    lower[at > 0.9] = 0.5 * reach[at > 0.9]  # outside: it has to come back
    upper[at > 0.9] = reach[at > 0.9]
    solution = iq.solve_velocity(J, rng.normal(size=6), exact=rows, bounds=(lower, upper))
    assert solution.status != "held"
    assert 0.0 <= solution.scale <= 1.0
    assert ((lower <= solution.velocity) & (solution.velocity <= upper)).all()
    feasible = np.linalg.matrix_rank(np.column_stack((rows.A, rows.b)), tol=1e-9) == np.linalg.matrix_rank(
        rows.A, tol=1e-9
    )
    if solution.status in {"ok", "scaled"}:
        assert feasible
    if feasible and (lower <= 0.0).all():
        share = largest_share(rows.A, rows.b, lower, upper)
        assert solution.scale >= share * (1.0 - SHARE_TOLERANCE) - 1e-7
        np.testing.assert_allclose(rows.A @ solution.velocity, solution.scale * rows.b, atol=1e-8)


def test_rows_at_rest_are_not_scaled_by_an_independent_motion():
    """A joint on its way back inside its range, which the others can make up for."""
    rng = np.random.default_rng(5)
    for _ in range(40):
        J, s = rng.normal(size=(6, 7)), rng.normal(size=6)
        lower, upper = np.full(7, -9.0), np.full(7, 9.0)
        lower[3] = 10.0 ** rng.uniform(-3, 0)
        rows = iq.ExactRows.of(J, np.eye(6)[3:], np.zeros(3))
        solution = iq.solve_velocity(J, s, exact=rows, bounds=iq.Bounds(lower, upper))
        assert solution.scale == 1.0
        assert solution.status != "scaled"
        assert np.abs(J[3:] @ solution.velocity).max() <= 1e-12 * np.abs(solution.velocity).max()


def test_consistent_dependent_rows_count_as_one():
    rng = np.random.default_rng(12)
    J, s, _ = regular_problem(rng, 6)
    one = iq.solve_velocity(J, s, exact=iq.ExactRows(J[3:5], s[3:5]))
    rows = iq.ExactRows(np.vstack((J[3:5], 2.0 * J[3:4])), [*s[3:5], 2.0 * s[3]])
    twice = iq.solve_velocity(J, s, exact=rows)
    assert twice.status == one.status == "ok"
    np.testing.assert_allclose(twice.velocity, one.velocity, atol=1e-9)


def test_rows_that_no_velocity_satisfies():
    """They are met by least squares, the twist goes on, and it is told."""
    rng = np.random.default_rng(13)
    J, s, _ = regular_problem(rng, 5)
    rows = iq.ExactRows(np.vstack((J[3], J[3])), [1.0, 2.0])
    solution = iq.solve_velocity(J, s, exact=rows)
    assert (solution.status, solution.scale) == ("degraded", 1.0)
    assert "the joints cannot keep the direction of the exact rows: 3.2e-01 of the demand is" in solution.reason
    between = iq.solve_velocity(J, s, exact=iq.ExactRows(J[3:4], [1.5]))
    np.testing.assert_allclose(solution.velocity, between.velocity, rtol=1e-9)
    nothing = iq.solve_velocity(J, s, exact=iq.ExactRows(np.zeros((1, 5)), [1.0]))
    assert nothing.status == "degraded"


def test_limits_that_forbid_the_rows_direction():
    """Outside its limits a joint must move against what the row asks: by no more than limits require."""
    rng = np.random.default_rng(14)
    J, s, _ = regular_problem(rng, 4)
    bounds = iq.Bounds([0.2, -1.0, -1.0, -1.0], [0.5, 1.0, 1.0, 1.0])
    rows = iq.ExactRows([[1.0, 0.0, 0.0, 0.0]], [-1.0])
    solution = iq.solve_velocity(J, s, exact=rows, bounds=bounds)
    assert solution.status == "scaled"
    assert "no velocity reduces the error" in solution.reason
    assert "limits allow" in solution.reason
    assert solution.scale == pytest.approx(0.0, abs=1e-6)
    assert solution.velocity[0] == pytest.approx(0.2, abs=1e-6)


def test_where_rest_is_forbidden_the_rows_may_still_be_at_rest():
    """The first joint has to come back at 0.2 and the second can make up for it."""
    J = np.random.default_rng(14).normal(size=(6, 4))
    bounds = ([0.2, -1.0, -1.0, -1.0], [0.5, 1.0, 1.0, 1.0])
    still, fast = (
        iq.solve_velocity(J, np.zeros(6), exact=iq.ExactRows([[1.0, 1.0, 0.0, 0.0]], [b]), bounds=bounds)
        for b in (0.0, -5.0)
    )
    assert still.velocity[:2].sum() == pytest.approx(0.0, abs=1e-9)
    assert fast.velocity[:2].sum() == pytest.approx(-0.8, rel=1e-6)
    assert fast.scale == pytest.approx(0.8 / 5.0, rel=1e-5)
    assert "beside" not in fast.reason


def test_rows_that_limits_violate_are_reported():
    """The first joint has to move where a row wants it at rest, while another row slows down."""
    J = np.random.default_rng(14).normal(size=(6, 4))
    rows = iq.ExactRows([[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]], [4.0, 0.0])
    bounds = ([0.2, -1.0, -1.0, -1.0], [0.5, 1.0, 1.0, 1.0])
    for metric in (None, np.diag([1.0, 2.0, 3.0, 4.0])):
        solution = iq.solve_velocity(J, np.zeros(6), exact=rows, bounds=bounds, joint_metric=metric)
        off = solution.velocity[0]
        assert solution.status == "scaled"
        assert f"; limits violate the exact rows: exact row 1 is off by {off:.3g}; at the limits" in solution.reason


@pytest.mark.cases(3)
@pytest.mark.parametrize("m", [4, 6, 7])
def test_where_rest_is_infeasible_rows_are_approximated(m):
    """As of joints that cannot brake at once: in their direction if some velocity is, at the largest share."""
    rng = np.random.default_rng(m)
    kept = missed = beyond = 0
    for _ in range(repeats(120, 40)):
        J, s, _ = regular_problem(rng, m)
        A, before = J[3:], rng.uniform(-1.0, 1.0, m)
        lower, upper = before - 0.1, before + 0.1
        b = A @ before * 10.0 ** rng.uniform(-0.3, 0.7) + 10.0 ** rng.uniform(-3.0, 0.0) * rng.normal(size=3)
        share = largest_share(A, b, lower, upper)
        solution = iq.solve_velocity(J, s, exact=iq.ExactRows(A, b), bounds=(lower, upper))
        x, P = solution.velocity, np.linalg.pinv(A)
        if share is not None:
            kept += 1
            assert solution.scale == pytest.approx(share, rel=SHARE_TOLERANCE)
            np.testing.assert_allclose(A @ x, solution.scale * b, atol=1e-9 * np.abs(x).max())
            continue
        nearest = lsq_linear(
            np.column_stack((P @ A, -P @ b)), np.zeros(m), (np.append(lower, 0.0), np.append(upper, 1.0)), method="bvls"
        )
        missed += 1
        slower = solution.scale < 1.0 - ACTIVE_TOLERANCE
        beyond += not slower
        assert "limits violate the exact rows" in solution.reason
        assert solution.status == ("scaled" if slower else "limited")
        off = np.linalg.norm(P @ (A @ x - solution.scale * b))
        assert off == pytest.approx(np.sqrt(2.0 * nearest.cost), rel=1e-6, abs=1e-9)
    assert min(kept, missed, beyond) > 2


def test_approximated_rows_have_the_largest_scale():
    """The first row may not rest; however fast the second is, the first is as far off."""
    J = np.random.default_rng(14).normal(size=(6, 4))
    rows = iq.ExactRows([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]], [0.0, 2.0])
    bounds = ([0.2, 0.3, -1.0, -1.0], [0.5, 1.0, 1.0, 1.0])
    solution = iq.solve_velocity(J, np.zeros(6), exact=rows, bounds=bounds)
    np.testing.assert_allclose(solution.velocity[:2], [0.2, 1.0], atol=1e-8)
    assert solution.scale == pytest.approx(0.5, abs=1e-7)  # what keeps the share unique costs ROUNDING of the way


def test_a_tool_speed_limit_that_determines_the_velocity_of_approximated_rows():
    """Only joint 3 brings the tool's speed, (q0' + q1', q2' + q3'), to where it lets the row move least."""
    J = np.zeros((6, 4))
    J[3, :2] = J[4, 2:] = 1.0
    solution = iq.solve_velocity(
        J,
        [0.0, 0.0, 0.0, -1.0, -1.0, 0.0],
        exact=iq.ExactRows([[1.0, -1.0, 1.0, 0.0]], [0.0]),
        bounds=([0.9, -1.0, -1.0, -1.0], np.ones(4)),
        tool_speed=iq.limits.ToolSpeed(0.3, np.zeros(3)),
    )
    np.testing.assert_allclose(solution.velocity, [0.9, -0.6, -1.0, 1.0], atol=1e-6)
    assert solution.scale == 1.0
    assert "exact row 0 is off by 0.5" in solution.reason


def test_with_open_sides_too():
    rng = np.random.default_rng(15)
    J, s, _ = regular_problem(rng, 7)
    lower, upper = np.full(7, -0.1), np.full(7, 0.1)
    upper[3], lower[5] = np.inf, -np.inf
    solution = iq.solve_velocity(J, s, exact=iq.ExactRows(J[3:], s[3:]), bounds=(lower, upper))
    share = largest_share(J[3:], s[3:], lower, upper)
    assert share < 1.0
    assert solution.scale == pytest.approx(share, rel=SHARE_TOLERANCE)


@pytest.mark.parametrize("inside", [True, False])
def test_exact_rows_that_determine_all_joints(inside):
    rng = np.random.default_rng(16)
    J, s, h = regular_problem(rng, 3)
    wanted = np.array([0.5, -0.2, 0.1])
    reach = np.full(3, 1.0 if inside else 0.25)
    solution = iq.solve_velocity(J, s, form=h, exact=iq.ExactRows(np.eye(3), wanted), bounds=(-reach, reach))
    np.testing.assert_allclose(solution.velocity, wanted * (1.0 if inside else 0.5), rtol=SHARE_TOLERANCE)
    assert solution.scale == pytest.approx(1.0 if inside else 0.5, rel=SHARE_TOLERANCE)
    assert solution.status in ({"ok", "guarded"} if inside else {"scaled"})


def test_a_joint_metric_decides_among_them():
    rng = np.random.default_rng(17)
    J, s, _ = regular_problem(rng, 8)
    M = rng.uniform(0.2, 5.0, size=8)
    x = iq.solve_velocity(J, s, exact=iq.ExactRows(J[3:], s[3:]), joint_metric=M, damping=0.0).velocity
    np.testing.assert_allclose(x, iq.pseudoinverse(J, 0.3, joint_metric=M) @ s, atol=1e-9)


def test_rows_whose_coefficients_are_rounding_are_no_limits():
    """A joint that the rows fix keeps a coefficient of 1e-17: it must neither scale the problem nor hide its bounds."""
    x_axis, y_axis, z_axis = np.eye(3)
    joints = [
        iq.revolute(z_axis, [0, 0, 0]),
        iq.revolute(y_axis, [0, 0, 0.3]),
        iq.revolute(y_axis, [0.4, 0, 0.3]),
        iq.revolute(x_axis, [0.8, 0, 0.3]),
    ]
    robot = iq.robots.Chain(np.column_stack(joints), np.eye(4))
    for seed in range(200):
        rng = np.random.default_rng(seed)
        J, x = robot.jacobian(rng.uniform(-1, 1, 4)), rng.uniform(-0.9, 0.9, 4)
        rows = iq.ExactRows(J[:3], J[:3] @ x)
        solution = iq.solve_velocity(J, rng.normal(size=6), exact=rows, bounds=(-np.ones(4), np.ones(4)), form=0.3)
        assert np.abs(J[:3] @ solution.velocity - rows.b).max() < 1e-12
        assert solution.scale == 1.0


def test_repeated_rows_and_other_units_change_nothing():
    """Rows that say what they are of the twist: their scaling and their basis are nobody's business."""
    rng = np.random.default_rng(18)
    for _ in range(20):
        J, s = rng.normal(size=(6, 7)), rng.normal(size=6)
        p, a = rng.normal(size=3), rng.normal(size=3)
        rows = iq.ExactRows.point(J, p, rng.normal(size=3)).with_rows(iq.ExactRows.axis(J, a, rng.normal(size=3)))
        mix = rng.normal(size=(5, 5)) * np.array([1e-3, 1.0, 1.0, 1.0, 1e3])[:, None]
        mixed = iq.ExactRows(mix @ rows.A, mix @ rows.b, mix @ rows.of_twist)
        box = bounds_of((np.full(7, -0.2), np.full(7, 0.2)), 7)
        one, other = (iq.solve_velocity(J, s, exact=r, bounds=box) for r in (rows, mixed))
        assert one.status == other.status
        np.testing.assert_allclose(other.velocity, one.velocity, atol=1e-9)


def test_what_damping_misses_of_the_twist_is_reported():
    rng = np.random.default_rng(0)
    J = rng.normal(size=(6, 7))
    for s in (np.zeros(6), np.ones(6)):
        rows = iq.ExactRows(np.eye(7)[:1], [0.1])
        solution = iq.solve_velocity(J, s, exact=rows, point=np.zeros(3), damping=10.0)
        assert np.linalg.norm(solution.residual) > 0.1
        assert solution.status == "limited"
        assert "of the twist is missed" in solution.reason
        assert solution.velocity[0] == pytest.approx(0.1)
