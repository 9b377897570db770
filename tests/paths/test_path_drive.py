"""A path whose shape is kept: joints keep jerk limits beside the others, and a clock never goes back by itself."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from support.along_paths import drive
from support.arms import ready
from support.streams import Arm, driven

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
    q0 = ready("ur5") + 0.2 * rng.normal(size=6)
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
    Q, answers = driven(
        arm, follower, [(450 * arm.dt, lambda f: f.follow(paths[1]))], 6.0, clock=None, late=round(delay / arm.dt)
    )
    arm.held(Q)
    assert answers[-1].status == "done"
    assert "waiting" in {answer.status for answer in answers}
    assert np.linalg.norm((arm.robot.pose(Q[-1]) - paths[1][-1])[:3, 3]) < 1e-4
