"""Paths of targets that leave something free: the rest is on the path, nothing turns for nothing, limits are kept."""

import numpy as np
import pytest
from support.along_paths import drive, follower_on, speeds
from support.arms import ready

import invariantqp as iq

ARMS = ("so101", "ur5", "panda")
KINDS = ("point", "both", "axis")
POINT, AXIS = np.array((0.02, -0.01, 0.05)), np.array((0.6, 0.0, 0.8))


def poses_of(name, seed=1, count=6, far=0.2):
    """(n, 4, 4) poses of an arm on a smooth walk."""
    robot, rng = iq.load_robot(name), np.random.default_rng(seed)
    Q = ready(name) + np.cumsum(rng.uniform(-far, far, (count, len(ready(name)))), axis=0)
    return np.array([robot.pose(q) for q in (ready(name), *Q)])


def targets_of(poses, kind, point=(0.0, 0.0, 0.0), axis=(0.0, 0.0, 1.0)):
    there = [T[:3, :3] @ point + T[:3, 3] for T in poses]
    along = [T[:3, :3] @ axis for T in poses]
    return [
        iq.Target(None if kind == "axis" else p, None if kind == "point" else a, tool_point=point, tool_axis=axis)
        for p, a in zip(there, along, strict=True)
    ]


def travel(positions):
    return np.abs(np.diff(positions, axis=0)).sum()


def off(robot, q, target):
    """How far the point and the axis of an arm are from a target, each by itself."""
    T = robot.pose(q)
    place = 0.0 if target.point is None else np.linalg.norm(T[:3, :3] @ target.tool_point + T[:3, 3] - target.point)
    return max(place, 0.0 if target.axis is None else np.linalg.norm(T[:3, :3] @ target.tool_axis - target.axis))


def kept(robot, velocities, dt=0.004, rise=0.2):
    """Assert that velocities and accelerations are inside the limits."""
    assert (np.abs(velocities) <= speeds(robot) * (1.0 + 1e-9)).all()
    assert (np.abs(np.diff(velocities, axis=0)) <= dt * speeds(robot) / rise * (1.0 + 1e-6)).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ARMS)
def test_the_tool_is_on_the_path_and_free_directions_move_little(name, kind):
    robot, poses = iq.load_robot(name), poses_of(name)
    for targets in (targets_of(poses, kind), targets_of(poses, kind, POINT, AXIS)):
        follower = follower_on(robot, targets, ready(name), options={"posture": False})
        solutions, Q, velocities = drive(follower, ready(name))
        assert solutions[-1].status == "done"
        assert max(solution.across for solution in solutions) < 1e-5
        places = np.array([solution.place for solution in solutions])
        for i, target in enumerate(targets):
            assert off(robot, Q[1 + np.abs(places - i).argmin()], target) < 0.01  # a tick beside it at most
        assert off(robot, Q[-1], targets[-1]) < 1e-5
        kept(robot, velocities)
        if len(ready(name)) > targets[0].size:
            whole = drive(follower_on(robot, poses, ready(name), options={"posture": False}), ready(name))[1]
            assert travel(Q) <= travel(whole)


def test_points_are_targets_of_the_tools_origin():
    robot, poses, q = iq.load_robot("ur5"), poses_of("ur5"), ready("ur5")
    wanted = drive(follower_on(robot, targets_of(poses, "point"), q), q)[1]
    for path in (poses[:, :3, 3], poses[:, :3, 3].tolist()):
        np.testing.assert_array_equal(drive(follower_on(robot, path, q), q)[1], wanted)


def test_free_rotation_costs_no_time_and_no_travel():
    robot, q = iq.load_robot("ur5"), ready("ur5")
    home = robot.pose(q)
    spun = [home @ iq.exp([0.0, 0.0, 3.0 * u, 0.05 * u, 0.03 * u, 0.0]) for u in np.linspace(0.0, 1.0, 30)]
    solutions, Q, _ = drive(follower_on(robot, targets_of(spun, "both"), q), q)
    whole, turned, _ = drive(follower_on(robot, spun, q), q)
    assert len(solutions) < 0.6 * len(whole)
    assert travel(Q) < 0.4 * travel(turned)
    plain = drive(follower_on(robot, targets_of([iq.transform(home[:3, :3], T[:3, 3]) for T in spun], "both"), q), q)[1]
    np.testing.assert_allclose(Q, plain, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_the_motion_is_the_same_in_every_frame(kind):
    robot, poses, q = iq.load_robot("ur5"), poses_of("ur5"), ready("ur5")
    X = iq.exp([0.4, -0.3, 0.9, 0.1, 0.05, -0.2])
    back = np.linalg.inv(X)
    here = drive(follower_on(robot, targets_of(poses, kind, POINT, AXIS), q, options={"point": POINT}), q)[1]
    moved = robot.with_tool(X)
    elsewhere = targets_of(poses @ X, kind, back[:3, :3] @ POINT + back[:3, 3], back[:3, :3] @ AXIS)
    options = {"point": back[:3, :3] @ POINT + back[:3, 3]}
    np.testing.assert_allclose(drive(follower_on(moved, elsewhere, q, options=options), q)[1], here, atol=1e-6)


def test_the_posture_uses_free_directions():
    robot, q = iq.load_robot("ur5"), ready("ur5")
    posture = q + np.array([0.0, 0.0, 0.0, 0.3, 0.4, -0.8])
    points = robot.pose(q)[:3, 3] + np.linspace(0.0, 0.3, 10)[:, None] * [0.0, 1.0, 0.0]
    ends = []
    for options in ({"posture": False}, {"posture": posture, "posture_gain": 5.0}):
        solutions, Q, velocities = drive(follower_on(robot, points, q, options=options), q)
        assert max(s.across for s in solutions) < 1e-5
        kept(robot, velocities)
        ends.append(np.abs(Q[-1] - posture)[3:].sum())
    assert ends[1] < 0.7 * ends[0]


@pytest.mark.parametrize("kind", KINDS)
def test_functions_corners_jerk_and_time(kind):
    robot, q = iq.load_robot("ur5"), ready("ur5")
    home = robot.pose(q)

    def path(t):
        T = home @ iq.exp([0.4 * np.sin(t), 0.3 * t, 0.5 * t, 0.0, 0.0, 0.0])
        T[:3, 3] = home[:3, 3] + [0.05 * np.sin(3.0 * t), 0.1 * t, 0.03 * t * t]
        return targets_of([T], kind, POINT, AXIS)[0]

    follower = follower_on(robot, path, q, rate=0.4, joint_jerk=100.0 * speeds(robot))
    solutions, Q, velocities = drive(follower, q)
    assert solutions[-1].status == "done"
    assert max(s.across for s in solutions) < 1e-5
    assert 2.5 <= 0.004 * len(solutions) < 3.0
    kept(robot, velocities)
    jerks = np.abs(np.diff(velocities, 2, axis=0)) / 0.004**2
    assert (jerks <= 100.0 * speeds(robot) * (1.0 + 1e-6)).all()
    for place in (0.2, 0.7):
        found = follower.pose(place)
        tick = np.abs([s.place - place for s in solutions]).argmin()
        assert off(robot, Q[tick + 1], found) < 1e-3
        assert off(robot, Q[tick + 1], path(place)) < 1e-3
    square = [path(t) for t in (0.0, 0.5, 1.0)]
    solutions, Q, velocities = drive(follower_on(robot, square, q, corners=True), q)
    assert solutions[-1].status == "done"
    corner = np.abs([s.place - 1.0 for s in solutions]).argmin()
    assert np.abs(velocities[corner]).max() < 0.1 * np.abs(velocities).max()
    kept(robot, velocities)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("jerk", [None, 50.0])
def test_the_approach_to_the_start_moves_free_directions_little(kind, jerk):
    robot, q = iq.load_robot("ur5"), ready("ur5")
    home = robot.pose(q)
    away = [home @ iq.exp([0.1 + 0.1 * u, 0.1, 2.5, 0.05, 0.04, 0.03 + 0.1 * u]) for u in np.linspace(0.0, 1.0, 5)]
    follower = follower_on(robot, targets_of(away, kind), joint_jerk=jerk)
    solutions, Q, velocities = drive(follower, q)
    assert solutions[-1].status == "done"
    assert off(robot, Q[-1], targets_of(away, kind)[-1]) < 1e-5
    assert travel(Q) < 0.7 * travel(drive(follower_on(robot, away, joint_jerk=jerk), q)[1])
    kept(robot, velocities)


def test_a_push_in_free_directions_is_kept_and_others_are_corrected():
    robot, q = iq.load_robot("ur5"), ready("ur5")
    points = robot.pose(q)[:3, 3] + np.linspace(0.0, 0.3, 10)[:, None] * [0.0, 1.0, 0.0]
    push = {30: np.array([0.05, -0.05, 0.05, 0.0, 0.0, 0.0])}
    solutions, Q, _ = drive(follower_on(robot, points, q), q, push=push)
    assert solutions[31].status == "waiting"
    assert solutions[-1].status == "done"
    np.testing.assert_allclose(robot.pose(Q[-1])[:3, 3], points[-1], atol=1e-4)


@pytest.mark.parametrize("blocked", ["stop", "leave"])
def test_points_out_of_reach_end_the_path_or_are_left(blocked):
    robot, q = iq.load_robot("panda"), ready("panda")
    home = robot.pose(q)[:3, 3]
    points = home + np.sin(np.linspace(0.0, np.pi, 30))[:, None] * [0.9, 0.0, 0.0]
    points[:, 1] += np.linspace(0.0, 0.2, 30)
    solutions, Q, velocities = drive(follower_on(robot, points, q, blocked=blocked), q)
    kept(robot, velocities)
    if blocked == "stop":
        assert solutions[-1].status == "blocked"
        assert "reach" in solutions[-1].reason or "limit" in solutions[-1].reason
    else:
        assert "left" in {s.status for s in solutions}
        assert solutions[-1].status == "done"
        np.testing.assert_allclose(robot.pose(Q[-1])[:3, 3], points[-1], atol=1e-4)


@pytest.mark.parametrize("kind", ["points", "both", "poses"])
def test_a_follower_that_keeps_the_shape_is_a_path_follower(kind):
    robot, poses, q = iq.load_robot("ur5"), poses_of("ur5"), ready("ur5")
    path = {"points": poses[:, :3, 3], "both": targets_of(poses, "both"), "poses": poses}[kind]
    solutions, wanted, _ = drive(follower_on(robot, path, q), q)
    follower = iq.Follower(iq.Controller(robot, dt=0.004, acceleration_limit=speeds(robot) / 0.2), keep="shape")
    follower.follow(path)
    follower.prepare(q)
    same, Q, _ = drive(follower, q)
    np.testing.assert_array_equal(Q, wanted)
    assert [s.across for s in same] == [s.across for s in solutions]
    follower.follow(path[:4], 3.0 * np.arange(4.0))
    follower.prepare(q)
    solutions, _, _ = drive(follower, q)
    assert solutions[-1].status == "done"
    assert 9.0 <= 0.004 * len(solutions) < 9.5


def test_the_speed_limit_of_a_tool_point_holds_under_free_rotation():
    robot, q = iq.load_robot("ur5"), ready("ur5")
    tip = np.array((0.0, 0.0, 0.3))
    options = {"tool_speed": iq.limits.ToolSpeed(0.1, tip), "posture": q + 0.6, "posture_gain": 5.0}
    points = robot.pose(q)[:3, 3] + np.linspace(0.0, 0.2, 10)[:, None] * [0.0, 1.0, 0.0]
    follower = follower_on(robot, points, q, options=options)
    motion = follower.plan.motion
    smoothed_motion = motion.at(np.linspace(0.0, motion.end, 200))[:, :2, :-1]
    _, Q, velocities = drive(follower, q)
    speed = []
    for x, v in (*smoothed_motion, *zip(Q, velocities, strict=False)):
        T, s = robot.pose(x), robot.jacobian(x) @ v
        speed.append(np.linalg.norm(s[3:] + np.cross(s[:3], T[:3, :3] @ tip + T[:3, 3])))
    assert 0.099 < max(speed) <= 0.1 * (1.0 + 1e-6)


def test_invalid_paths_are_refused_by_name():
    robot, T = iq.load_robot("ur5"), poses_of("ur5")
    loop = iq.Controller(robot, dt=0.004)
    point, axis = T[0][:3, 3], T[0][:3, 2]
    wrong = {
        "path[1]": [
            [point, T[1]],
            [T[0], iq.Target(point)],
            [iq.Target(point), iq.Target(axis=axis)],
            [iq.Target(point), iq.Target(point + 0.1, tool_point=[0.0, 0.0, 0.1])],
            [point, [np.nan, 0.0, 0.0]],
            [point, [0.0, 0.0]],
        ],
        "path": [
            [iq.Target(axis=axis), iq.Target(axis=axis)],
            [point, point],
            [point],
            lambda t: iq.Target(point) if t < 0.5 else iq.Target(axis=axis),
        ],
    }
    for argument, paths in wrong.items():
        for path in paths:
            with pytest.raises(iq.BadInput) as refused:
                iq.PathFollower(loop, path)
            assert refused.value.argument == argument
    points = [point, point + 0.1]
    for options in ({"exact": "position"}, {"exact": "twist"}, {"form": 0.3}):
        with pytest.raises(iq.BadInput, match="These need the whole pose"):
            iq.PathFollower(iq.Controller(robot, dt=0.004, **options), points)
        with pytest.raises(iq.BadInput) as refused:
            iq.Follower(iq.Controller(robot, dt=0.004, **options), keep="shape").follow(points)
        assert refused.value.argument == "points"
    follower = iq.Follower(loop, keep="shape")
    for points in ([point], [iq.Target([1e3, 0.0, 0.0]), iq.Target([1e3, 0.0, 0.1])]):
        with pytest.raises(iq.BadInput) as refused:
            follower.follow(points)
        assert refused.value.argument == "points"
