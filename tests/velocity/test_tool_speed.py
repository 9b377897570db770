"""The speed limit of a tool point: tangent planes against the cone itself, and both against what they must give."""

import builtins

import numpy as np
import pytest
from scipy.optimize import minimize
from support.random_systems import motion
from support.task_files import run_displaced
from support.velocity_reference import convex_form, regular_problem, tight_box

import invariantqp as iq
from invariantqp.velocity.qp import tangents


def point_jacobian(J, p):
    return J[3:] + np.cross(J[:3], p, axis=0)


def problem(rng, m, low=0.3, high=0.9):
    """A box-limited problem, a point, and a speed limit below what the box alone would give."""
    J, s, h = regular_problem(rng, m)
    p = rng.normal(size=3)
    free = iq.solve_velocity(J, s, form=h, guard=False).velocity
    bounds = tight_box(rng, m, free, share=0.3)
    x = iq.solve_velocity(J, s, form=h, guard=False, bounds=bounds).velocity
    return J, s, h, bounds, p, rng.uniform(low, high) * np.linalg.norm(point_jacobian(J, p) @ x)


def test_planes_and_the_cone_by_cvxpy_agree():
    pytest.importorskip("cvxpy")
    rng = np.random.default_rng(0)
    worst = 0.0
    for k in range(40):
        J, s, h, bounds, p, limit = problem(rng, 3 + k % 4)
        options = {"form": h, "bounds": bounds, "guard": bool(k % 2)}
        planes = iq.solve_velocity(J, s, tool_speed=iq.limits.ToolSpeed(limit, p), **options)
        cone = iq.solve_velocity(J, s, tool_speed=iq.limits.ToolSpeed(limit, p, exact=True), **options)
        assert planes.method == cone.method == "qp"
        assert planes.status == cone.status
        assert cone.backend == "cvxpy"
        worst = max(worst, np.linalg.norm(planes.velocity - cone.velocity) / np.linalg.norm(planes.velocity))
        for x in (planes.velocity, cone.velocity):
            assert np.linalg.norm(point_jacobian(J, p) @ x) <= limit * (1.0 + 1e-9)
            assert ((x >= bounds.lower) & (x <= bounds.upper)).all()
    assert worst < 1e-6


def test_the_optimum_meets_its_own_equations():
    """H x - c + y + t J_p'v = 0 with t >= 0 for the cone and y the reported multipliers."""
    rng = np.random.default_rng(1)
    for k in range(30):
        J, s, h, bounds, p, limit = problem(rng, 3 + k % 4)
        solution = iq.solve_velocity(J, s, form=h, bounds=bounds, tool_speed=iq.limits.ToolSpeed(limit, p), guard=False)
        H, c = convex_form(J, s, h, 0.0)
        x = solution.velocity
        Jp = point_jacobian(J, p)
        left, normal = c - H @ x - solution.multipliers, Jp.T @ (Jp @ x)
        t = left @ normal / (normal @ normal)
        assert t > 0.0
        assert np.abs(left - t * normal).max() < 1e-7 * np.abs(c).max()
        assert np.linalg.norm(Jp @ x) == pytest.approx(limit, rel=1e-12)


def test_planes_alone_come_to_the_same(monkeypatch):
    rng = np.random.default_rng(2)
    for k in range(10):
        J, s, h, bounds, p, limit = problem(rng, 3 + k % 4)
        options = {"form": h, "bounds": bounds, "guard": False, "tool_speed": iq.limits.ToolSpeed(limit, p)}
        newton = iq.solve_velocity(J, s, **options).velocity
        with monkeypatch.context() as patch:
            patch.setattr(tangents, "MOST_STEPS", 0)
            heaped = iq.solve_velocity(J, s, **options).velocity
        assert np.linalg.norm(point_jacobian(J, p) @ heaped) <= limit * (1.0 + 1e-9)
        # 1e-9 outside in length is the root of it in direction.
        np.testing.assert_allclose(heaped, newton, atol=1e-4 * np.linalg.norm(newton))


def test_a_slow_tool_is_left_alone():
    J, s, h = regular_problem(np.random.default_rng(3), 6)
    free = iq.solve_velocity(J, s, form=h)
    limited = iq.solve_velocity(J, s, form=h, tool_speed=iq.limits.ToolSpeed(1e3, (0.0, 0.0, 0.0)))
    np.testing.assert_array_equal(limited.velocity, free.velocity)
    assert limited.method == "closed-form"
    choice = iq.velocity.method_for(J, s, form=h, tool_speed=iq.limits.ToolSpeed(1e-3, (0.0, 0.0, 0.0)))
    assert choice.method == "qp"
    assert "the tool past their limits" in choice.reason


@pytest.mark.parametrize("exact", [False, True], ids=["planes", "cone"])
def test_exact_rows_are_slowed_to_the_limit_and_told_by_whom(exact):
    if exact:
        pytest.importorskip("cvxpy")
    rng = np.random.default_rng(4)
    J, s, h = regular_problem(rng, 6)
    p = rng.normal(size=3)
    Jp = point_jacobian(J, p)
    b = np.array([0.3, 0.0, 0.4])
    solution = iq.solve_velocity(
        J, s, form=h, exact=iq.ExactRows(Jp, b), tool_speed=iq.limits.ToolSpeed(0.25, p, exact=exact)
    )
    assert solution.status == "scaled"
    assert solution.scale == pytest.approx(0.5, rel=1e-6)
    assert "held by the tool's speed" in solution.reason
    np.testing.assert_allclose(Jp @ solution.velocity, solution.scale * b, atol=1e-9)
    assert np.linalg.norm(Jp @ solution.velocity) <= 0.25 + 1e-9


@pytest.mark.parametrize("exact", [False, True], ids=["planes", "cone"])
def test_bounds_that_force_the_tool_to_move_come_first(exact):
    """On the way back from outside a position limit: the least speed there is, and it is told."""
    if exact:
        pytest.importorskip("cvxpy")
    rng = np.random.default_rng(5)
    J, s, h = regular_problem(rng, 4)
    p = rng.normal(size=3)
    Jp = point_jacobian(J, p)
    bounds = iq.Bounds([0.5, -0.1, -0.1, -0.1], [1.0, 0.1, 0.1, 0.1])
    least = minimize(
        lambda x: 0.5 * (Jp @ x) @ (Jp @ x),
        [0.7, 0.0, 0.0, 0.0],
        jac=lambda x: Jp.T @ (Jp @ x),
        bounds=list(zip(bounds.lower, bounds.upper, strict=True)),
        method="L-BFGS-B",
        options={"ftol": 1e-15, "gtol": 1e-12},
    )
    slowest = np.linalg.norm(Jp @ least.x)
    solution = iq.solve_velocity(
        J, s, form=h, bounds=bounds, tool_speed=iq.limits.ToolSpeed(0.5 * slowest, p, exact=exact)
    )
    assert solution.status == "degraded"
    assert "the tool's speed is" in solution.reason
    assert np.linalg.norm(Jp @ solution.velocity) == pytest.approx(slowest, rel=1e-5)
    assert ((solution.velocity >= bounds.lower) & (solution.velocity <= bounds.upper)).all()


def test_rows_cone_box_and_guard_together_move_with_the_frame():
    """Random frames: the same velocity, inside every limit, whatever status."""
    rng = np.random.default_rng(6)
    worst, seen = 0.0, set()
    for k in range(150):
        m = 2 + k % 7
        J, s, T, p = rng.normal(size=(6, m)), rng.normal(size=6), motion(rng, 1.0), rng.normal(size=3)
        A, q = iq.adjoint(T), (T @ np.append(p, 1.0))[:3]
        lower, upper = -rng.uniform(0.05, 1.0, m), rng.uniform(0.05, 1.0, m)
        C = rng.normal(size=(2, m))
        options = {
            "bounds": iq.Bounds(lower, upper),
            "rows": iq.limits.LimitRows(C, -rng.uniform(0.05, 0.5, 2), rng.uniform(0.05, 0.5, 2)),
            "posture": rng.normal(size=m),
            "form": (None, 0.7)[k % 2],
        }
        limit = rng.uniform(0.05, 0.5)
        here = iq.solve_velocity(J, s, tool_speed=iq.limits.ToolSpeed(limit, p), **options)
        there = iq.solve_velocity(A @ J, A @ s, tool_speed=iq.limits.ToolSpeed(limit, q), **options)
        assert here.status == there.status
        x = here.velocity
        worst = max(worst, np.linalg.norm(x - there.velocity) / (np.linalg.norm(x) + np.linalg.norm(s) / 10.0))
        y = C @ x
        assert ((x >= lower) & (x <= upper)).all()
        assert (y >= options["rows"].lower - 1e-9).all()
        assert (y <= options["rows"].upper + 1e-9).all()
        assert np.linalg.norm(point_jacobian(J, p) @ x) <= limit + 1e-9
        seen.add(here.status)
    assert {"ok", "guarded"} <= seen
    assert worst < 1e-7  # the direction settles to 1e-8, no further


def test_exact_rows_that_leave_nothing_free_are_slowed_too():
    rng = np.random.default_rng(8)
    J, s, h = regular_problem(rng, 3)
    p, x = rng.normal(size=3), np.array([0.5, -0.2, 0.1])
    speed = np.linalg.norm(point_jacobian(J, p) @ x)
    solution = iq.solve_velocity(
        J, s, form=h, exact=iq.ExactRows(np.eye(3), x), tool_speed=iq.limits.ToolSpeed(0.4 * speed, p)
    )
    assert solution.status == "scaled"
    np.testing.assert_allclose(solution.velocity, 0.4 * x, atol=1e-7)
    assert np.linalg.norm(point_jacobian(J, p) @ solution.velocity) <= 0.4 * speed + 1e-9


BAD = {
    "zero": ((0.0,), {}, "limit"),
    "nan": ((np.nan,), {}, "limit"),
    "infinite": ((np.inf,), {}, "limit"),
    "point": ((0.25, [0.0, np.nan, 0.0]), {}, "point"),
    "exact": ((0.25,), {"exact": "yes"}, "exact"),
}


@pytest.mark.parametrize("case", BAD)
def test_limits_that_are_none(case):
    arguments, options, argument = BAD[case]
    with pytest.raises(iq.BadInput) as caught:
        iq.limits.ToolSpeed(*arguments, **options)
    assert caught.value.argument == argument


def test_a_point_has_to_be_said():
    with pytest.raises(iq.BadInput, match="Say which point"):
        iq.solve_velocity(np.ones((6, 2)), np.ones(6), form=0.4, tool_speed=iq.limits.ToolSpeed(0.25))
    with pytest.raises(iq.BadInput, match="tool_speed"):
        iq.solve_velocity(np.ones((6, 2)), np.ones(6), form=0.4, tool_speed=0.25)


def test_without_cvxpy_the_extra_is_named(monkeypatch):
    original = builtins.__import__

    def absent(name, *arguments, **options):
        if name == "cvxpy":
            raise ImportError(name)
        return original(name, *arguments, **options)

    monkeypatch.setattr(builtins, "__import__", absent)
    with pytest.raises(iq.errors.MissingExtra, match=r"pip install 'invariantqp\[cvxpy\]'"):
        iq.limits.ToolSpeed(0.25, exact=True)
    assert iq.limits.ToolSpeed(0.25).limit == 0.25  # planes need nothing


def test_a_cone_solver_that_fails_is_replaced_and_the_status_says_so(monkeypatch):
    cvxpy = pytest.importorskip("cvxpy")
    J, s, h, bounds, p, limit = problem(np.random.default_rng(7), 5)
    options = {"form": h, "bounds": bounds, "guard": False}
    planes = iq.solve_velocity(J, s, tool_speed=iq.limits.ToolSpeed(limit, p), **options)

    def broken(self, *arguments, **options):
        raise cvxpy.error.SolverError("no licence")

    monkeypatch.setattr(cvxpy.Problem, "solve", broken)
    solution = iq.solve_velocity(J, s, tool_speed=iq.limits.ToolSpeed(limit, p, exact=True), **options)
    assert (solution.status, solution.backend) == ("degraded", "daqp")
    assert "cvxpy: SolverError: no licence" in solution.reason
    np.testing.assert_array_equal(solution.velocity, planes.velocity)


def test_a_task_files_tool_speed_is_kept_at_its_point_wherever_the_tool_frame_is():
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
