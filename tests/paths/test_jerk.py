"""The least time of a path with jerk limits: a limit is met at nearly every moment, and knots do not matter."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import invariantqp as iq
from invariantqp.paths.ahead import JointPath
from invariantqp.paths.plan import plan_of

ACCELERATION, JERK = 10.0, 100.0


@pytest.mark.parametrize(("name", "seed"), [("panda", 1), ("ur5", 2), ("so101", 3), ("xarm7", 4), ("kinova", 5)])
def test_some_limit_is_near_at_every_moment_and_knots_do_not_matter(name, seed):
    robot, rng = iq.load_robot(name), np.random.default_rng(seed)
    low, high = (np.clip(x, -3.0, 3.0) for x in (robot.position_lower, robot.position_upper))
    q = low + (high - low) * (0.3 + 0.4 * rng.random((4, len(low))))
    way = CubicSpline(np.linspace(0.0, 1.0, 4), q[0] + np.clip(q - q[0], -0.6, 0.6))
    loop = iq.Controller(robot, dt=0.004, acceleration_limit=ACCELERATION)
    follower = iq.PathFollower(loop, lambda u: robot.pose(way(u)), joint_jerk=JERK)
    search = JointPath(loop, follower._shape.given.curve, way(0.0))
    while not search.done:
        search.extend()

    def motion(share):
        knots = [k for k in search.knots if k.at in (0.0, search.curve.end) or rng.random() < share]
        return plan_of(loop, search.curve, knots, "", along=3 * (np.inf,), jerk=np.full(len(low), JERK)).motion

    whole = motion(1.0)
    times = np.linspace(0.0, whole.end, 5000)[1:-1]
    limits = robot.velocity_limit, ACCELERATION, JERK
    r = np.abs(whole.at(times)[:, 1:, :-1])
    needs = np.array([(r[:, i] / limits[i]).max(axis=1) for i in range(3)])
    assert needs.max() <= 1.0 + 1e-9
    assert (needs.max(axis=0) > 0.9).mean() > 0.98
    for _ in range(3):
        assert motion(0.97).end == pytest.approx(whole.end, rel=0.01)
