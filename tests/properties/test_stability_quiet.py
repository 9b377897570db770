"""At a target three metres away the arm comes to rest as near as least squares would leave it, whatever the gain."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.least_squares import LeastSquares
from support.loops import drive

import invariantqp as iq

DT = 0.01
QUIET = 1e-4  # rad/s
# Simulated time after which the last of the creep to the optimum is below that [s]: seven joints have a slow direction.
ARMS = {
    "panda": ([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8], 40.0),
    "ur5": ([0.0, -1.2, 1.6, -0.6, -1.2, 0.3], 40.0),  # limits slow a chase of 15 m/s down, near the end too
    "so101": ([0.0, -0.4, 0.5, 0.6, 0.0], 15.0),
}


@pytest.mark.parametrize("name", ARMS)
def test_quiet_at_the_definite_laws_error(name):
    gain = 1.0 / DT
    start, seconds = ARMS[name]
    robot = iq.load_robot(name)
    pose = robot.pose(start)
    pose[0, 3] += 3.0
    target = robot.target(pose)
    loop = iq.Controller(robot, dt=DT, gain=gain)
    L, errors = loop.measure.length, []
    law = SimpleNamespace(dt=DT, gain=gain, posture=False, posture_gain=0.5, point=np.zeros(3), length=L, exact=None)
    for one in (loop, LeastSquares(robot, law)):
        q, x, _ = drive(one, start, target, round(seconds / DT))
        q, x = q[-1], x[-1]
        assert np.abs(x).max() < QUIET
        error = robot.state(q, target).error
        off = np.linalg.norm(robot.pose(q)[:3, 3] - pose[:3, 3]), L * np.linalg.norm(error[:3])
        errors.append(np.hypot(*off))  # what both make least; what gains less than a thousandth of it stays
    np.testing.assert_allclose(errors[0], errors[1], rtol=0.01)
