"""Where limits, singularities and pushes are in its way, a follower keeps its path and goes on."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from support.along_paths import drive, follower_on, straight
from support.arms import ready
from support.streams import run

import invariantqp as iq

AXES = [((0, 0, 1), (0, 0, 0)), ((0, 1, 0), (0.1, 0, 0.3)), ((1, 0, 0), (0.4, 0.2, 0.5)), ((0, 1, 0), (0.6, 0.2, 0.4))]
AXES += [
    ((0, 0, 1), (0.8, 0.1, 0.3)),
    ((1, 0, 0), (0.9, 0.1, 0.3)),
    ((0, 1, 0), (1, 0, 0.4)),
    ((0, 0, 1), (1.1, 0.1, 0.2)),
]
LEAST = 5e-5  # [length] off a path


def arm_of(m):
    """An arm of the first m axes."""
    screws = np.column_stack([iq.revolute(axis, point) for axis, point in AXES[:m]])
    home = iq.transform(translation=np.add(AXES[m - 1][1], (0.2, 0.1, -0.1)))
    return iq.robots.Chain(screws, home, position_lower=-2.5, position_upper=2.5, velocity_limit=2.0)


@pytest.mark.cases(1)
@pytest.mark.parametrize(("dt", "jerk"), [(0.005, 25.0), (0.01, 289.0), (0.02, 4.3)])
def test_an_s_curve_reaches_the_place_where_the_path_is_blocked(dt, jerk):
    arm = iq.load_robot("so101")
    q = np.array([1.03574562, -0.56392953, -0.17575351, 0.77736402, 2.44121])
    turn = np.array([0.0, 0.0, 0.0, 0.0, 0.56337917]) + 0.1 * np.cos(np.arange(5))
    follower = follower_on(arm, lambda u: arm.pose(q + u * turn), q, dt, 0.1, jerk=jerk)
    last = drive(follower, q)[0][-1]
    assert last.status == "blocked"
    assert "upper position limit" in last.reason


def test_a_path_is_planned_inside_a_controller_s_own_limits():
    """As for an arm that has them itself: it is not planned faster, to be slowed down."""
    arm = arm_of(7)
    slow = iq.robots.Chain(arm.screws, arm.home, position_lower=-2.5, position_upper=2.5, velocity_limit=0.3)
    q, turn, ends = np.full(7, 0.3), 0.5 * np.cos(np.arange(7)), []
    for robot, limits in ((slow, []), (arm, [iq.limits.JointLimits(velocity_limit=0.3)])):
        loop = iq.Controller(robot, dt=0.01, acceleration_limit=4.0, limits=limits)
        follower = iq.PathFollower(loop, lambda u: arm.pose(q + u * turn))
        follower.prepare(q)
        solutions, positions, _ = drive(follower, q)
        assert solutions[-1].status == "done"
        assert np.abs(np.diff(positions, axis=0)).max() <= 0.003 * (1.0 + 1e-9)
        ends.append((len(solutions), max(s.across for s in solutions), positions[-1]))
    assert ends[0][0] == ends[1][0]
    assert max(off for _, off, _ in ends) < LEAST
    np.testing.assert_allclose(ends[0][2], ends[1][2], rtol=0.0, atol=1e-6)


def test_a_path_that_ends_beside_a_singularity_is_not_driven_back():
    arm = iq.load_robot("z1")
    q = np.array([0.4502256612, 0.8442602893, -2.2534555304, -0.7595615323, 0.3878826847, 1.4802279124])
    start = arm.pose(q)
    way = 2.0 * start[:3, 3] / np.linalg.norm(start[:3, 3])
    solutions = drive(follower_on(arm, straight(start, *way), q, 0.001), q)[0]
    assert solutions[-1].status == "blocked"
    assert min(s.speed for s in solutions) > -1e-3
    assert max(s.across for s in solutions) < LEAST


def test_fast_joints_near_a_singularity_keep_the_path():
    robot = arm_of(8)
    q = np.array(
        [0.6872902729, 0.0219996264, -0.8000008865, 0.2084246761, -1.1588833118, -1.4956822359, -0.788459, -0.283915]
    )
    way = 0.9464241439 * np.array([-0.3694043367, 0.7929028275, -0.4846086484])
    solutions = drive(follower_on(robot, straight(robot.pose(q), *way), q, 0.005), q)[0]
    assert solutions[-1].status == "blocked"
    assert max(s.across for s in solutions) < LEAST


def test_a_tool_speed_limit_does_not_stop_an_exact_point():
    robot = iq.load_robot("ur10")
    joints = CubicSpline(
        np.linspace(0.0, 1.0, 4),
        [
            [-2.1802163872, 0.8873669849, 0.1968445837, -2.1231192157, -1.7292137983, 0.9887264747],
            [-1.7095608274, 1.3092767837, -0.0617544828, -2.2042540885, -1.4789907482, 1.0556325692],
            [-1.5826322936, 1.0830714063, -0.3845591728, -2.2205058769, -2.0159688921, 1.7217380449],
            [-2.1543656243, 0.6497471547, -1.0053256698, -1.9562712465, -1.5492196944, 1.0460567772],
        ],
    )
    options = {"exact": "position", "tool_speed": 0.2506303284}
    follower = follower_on(robot, lambda u: robot.pose(joints(u)), joints(0.0), 0.005, 0.5, options=options)
    solutions = drive(follower, joints(0.0), 2400)[0]
    assert solutions[-1].status == "done"
    assert max(s.across for s in solutions) < LEAST


def test_exact_rows_at_a_limit_are_left_in_time():
    robot = arm_of(3)
    q = np.array([-0.2773559891, 2.1, -0.7918015234])
    over = np.array([0.0, 0.4914173738, 0.0])

    def pose(u):  # a joint goes beyond its limit and comes back
        return robot.pose(q + np.sin(np.pi * u) * over + 0.1 * u * np.cos(np.arange(3)))

    follower = follower_on(robot, pose, q, 0.002, 0.1, options={"exact": "position"}, blocked="leave")
    solutions = drive(follower, q)[0]
    assert "left" in {s.status for s in solutions}
    assert solutions[-1].status == "done"


def test_an_exact_point_that_was_pushed_comes_to_rest_on_its_path():
    robot = iq.load_robot("ur5")
    q = ready("ur5")
    # At a tick of half a millisecond the gain is 200/s: it asks for more than joints can brake.
    way, pushed = straight(robot.pose(q), 0.0, 0.3, 0.0), np.array([0.01, -0.01, 0.01, 0.02, -0.01, 0.02])
    follower = follower_on(robot, way, q, 0.0005, 1.0, options={"exact": "position"})
    solutions = drive(follower, q, 2100, push={200: pushed})[0]
    across = np.array([s.across for s in solutions[200:]])
    assert across[0] > 5e-3
    assert {s.status for s in solutions} <= {"moving", "slowed", "done"}
    assert across[1500:].max() < LEAST


@pytest.mark.cases(1)
@pytest.mark.parametrize(
    ("name", "q", "turn"), [("so101", [0.0, -0.4, 0.5, 0.6, 0.0], 1.0), ("ur5", [0.0, -1.4, 1.6, -1.8, -1.57, 0], 2.8)]
)
def test_the_error_of_an_exact_point_does_not_depend_on_orientation(name, q, turn):
    robot, q = iq.load_robot(name), np.array(q)
    home, turned = robot.pose(q), iq.exp([0.0, 0.0, turn, 0.0, 0.0, 0.0])[:3, :3]

    def pose(u):  # along y, the tool turned about z from where it is
        return iq.transform(turned @ home[:3, :3], home[:3, 3] + [0.0, 0.12 * u, 0.0])

    follower = follower_on(robot, pose, q, 0.005, options={"exact": "position"})
    J = iq.adjoint(iq.transform(translation=-home[:3, 3])) @ robot.jacobian(q)
    solutions, positions, _ = drive(follower, q, push={30: np.linalg.pinv(J[3:]) @ [3e-3, 0.0, 0.0]})
    pushed = solutions[31:60]
    off = [np.hypot(*(robot.pose(p)[:3, 3] - home[:3, 3])[[0, 2]]) for p in positions[31:60]]
    np.testing.assert_allclose([s.across for s in pushed], off, rtol=1e-6)
    assert off[0] > 2e-3
    assert {s.status for s in solutions} <= {"moving", "slowed", "done"}
    assert solutions[-1].status == "done"


def test_an_exact_height_is_kept_far_from_the_rest_of_the_target():
    arm, plane = iq.load_robot("so101"), iq.control.ExactPlane([0.0, 0.3, 1.0], [0.0, 0.0, 0.1])
    q = np.array([-0.33641766, 0.70922652, -0.50926223, -0.7215866, 1.50639779])
    home = arm.pose(q)
    way, side = home[:3, 3] / np.linalg.norm(home[:3, 3]), np.array([-0.09791569, -0.66596279, -0.73953098])

    def pose(u):  # out of reach, but for the height over the plane
        return iq.transform(home[:3, :3], home[:3, 3] + 0.64 * np.sin(0.5 * np.pi * u) * way + 0.09 * u * side)

    solutions = drive(follower_on(arm, pose, q, 0.01, options={"exact": plane}), q, 1000)[0]
    assert {s.status for s in solutions} <= {"moving", "slowed", "done"}
    assert solutions[-1].status == "done"
    assert max(s.across for s in solutions) < LEAST


@pytest.mark.parametrize(("override", "turns"), [(1.0, bool), (1.3, lambda tick: tick % 100 >= 50)])
def test_no_limit_makes_the_tool_faster_than_requested(override, turns):
    """Joints that cannot brake as soon as the timing asks for brake before that; the path would have to go faster."""
    robot = iq.load_robot("ur5")
    q = ready("ur5")
    start = robot.pose(q)

    def pose(u):  # a circle of 0.2 m that begins and ends at rest, the tool rocking
        a = 2.0 * np.pi * u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        rock = iq.exp([0.4 * np.sin(a), 0.0, 0.0, 0.0, 0.0, 0.0])[:3, :3]
        return iq.transform(rock @ start[:3, :3], start[:3, 3] + [0.0, 0.2 * (1.0 - np.cos(a)), 0.2 * np.sin(a)])

    loop = iq.Controller(robot, dt=0.002, acceleration_limit=10.0)
    follower = iq.PathFollower(loop, pose, rate=1.0 / 1.2)
    follower.prepare(q)
    parts = [override if turns(tick) else 1.0 for tick in range(2000)]
    solutions = drive(follower, q, 2000, override=parts.__getitem__)[0]
    assert solutions[-1].status == "done"
    # Every 50 ticks, when what was faster before has come down.
    assert max(1.2 * s.speed / parts[k] for k, s in enumerate(solutions) if k % 50 > 45) < 1.001
    assert max(s.across for s in solutions) < LEAST


def test_a_tool_back_at_the_start_rests():
    robot = iq.load_robot("ur5")
    q = ready("ur5")
    follower = follower_on(robot, straight(robot.pose(q), 0.0, 0.2, 0.0), q, 0.005)
    solutions, positions, _ = drive(follower, q, 300, during=lambda tick, f: tick == 60 and f.reverse())
    assert (solutions[-1].status, solutions[-1].ruling) == ("paused", "the start")
    follower.reverse()
    assert drive(follower, positions[-1])[0][-1].status == "done"


def test_a_push_at_the_very_start_leaves_numbers():
    robot = iq.load_robot("so101")
    q = ready("so101")
    follower = follower_on(robot, straight(robot.pose(q), 0.0, 0.1, 0.0), q, 0.002)
    solutions = drive(follower, q, push={0: np.array([0.3, 0.0, 0.0, 0.0, 0.0])})[0]
    assert solutions[0].status == "waiting"
    assert solutions[-1].status in ("done", "blocked")


@pytest.mark.cases(1)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_path_shorter_than_the_tool_error_ends(seed):
    robot = arm_of(3)
    q = np.array([-1.3277, -1.3868, 0.24])
    home = robot.pose(q)
    rng = np.random.default_rng(seed)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    side = np.cross(way, rng.normal(size=3))
    side /= np.linalg.norm(side)

    def pose(u):  # ten micrometres, bent by more than a right angle
        return iq.transform(home[:3, :3], home[:3, 3] + 1e-5 * (np.sin(3.0 * u) * way + u * side))

    follower = iq.PathFollower(iq.Controller(robot, dt=0.002), pose, blocked="leave")
    follower.prepare(q)
    last = drive(follower, q + 1e-3 * np.array([1.0, -1.0, 1.0]), 500)[0][-1]
    assert last.status in ("done", "blocked")  # three joints cannot be at every pose


def test_the_search_advances_with_time_not_with_ticks():
    robot = iq.load_robot("ur5")
    q = ready("ur5")
    follower = follower_on(robot, straight(robot.pose(q), 0.0, 0.2, 0.0), dt=0.01)
    waits = [s for s in drive(follower, q)[0] if s.status == "waiting"]
    assert 1 < len(waits) * 0.01 * 1500.0 < 1000


@pytest.mark.cases(1)
@pytest.mark.filterwarnings("ignore:gain=1 is 1 1/s here")
@pytest.mark.parametrize("gain", [1.0, None])
def test_a_start_out_of_reach_is_reported_as_blocked(gain):
    robot, q = iq.load_robot("panda"), ready("panda")
    home, ends = robot.pose(q), []
    for start in (np.array([-0.1, 0.05, -0.1]), 1.5 * home[:3, 3]):
        way = straight(iq.transform(translation=start) @ home, 0.0, 0.1, 0.0)
        ends.append(drive(follower_on(robot, way, rise=None, options={"gain": gain}), q, 3750)[0][-1])
    assert [s.status for s in ends] == ["done", "blocked"]
    assert ends[1].reason.startswith("the arm comes no closer than ")
    assert ends[1].across > 0.5


@pytest.mark.parametrize("joint_jerk", [None, 400.0])
def test_a_tool_speed_holds_on_the_way_to_the_path(joint_jerk):
    arm, q = iq.load_robot("ur5"), ready("ur5")
    poses = [arm.pose(q) @ iq.transform(translation=[0.0, 0.01 * k, 0.0]) for k in range(6)]
    loop = iq.Controller(arm, dt=0.008, acceleration_limit=8.0, tool_speed=0.1)
    follower = iq.PathFollower(loop, np.array(poses), joint_jerk=joint_jerk)
    solutions, positions, x = drive(follower, q + np.array([0.2, 0.1, 0.0, 0.0, 0.2, 0.0]), 750)
    twists = [(arm.jacobian(p) @ v, arm.pose(p)[:3, 3]) for p, v in zip(positions, x, strict=False)]
    assert solutions[-1].status == "done"
    assert 0.099 < max(np.linalg.norm(s[3:] + np.cross(s[:3], p)) for s, p in twists) <= 0.1 * (1.0 + 1e-9)


@pytest.mark.parametrize("declared", [True, False])
def test_an_obstacle_at_a_path_is_avoided_and_the_path_goes_on(declared):
    arm, q, dt, speed, a = iq.load_robot("ur5"), ready("ur5"), 0.01, 0.1, 8.0
    start, ball = arm.pose(q), iq.limits.Sphere([0.0, 0.0, 0.0], 0.08, name="ball")
    clear = iq.limits.Clearance(arm, {"tool": [iq.limits.Sphere([0.0, 0.0, -0.02], 0.05)]}, [ball])
    loop = iq.Controller(arm, dt=dt, acceleration_limit=a, limits=[clear])
    end = iq.transform(translation=[0.15, 0.0, 0.05]) @ start
    follower, distances = iq.PathFollower(loop, np.array([start, end]), rate=0.1), []
    follower.prepare(q)

    def before(tick, q):
        distances.append(clear.at(q).distance)
        t = dt * tick
        place, along = (0.2 - speed * min(t, 1.0), -speed) if t < 2.0 else (0.1 + speed * min(t - 2.0, 1.0), speed)
        twist = [0.0, 0.0, 0.0, 0.0, along if t < 1.0 or 2.0 < t < 3.0 else 0.0, 0.0]
        ball.move(iq.transform(translation=start[:3, 3] + [0.02, place, 0.01]), twist if declared else None)

    made = run(follower, q, 1400, dt=dt, before=before, clock=None, until=("done",))
    assert (np.abs(np.diff(made.V, axis=0, prepend=0.0)) <= a * dt + 1e-9).all()
    assert min(distances[1:]) > 0.02 - speed * dt * (1.0 if declared else 11.0) - speed**2 / (2.0 * 0.3 * a * 0.4)
    assert {"waiting", "done"} <= set(made.statuses)
    np.testing.assert_allclose(arm.pose(made.Q[-1]), end, atol=1e-9)


class Breaks(iq.limits.Limit):
    """A limit of one row whose functions raise an error after so many calls."""

    name = "mine"

    def __init__(self, method, error, calls):
        self.method, self.error, self.left = method, error, calls

    def called(self, method):
        self.left -= method == self.method
        if self.left == 0 and method == self.method:
            raise self.error

    def rows(self, q, velocity):
        self.called("rows")
        return iq.limits.LimitRows(np.eye(7)[:1], [-0.05], [0.05])

    def after(self, q, velocity):
        self.called("after")


@pytest.mark.parametrize("method", ["rows", "after"])
@pytest.mark.parametrize("calls", [30, 31])  # of the loop for twists, and of that for joint velocities
@pytest.mark.parametrize("error", [RuntimeError("mine"), KeyboardInterrupt()])
def test_an_exception_of_a_limit_reaches_the_caller_and_the_follower_goes_on(panda, method, calls, error):
    limit = Breaks(method, error, calls)
    follower = iq.Follower(iq.Controller(panda, dt=0.004, acceleration_limit=10.0, limits=[limit]))
    q, raised, first = ready("panda"), [], []
    for i in range(60):
        if i % 10 == 0:
            follower.twist([0.0, 0.0, 0.0, 0.0, 0.2, 0.0])
        try:
            x = follower.step(q).velocity
        except (RuntimeError, KeyboardInterrupt) as found:
            raised.append(found)
            continue
        q = q + 0.004 * x
        first.append(x[0])
    assert raised == [error]
    assert np.abs(first).max() <= 0.05 + 1e-9
