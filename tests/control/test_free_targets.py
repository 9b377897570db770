"""Targets that leave something free: what is asked is reached, what is free moves little, no frame or unit decides."""

import numpy as np
import pytest
from support.arms import arm, ready
from support.loops import OwnDemand, drive

import invariantqp as iq

DT = 0.01
Z = np.array((0.0, 0.0, 1.0))
ARMS = ("ur5", "panda", "so101")


def point_of(pose, point=(0.0, 0.0, 0.0)):
    return pose[:3, :3] @ point + pose[:3, 3]


def errors(robot, q, target):
    """How far the point and the axis are from where they should be; 0 of what is free."""
    pose = robot.pose(q)
    off = 0.0 if target.point is None else np.linalg.norm(target.point - point_of(pose, target.tool_point))
    if target.axis is None:
        return off, 0.0
    axis = pose[:3, :3] @ target.tool_axis
    return off, np.arctan2(np.linalg.norm(np.cross(axis, target.axis)), axis @ target.axis)


def reach(robot, q, target, seconds=4.0, **options):
    """Joint positions at the end, the last solution, and the sum of all joints' motions."""
    run = drive(iq.Controller(robot, dt=DT, **options), q, target, round(seconds / DT))
    return *run.end, DT * np.abs(run.x).sum()


def random_chain(rng, m):
    """An arm of m hinges wherever they are, with a tool a little off the last."""
    made = arm(rng, "general", m)
    return iq.robots.Chain(made.J, iq.exp(rng.normal(size=6)))


def targets_near(robot, q, rng, far=0.25):
    """A point, a point and an axis, and an axis, of a pose nearby that the arm has."""
    pose = robot.pose(q + far * rng.uniform(-1.0, 1.0, len(q)))
    point, axis = 0.1 * rng.normal(size=3), rng.normal(size=3)
    there, along = point_of(pose, point), pose[:3, :3] @ axis
    return [
        iq.Target(there, tool_point=point),
        iq.Target(there, along, tool_point=point, tool_axis=axis),
        iq.Target(axis=along, tool_axis=axis),
    ]


@pytest.mark.parametrize("m", [6, 7])
@pytest.mark.parametrize("seed", range(3))
def test_random_arms_reach_a_partial_target(m, seed):
    rng = np.random.default_rng((m, seed))
    robot, q = random_chain(rng, m), rng.uniform(-1.0, 1.0, m)
    for target in targets_near(robot, q, rng):
        q_end, solution, _ = reach(robot, q, target)
        assert max(errors(robot, q_end, target)) < 1e-6
        assert solution.status == "ok"
        np.testing.assert_allclose(solution.residual, 0.0, atol=1e-6)


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("seed", range(3))
def test_named_arms_reach_a_partial_target(name, seed):
    rng, robot = np.random.default_rng(seed), iq.load_robot(name)
    for target in targets_near(robot, ready(name), rng):
        q_end, solution, _ = reach(robot, ready(name), target, posture=False)
        assert max(errors(robot, q_end, target)) < 1e-6
        assert solution.status == "ok"


@pytest.mark.parametrize("name", ["ur5", "panda", "xarm7"])
def test_partial_targets_need_no_more_joint_motion_than_whole_poses(name):
    robot, q, rng = iq.load_robot(name), ready(name), np.random.default_rng(5)
    for _ in range(4):
        twist = np.concatenate((rng.uniform(-1.0, 1.0, 3), rng.uniform(-0.1, 0.1, 3)))
        pose = robot.pose(q) @ iq.exp(twist)
        _, _, whole = reach(robot, q, pose, posture=False)
        for target in (iq.Target(pose[:3, 3]), iq.Target(pose[:3, 3], pose[:3, 2]), iq.Target(axis=pose[:3, 2])):
            _, _, travel = reach(robot, q, target, posture=False)
            assert travel <= 1.02 * whole


def test_the_rotation_about_a_target_axis_is_free():
    robot, q = iq.load_robot("ur5"), ready("ur5")
    spun = robot.pose(q) @ iq.transform(translation=[0.05, 0.03, 0.02]) @ iq.exp([0, 0, 2.5, 0, 0, 0])
    q_end, _, _ = reach(robot, q, iq.Target(spun[:3, 3], spun[:3, 2]))
    assert np.abs(q_end - q).max() < 0.3
    assert np.linalg.norm(robot.pose(q_end)[:3, 3] - spun[:3, 3]) < 1e-6


def test_a_point_is_a_target_of_the_tools_origin():
    robot, q = iq.load_robot("panda"), ready("panda")
    place = robot.pose(q)[:3, 3] + [0.1, 0.1, 0.05]
    ahead = np.array([0.1, 0.2, -0.1, 0.02, 0.03, 0.01])
    wanted = iq.Controller(robot, dt=DT).step(q, iq.Target(place), ahead)
    for point in (place, list(place), tuple(place.tolist()), place.astype(np.float64)[::1]):
        found = iq.Controller(robot, dt=DT).step(q, point, ahead)
        np.testing.assert_array_equal(found.velocity, wanted.velocity)


def test_the_unconstrained_part_of_a_feedforward_is_ignored():
    robot, q = iq.load_robot("ur5"), ready("ur5")
    place, axis = robot.pose(q)[:3, 3], robot.pose(q)[:3, 2]
    first = np.array([0.1, -0.2, 0.3, 0.02, 0.01, 0.03])
    spin = iq.adjoint(iq.transform(translation=place)) @ [*(0.7 * axis), 0.0, 0.0, 0.0]
    both = [iq.Controller(robot, dt=DT).step(q, iq.Target(place, axis), ahead) for ahead in (first, first + spin)]
    np.testing.assert_allclose(both[0].velocity, both[1].velocity, atol=1e-12)
    moved = robot.jacobian(q) @ both[0].velocity
    v = moved[3:] + np.cross(moved[:3], place)
    wanted = first[3:] + np.cross(first[:3], place)
    np.testing.assert_allclose(v, wanted, atol=2e-3 * np.linalg.norm(wanted))  # the law remembers that it was at rest


def test_the_residual_has_the_constrained_part_alone():
    robot, q = iq.load_robot("ur5").with_limits(velocity_limit=0.1), ready("ur5")
    pose = robot.pose(q) @ iq.exp([0.4, 0.3, -0.5, 0.2, 0.1, -0.1])
    point, axis = np.array([0.1, 0.0, 0.05]), np.array([0.6, 0.0, 0.8])
    there, along, a = point_of(pose, point), pose[:3, :3] @ axis, point_of(robot.pose(q), point)
    parts = {"point": there, "tool_point": point}, {"axis": along, "tool_axis": axis}
    for given in (parts[0], parts[0] | parts[1], parts[1] | {"tool_point": point}):
        loop = iq.Controller(robot, dt=DT, gain=2.0)
        solution = loop.step(q, iq.Target(**given))
        omega, v = np.split(solution.residual, 2)
        moved = robot.jacobian(q) @ solution.velocity
        v_a, n = v + np.cross(omega, a), robot.pose(q)[:3, :3] @ axis
        wanted = 2.0 * (there - a) - moved[3:] - np.cross(moved[:3], a)
        np.testing.assert_allclose(v_a, wanted if "point" in given else 0.0, atol=1e-9)
        turn = np.cross(n, along) * np.arctan2(np.linalg.norm(np.cross(n, along)), n @ along)
        left = 2.0 * turn / np.linalg.norm(np.cross(n, along)) - moved[:3]
        np.testing.assert_allclose(omega, left - n * (n @ left) if "axis" in given else 0.0, atol=1e-9)


def test_the_posture_acts_on_unconstrained_directions():
    robot, q = iq.load_robot("ur5"), ready("ur5")
    posture = q + np.array([0.0, 0.0, 0.0, 0.5, 0.3, -0.8])
    ahead = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.4])  # the point goes on and on
    followed, left = (iq.Controller(robot, dt=DT, posture=p) for p in (posture, False))
    for _ in range(20):
        place = robot.pose(q)[:3, 3]
        difference = followed.step(q, place, ahead).velocity - left.step(q, place, ahead).velocity
    J = robot.jacobian(q)
    moved = J[3:] + np.cross(J[:3], place, axisa=0, axisc=0)
    assert np.linalg.norm(moved @ difference) < 1e-3 * np.linalg.norm(difference)
    assert difference @ (posture - q) > 0.1 * np.linalg.norm(difference) * np.linalg.norm(posture - q)
    assert np.linalg.norm(difference) > 0.02


def test_where_the_task_rests_so_do_the_joints():
    for name in ("ur5", "panda"):
        robot, q = iq.load_robot(name), ready(name)
        loop = iq.Controller(robot, dt=DT)
        assert not loop.step(q, robot.pose(q)[:3, 3]).velocity.any()


@pytest.mark.parametrize("kind", ["point", "both", "axis"])
@pytest.mark.parametrize("form", [None, "carried"])
def test_neither_the_base_frame_nor_the_unit_of_length_decides(kind, form):
    rng = np.random.default_rng(3)
    made, home, q = arm(rng, "general", 6), iq.exp(rng.normal(size=6)), rng.uniform(-1.0, 1.0, 6)
    to, unit = iq.exp(rng.normal(size=6)), 1000.0
    moved = home.copy()
    moved[:3, 3] *= unit
    robots = [
        iq.robots.Chain(made.J, home, velocity_limit=0.4),
        iq.robots.Chain(iq.adjoint(to) @ made.J, to @ home, velocity_limit=0.4),
        iq.robots.Chain(made.in_units(unit).J, moved, velocity_limit=0.4),
    ]
    pose, point = robots[0].pose(q) @ iq.exp([0.5, -0.4, 0.3, 0.1, 0.2, -0.1]), np.array([0.1, -0.05, 0.2])
    there, along = point_of(pose, point), pose[:3, 0]
    velocities = []
    for robot, T, scale in zip(robots, (np.eye(4), to, np.eye(4)), (1.0, 1.0, unit), strict=True):
        parts = {
            "point": {"point": scale * point_of(T, there), "tool_point": scale * point},
            "axis": {"axis": T[:3, :3] @ along, "tool_axis": [1.0, 0.0, 0.0]},
        }
        given = parts["point"] | parts["axis"] if kind == "both" else parts[kind]
        loop = iq.Controller(robot, dt=DT, form=None if form is None else iq.tool_metric(robot))
        velocities.append(loop.step(q, iq.Target(**given)).velocity)
    assert np.abs(velocities[0]).max() > 0.1
    for velocity in velocities[1:]:
        np.testing.assert_allclose(velocity, velocities[0], atol=1e-9)


def test_a_carried_metric_measures_the_same_as_the_point_it_stands_for():
    robot, q = iq.load_robot("ur5"), ready("ur5")
    pose = robot.pose(q) @ iq.exp([0.4, 0.2, 0.3, 0.05, 0.02, 0.01])
    for target in (iq.Target(pose[:3, 3]), iq.Target(pose[:3, 3], pose[:3, 2]), iq.Target(axis=pose[:3, 2])):
        by_point = iq.Controller(robot, dt=DT).step(q, target)
        by_metric = iq.Controller(robot, dt=DT, form=iq.tool_metric(robot)).step(q, target)
        np.testing.assert_allclose(by_metric.velocity, by_point.velocity, atol=1e-9)


@pytest.mark.parametrize("turned", [np.pi, np.pi - 1e-9, np.pi - 0.05])
def test_an_axis_turned_round_goes_one_way(turned):
    robot, q = iq.load_robot("ur5"), ready("ur5")
    axis = (robot.pose(q) @ iq.exp([turned, 0, 0, 0, 0, 0]))[:3, 2]
    target, loop = iq.Target(axis=axis), iq.Controller(robot, dt=DT)
    angles = [errors(robot, p, target)[1] for p in drive(loop, q, target, 599).q]
    assert angles[-1] < 1e-6
    assert (np.diff(angles) < 1e-9).all()


def test_the_turn_of_the_tick_before_is_kept_past_half_a_turn():
    robot, q = iq.load_robot("ur5"), ready("ur5")
    loop = iq.Controller(robot, dt=DT, posture=False)
    turns = [(robot.pose(q) @ iq.exp([angle, 0, 0, 0, 0, 0]))[:3, 2] for angle in (3.0, 3.3)]
    first, second = (robot.jacobian(q) @ loop.step(q, iq.Target(axis=axis)).velocity for axis in turns)
    assert first[:3] @ second[:3] > 0.9 * np.linalg.norm(first[:3]) * np.linalg.norm(second[:3])


@pytest.mark.parametrize("kind", ["point", "both", "axis"])
def test_out_of_reach_the_arm_comes_to_rest(kind):
    robot, q = iq.load_robot("panda"), ready("panda")
    far = {"point": [1.4, 0.3, 0.4], "axis": [0.3, 1.0, 0.2]}
    if kind == "axis":
        robot = robot.with_limits(velocity_limit=[1.0, 1.0, 1.0, 1.0, 1e-9, 1e-9, 1e-9])
    target = iq.Target(**(far if kind == "both" else {kind: far[kind]}))
    q, solution, _ = reach(robot, q, target, seconds=20.0)
    assert np.abs(solution.velocity).max() < 1e-2
    if kind != "axis":
        assert solution.status in {"limited", "scaled"}
        assert errors(robot, q, target)[0] > 0.1


def test_joint_limits_hold_on_the_way():
    robot, rng = iq.load_robot("ur5"), np.random.default_rng(8)
    q = ready("ur5")
    robot = robot.with_limits(position_lower=q - 0.5, position_upper=q + 0.3, velocity_limit=0.8)
    loop = iq.Controller(robot, dt=DT, acceleration_limit=5.0)
    last = np.zeros(6)
    for _ in range(6):
        pose = robot.pose(q + rng.uniform(-1.0, 1.0, 6))
        for target in (iq.Target(pose[:3, 3]), iq.Target(pose[:3, 3], pose[:3, 2])):
            for _ in range(60):
                x = loop.step(q, target).velocity
                assert (np.abs(x) <= 0.8).all()
                assert (np.abs(x - last) <= 5.0 * DT * (1 + 1e-9)).all()
                q, last = q + DT * x, x
                assert (q >= robot.position_lower - 1e-12).all()
                assert (q <= robot.position_upper + 1e-12).all()


@pytest.mark.parametrize("delay", [0.0, 0.03])
def test_with_limited_accelerations_it_brakes_without_overshoot(delay):
    robot, q = iq.load_robot("ur5"), ready("ur5")
    target = iq.Target(robot.pose(q)[:3, 3] + [0.2, 0.1, -0.1])
    loop = iq.Controller(robot, dt=DT, acceleration_limit=3.0, delay=delay, gain=5.0)
    run = drive(loop, q, target, 500, late=round(delay / DT))
    off = [errors(robot, p, target)[0] for p in run.q[1:]]
    assert off[-1] < 1e-6
    assert (np.diff(off) < 1e-6).all()


def test_a_point_and_an_axis_on_five_joints_are_reached_exactly():
    robot, q = iq.load_robot("so101"), ready("so101")
    rng = np.random.default_rng(4)
    for _ in range(5):
        pose = robot.pose(q + rng.uniform(-0.4, 0.4, 5))
        spun = pose @ iq.exp([0.0, 0.0, 2.0, 0.0, 0.0, 0.0])  # a turn that five joints cannot also have
        target = iq.Target(spun[:3, 3], spun[:3, 2])
        q_end, solution, _ = reach(robot, q, target)
        assert max(errors(robot, q_end, target)) < 1e-6
        assert solution.status == "ok"
        least, _, _ = reach(robot, q, spun)
        assert max(errors(robot, least, target)) > 1e-3


def test_a_planar_arm_reaches_points_of_its_plane():
    screws = np.column_stack([iq.revolute(Z, [0.4 * i, 0.0, 0.0]) for i in range(3)])
    robot, q = iq.robots.Chain(screws, iq.transform(translation=[1.1, 0.0, 0.0])), np.array([0.3, 0.5, 0.4])
    q_end, solution, _ = reach(robot, q, np.array([0.5, 0.7, 0.0]))
    np.testing.assert_allclose(robot.pose(q_end)[:3, 3], [0.5, 0.7, 0.0], atol=1e-6)
    assert solution.status == "ok"
    q_end, solution, _ = reach(robot, q, np.array([0.5, 0.7, 0.2]))  # above the plane
    assert np.linalg.norm(robot.pose(q_end)[:2, 3] - [0.5, 0.7]) ** 2 < 2e-3 * 0.2**2  # a thousandth is not gone for
    assert solution.status == "limited"
    assert not np.abs(solution.velocity).max() > 1e-3


@pytest.mark.parametrize("name", ARMS)
def test_an_exact_position_agrees_with_a_point(name):
    robot, q = iq.load_robot(name), ready(name)
    place = robot.pose(q + 0.02)[:3, 3]
    exact = iq.Controller(robot, dt=DT, exact="position", posture=False).step(q, place)
    plain = iq.Controller(robot, dt=DT, posture=False).step(q, place)
    assert exact.status == "ok"
    np.testing.assert_allclose(exact.velocity, plain.velocity, atol=5e-3 * np.abs(plain.velocity).max())


def test_exact_demands_with_a_partial_target():
    robot, q = iq.load_robot("panda"), ready("panda")
    pose = robot.pose(q + 0.2)
    exact = [iq.control.ExactPoint(), iq.control.ExactAxis(Z), iq.control.ExactJoints([[1.0, 0, 0, 0, 0, 0, 0]])]
    q_end, solution, _ = reach(robot, q, iq.Target(pose[:3, 3], pose[:3, 2]), exact=exact)
    assert max(errors(robot, q_end, iq.Target(pose[:3, 3], pose[:3, 2]))) < 1e-6
    assert q_end[0] == pytest.approx(q[0], abs=1e-9)
    assert solution.status == "ok"


class Mine(iq.robots.Chain):
    """A robot that is no plain Chain: the engine asks Python for it."""


@pytest.mark.parametrize("name", ["ur5", "so101"])
def test_robots_and_demands_of_the_users_own_do_the_same(name):
    robot, q = iq.load_robot(name), ready(name)
    limits = robot.position_lower, robot.position_upper, robot.velocity_limit
    own = Mine(robot.screws, robot.home, robot.names, *limits)
    pose = robot.pose(q + 0.2)
    p, z = pose[:3, 3], pose[:3, 2]
    for target in (iq.Target(p), iq.Target(p, z), iq.Target(axis=z), p):
        plain = iq.Controller(robot, dt=DT).step(q, target)
        np.testing.assert_allclose(iq.Controller(own, dt=DT).step(q, target).velocity, plain.velocity, atol=1e-12)
    for target in (iq.Target(pose[:3, 3]), iq.Target(pose[:3, 3], pose[:3, 2])):
        exact = [
            iq.Controller(robot, dt=DT, exact=e).step(q, target)
            for e in (iq.control.ExactPoint(), OwnDemand(iq.control.ExactPoint()))
        ]
        np.testing.assert_allclose(exact[0].velocity, exact[1].velocity, atol=1e-9)


@pytest.mark.parametrize("exact", [None, "position"])
@pytest.mark.parametrize("name", ARMS)
def test_the_definition_gives_the_same_answer(name, exact):
    robot, q = iq.load_robot(name), ready(name)
    rng = np.random.default_rng(2)
    for target in targets_near(robot, q, rng):
        given = target if target.point is None else iq.Target(target.point, target.axis, tool_axis=target.tool_axis)
        engine, solver = (iq.Controller(robot, dt=DT, exact=exact, backend=b) for b in (None, "daqp"))
        at = q
        for _ in range(5):
            x, y = engine.step(at, given), solver.step(at, given)
            np.testing.assert_allclose(x.velocity, y.velocity, atol=2e-5 * (1.0 + np.abs(y.velocity).max()))
            assert x.status == y.status
            at = at + DT * x.velocity


def test_clearance_and_tool_speed_hold_on_the_way_to_a_point():
    robot, q = iq.load_robot("ur5"), ready("ur5")
    place = robot.pose(q)[:3, 3] + [0.0, 0.0, -0.3]
    ball = iq.limits.Sphere(place, 0.1)
    tip = {"wrist_3_link": [iq.limits.Sphere([0.0, 0.0, 0.0], 0.02)]}
    clearance = iq.limits.Clearance(robot, bodies=tip, obstacles=[ball], distance=0.01)
    loop = iq.Controller(robot, dt=DT, limits=[clearance], tool_speed=0.2)
    run = drive(loop, q, place, 400)
    for q, x in zip(run.q, run.x, strict=False):
        speed = robot.jacobian(q) @ x
        assert np.linalg.norm(speed[3:] + np.cross(speed[:3], robot.pose(q)[:3, 3])) <= 0.2 * (1 + 1e-6)
    assert min(clearance.at(q).distance for q in run.q) > 0.0
    assert errors(robot, run.q[-1], iq.Target(place))[0] < 0.14  # as near as the ball lets it


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({}, "point"),
        ({"point": [0.0, np.nan, 0.0]}, "point"),
        ({"point": [0.0, 0.0]}, "point"),
        ({"axis": [0.0, 0.0, 0.0]}, "axis"),
        ({"axis": [0.0, np.inf, 0.0]}, "axis"),
        ({"point": Z, "tool_point": [1.0]}, "tool_point"),
        ({"axis": Z, "tool_axis": [0.0, 0.0, 0.0]}, "tool_axis"),
    ],
)
def test_bad_arguments_of_a_target_are_refused_by_name(arguments, name):
    with pytest.raises(iq.BadInput) as refused:
        iq.Target(**arguments)
    assert refused.value.argument == name


BAD = [[np.nan, 0.0, 0.0], np.array([0.0, np.inf, 0.0]), [1.0, 2.0], np.zeros(7), [100.0, 0.0, 0.0], "point", None]
BAD += [np.eye(3), np.full((4, 4), np.nan), 2.0 * np.eye(4), np.eye(4) + np.eye(4)[3:]]


@pytest.mark.parametrize("target", BAD, ids=str)
def test_bad_targets_of_a_step_are_refused(target):
    robot, q = iq.load_robot("ur5"), ready("ur5")
    loop = iq.Controller(robot, dt=DT)
    before = loop.state
    with pytest.raises(iq.BadInput) as refused:
        loop.step(q, target)
    assert refused.value.argument == "target"
    assert loop.state == before


def test_a_form_needs_the_whole_pose():
    robot, q = iq.load_robot("ur5"), ready("ur5")
    with pytest.raises(iq.BadInput, match="form"):
        iq.Controller(robot, dt=DT, form=0.3).step(q, robot.pose(q)[:3, 3])


@pytest.mark.parametrize("option", [{"exact": "twist"}, {"form": 0.3}])
def test_demands_on_the_whole_twist_refuse_partial_targets(option):
    loop = iq.Controller(iq.load_robot("ur5"), dt=DT, **option)
    with pytest.raises(iq.BadInput, match="These need the whole twist"):
        loop.step(ready("ur5"), [0.3, 0.2, 0.4])
