"""The speed limit of a tool point: by its multiplier, as the cone itself, and both against what they must give."""

import numpy as np
import pytest
from support.task_files import run_displaced
from support.velocity_reference import reach_of, regular_problem, root_of, tight_box

import invariantqp as iq


def point_jacobian(J, p):
    return J[3:] + np.cross(J[:3], p, axis=0)


def problem(rng, m, low=0.3, high=0.9):
    """A box-limited problem, a point, and a speed limit below what the box alone would give."""
    J, s, _ = regular_problem(rng, m)
    p = rng.normal(size=3)
    free = iq.solve_velocity(J, s, point=p).velocity
    bounds = tight_box(rng, m, free, share=0.3)
    x = iq.solve_velocity(J, s, point=p, bounds=bounds).velocity
    return J, s, bounds, p, rng.uniform(low, high) * np.linalg.norm(point_jacobian(J, p) @ x)


def test_the_optimum_satisfies_its_kkt_conditions():
    """H x - c + y + t J_p'v = 0 with t >= 0 for the cone and y the reported multipliers."""
    rng = np.random.default_rng(1)
    for k in range(30):
        J, s, bounds, p, limit = problem(rng, 3 + k % 4)
        solution = iq.solve_velocity(J, s, bounds=bounds, tool_speed=iq.limits.ToolSpeed(limit, p), point=p)
        root = root_of(p, reach_of(J, p))
        H, c = J.T @ root.T @ root @ J, J.T @ root.T @ root @ s
        x, y = solution.velocity, solution.multipliers
        Jp = point_jacobian(J, p)
        left, normal = c - H @ x - y, Jp.T @ (Jp @ x)
        t = left @ normal / (normal @ normal)
        assert t > 0.0
        assert np.abs(left - t * normal).max() < 1e-8 * np.abs(c).max()
        assert np.linalg.norm(Jp @ x) == pytest.approx(limit, rel=1e-12)
        assert ((x >= bounds.lower) & (x <= bounds.upper)).all()
        np.testing.assert_allclose(x[y != 0.0], np.where(y > 0.0, bounds.upper, bounds.lower)[y != 0.0], rtol=1e-12)


def test_an_inactive_tool_speed_limit_changes_nothing():
    J, s, h = regular_problem(np.random.default_rng(3), 6)
    free = iq.solve_velocity(J, s, form=h)
    limited = iq.solve_velocity(J, s, form=h, tool_speed=iq.limits.ToolSpeed(1e3, (0.0, 0.0, 0.0)))
    np.testing.assert_array_equal(limited.velocity, free.velocity)
    assert limited.method == "closed-form"
    slow = iq.solve_velocity(J, s, form=h, tool_speed=iq.limits.ToolSpeed(1e-3, (0.0, 0.0, 0.0)))
    assert (slow.method, slow.backend) == ("qp", "engine")
    assert slow.reason.endswith("at the limits of the tool's speed")


def test_exact_rows_are_scaled_to_the_tool_speed_limit_which_is_named():
    rng = np.random.default_rng(4)
    J, s, h = regular_problem(rng, 6)
    p = rng.normal(size=3)
    Jp = point_jacobian(J, p)
    b = np.array([0.3, 0.0, 0.4])
    solution = iq.solve_velocity(J, s, form=h, exact=iq.ExactRows(Jp, b), tool_speed=iq.limits.ToolSpeed(0.25, p))
    assert solution.status == "scaled"
    assert solution.scale == pytest.approx(0.5, rel=1e-6)
    assert solution.reason.endswith("of the exact rows' speed; at the limits of the tool's speed")
    np.testing.assert_allclose(Jp @ solution.velocity, solution.scale * b, atol=1e-9)
    assert np.linalg.norm(Jp @ solution.velocity) <= 0.25 + 1e-9


def test_a_tool_speed_limit_close_to_the_least_feasible_speed():
    """Identical joints and a demand on an axis slowed down to where the tool's speed is just the limit's."""
    rng = np.random.default_rng(7)
    for _ in range(40):
        twin = iq.revolute(rng.normal(size=3), rng.normal(size=3))
        J = np.column_stack(
            [twin, *(iq.revolute(rng.normal(size=3), rng.normal(size=3)) for _ in range(2)), twin, twin]
        )
        p, lower, upper = rng.normal(size=3), -rng.uniform(0.1, 0.8, 5), rng.uniform(0.1, 0.8, 5)
        rows = iq.ExactRows.axis(J, rng.normal(size=3), 0.5 * rng.normal(size=3))
        limit = rng.uniform(0.05, 0.3)
        solution = iq.solve_velocity(
            J,
            J @ rng.normal(size=5),
            exact=rows,
            bounds=(lower, upper),
            tool_speed=iq.limits.ToolSpeed(limit, p),
            point=p,
        )
        x = solution.velocity
        assert solution.status != "held"
        assert ((x >= lower) & (x <= upper)).all()
        assert np.linalg.norm(point_jacobian(J, p) @ x) <= limit * (1.0 + 1e-6)
        np.testing.assert_allclose(rows.A @ x, solution.scale * rows.b, atol=1e-7)


def test_exact_rows_that_determine_all_joints_are_scaled_too():
    rng = np.random.default_rng(8)
    J, s, h = regular_problem(rng, 3)
    p, x = rng.normal(size=3), np.array([0.5, -0.2, 0.1])
    speed = np.linalg.norm(point_jacobian(J, p) @ x)
    solution = iq.solve_velocity(
        J, s, form=h, exact=iq.ExactRows(np.eye(3), x), tool_speed=iq.limits.ToolSpeed(0.4 * speed, p)
    )
    assert solution.status == "scaled"
    np.testing.assert_allclose(solution.velocity, 0.4 * x, rtol=1e-6)
    assert np.linalg.norm(point_jacobian(J, p) @ solution.velocity) <= 0.4 * speed + 1e-9


@pytest.mark.parametrize("limit", [0.0, np.inf])
def test_wrong_tool_speed_limits_are_refused(limit):
    with pytest.raises(iq.BadInput, match="limit"):
        iq.limits.ToolSpeed(limit)


def test_a_tool_speed_limit_needs_a_point():
    with pytest.raises(iq.BadInput, match="Say which point"):
        iq.solve_velocity(np.ones((6, 2)), np.ones(6), form=0.4, tool_speed=iq.limits.ToolSpeed(0.25))
    with pytest.raises(iq.BadInput, match="tool_speed"):
        iq.solve_velocity(np.ones((6, 2)), np.ones(6), form=0.4, tool_speed=0.25)


def test_a_tool_speed_of_a_task_file_holds_at_its_point():
    task = iq.load_task("arm_3r")
    point = (0.05, 0.0, 0.1)
    robot = task.load_robot()
    free = iq.run_task(task, dt=0.01)
    offset = iq.exp([0.3, -0.5, 0.2, 0.1, 0.2, -0.1])
    law = {"dt": 0.01, "tool_speed": 0.05, "tool_speed_point": point}
    runs = [iq.run_task(task, **law), run_displaced(task, offset, **law)]

    def fastest(trace):
        at = [robot.pose(q) @ [*point, 1.0] for q in trace.q[:-1]]
        return max(
            np.linalg.norm(point_jacobian(robot.jacobian(q), p[:3]) @ x)
            for q, p, x in zip(trace.q[:-1], at, trace.velocity, strict=True)
        )

    assert fastest(free) > 0.06
    assert fastest(runs[0]) <= 0.05 + 1e-9
    np.testing.assert_allclose(runs[1].q, runs[0].q, atol=1e-9)
