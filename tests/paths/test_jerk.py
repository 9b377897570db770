"""The least time of a path with jerk limits: a limit is met at nearly every moment, and knots do not matter."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import invariantqp as iq
from invariantqp.paths.joint_path import JointPath, Knot
from invariantqp.paths.plan import plan_of

ACCELERATION, JERK = 10.0, 100.0


@pytest.mark.cases(2)
@pytest.mark.parametrize(("name", "seed"), [("panda", 1), ("ur5", 2), ("so101", 3), ("xarm7", 4), ("kinova", 5)])
def test_some_limit_is_near_at_every_moment_and_knots_do_not_matter(name, seed):
    robot, rng = iq.load_robot(name), np.random.default_rng(seed)
    low, high = (np.clip(x, -3.0, 3.0) for x in (robot.position_lower, robot.position_upper))
    q = low + (high - low) * (0.3 + 0.4 * rng.random((4, len(low))))
    way = CubicSpline(np.linspace(0.0, 1.0, 4), q[0] + np.clip(q - q[0], -0.6, 0.6))
    loop = iq.Controller(robot, dt=0.004, acceleration_limit=ACCELERATION)
    follower = iq.PathFollower(loop, lambda u: robot.pose(way(u)), joint_jerk=JERK)
    search = JointPath(follower.controller, follower._path.drive.given.curve, way(0.0))
    while not search.done:
        search.extend()

    def motion(share):
        knots = [k for k in search.knots if k.at in (0.0, search.curve.end) or rng.random() < share]
        return plan_of(
            follower.controller, search.curve, knots, "", along=3 * (np.inf,), jerk=np.full(len(low), JERK)
        ).motion

    whole = motion(1.0)
    times = np.linspace(0.0, whole.end, 5000)[1:-1]
    limits = robot.velocity_limit, ACCELERATION, JERK
    r = np.abs(whole.at(times)[:, 1:, :-1])
    needs = np.array([(r[:, i] / limits[i]).max(axis=1) for i in range(3)])
    assert needs.max() <= 1.0 + 1e-9
    assert (needs.max(axis=0) > 0.9).mean() > 0.98
    for _ in range(3):
        assert motion(0.97).end == pytest.approx(whole.end, rel=0.01)


@pytest.mark.parametrize("seed", range(9))
def test_the_place_never_goes_back_and_rests_at_both_ends(seed):
    robot, rng = iq.load_robot("ur5"), np.random.default_rng([seed, 33])
    loop = iq.Controller(robot, dt=0.004, acceleration_limit=ACCELERATION)
    corners, blend = rng.uniform(-0.5, 0.5, (int(rng.integers(2, 6)), 6)), 10.0 ** rng.uniform(-4.0, -2.0)
    # Joints go straight, and along parabolas so far before and after the corners
    u = np.arange(len(corners))[:, None] + blend * np.linspace(-1.0, 1.0, 21)
    at = np.unique(np.clip(np.append(u, np.linspace(0.0, u[-1, 10], 40)), 0.0, u[-1, 10]))
    slopes = np.array([np.interp(at, np.append(-1.0, u[:, [0, -1]]), x) for x in _slopes(corners)]).T
    q = corners[0] + np.vstack(
        (np.zeros(6), np.cumsum(0.5 * (slopes[1:] + slopes[:-1]) * np.diff(at)[:, None], axis=0))
    )
    knots = [Knot(*x, 0.0, 1.0) for x in zip(at, q, slopes, strict=True)]
    if seed % 3 == 0:
        knots = knots[: int(rng.integers(1, 6))]
    jerk = JERK * 10.0 ** rng.uniform(-2.0, 2.0, 6)
    motion = plan_of(loop, SimpleNamespace(end=at[-1]), knots, "", along=3 * (np.inf,), jerk=jerk).motion

    times = (motion.knots[:-1, None] + np.diff(motion.knots)[:, None] * np.linspace(0.0, 1.0, 30)).ravel()[:-1]
    r = motion.at(times)
    assert np.diff(r[:, 0, -1]).min() >= -1e-13 * at[-1]
    for k, limit in ((1, robot.velocity_limit), (2, ACCELERATION), (3, jerk)):
        assert np.abs(r[:, k, :-1] / limit).max() <= 1.0 + 1e-9
    ends = motion.at((0.0, (1.0 - 1e-9) * motion.end))[:, 1:3]
    assert np.abs(ends / np.abs(r[:, 1:3]).max(axis=0)).max() < 1e-4


def _slopes(corners):
    """(m, 2 k + 1) what joints go a unit of the path, before, between and after corners (k, m)."""
    between = np.diff(corners, axis=0).repeat(2, axis=0)
    return np.vstack((between[:2], between, between[-1:])).T
