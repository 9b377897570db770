"""Several tasks: sums, strict priority, limits, and what a lower level may not touch."""

import numpy as np
import pytest
from scipy.optimize import minimize
from support.velocity_reference import reach_of, root_of

import invariantqp as iq

WIDE = 50.0


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def arm(rng, m):
    axes = rng.normal(size=(3, m))
    axes /= np.linalg.norm(axes, axis=0)
    return np.vstack((axes, np.cross(rng.normal(size=(m, 3)), axes.T).T))


def box(m, size):
    return iq.Bounds(np.full(m, -size), np.full(m, size))


@pytest.mark.parametrize("m", [3, 5, 6, 7, 8])
def test_one_task_is_the_velocity_law(rng, m):
    """With a form, without limits: it is P s of the form, whose own size is for one twist alone."""
    J, s = arm(rng, m), rng.normal(size=6)
    for form, bounds in ((None, None), (None, box(m, 0.2)), (0.7, None)):
        alone = iq.solve_velocity(J, s, form=form, bounds=bounds)
        among = iq.velocity.solve_tasks([iq.velocity.TwistTask(J, s, form=form)], bounds=bounds)
        assert np.allclose(among.velocity, alone.velocity, rtol=1e-7, atol=1e-9)


def test_a_single_joint_task_is_achieved():
    wanted = np.array([0.1, -0.2, 0.3])
    assert np.allclose(iq.velocity.solve_tasks([iq.velocity.JointTask(wanted)]).velocity, wanted)


def test_the_weighted_sum_is_the_optimum_of_the_sum(rng):
    J, s, rest = arm(rng, 4), rng.normal(size=6), rng.normal(size=4)
    x = iq.velocity.solve_tasks(
        [iq.velocity.TwistTask(J, s, weight=2.0), iq.velocity.JointTask(rest, weight=0.3)]
    ).velocity
    own = iq.systems.centre(J, s).point
    A, b = root_of(own, reach_of(J, own)) @ J, root_of(own, reach_of(J, own)) @ s

    def cost(y):
        return (A @ y - b) @ (A @ y - b) + 0.15 * (y - rest) @ (y - rest)

    found = minimize(cost, np.zeros(4), method="BFGS", options={"gtol": 1e-12}).x
    assert np.allclose(x, found, atol=1e-6)


def test_a_lower_level_moves_in_the_null_space_of_the_higher(rng):
    J, s, rest = arm(rng, 8), 0.3 * rng.normal(size=6), rng.normal(size=8)
    first = iq.velocity.TwistTask(J, s, form=0.5, priority=0)
    second = iq.velocity.JointTask(rest, priority=1)
    both = iq.velocity.solve_tasks([second, first], bounds=box(8, WIDE))
    assert np.allclose(J @ both.velocity, s, atol=1e-9)
    null = np.linalg.svd(J)[2][6:]
    assert np.allclose(null @ both.velocity, null @ rest, atol=1e-9)


def test_priority_holds_at_the_limits_too(rng):
    for _ in range(20):
        J, s, rest = arm(rng, 8), 2.0 * rng.normal(size=6), 5.0 * rng.normal(size=8)
        bounds = box(8, 0.5)
        alone = iq.velocity.solve_tasks([iq.velocity.TwistTask(J, s, form=0.5)], bounds=bounds)
        both = iq.velocity.solve_tasks(
            [iq.velocity.TwistTask(J, s, form=0.5), iq.velocity.JointTask(rest, priority=1)], bounds=bounds
        )
        assert np.abs(both.velocity).max() <= 0.5
        assert both.status == alone.status
        assert np.allclose(J @ both.velocity, J @ alone.velocity, atol=1e-7)
        assert np.linalg.norm(both.velocity - rest) <= np.linalg.norm(alone.velocity - rest) + 1e-9


def test_a_change_of_frame_changes_nothing(rng):
    J, K, s, t = arm(rng, 7), arm(rng, 7), rng.normal(size=6), rng.normal(size=6)
    K[:, 4:] = 0.0  # an elbow: the last joints do not move it
    Ad = iq.adjoint(iq.exp(rng.normal(size=6)))
    bounds = box(7, 0.4)

    def solved(A):
        tasks = [iq.velocity.TwistTask(A @ J, A @ s, 0.4), iq.velocity.TwistTask(A @ K, A @ t, -0.3, weight=0.2)]
        return iq.velocity.solve_tasks(
            [*tasks, iq.velocity.JointTask(np.zeros(7), weight=0.01)], bounds=bounds
        ).velocity

    assert np.allclose(solved(np.eye(6)), solved(Ad), rtol=0.0, atol=1e-10)


def test_exact_rows_have_priority_over_every_level(rng):
    J, s = arm(rng, 7), rng.normal(size=6)
    rows = iq.ExactRows(rng.normal(size=(2, 7)), 0.1 * rng.normal(size=2))
    x = iq.velocity.solve_tasks(
        [iq.velocity.TwistTask(J, s, 0.4), iq.velocity.JointTask(np.ones(7), priority=3)], exact=rows
    ).velocity
    assert np.allclose(np.asarray(rows.A) @ x, rows.b, atol=1e-12)


def test_rows_from_geometry(rng):
    J, x = arm(rng, 6), rng.normal(size=6)
    twist, p, a = J @ x, rng.normal(size=3), rng.normal(size=3)
    v = twist[3:] + np.cross(twist[:3], p)
    point, plane = iq.ExactRows.point(J, p, v), iq.ExactRows.plane(J, p, 3.0 * a, v @ a / np.linalg.norm(a))
    axis = iq.ExactRows.axis(J, a, twist[:3] + 0.7 * a)  # turning about the axis itself is nobody's demand
    rows = point.with_rows(plane).with_rows(axis)
    assert np.shape(rows.A) == (6, 6)
    assert np.allclose(np.asarray(rows.A) @ x, rows.b)


def test_bad_tasks_are_refused(rng):
    J, s = arm(rng, 4), np.ones(6)
    with pytest.raises(iq.BadInput, match="none"):
        iq.velocity.solve_tasks([])
    with pytest.raises(iq.BadInput, match="5 joints; expected 4"):
        iq.velocity.solve_tasks([iq.velocity.TwistTask(J, s), iq.velocity.JointTask(np.zeros(5))])
    with pytest.raises(iq.BadInput, match="weight"):
        iq.velocity.JointTask(np.zeros(4), weight=0.0)
    for priority in ("abc", None, np.nan, 0.5, -1, True):
        with pytest.raises(iq.BadInput, match=r"priority: found .*; expected a whole number, zero or more"):
            iq.velocity.TwistTask(J, s, priority=priority)
        with pytest.raises(iq.BadInput, match="priority"):
            iq.velocity.JointTask(np.zeros(4), priority=priority)
    with pytest.raises(iq.BadInput, match="Guard"):
        iq.velocity.solve_tasks([iq.velocity.TwistTask(J, s)], damping=iq.Guard(0.5))
    with pytest.raises(iq.BadInput, match="zero vector"):
        iq.ExactRows.axis(J, np.zeros(3), np.zeros(3))


def test_many_levels_at_the_limits_always_have_a_solution(rng):
    """Each level starts from what the one before it left, which is inside; none is disturbed by those below it."""
    for _ in range(40):
        m = int(rng.integers(3, 9))
        J, K = arm(rng, m), arm(rng, m)
        K[:, m // 2 :] = 0.0
        tasks = [
            iq.velocity.TwistTask(J, 2.0 * rng.normal(size=6)),
            iq.velocity.TwistTask(K, rng.normal(size=6), priority=1),
            iq.velocity.JointTask(rng.normal(size=m), priority=2),
        ]
        options = {
            "bounds": (-rng.uniform(0.0, 0.5, m), rng.uniform(0.0, 0.5, m)),
            "exact": iq.ExactRows(rng.normal(size=(1, m)), rng.normal(size=1)),
            "rows": iq.limits.LimitRows(rng.normal(size=(2, m)), [-0.1, -0.2], [0.2, 0.1]),
        }
        whole, part = iq.velocity.solve_tasks(tasks, **options), iq.velocity.solve_tasks(tasks[:1], **options)
        assert whole.status == part.status
        assert 0.0 <= whole.scale <= 1.0
        np.testing.assert_allclose(J @ whole.velocity, J @ part.velocity, atol=1e-8)
        np.testing.assert_allclose(options["exact"].A @ whole.velocity, whole.scale * options["exact"].b, atol=1e-9)


def test_rows_hold_to_the_last_digits_as_in_a_tick(rng):
    for _ in range(150):
        tasks = [iq.velocity.TwistTask(arm(rng, 8), 3.0 * rng.normal(size=6))]
        tasks += [iq.velocity.JointTask(5.0 * rng.normal(size=8), priority=1)]
        rows = iq.limits.LimitRows(rng.normal(size=(3, 8)), np.full(3, -0.3), np.full(3, 0.3))
        speed = iq.limits.ToolSpeed(0.2, rng.normal(size=3))
        x = iq.velocity.solve_tasks(tasks, rows=rows, tool_speed=speed, bounds=box(8, 2.0)).velocity
        assert np.abs(np.asarray(rows.C) @ x).max() <= 0.3 * (1.0 + 5e-14)


def test_inconsistent_exact_rows_are_reported(rng):
    J = arm(rng, 5)
    task = iq.velocity.TwistTask(J, rng.normal(size=6))
    rows = iq.ExactRows(np.vstack((J[3], J[3])), [1.0, 2.0])
    solution = iq.velocity.solve_tasks([task], exact=rows)
    assert solution.status == "degraded"
    assert "cannot keep the direction of the exact rows" in solution.reason
    assert J[3] @ solution.velocity == pytest.approx(1.5)
    outside = iq.ExactRows(np.eye(5)[:1], [-1.0])  # the first joint is outside its limits, on the way back
    lower, upper = np.array([0.2, -1, -1, -1, -1]), np.array([0.5, 1, 1, 1, 1])
    back = iq.velocity.solve_tasks([task], exact=outside, bounds=(lower, upper))
    assert back.status in {"scaled", "degraded"}
    assert ((back.velocity >= lower) & (back.velocity <= upper)).all()
    assert back.velocity[0] == pytest.approx(0.2, abs=1e-6)
