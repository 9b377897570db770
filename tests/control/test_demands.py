"""Exact demands of a controller: each holds to rounding while the form judges the rest, in any tool frame."""

import numpy as np
import pytest
from support.loops import OwnDemand

import invariantqp as iq
from invariantqp.control.demands import View, demands_of
from invariantqp.robots.kinematics import middle

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
    view = View(so101, so101.state(Q, target), target, 2.0, np.zeros(6))
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
        ("orientation", 'expected "position", "twist"'),
        (["position", "axis"], "found 'axis'; expected \"position\""),
        ([3.0], "found 3.0"),
        (iq.control.ExactJoints(np.ones(4)), "rows on 4 joints"),
    ],
)
def test_bad_demands_are_refused(so101, exact, said):
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


# The whole twist

ARMS = {
    "ur5e": [0.3, -1.2, 1.5, -1.0, -1.57, 0.3],
    "lite6": [0.0, 0.3, 1.2, 0.0, 0.9, 0.0],
    "panda": [0.1, -0.4, 0.2, -2.2, 0.1, 1.8, 0.8],
}


def six_hinges(rng, m):
    """A random arm with m hinges and finite limits, and a state of it."""
    axes, points = rng.normal(size=(m, 3)), rng.uniform(-0.7, 0.7, size=(m, 3))
    screws = np.column_stack([iq.revolute(a / np.linalg.norm(a), p) for a, p in zip(axes, points, strict=True)])
    robot = iq.robots.Chain(screws, iq.exp(rng.normal(size=6)), (), -2.9, 2.9, rng.uniform(0.5, 3.0, size=m))
    return robot, rng.uniform(-2.0, 2.0, size=m)


def mirrored(robot):
    """The same arm seen in a mirror, the plane y = 0: hinges turn the other way about mirrored axes."""
    M = np.diag([1.0, -1.0, 1.0])
    screws = np.vstack((-M @ robot.screws[:3], M @ robot.screws[3:]))
    home = robot.home.copy()
    home[:3, :3], home[:3, 3] = M @ home[:3, :3] @ M, M @ home[:3, 3]
    limits = robot.position_lower, robot.position_upper, robot.velocity_limit
    return iq.robots.Chain(screws, home, robot.names, *limits)


def limit_that_binds(kind, robot, q, needed, rng):
    """A robot and options of a controller, such that joint velocities `needed` exceed a limit of this kind."""
    most = np.abs(needed).max()
    if kind == "velocity":
        return robot.with_limits(velocity_limit=np.minimum(robot.velocity_limit, 0.2 * most)), {}
    if kind == "position":
        return robot.with_limits(q - 0.2 * DT * most, q + 0.2 * DT * most), {"posture": False}
    if kind == "acceleration":
        return robot, {"acceleration_limit": 0.2 * most / DT}
    if kind == "tool speed":
        twist, p = robot.jacobian(q) @ needed, robot.pose(q)[:3, 3]
        return robot, {"tool_speed": 0.4 * np.linalg.norm(moves(twist, p))}
    rows = rng.normal(size=(3, len(q)))
    rows *= np.sign(rows @ needed)[:, None]
    return robot, {"limits": [iq.limits.LimitRows(rows, np.full(3, -np.inf), 0.2 * rows @ needed)]}


@pytest.mark.parametrize("kind", ["velocity", "position", "acceleration", "tool speed", "rows"])
@pytest.mark.parametrize("name", [*ARMS, "six random hinges", "eight random hinges"])
def test_limits_scale_a_whole_twist(name, kind):
    """The tool moves along the twist in its own direction, no limit is exceeded, and the mirrored arm does the same."""
    rng, scaled = np.random.default_rng(sum(map(ord, name + kind))), 0
    for _ in range(6):
        if name in ARMS:
            robot, q = iq.load_robot(name), np.array(ARMS[name]) + rng.normal(size=len(ARMS[name])) * 0.2
        else:
            robot, q = six_hinges(rng, 6 if name.startswith("six") else 8)
        twist = rng.normal(size=6) * [0.3, 0.3, 0.3, 0.1, 0.1, 0.1]
        sign = np.repeat([-1.0, 1.0], 3) * [1.0, -1.0, 1.0, 1.0, -1.0, 1.0]
        needed = np.linalg.lstsq(robot.jacobian(q), twist, rcond=None)[0]
        robot, options = limit_that_binds(kind, robot, q, needed, rng)
        loop = iq.Controller(robot, dt=DT, exact="twist", **options)
        solution = loop.follow(q, twist, at="base")
        x, done = solution.velocity, robot.jacobian(q) @ solution.velocity
        size = np.linalg.norm(done)
        assert size > 1e-4 * np.linalg.norm(twist)
        np.testing.assert_allclose(done / size, twist / np.linalg.norm(twist), atol=1e-9)
        assert solution.status in (("scaled",) if solution.scale < 0.9 else ("ok", "scaled"))
        scaled += solution.scale < 0.9
        assert (np.abs(x) <= robot.velocity_limit * (1.0 + 1e-12)).all()
        after = q + DT * x
        assert ((after >= robot.position_lower - 1e-12) & (after <= robot.position_upper + 1e-12)).all()
        if "acceleration_limit" in options:
            assert (np.abs(x) <= DT * options["acceleration_limit"] * (1.0 + 1e-12)).all()
        if "tool_speed" in options:
            assert np.linalg.norm(moves(done, robot.pose(q)[:3, 3])) <= options["tool_speed"] * (1.0 + 1e-9)
        for limit in options.get("limits", ()):
            assert (limit.C @ x <= limit.upper + 1e-12).all()
        other = iq.Controller(mirrored(robot), dt=DT, exact="twist", **options)
        np.testing.assert_allclose(other.follow(q, sign * twist, at="base").velocity, x, atol=1e-7)
    assert scaled >= (1 if kind == "rows" else 5)  # redundant joints may avoid rows


@pytest.mark.parametrize(("name", "speed"), [("ur5e", 0.15), ("lite6", 0.1)])
def test_a_joystick_keeps_its_line_where_one_joint_is_slow(name, speed):
    q, robot = np.array(ARMS[name]), iq.load_robot(name)
    slow = robot.velocity_limit.copy()
    slow[5] = 0.05
    robot = robot.with_limits(velocity_limit=slow)
    follower = iq.Follower(iq.Controller(robot, dt=0.01, exact="twist", acceleration_limit=10.0), jerk=500.0)
    begin, statuses = robot.pose(q), set()
    for _ in range(300):
        follower.twist([0.0, 0.0, 0.0, 0.0, speed, 0.0])
        solution = follower.step(q)
        q = q + 0.01 * solution.velocity
        statuses.add(solution.status)
    end = robot.pose(q)
    assert np.linalg.norm(iq.log(iq.inverse(begin) @ end)[:3]) < np.radians(0.1)
    assert np.hypot(*(end - begin)[[0, 2], 3]) < 5e-4
    assert (end - begin)[1, 3] > 0.04
    assert statuses <= {"moving", "scaled"}
    assert solution.status == "scaled"


@pytest.mark.parametrize("backend", [None, "daqp"])
@pytest.mark.parametrize("acceleration", [None, 20.0])
def test_a_pose_is_reached_along_one_screw(acceleration, backend):
    robot, q = iq.load_robot("ur5e"), np.array(ARMS["ur5e"])
    slow = robot.velocity_limit.copy()
    slow[4] = 0.2
    options = {"exact": "twist", "gain": 4.0, "acceleration_limit": acceleration, "backend": backend}
    loop = iq.Controller(robot.with_limits(velocity_limit=slow), dt=0.005, **options)
    begin = robot.pose(q)
    way = np.array([0.1, 0.2, -0.6, 0.1, 0.05, -0.1])
    target = iq.exp(way) @ begin
    for _ in range(600 if backend is None else 120):
        q = q + 0.005 * loop.step(q, target).velocity
        done = iq.log(robot.pose(q) @ iq.inverse(begin))
        share = done @ way / (way @ way)
        assert np.linalg.norm(done - share * way) < 2e-3 * np.linalg.norm(way)
    if backend is None:
        np.testing.assert_allclose(robot.pose(q), target, atol=1e-4)


def test_another_solver_scales_a_twist_alike():
    q, twist = np.array(ARMS["panda"]), [0.3, 0.1, -2.0, 2.4, 1.2, 0.6]
    robot = iq.load_robot("panda")
    ours, theirs = (
        iq.Controller(robot, dt=DT, exact="twist", backend=backend).follow(q, twist) for backend in (None, "daqp")
    )
    assert ours.status == theirs.status == "scaled"
    np.testing.assert_allclose(theirs.velocity, ours.velocity, atol=1e-6)


def test_a_displaced_tool_frame_does_not_change_a_whole_twist():
    robot, q = iq.load_robot("ur5e"), np.array(ARMS["ur5e"])
    offset = iq.exp([0.4, -0.8, 0.3, 0.1, 0.2, -0.1])
    target = iq.exp([0.05, 0.1, -0.1, 0.01, 0.02, -0.01]) @ robot.pose(q)
    found = [
        iq.Controller(arm, dt=DT, gain=5.0, exact=exact).step(q, T, AHEAD).velocity
        for arm, T in ((robot, target), (robot.with_tool(offset), target @ offset))
        for exact in ("twist", iq.control.ExactTwist(), OwnDemand(iq.control.ExactTwist()))
    ]
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], atol=1e-10)


def test_an_arm_that_cannot_follow_a_whole_twist_is_refused(so101):
    with pytest.raises(iq.BadInput, match=r'5 joints, which cannot follow a whole twist.*exact="position"'):
        iq.Controller(so101, dt=DT, exact="twist")
    planar = np.column_stack([iq.revolute([0, 0, 1], [0.2 * i, 0.1 * i**2, 0]) for i in range(6)])
    with pytest.raises(iq.BadInput, match="6 joints that move the tool in 3 directions"):
        iq.Controller(iq.robots.Chain(planar, np.eye(4)), dt=DT, exact=["position", iq.control.ExactTwist()])


def test_a_whole_twist_beside_a_singularity_stays_inside_the_limits():
    robot, q = iq.load_robot("ur5e"), np.array([0.3, -1.2, 0.02, -1.0, -1.57, 0.3])  # the elbow nearly straight
    loop = iq.Controller(robot, dt=DT, exact="twist", acceleration_limit=20.0)
    outwards = robot.pose(q)[:3, 3] * [1.0, 1.0, 0.0]
    for _ in range(200):
        solution = loop.follow(q, [0.0, 0.0, 0.0, *(0.3 * outwards / np.linalg.norm(outwards))])
        q = q + DT * solution.velocity
        assert (np.abs(solution.velocity) <= robot.velocity_limit).all()
    assert np.abs(solution.velocity).max() < 0.05


def planar():
    """Two hinges in a plane: an exact position decides all that they do."""
    screws = np.column_stack((iq.revolute([0, 0, 1], [0, 0, 0]), iq.revolute([0, 0, 1], [0.3, 0, 0])))
    return iq.robots.Chain(screws, iq.transform(translation=[0.55, 0, 0]), (), -2.8, 2.8, [2.0, 2.0])


STRETCHING = {
    "lite6": (ARMS["lite6"], "twist", 0.3),
    "panda": ([0.1, -0.4, 0.2, -2.2, 0.1, 1.8, 0.8], "twist", 0.5),
    "ur5e": ([0.0, -1.57, 1.57, -1.57, -1.57, 0.0], "twist", 0.5),
    "ur10": ([0.3, -1.2, 1.5, -1.0, 1.0, 0.3], "twist", 0.6),
    "so101": ([0.1, -0.6, 0.8, 0.5, 0.2], ["position", iq.control.ExactAxis([0.0, 0.0, 1.0])], 0.25),
    "planar": ([0.3, 1.1], "position", 0.3),
    "ur5, a point": ([0.3, -1.2, 1.5, -1.0, 1.0, 0.3], "position", 0.5),
    "ur5e, a point": ([0.0, -1.57, 1.57, -1.57, -1.57, 0.0], "position", 0.5),
    "lite6, a point": (ARMS["lite6"], "position", 0.3),
    "ur5e, nothing": ([0.0, -1.57, 1.57, -1.57, -1.57, 0.0], None, 0.5),
}


def stretching(name):
    """A robot, its first state, exact demands that leave it nothing free, and a way out of its reach."""
    q, exact, out = STRETCHING[name]
    robot = planar() if name == "planar" else iq.load_robot(name.split(",")[0])
    away = robot.pose(q)[:3, 3] * [1.0, 1.0, 0.0]
    return robot, np.array(q), exact, out * away / np.linalg.norm(away)


@pytest.mark.parametrize(("acceleration", "noise"), [(None, 0.0), (None, 3e-4), (10.0, 0.0), (10.0, 1e-5)])
@pytest.mark.parametrize("name", list(STRETCHING))
def test_a_target_out_of_reach_is_followed_home(name, acceleration, noise):
    """The arm stops before it is stretched out, and bends again with the same elbow."""
    rng, statuses = np.random.default_rng(1), set()
    robot, q, exact, away = stretching(name)
    begin, home = q, robot.pose(q)
    dt = 0.002 if "point" in name else 0.004
    loop = iq.Controller(robot, dt=dt, exact=exact, acceleration_limit=acceleration)
    for k in range(round(7.0 / dt)):
        goal = home.copy()
        goal[:3, 3] += max(np.sin(np.pi * min(k * dt / 4.0, 1.0)), 0.0) * away
        solution = loop.step(q + noise * rng.normal(size=len(q)), goal)
        q = q + dt * solution.velocity
        statuses.add(solution.status)
    assert np.linalg.norm((robot.pose(q) - home)[:3, 3]) < 1e-3
    assert "point" in name or np.abs(q - begin).max() < 0.5  # beside a point joints are free
    assert statuses <= {"ok", "scaled", "limited"}
    turning = name == "lite6, a point" and acceleration  # its elbow is back the other way, and the tool still turns
    assert noise or turning or solution.status == "ok"


@pytest.mark.parametrize("acceleration", [None, 10.0])
@pytest.mark.parametrize("name", ["lite6", "panda", "ur5e", "ur10"])
def test_a_joystick_that_stretches_an_arm_brings_it_back(name, acceleration):
    robot, q, exact, away = stretching(name)
    begin, twist = q, 0.3 * away / np.linalg.norm(away)
    elbow = 3 if name == "panda" else 2
    loop = iq.Controller(robot, dt=0.004, exact=exact, acceleration_limit=acceleration)
    for k in range(1500):
        q = q + 0.004 * loop.follow(q, [0.0, 0.0, 0.0, *(twist if k < 700 else -twist)]).velocity
    way = (robot.pose(q) - robot.pose(begin))[:3, 3]
    assert way @ twist < -0.2 * np.linalg.norm(twist)
    assert abs(q[elbow]) > abs(begin[elbow]) if name != "lite6" else q[elbow] < begin[elbow]


@pytest.mark.parametrize("name", ["lite6", "panda"])
def test_another_solver_stops_a_stretching_arm_alike(name):
    robot, q, exact, away = stretching(name)
    home, stopped = robot.pose(q), 0
    ours, theirs = (iq.Controller(robot, dt=0.02, exact=exact, backend=backend) for backend in (None, "daqp"))
    for k in range(200):
        goal = home.copy()
        goal[:3, 3] += np.sin(np.pi * k / 200) * away
        one, other = (loop.step(q, goal) for loop in (ours, theirs))
        np.testing.assert_allclose(other.velocity, one.velocity, atol=1e-6)
        stopped += one.scale == 0.0
        q = q + 0.02 * one.velocity
    assert stopped > 10


@pytest.mark.parametrize("name", ["ur5", "ur5e", "ur10"])
def test_rows_of_a_nearly_singular_arm_contradict_nothing(name):
    """Where joints lose a direction, its speed is small; rounding is no contradiction, however near they are."""
    robot, q = iq.load_robot(name), np.array([0.3, -1.2, 0.0, -1.0, -1.57, 0.3])
    rng, states = np.random.default_rng(1), 0
    for exact in ("twist", ["position", iq.control.ExactAxis([0.0, 0.0, 1.0])]):
        for _ in range(200):
            q[2] = 10.0 ** rng.uniform(-14.0, -2.0) * rng.choice([-1.0, 1.0])
            solution = iq.Controller(robot, dt=0.004, exact=exact).follow(q, 0.2 * rng.normal(size=6))
            states += np.linalg.svd(robot.jacobian(q))[1][-1] < 1e-7
            assert solution.status in {"ok", "scaled", "limited"}
    assert states > 50


@pytest.mark.parametrize("name", ["so101", "ur5e", "panda"])
def test_an_exact_position_away_from_limits_has_no_active_limit(name):
    """Exact rows that only the damping slows are solved in closed form."""
    robot = iq.load_robot(name)
    controller, q = iq.Controller(robot, dt=0.002, exact="position"), middle(robot) + 0.1
    for k in range(50):
        solution = controller.step(q, robot.pose(q + 0.01 * np.sin(0.1 * k)))
        assert (solution.method, solution.active) == ("closed-form", ())
        q = q + 0.002 * solution.velocity
