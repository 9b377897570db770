"""Exact demands of a controller: each holds to rounding while the form judges the rest, in any tool frame."""

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.control.demands import View, demands_of

DT = 0.01
Q = np.array([0.1, -0.4, 0.5, 0.6, 0.2])
AHEAD = np.array([0.1, -0.2, 0.3, 0.02, -0.01, 0.03])


def goal(robot):
    return iq.exp([0.05, 0.1, -0.1, 0.01, 0.02, -0.01]) @ robot.pose(Q)


def stepped(robot, exact, target=None, **more):
    loop = iq.Controller(robot, dt=DT, gain=5.0, exact=exact, **more)
    return loop.step(Q, goal(robot) if target is None else target, AHEAD)


def at(pose, point):
    return pose[:3, :3] @ point + pose[:3, 3]


def moves(twist, p):
    return twist[3:] + np.cross(twist[:3], p)


def test_a_point_off_the_tool_follows(so101):
    point = np.array([0.02, -0.01, 0.05])
    solution = stepped(so101, iq.control.ExactPoint(point))
    here, there = at(so101.pose(Q), point), at(goal(so101), point)
    wanted = 5.0 * (there - here) + moves(AHEAD, there)
    np.testing.assert_allclose(moves(so101.jacobian(Q) @ solution.velocity, here), wanted, atol=1e-12)
    assert solution.scale == 1.0


def test_position_is_the_point_at_the_tools_origin(so101):
    axis = iq.control.ExactAxis([0.0, 0.0, 1.0])
    for named, valued in (("position", iq.control.ExactPoint()), (["position", axis], [iq.control.ExactPoint(), axis])):
        np.testing.assert_array_equal(stepped(so101, named).velocity, stepped(so101, valued).velocity)


def test_an_axis_follows_and_turns_freely_about_itself(so101):
    axis = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    solution = stepped(so101, iq.control.ExactAxis(2.0 * axis))
    a, b = so101.pose(Q)[:3, :3] @ axis, goal(so101)[:3, :3] @ axis
    turn = np.cross(a, b) / np.linalg.norm(np.cross(a, b)) * np.arccos(a @ b)
    missed = 5.0 * turn + AHEAD[:3] - (so101.jacobian(Q) @ solution.velocity)[:3]
    np.testing.assert_allclose(missed - a * (a @ missed), 0.0, atol=1e-12)


def test_an_axis_turned_round_is_half_a_turn_away(so101):
    target = so101.pose(Q) @ iq.exp([np.pi, 0.0, 0.0, 0.0, 0.0, 0.0])
    view = View(so101, so101.sight(Q, target), target, 2.0, np.zeros(6))
    rows = iq.control.ExactAxis([0.0, 0.0, 1.0]).rows(view)
    assert np.linalg.norm(rows.b) == pytest.approx(2.0 * np.pi, rel=1e-6)


def test_a_height_over_a_plane_is_kept(so101):
    normal, point = np.array([0.0, 0.3, 1.0]), np.array([0.0, 0.0, 0.03])
    solution = stepped(so101, iq.control.ExactPlane(normal, point))
    here, there = at(so101.pose(Q), point), at(goal(so101), point)
    n = normal / np.linalg.norm(normal)
    speed = n @ moves(so101.jacobian(Q) @ solution.velocity, here)
    assert speed == pytest.approx(n @ (5.0 * (there - here) + moves(AHEAD, there)), abs=1e-12)


def test_a_combination_of_joints_is_held(so101):
    together = [iq.control.ExactPoint(), iq.control.ExactJoints([1.0, 0.0, 0.0, 0.0, 2.0])]
    solution = stepped(so101, together)
    assert solution.velocity[0] + 2.0 * solution.velocity[4] == pytest.approx(0.0, abs=1e-12)
    here, there = so101.pose(Q)[:3, 3], goal(so101)[:3, 3]
    wanted = 5.0 * (there - here) + moves(AHEAD, there)
    np.testing.assert_allclose(moves(so101.jacobian(Q) @ solution.velocity, here), wanted, atol=1e-12)


@pytest.mark.parametrize(
    "exact",
    [
        lambda T: iq.control.ExactPoint(at(T, [0.01, 0.02, 0.03])),
        lambda T: iq.control.ExactAxis(T[:3, :3] @ [0, 1, 1]),
        lambda T: iq.control.ExactPlane([0, 0, 1], at(T, [0, 0.1, 0])),
        lambda _: iq.control.ExactJoints([1, 1, 0, 0, 0]),
    ],
)
def test_a_displaced_tool_frame_changes_nothing(so101, exact):
    offset = iq.exp([0.4, -0.8, 0.3, 0.1, 0.2, -0.1])
    back = iq.inverse(offset)  # to the same physical points
    plain = stepped(so101, exact(np.eye(4)), point=(0.0, 0.0, 0.0))
    moved = stepped(so101.with_tool(offset), exact(back), goal(so101) @ offset, point=back[:3, 3])
    np.testing.assert_allclose(moved.velocity, plain.velocity, atol=1e-10)


@pytest.mark.parametrize(
    ("exact", "said"),
    [
        ("orientation", 'expected "position"'),
        (["position", "axis"], "found 'axis'; expected \"position\""),
        ([3.0], "found 3.0"),
        (iq.control.ExactJoints(np.ones(4)), "rows on 4 joints"),
    ],
)
def test_demands_that_are_none(so101, exact, said):
    with pytest.raises(iq.BadInput, match=said):
        stepped(so101, exact)


def test_values_are_checked_when_they_are_made():
    for kind in (iq.control.ExactAxis, iq.control.ExactPlane):
        with pytest.raises(iq.BadInput):
            kind([0, 0, 0])
    assert demands_of(None) == ()


def test_a_slide_beside_hinges_keeps_three_rows_in_millimetres():
    slide, hinge = iq.se3.prismatic([0.6, 0.3, -0.7]), iq.revolute([0.1, 0.9, 0.4], [0.2, -0.3, 0.4])
    S, home = np.column_stack((slide, hinge, iq.revolute([0.1, 0.9, 0.4], [-0.1, 0.3, 0.5]))), np.eye(4)
    home[:3, 3] = 0.4, -0.2, 0.1
    for unit in (1.0, 1e3, 1e6):
        scaled, placed = S * np.repeat([1.0, unit], 3)[:, None] / [unit, 1.0, 1.0], home.copy()
        placed[:3, 3] *= unit
        robot = iq.robots.Chain(scaled, placed, (), [-unit, -1.0, -1.0], [unit, 1.0, 1.0], [unit, 1.0, 1.0])
        solution = iq.Controller(robot, dt=0.01, exact="position").step(np.full(3, 0.1), robot.pose(np.full(3, 0.15)))
        assert solution.status == "ok"


@pytest.mark.parametrize("noise", [0.0, 1e-5])
@pytest.mark.parametrize(
    ("name", "q", "out"),
    [
        ("ur5", [0.3, -1.2, 1.5, -1.0, 1.0, 0.3], 0.5),
        ("ur5e", [0.0, -1.57, 1.57, -1.57, -1.57, 0.0], 0.5),
        ("lite6", [0.0, 0.3, 1.2, 0.0, 0.9, 0.0], 0.3),
    ],
)
def test_an_exact_position_led_out_of_reach_comes_home(name, q, out, noise):
    """Stretched out to the last digit, the elbow bends again."""
    robot, q, rng = iq.load_robot(name), np.array(q), np.random.default_rng(0)
    home = robot.pose(q)
    away = home[:3, 3] * [1.0, 1.0, 0.0]
    away *= out / np.linalg.norm(away)
    controller = iq.Controller(robot, dt=0.002, exact="position")
    for k in range(3500):
        goal = home.copy()
        goal[:3, 3] += max(np.sin(np.pi * min(k / 2000, 1.0)), 0.0) * away
        solution = controller.step(q + noise * rng.normal(size=len(q)), goal)
        q = q + 0.002 * solution.velocity
    assert np.linalg.norm((robot.pose(q) - home)[:3, 3]) < 1e-4
    assert noise or solution.status == "ok"
