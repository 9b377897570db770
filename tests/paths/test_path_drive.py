"""A path whose shape is kept: joints keep jerk limits beside the others, and a clock never goes back by itself."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation
from support.along_paths import drive
from support.streams import Arm

import invariantqp as iq


@pytest.mark.cases(1)
@pytest.mark.parametrize(("name", "rise"), [("so101", 0.1), ("ur5", 0.03), ("panda", 0.1)])
def test_joints_keep_jerk_limits_and_the_tool_its_path(name, rise):
    arm = Arm(name)
    arm.jerk = arm.acceleration / rise
    rng = np.random.default_rng(3)
    way = CubicSpline(np.linspace(0.0, 1.0, 4), arm.start + 0.25 * rng.uniform(-1.0, 1.0, (4, len(arm.start))))
    follower = iq.PathFollower(arm.controller(), lambda u: arm.robot.pose(way(u)), joint_jerk=arm.jerk)
    follower.prepare(way(0.0))
    solutions, Q, _ = drive(follower, way(0.0), 4000)
    assert solutions[-1].status == "done"
    arm.held(Q, 1.005)  # to rounding of the last tick, whose command is no more than a millionth of a radian
    for answer, x in zip(solutions[::20], Q[1::20], strict=False):
        tip, u = arm.robot.pose(x)[:3, 3], answer.place
        found = minimize_scalar(
            lambda s, tip=tip: np.linalg.norm(arm.robot.pose(way(s))[:3, 3] - tip),
            bounds=(u - 1e-3, u + 1e-3),
            options={"xatol": 1e-9},
        )
        assert found.fun < 1e-5
    fastest = iq.PathFollower(arm.controller(), lambda u: arm.robot.pose(way(u)))
    fastest.prepare(way(0.0))
    assert len(solutions) * arm.dt < 1.05 * fastest.plan.motion.end + 3.0 * rise


def test_a_path_that_an_arm_leaves_and_rejoins_ends():
    dt = 0.005
    robot = iq.load_robot("kinova")  # by a tick's law it went to and fro near the end for ever
    rng = np.random.default_rng(7500461)
    rng.integers(11)
    low = np.where(np.isfinite(robot.position_lower), robot.position_lower, -3.0)
    high = np.where(np.isfinite(robot.position_upper), robot.position_upper, 3.0)
    q = low + (high - low) * (0.15 + 0.7 * rng.random(len(low)))
    start = robot.pose(q)
    rng.choice([0.001, 0.002, 0.005, 0.01])
    acceleration = float(rng.choice([5, 10, 20]))
    rng.random()
    size, n = rng.choice([0.02, 0.05, 0.15]), int(rng.integers(2, 6))
    places, turns = [np.zeros(3)], [np.zeros(3)]
    for _ in range(n):
        places.append(places[-1] + size * rng.standard_normal(3))
        turns.append(turns[-1] + 0.5 * rng.standard_normal(3))
    u = np.linspace(0.0, 1.0, n + 1)
    place, turn = CubicSpline(u, places), CubicSpline(u, turns)

    def path(t):
        return iq.transform(Rotation.from_rotvec(turn(t)).as_matrix() @ start[:3, :3], start[:3, 3] + place(t))

    loop = iq.Controller(robot, dt=dt, acceleration_limit=acceleration, exact="position")
    follower = iq.PathFollower(loop, path, blocked="leave")
    follower.prepare(q)
    solutions = drive(follower, q, round(20.0 / dt))[0]
    assert solutions[-1].status in ("done", "blocked")
    assert min(np.diff([s.place for s in solutions], prepend=0.0)) >= 0.0


def quickest(way, V, A, J):
    """The least time from rest to rest along a line, inside limits of speed, acceleration and jerk: an S-curve."""
    A, V = min(A, np.sqrt(J * V)), min(V, np.cbrt(0.25 * J * way * way))  # neither is reached
    A = min(A, np.sqrt(J * V))
    if way >= V * (V / A + A / J):
        return way / V + V / A + A / J
    b = A * A / J  # full acceleration, no full speed: way = v (v / A + A / J)
    v = 0.5 * (-b + np.sqrt(b * b + 4.0 * A * way))
    return 2.0 * (v / A + A / J)


@pytest.mark.cases(1)
@pytest.mark.parametrize(("rise", "seed"), [(0.02, 0), (0.05, 1), (0.2, 2)])
def test_a_straight_joint_path_takes_little_more_than_the_least_time(rise, seed):
    """From rest to rest, beside the S-curve of the joint that goes farthest: all joints go in proportion."""
    robot, rng = iq.load_robot("ur5"), np.random.default_rng(seed)
    q0 = np.array([0.3, -1.4, 1.8, -1.9, -1.5, 0.3]) + 0.2 * rng.normal(size=6)
    d = rng.uniform(-0.8, 0.8, 6) * (0.3 if seed == 0 else 1.0)
    loop = iq.Controller(robot, dt=0.002, acceleration_limit=8.0)
    follower = iq.PathFollower(loop, lambda u: robot.pose(q0 + u * d), joint_jerk=8.0 / rise)
    follower.prepare(q0)
    share = np.abs(d).max()
    speed = (robot.velocity_limit / np.abs(d)).min() * share
    assert follower.plan.motion.end < 1.03 * quickest(share, speed, 8.0, 8.0 / rise)


def test_the_approach_to_a_path_keeps_jerk_limits():
    """From rest, and from a path that is driven: every limit, and then the path is driven to its end."""
    delay = 0.008
    arm = Arm("ur5", delay=delay)
    truth = arm.motion(np.random.default_rng(4))
    follower = iq.Follower(arm.controller(), keep="shape", jerk=arm.jerk)
    paths = [[arm.robot.pose(truth(t)) for t in np.linspace(a, b, 20)] for a, b in ((1.0, 2.0), (2.5, 4.0))]
    follower.follow(paths[0])
    q, Q, states, sent = arm.start, [arm.start], [], []
    for i in range(1500):
        if i == 450:
            follower.follow(paths[1])
        answer = follower.step(q if not sent else Q[max(len(Q) - 1 - round(delay / arm.dt), 0)])
        sent.append(answer.velocity)
        q = Q[-1] + arm.dt * answer.velocity
        Q.append(q)
        states.append(answer.status)
        if i > 450 and answer.status == "done":
            break
    arm.held(Q)
    assert states[-1] == "done"
    assert "waiting" in states
    assert np.linalg.norm((arm.robot.pose(q) - paths[1][-1])[:3, 3]) < 1e-4
