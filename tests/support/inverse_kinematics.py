"""Common to the tests of inverse kinematics: arms, random joint positions, and errors by Pinocchio alone."""

import numpy as np
import pinocchio as pin
import pytest

import invariantqp as iq
from invariantqp.robots.kinematics import joint_ranges

NO_LIMIT = {"time_limit": np.inf}  # the same in every run, however busy the machine
ARMS = {name: iq.load_robot(name) for name in ("panda", "ur5", "xarm7", "kinova", "so101", "iiwa14")}


def random_joints(robot, count, seed):
    """(count, m) uniform in the joint range."""
    low, high = joint_ranges(robot)
    return low + np.random.default_rng(seed).random((count, len(low))) * (high - low)


def fk(robot, q):
    """The tool pose by Pinocchio."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    return data.oMf[robot.model.getFrameId(robot.tool)]


def pose_errors(robot, q, target):
    """Distance and angle of the tool from a pose (4, 4)."""
    T, desired = fk(robot, q), pin.SE3(target)
    return (
        np.linalg.norm(desired.translation - T.translation),
        np.linalg.norm(pin.log3(T.rotation.T @ desired.rotation)),
    )


def is_inside(robot, q):
    return bool((robot.position_lower <= q).all() and (q <= robot.position_upper).all())


def assert_refused(call, argument):
    """A call raises BadInput that names the argument."""
    with pytest.raises(iq.BadInput, match=r": found .*; expected ") as caught:
        call()
    assert caught.value.argument == argument
