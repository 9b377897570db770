import numpy as np
import pytest
from scipy.optimize import linprog
from support.velocity_reference import regular_problem, tight_box

import invariantqp as iq


def largest_share(A, b, lower, upper):
    """max alpha in [0, 1] with A x = alpha b inside the box, on x itself."""
    k, m = A.shape
    result = linprog(
        [-1.0] + [0.0] * m,
        A_eq=np.column_stack((-b, A)),
        b_eq=np.zeros(k),
        bounds=[(0.0, 1.0), *zip(lower, upper, strict=True)],
    )
    return result.x[0]


@pytest.mark.parametrize("m", [3, 5, 6, 7, 8])
def test_rows_are_met_to_rounding(m):
    rng = np.random.default_rng(m)
    bound = 0
    for k in range(60):
        J, s, h = regular_problem(rng, m)
        A, b = J[3:], s[3:]
        A, b = A[: min(3, m - 1)], b[: min(3, m - 1)]
        rows = iq.ExactRows(A, b)
        free = iq.solve_velocity(J, s, form=h, exact=rows, guard=bool(k % 2))
        assert np.abs(A @ free.velocity - b).max() <= 1e-12 * (1.0 + np.abs(free.velocity).max())
        bounds = tight_box(rng, m, free.velocity, share=0.3)
        solution = iq.solve_velocity(J, s, form=h, exact=rows, bounds=bounds, guard=bool(k % 2))
        bound += solution.method == "qp" and solution.scale == 1.0
        share = largest_share(A, b, bounds.lower, bounds.upper)
        assert solution.scale == pytest.approx(share, rel=1e-8, abs=1e-9)
        assert (solution.status == "scaled") == (share < 1.0)
        size = 1.0 + np.abs(free.velocity).max()
        assert np.abs(A @ solution.velocity - solution.scale * b).max() <= 1e-12 * size
        assert ((bounds.lower <= solution.velocity) & (solution.velocity <= bounds.upper)).all()
        if solution.status == "scaled":
            assert f"limits allow {solution.scale:.3g} of the exact rows' speed" in solution.reason
    assert bound or m == 3


def test_among_the_velocities_that_meet_the_rows_the_form_decides():
    """The stationary point of Q_h on {A x = b}, from its own linear equations."""
    rng = np.random.default_rng(11)
    for m in (4, 5, 6):
        J, s, h = regular_problem(rng, m)
        A, b = J[3:], s[3:]
        Q = iq.pitch_form(h)
        kkt = np.block([[J.T @ Q @ J, A.T], [A, np.zeros((3, 3))]])
        expected = np.linalg.solve(kkt, np.concatenate((J.T @ Q @ s, b)))[:m]
        solution = iq.solve_velocity(J, s, form=h, exact=iq.ExactRows(A, b), damping=0.0, guard=False)
        np.testing.assert_allclose(solution.velocity, expected, atol=1e-8 * np.linalg.norm(expected))


def test_dependent_rows_that_agree_are_as_one():
    rng = np.random.default_rng(12)
    J, s, h = regular_problem(rng, 6)
    one = iq.solve_velocity(J, s, form=h, exact=iq.ExactRows(J[3:5], s[3:5]))
    twice = iq.solve_velocity(
        J, s, form=h, exact=iq.ExactRows(np.vstack((J[3:5], 2.0 * J[3:4])), [*s[3:5], 2.0 * s[3]])
    )
    assert twice.status == one.status
    np.testing.assert_allclose(twice.velocity, one.velocity, atol=1e-9)


def test_rows_that_no_velocity_satisfies():
    rng = np.random.default_rng(13)
    J, s, h = regular_problem(rng, 5)
    rows = iq.ExactRows(np.vstack((J[3], J[3])), [1.0, 2.0])
    solution = iq.solve_velocity(J, s, form=h, exact=rows)
    assert solution.status == "degraded"
    assert "of the exact rows is beyond these joints" in solution.reason
    assert J[3] @ solution.velocity == pytest.approx(1.5)  # the nearest there is
    nothing = iq.solve_velocity(J, s, form=h, exact=iq.ExactRows(np.zeros((1, 5)), [1.0]))
    assert nothing.status == "degraded"


def test_limits_that_forbid_even_standing_still_along_the_rows():
    """Outside its limits, a joint must move; rows that forbid it are dropped, and that is told."""
    rng = np.random.default_rng(14)
    J, s, h = regular_problem(rng, 4)
    bounds = iq.Bounds([0.2, -1.0, -1.0, -1.0], [0.5, 1.0, 1.0, 1.0])
    rows = iq.ExactRows([[1.0, 0.0, 0.0, 0.0]], [-1.0])
    solution = iq.solve_velocity(J, s, form=h, exact=rows, bounds=bounds)
    assert solution.status == "degraded"
    assert "rows dropped" in solution.reason
    assert solution.scale == 0.0
    assert 0.2 <= solution.velocity[0] <= 0.5


def test_with_open_sides_too():
    rng = np.random.default_rng(15)
    J, s, h = regular_problem(rng, 7)
    lower, upper = np.full(7, -0.1), np.full(7, 0.1)
    upper[3], lower[5] = np.inf, -np.inf
    solution = iq.solve_velocity(J, s, form=h, exact=iq.ExactRows(J[3:], s[3:]), bounds=iq.Bounds(lower, upper))
    share = largest_share(J[3:], s[3:], lower, upper)
    assert share < 1.0
    assert solution.scale == pytest.approx(share, rel=1e-8)


@pytest.mark.parametrize("inside", [True, False])
def test_rows_that_leave_nothing_free(inside):
    rng = np.random.default_rng(16)
    J, s, h = regular_problem(rng, 3)
    wanted = np.array([0.5, -0.2, 0.1])
    reach = np.full(3, 1.0 if inside else 0.25)
    solution = iq.solve_velocity(J, s, form=h, exact=iq.ExactRows(np.eye(3), wanted), bounds=iq.Bounds(-reach, reach))
    np.testing.assert_allclose(solution.velocity, wanted * (1.0 if inside else 0.5), atol=1e-8)
    assert solution.scale == pytest.approx(1.0 if inside else 0.5, rel=1e-8)
    assert solution.status in ({"ok", "guarded"} if inside else {"scaled"})


def test_a_joint_metric_decides_among_them():
    rng = np.random.default_rng(17)
    J, s, h = regular_problem(rng, 8)
    M = rng.uniform(0.2, 5.0, size=8)
    x = iq.solve_velocity(J, s, form=h, exact=iq.ExactRows(J[3:], s[3:]), joint_metric=M).velocity
    np.testing.assert_allclose(x, iq.pseudoinverse(J, h, joint_metric=M) @ s, atol=1e-9)
