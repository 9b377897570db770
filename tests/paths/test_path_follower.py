"""A follower keeps its tool on the path: limits make it late, not off."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from support.along_paths import drive, follower_on, quickest, speeds, straight
from support.arms import ready

import invariantqp as iq
from invariantqp.geometry import se3
from invariantqp.workbench.runs.trace import distance

DT = 0.004
RISE = 0.2
ARMS = ("ur5", "panda", "so101", "z1")
MM, RAD = 5e-5, np.radians(0.01)


def joint_path(robot, seed, reach=0.5):
    rng = np.random.default_rng(seed)
    low = np.where(np.isfinite(robot.position_lower), robot.position_lower, -3.0)
    high = np.where(np.isfinite(robot.position_upper), robot.position_upper, 3.0)
    mid, half = 0.5 * (low + high), 0.5 * (high - low)
    q = [mid + half * rng.uniform(-0.5, 0.5, len(mid))]
    for _ in range(2):
        q.append(np.clip(q[-1] + rng.uniform(-reach, reach, len(mid)), mid - 0.8 * half, mid + 0.8 * half))
    return CubicSpline([0.0, 0.5, 1.0], q)


def along(robot, joints):
    return lambda u: robot.pose(joints(u))


def largest_error(robot, pose, solutions, positions, radian=0.5):
    """How far the tool is from the path: from the pose nearest it, near the place that the solutions tell."""
    size = np.array([radian, radian, radian, 1.0, 1.0, 1.0])

    def error(T, u):
        W = pose(u)
        return size * np.append(iq.log(T @ iq.inverse(W))[:3], T[:3, 3] - W[:3, 3])

    worst = np.zeros(2)
    for s, q in zip(solutions[::3], positions[1::3], strict=True):  # it changes little in three ticks
        T, u = robot.pose(q), min(s.place, 1.0)
        a, b = max(u - 1e-5, 0.0), min(u + 1e-5, 1.0)
        along = (error(T, b) - error(T, a)) / (b - a)
        near = np.clip(u - along.dot(error(T, u)) / along.dot(along), 0.0, 1.0)
        worst = np.maximum(worst, min((distance(T, pose(v)) for v in (u, near)), key=sum))
    return worst


def gentle(robot, velocities, dt=DT):
    """Whether joint velocities, tick by tick, are inside the limits of velocity and acceleration."""
    jumps = np.abs(np.diff(velocities, axis=0, prepend=np.zeros((1, velocities.shape[1])))) / dt
    inside = (jumps * RISE / speeds(robot)).max() <= 1.0 + 1e-9
    return inside and (np.abs(velocities) <= robot.velocity_limit + 1e-9).all()


def kept(robot, pose, run, dt=DT):
    """Whether the path was done, the tool on it, inside those limits."""
    solutions, q, x = run
    on = (largest_error(robot, pose, solutions, q) < (MM, RAD)).all()
    return solutions[-1].status == "done" and on and gentle(robot, x, dt)


@settings(max_examples=6, deadline=None)
@given(name=st.sampled_from(ARMS), seed=st.integers(0, 10_000))
def test_the_tool_stays_on_the_path_at_the_limits(name, seed):
    robot = iq.load_robot(name)
    joints = joint_path(robot, seed)
    if min(np.linalg.cond(robot.jacobian(joints(u))[:, :6]) for u in np.linspace(0.0, 1.0, 20)) > 200.0:
        return
    pose = along(robot, joints)
    follower = follower_on(robot, pose, joints(0.0), dt=0.001)
    assert kept(robot, pose, drive(follower, joints(0.0)), 0.001)


@pytest.mark.cases(1)
@pytest.mark.parametrize("seed", [0, 1])
def test_it_takes_little_longer_than_the_optimal_time(seed):
    pytest.importorskip("toppra")
    robot = iq.load_robot("ur5")
    joints = joint_path(robot, seed)
    follower = follower_on(robot, along(robot, joints), joints(0.0))
    _, _, x = drive(follower, joints(0.0))
    optimal = quickest(speeds(robot), speeds(robot) / RISE, joints)
    assert optimal * 0.99 < DT * len(x) < optimal * 1.1


def test_a_corner_is_not_cut():
    robot = iq.load_robot("ur5")
    q = np.array(
        [[0.0, -1.4, 1.6, -1.8, -1.57, 0.0], [0.3, -1.2, 1.4, -1.7, -1.3, 0.2], [0.4, -1.5, 1.7, -1.6, -1.6, 0]]
    )

    def pose(u):
        return robot.pose([np.interp(2.0 * u, (0, 1, 2), c) for c in q.T])

    follower = follower_on(robot, pose, q[0])
    solutions, _, x = run = drive(follower, q[0])
    assert kept(robot, pose, run)
    slowest = min(np.abs(v).max() for s, v in zip(solutions, x, strict=True) if 0.4 < s.place < 0.6)
    assert slowest < 0.1 * np.abs(x).max()


def test_the_same_motion_in_another_frame_of_the_tool():
    robot = iq.load_robot("panda")
    joints = joint_path(robot, 3)
    offset = se3.exp([0.3, -0.2, 0.5, 0.1, 0.05, -0.2])
    moved = robot.with_tool(offset)
    point = np.array([0.0, 0.0, 0.05])
    there = np.linalg.inv(offset).dot([*point, 1.0])[:3]
    runs = []
    for arm, at in ((robot, point), (moved, there)):
        follower = follower_on(arm, along(arm, joints), joints(0.0), options={"point": at})
        runs.append(drive(follower, joints(0.0), 200)[1])
    assert np.abs(runs[0] - runs[1]).max() < 1e-10


def test_the_same_motion_in_another_frame_of_the_base():
    base = se3.exp([0.4, 0.1, -0.7, 0.3, -0.5, 0.2])
    robot = iq.load_robot("ur5")
    q0 = ready("ur5")
    home, screws = robot.pose(q0), robot.jacobian(q0)
    joints = CubicSpline([0.0, 0.5, 1.0], [np.zeros(6), np.full(6, 0.3), [0.5, 0.1, 0.2, 0.4, 0.0, 0.3]])
    runs = []
    for frame in (np.eye(4), base):
        arm = iq.robots.Chain(iq.adjoint(frame) @ screws, frame @ home, velocity_limit=2.0)
        follower = follower_on(arm, along(arm, joints), np.zeros(6))
        runs.append(drive(follower, np.zeros(6), 200)[1])
    assert np.abs(runs[0] - runs[1]).max() < 1e-10


@pytest.mark.parametrize("name", ["ur5", "five joints"])
def test_it_stops_before_a_position_limit(name):
    robot = iq.load_robot("ur5" if name == "ur5" else "so101")
    joints = joint_path(robot, 5, 0.3)
    start = joints(0.0)
    beyond = start.copy()
    beyond[1] = robot.position_upper[1] + 0.3
    start = start.copy()
    start[1] = robot.position_upper[1] - 0.3

    def pose(u):
        return robot.pose(start + u * (beyond - start))

    follower = follower_on(robot, pose, start)
    solutions, q, x = drive(follower, start)
    last = solutions[-1]
    assert last.status == "blocked"
    assert f"joint 1 ({robot.names[1]}) is at its upper position limit" in last.reason
    assert 0.45 < last.place < 0.51  # other joints carry the tool a little farther
    assert (q <= robot.position_upper + 1e-9).all()
    assert np.abs(x[-1]).max() < 1e-2
    assert gentle(robot, x)
    assert (largest_error(robot, pose, solutions, q) < (MM, RAD)).all()


def test_it_leaves_the_path_out_of_reach_and_rejoins_it():
    robot = iq.load_robot("ur5")
    q = ready("ur5")
    T0 = robot.pose(q)

    def pose(u):  # half a metre outwards and back: beyond the arm's reach
        T = T0.copy()
        T[:3, 3] += 0.6 * np.sin(np.pi * u) * T0[:3, 3] / np.linalg.norm(T0[:3, 3]) + [0.0, 0.2 * u, 0.0]
        return T

    stops, leaves = (follower_on(robot, pose, blocked=way) for way in ("stop", "leave"))
    stops.prepare(q)
    assert drive(stops, q)[0][-1].status == "blocked"
    leaves.prepare(q)
    solutions, positions, x = drive(leaves, q, 15000)
    assert solutions[-1].status == "done"
    assert any(s.status == "left" for s in solutions)
    assert min(np.diff([s.place for s in solutions], prepend=0.0)) >= 0.0
    assert distance(robot.pose(positions[-1]), pose(1.0))[0] < MM
    assert gentle(robot, x)


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    ("name", "exact", "where"), [("ur5", None, "start"), ("panda", "position", "end"), ("so101", "position", "start")]
)
def test_it_leaves_the_path_by_the_least(name, exact, where):
    robot = iq.load_robot(name)
    start = ready(name)
    home = robot.pose(start)
    far = {"start": lambda u: 1.0 - u, "middle": lambda u: np.sin(np.pi * u), "end": lambda u: u}[where]
    length = iq.Controller(robot, dt=DT).measure.length
    out = home[:3, 3] / np.linalg.norm(home[:3, 3])
    side = np.cross([0.0, 0.0, 1.0], out)

    def pose(u):
        return iq.transform(home[:3, :3], home[:3, 3] + length * (0.6 * far(u) * out + 0.2 * u * side))

    def missing(q, W):
        T = robot.pose(q)
        if exact is not None:
            return W[:3, 3] - T[:3, 3]
        twist = iq.log(W @ iq.inverse(T))
        return np.append(length * twist[:3], twist[3:] + np.cross(twist[:3], T[:3, 3]))

    low, high = robot.position_lower, robot.position_upper
    bounds = np.maximum(low, -7.0), np.minimum(high, 7.0)
    follower = follower_on(robot, pose, dt=0.01, options={"exact": exact}, blocked="leave")
    start = least_squares(missing, start, bounds=bounds, args=(pose(0.0),)).x
    follower.prepare(start)
    found, before = [], start
    for u in np.linspace(0.0, 1.0, 7):
        q = follower.plan.joints(u * follower.plan.end)
        W = pose(follower._path.drive.given.place(u * follower.plan.end))
        tries = [least_squares(missing, np.clip(x, *bounds), bounds=bounds, args=(W,)) for x in (q, before)]
        best = min(tries, key=lambda one: one.cost)
        before = best.x
        found.append((np.linalg.norm(missing(q, W)), np.sqrt(2.0 * best.cost)))
        assert (low <= q).all()
        assert (q <= high).all()
    ours, least = np.array(found).T
    assert least.max() > 0.05 * length
    assert ours.max() < 1.02 * least.max()
    assert (ours - least).max() < 5e-3 * length


@pytest.mark.cases(1)
@pytest.mark.parametrize(("name", "joint"), [("z1", 2), ("so101", 1), ("so101", 3)])
def test_a_path_that_comes_back_into_reach_just_before_its_end_is_done(name, joint):
    robot = iq.load_robot(name)
    low, high = robot.position_lower, robot.position_upper
    q, limit = 0.5 * (low + high), high[joint]
    # Beyond the limit from the middle on, back inside for the last hundredth.
    over = CubicSpline([0.0, 0.5, 0.8, 0.99, 1.0], [-0.3, 0.0, 0.2, 0.0, -0.01])

    def pose(u):
        x = q + 0.2 * u
        x[joint] = limit + over(u)
        return robot.pose(x)

    follower = follower_on(robot, pose, dt=0.01, blocked="leave")
    start = q.copy()
    start[joint] = limit - 0.3
    follower.prepare(start)
    solutions, positions, x = drive(follower, start, 2000)
    assert "left" in {s.status for s in solutions}
    assert solutions[-1].status == "done"
    assert solutions[-1].place == 1.0
    assert distance(robot.pose(positions[-1]), pose(1.0))[0] < MM
    assert gentle(robot, x, 0.01)


@pytest.mark.cases(3)
@pytest.mark.parametrize(("name", "seed"), [("ur5", 1), ("panda", 2), ("z1", 3)])
@pytest.mark.parametrize("exact", [None, "position"])
def test_a_path_in_reach_is_not_left(name, seed, exact):
    robot = iq.load_robot(name)
    joints = joint_path(robot, seed)
    follower = follower_on(robot, along(robot, joints), dt=0.01, options={"exact": exact}, rate=0.2, blocked="leave")
    follower.prepare(joints(0.0))
    assert max(follower.plan.off) < 1e-9
    solutions, _, _ = drive(follower, joints(0.0))
    assert solutions[-1].status == "done"
    assert {s.status for s in solutions} <= {"moving", "slowed", "done"}
    assert max(s.across for s in solutions) < MM


def test_a_start_out_of_reach_blocks_the_path():
    robot = iq.load_robot("ur5")
    q = np.array([0.3, -0.6, 0.12, -0.4, -1.2, 0.1])  # nearly stretched
    home = robot.pose(q)
    out = home[:3, 3] / np.linalg.norm(home[:3, 3])
    follower = follower_on(robot, lambda u: iq.transform(home[:3, :3], home[:3, 3] + (0.01 + 0.1 * u) * out), q)
    solutions, _, _ = drive(follower, q, 1000)
    assert [s.status for s in solutions] == ["waiting"] * (len(solutions) - 1) + ["blocked"]
    assert "it is out of reach" in solutions[-1].reason


def test_a_push_off_the_path_is_corrected():
    robot = iq.load_robot("ur5")
    joints = joint_path(robot, 7)
    pose = along(robot, joints)
    follower = follower_on(robot, pose, joints(0.0))
    _, before, _ = drive(follower, joints(0.0), 75)
    pushed, q, _ = drive(follower, before[-1] + 2e-3 * np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0]), 100)
    assert pushed[0].across > 1e-3
    assert largest_error(robot, pose, pushed[-1:], q[-2:])[0] < MM


@pytest.mark.cases(1)
@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_after_a_large_push_it_returns_to_its_place(name):
    robot = iq.load_robot(name)
    joints = joint_path(robot, 7)
    pose = along(robot, joints)
    follower = follower_on(robot, pose, joints(0.0))
    before, q, x = drive(follower, joints(0.0), 75)
    after, p, y = drive(follower, q[-1] + 0.1 * (-1.0) ** np.arange(len(robot.names)))
    away = [s for s in after if s.status == "waiting"]
    assert "off the path, pushed or with more delay" in away[0].reason
    assert np.ptp([s.place for s in (before[-1], *away)]) < 1e-12
    back = after[len(away) :]
    assert back[0].place - before[-1].place < 1e-3
    assert back[-1].status == "done"
    assert (largest_error(robot, pose, back, p[len(away) :]) < (MM, RAD)).all()
    velocities = np.vstack((x, y))
    assert gentle(robot, velocities)


def test_pause_turn_and_override_keep_the_path():
    robot = iq.load_robot("ur5")
    joints = joint_path(robot, 7)
    calls = {50: "pause", 125: "resume", 165: "reverse", 250: "reverse"}
    pose = along(robot, joints)

    def during(k, follower):
        if k in calls:
            getattr(follower, calls[k])()

    follower = follower_on(robot, pose, joints(0.0))
    run = drive(follower, joints(0.0), during=during, override=lambda k: 0.3 if 300 <= k < 350 else 1.5)
    solutions, _, x = run
    assert solutions[120].status == "paused"
    assert np.abs(x[120]).max() < 1e-3
    assert min(s.speed for s in solutions) < 0.0
    assert kept(robot, pose, run)


def test_the_speed_keeps_the_jerk_limit():
    robot = iq.load_robot("ur5")
    q, acceleration, jerk = ready("ur5"), 20.0, 150.0
    turn = np.array([0.3, -0.2, 0.4, 0.2, -0.3, 0.5])

    def pose(u):  # bends that take most of the joints' acceleration
        return robot.pose(q + u * turn + 0.2 * np.sin(3.0 * np.pi * u) ** 2)

    # With a rate that is never reached the speed is told in the parameter that acceleration and jerk are of.
    follower = follower_on(robot, pose, q, rate=10.0, acceleration=acceleration, jerk=jerk)
    solutions, _, x = drive(follower, q, during=lambda k, f: {100: f.pause, 150: f.resume}.get(k, int)())
    assert solutions[-1].status == "done"
    assert gentle(robot, x)
    v = np.array([s.speed for s in solutions])[:-5]
    a = np.diff(v, prepend=0.0) / DT
    assert np.abs(a).max() <= acceleration * (1.0 + 1e-6)
    assert np.abs(np.diff(a)).max() / DT <= jerk * 1.05


def test_an_s_curve_of_long_ticks_reaches_the_end():
    robot = iq.load_robot("ur5")
    q, dt = ready("ur5"), 0.005
    T0 = robot.pose(q)
    controller = iq.Controller(robot, dt=dt, acceleration_limit=robot.velocity_limit / RISE)
    for length in (0.02, 0.024, 0.03):
        poses = [T0, iq.transform(T0[:3, :3], T0[:3, 3] + [0.0, length, 0.0])]
        follower = iq.PathFollower(controller, poses, jerk=200.0)
        follower.prepare(q)
        assert drive(follower, q, 300)[0][-1].status == "done"


def test_a_rate_is_kept_where_limits_allow_it_and_the_lag_is_reported():
    robot = iq.load_robot("ur5")
    joints = joint_path(robot, 7)
    slow = follower_on(robot, lambda t: robot.pose(joints(t / 20.0)), joints(0.0), end=20.0, rate=1.0)
    on_time = drive(slow, joints(0.0), 200)[0]
    assert on_time[-1].late < 0.2
    assert on_time[-1].ruling == "the rate asked for"
    fast = follower_on(robot, lambda t: robot.pose(joints(t / 0.4)), joints(0.0), end=0.4, rate=1.0)
    late, _, x = drive(fast, joints(0.0))
    assert late[-1].status == "done"
    assert late[-1].late == pytest.approx(DT * len(x) - 0.4, abs=2 * DT)
    assert {s.status for s in late} == {"slowed", "moving", "done"} or {s.status for s in late} == {"slowed", "done"}


@pytest.mark.cases(2)
@pytest.mark.parametrize(("exact", "turn"), [("position", 0.0), ("position", 0.3), (None, 0.0)])
def test_a_rotation_beyond_the_arm_does_not_slow_it_down(exact, turn):
    pytest.importorskip("toppra")
    arm = iq.load_robot("so101")
    q = ready("so101")
    home = arm.pose(q)

    def pose(u):  # 150 mm to the side, where five joints cannot keep the orientation; turned, a joint meets its limit
        turned = home[:3, :3] @ se3.exp([turn * u, turn * u, 0.0, 0.0, 0.0, 0.0])[:3, :3]
        return iq.transform(turned, home[:3, 3] + [0.0, 0.15 * u, 0.0])

    loop = iq.Controller(arm, dt=0.005, exact=exact, acceleration_limit=10.0)
    follower = iq.PathFollower(loop, pose)
    follower.prepare(q)
    solutions, positions, x = drive(follower, q)
    final = positions[-2]
    if exact is None:  # a pose is asked for, and told to be missed
        root = loop.measure.root_for(arm.jacobian(final), arm.pose(final))
        off = root @ iq.log(pose(1.0) @ np.linalg.inv(arm.pose(final)))
        assert solutions[-1].status == "blocked"
        assert solutions[-1].across == pytest.approx(np.linalg.norm(off), rel=1e-3)
        assert solutions[-1].across > MM
    else:
        assert solutions[-1].status == "done"
        assert max(s.across for s in solutions) < MM
    assert np.abs(np.diff(x, axis=0, prepend=0.0 * x[:1])).max() <= 0.005 * 10.0 * (1.0 + 1e-9)
    optimal = quickest(speeds(arm), np.full(5, 10.0), follower.plan.joints, follower.plan.end)
    assert 0.005 * len(x) < 1.3 * optimal


@pytest.mark.cases(1)
@pytest.mark.parametrize(("way", "turned"), [((0.07, 0.0, 0.07), 2.6), ((0.0, 0.0, 0.2), 30.0)])
def test_an_exact_point_is_reached_where_the_orientation_is_not(way, turned):
    arm = iq.load_robot("so101")
    q = ready("so101")
    home = arm.pose(q)

    pose = straight(home, *way)  # on the way the elbow is stretched, and the wrist has to turn the tool
    follower = follower_on(arm, pose, q, dt=0.005, options={"exact": "position"})
    solutions, positions, x = drive(follower, q)
    assert solutions[-1].status == "done"
    assert largest_error(arm, pose, solutions, positions, radian=0.0)[0] < MM
    assert np.degrees(distance(arm.pose(positions[-1]), pose(1.0))[1]) < turned
    assert gentle(arm, x, 0.005)
    # Without exact rows turning counts as well as moving, and the arm stops where it is stretched out.
    plain = follower_on(arm, pose, q, dt=0.005)
    last = drive(plain, q)[0][-1]
    assert last.status == "blocked"
    assert 'exact="position" would turn the tool instead' in last.reason


def test_a_tool_that_is_done_is_at_the_end():
    arm = iq.load_robot("so101")  # 10 rad/s, from which it stops within a tick where nothing limits acceleration
    q = ready("so101")
    home = arm.pose(q)
    end = home[:3, 3] + [0.0, 0.1, 0.0]
    follower = follower_on(arm, straight(home, 0.0, 0.1, 0.0), rise=None, options={"exact": "position"}, tolerance=1e-6)
    follower.prepare(q)
    solutions, positions, _ = drive(follower, q)
    assert solutions[-1].status == "done"
    assert all(np.linalg.norm(arm.pose(p)[:3, 3] - end) < 1e-6 for p in positions[-2:])
    assert max(s.across for s in solutions) < MM
    assert {(s.status, s.ruling) for s in solutions if s.place > 1.0 - 1e-12} == {
        ("moving", "settling"),
        ("done", "the path's end"),
    }
    there = positions[-1]
    J = (iq.adjoint(iq.transform(translation=-end)) @ arm.jacobian(there))[3:]
    past, q, _ = drive(follower, there + np.linalg.pinv(J) @ [0.0, 2e-4, 0.0])  # pushed past the end
    assert past[0].status != "done"
    assert past[-1].status == "done"
    assert np.linalg.norm(arm.pose(q[-1])[:3, 3] - end) < 1e-6


def test_tool_speed_and_rows_slow_it_down():
    robot = iq.load_robot("ur5")
    joints = joint_path(robot, 13)
    row = np.array([[1.0, 1.0, 0.0, 0.0, 0.0, 0.0]])
    pose = along(robot, joints)
    rows = iq.limits.LimitRows(row, [-0.4], [0.4])
    follower = follower_on(robot, pose, joints(0.0), options={"tool_speed": 0.2, "rows": rows})
    solutions, q, x = run = drive(follower, joints(0.0))
    assert kept(robot, pose, run)
    tool = np.linalg.norm(np.diff([robot.pose(p)[:3, 3] for p in q], axis=0), axis=1) / DT
    assert tool.max() < 0.2 * 1.001
    assert np.abs(x @ row[0]).max() <= 0.4 + 1e-9
    assert {"the tool's speed", "rows"} & {s.ruling for s in solutions}


def test_without_acceleration_limits_it_drives_at_the_velocity_limit():
    robot = iq.load_robot("ur5")
    joints = joint_path(robot, 2)
    pose = along(robot, joints)
    follower = follower_on(robot, pose, joints(0.0), rise=None)
    solutions, q, x = drive(follower, joints(0.0))
    assert solutions[-1].status == "done"
    assert (largest_error(robot, pose, solutions, q) < (MM, RAD)).all()
    busy = np.abs(x[5:-5] / robot.velocity_limit).max(axis=1)
    assert np.median(busy) > 0.99
    assert busy.min() > 0.9


def test_a_rail_at_its_limit_leaves_the_joints_on_their_motion():
    arm = iq.load_robot(
        "ur5e", base=iq.robots.stand_on(np.eye(4), iq.robots.rail([0, 1, 0], lower=-0.2, upper=2.5, speed=0.5))
    )
    q = np.array([0.0, 0.0, -1.4, 1.9, -2.1, -1.57, 0.0])
    T = arm.pose(q)

    def wave(u):
        return iq.transform(T[:3, :3], T[:3, 3] + [0.04 * np.sin(4.0 * np.pi * u) ** 2, 2.0 * u, 0.0])

    follower = iq.PathFollower(iq.Controller(arm, dt=0.01), wave)
    follower.prepare(q)
    statuses = [s.status for s in drive(follower, q, 700)[0]]
    assert statuses[-1] == "done"
    assert "waiting" not in statuses


def test_it_finds_the_path_and_its_start_by_itself():
    robot = iq.load_robot("ur5")
    joints = joint_path(robot, 7)
    poses = np.array([robot.pose(joints(u)) for u in np.linspace(0.0, 1.0, 101)])
    follower = follower_on(robot, poses, times=np.linspace(0.0, 1.0, 101))
    solutions, q, _ = drive(follower, joints(0.0) + 0.02)
    assert solutions[0].status == "waiting"
    follower = follower_on(robot, poses, joints(0.0), times=np.linspace(0.0, 1.0, 101))
    assert follower.step(joints(0.0) + 0.1).reason.startswith("on the way to the path's start")
    assert solutions[-1].status == "done"
    assert distance(robot.pose(q[-1]), poses[-1])[0] < MM


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"path": "a line"}, "path"),
        ({"path": [np.eye(4)]}, "path"),
        ({"path": [np.eye(4), np.eye(4)]}, "path"),
        ({"path": [np.eye(4), np.eye(4)], "times": [1.0, 1.0]}, "times"),
        ({"times": [0.0, 1.0]}, "times for a path that is a function"),
        ({"rate": -1.0}, "rate"),
        ({"jerk": 0.0}, "jerk"),
        ({"blocked": "jump"}, "blocked"),
    ],
)
def test_invalid_paths_are_refused(wrong, named):
    robot = iq.load_robot("ur5")
    right = {"path": lambda u: iq.transform(translation=[0.4 + 0.1 * u, 0.0, 0.4])}
    with pytest.raises(iq.BadInput, match=named):
        follower_on(robot, **{"pose" if k == "path" else k: v for k, v in {**right, **wrong}.items()})


@pytest.mark.parametrize("corners", [False, True])
def test_poses_with_corners_are_joined_by_straight_lines(corners):
    """An L with legs of 200 mm: a smooth curve through its three poses swings out."""
    robot, q = iq.load_robot("ur5"), ready("ur5")
    away = [iq.transform(translation=p) for p in ([0.0, 0.0, 0.0], [0.0, 0.2, 0.0], [-0.2, 0.2, 0.0])]
    follower = follower_on(robot, np.array(away) @ robot.pose(q), q, corners=corners)
    solutions, Q, _ = drive(follower, q)
    p = np.array([robot.pose(x)[:3, 3] for x in Q]) - robot.pose(q)[:3, 3]
    off = np.where(p[:, 1] < 0.2 + p[:, 0], np.hypot(p[:, 0], p[:, 2]), np.hypot(p[:, 1] - 0.2, p[:, 2]))
    assert solutions[-1].status == "done"
    assert np.abs(p[-1] - away[-1][:3, 3]).max() < 1e-4
    assert off.max() < 1e-4 if corners else off.max() > 0.02
