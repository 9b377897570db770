"""The controller with Isaac Lab's calls: whole arms driven to targets, in both orders of quaternions."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import invariantqp as iq
from invariantqp import batches

POSE = SimpleNamespace(command_type="pose", use_relative_mode=False, ik_method="dls", ik_params={"lambda_val": 0.01})


@pytest.fixture
def robot():
    return iq.load_robot("fr3")


def seen(robot, q, order):
    """What a simulator tells: position, quaternion, Jacobian of the tool's point with linear rows first."""
    here = batches.kinematics(robot, q)
    p = here.pose[:, :3, 3]
    J = here.jacobian
    linear = J[:, 3:] + np.cross(J[:, :3], p[:, :, None], axis=1)
    xyzw = Rotation.from_matrix(here.pose[:, :3, :3]).as_quat()
    return p, xyzw if order == "xyzw" else np.roll(xyzw, 1, axis=1), np.concatenate((linear, J[:, :3]), axis=1)


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
@pytest.mark.parametrize("library", ["numpy", "torch"])
def test_targets_are_reached_inside_the_limits(robot, order, library):
    torch = pytest.importorskip(library) if library == "torch" else None
    array = np.asarray if torch is None else torch.tensor
    rng = np.random.default_rng(0)
    low, high = robot.position_lower, robot.position_upper
    goal = low + (high - low) * rng.uniform(0.3, 0.7, size=(20, 7))
    q = goal + 0.2 * rng.normal(size=goal.shape)
    p, quat, _ = seen(robot, goal, order)
    dt, speed = 0.02, robot.velocity_limit
    controller = batches.DifferentialIK(
        POSE, 20, "cpu", quaternion=order, position_limits=(low, high), velocity_limit=speed, dt=dt
    )
    assert controller.action_dim == 7
    controller.set_command(array(np.hstack((p, -quat))))
    controller.reset()
    for _ in range(40):
        here = seen(robot, q, order)
        after = np.asarray(controller.compute(*map(array, here), array(q)))
        assert (np.abs(after - q) <= speed * dt + 1e-15).all()
        assert ((low <= after + 1e-15) & (after <= high + 1e-15)).all()
        q = after
    np.testing.assert_allclose(seen(robot, q, order)[0], p, rtol=0.0, atol=1e-9)
    assert (np.asarray(controller.status) == 0).all()


def test_commands_relative_and_of_positions_alone(robot):
    q = np.tile([0.1, -0.4, 0.2, -2.0, 0.1, 1.8, 0.5], (3, 1))
    p, quat, J = seen(robot, q, "xyzw")
    rng = np.random.default_rng(1)
    way = 0.01 * rng.normal(size=(3, 6))
    turned = Rotation.from_rotvec(way[:, 3:]) * Rotation.from_quat(quat)
    for kind, relative, command, size in (("pose", True, way, 6), ("position", True, way[:, :3], 3)):
        cfg = SimpleNamespace(command_type=kind, use_relative_mode=relative)
        controller = batches.DifferentialIK(cfg, 3, quaternion="xyzw")
        assert controller.action_dim == size
        controller.set_command(command, p, quat)
        moved = q
        for _ in range(5):
            moved = controller.compute(*seen(robot, moved, "xyzw"), moved)
        after, orientation, _ = seen(robot, moved, "xyzw")
        np.testing.assert_allclose(after, p + way[:, :3], rtol=0.0, atol=1e-9)
        if kind == "pose":
            off = (turned * Rotation.from_quat(orientation).inv()).magnitude()
            np.testing.assert_allclose(off, 0.0, atol=1e-9)
    absolute = batches.DifferentialIK(SimpleNamespace(command_type="position"), 3, quaternion="xyzw")
    absolute.set_command(p + 0.01, ee_quat=quat)
    step = absolute.compute(p, quat, J, q) - q
    np.testing.assert_allclose((J[:, :3] @ step[:, :, None])[:, :, 0], np.full((3, 3), 0.01), atol=1e-4)


def test_an_arm_comes_to_rest_where_its_target_is_out_of_reach(robot):
    q = np.tile([0.1, -0.4, 0.2, -2.0, 0.1, 1.8, 0.5], (2, 1))
    p, quat, _ = seen(robot, q, "wxyz")
    controller = batches.DifferentialIK(POSE, 2, quaternion="wxyz", velocity_limit=robot.velocity_limit, dt=0.02)
    controller.set_command(np.hstack((p + np.array([[0.0, 0.0, 3.0], [2.0, 1.0, 0.0]]), quat)))
    steps = []
    for _ in range(110):
        after = controller.compute(*seen(robot, q, "wxyz"), q)
        steps.append(np.abs(after - q).max())
        q = after
    assert max(steps[-20:]) < 0.02 * max(steps)


def test_bad_rows_hold_and_bad_arguments_are_named(robot):
    q = np.tile([0.1, -0.4, 0.2, -2.0, 0.1, 1.8, 0.5], (4, 1))
    p, quat, J = seen(robot, q, "wxyz")
    controller = batches.DifferentialIK(POSE, 4, quaternion="wxyz")
    with pytest.raises(iq.BadInput, match="set_command before compute"):
        controller.compute(p, quat, J, q)
    controller.set_command(np.hstack((p + 0.01, quat)))
    J[1, 0, 0], quat[2] = np.nan, 0.0
    after = controller.compute(p, quat, J, q)
    assert controller.status.tolist() == [0, 2, 2, 0]
    np.testing.assert_array_equal(after[1:3], q[1:3])
    with pytest.raises(iq.BadInput, match=r"command: found shape \(4, 3\)"):
        controller.set_command(p)
    with pytest.raises(iq.BadInput, match="quaternion: found 'zyx'"):
        batches.DifferentialIK(POSE, 4, quaternion="zyx")
    relative = SimpleNamespace(command_type="pose", use_relative_mode=True)
    controller = batches.DifferentialIK(relative, 4, quaternion="wxyz")
    with pytest.raises(iq.BadInput, match="ee_pos: found None"):
        controller.set_command(np.zeros((4, 6)))
    for limits in ({"velocity_limit": -robot.velocity_limit}, {"velocity_limit": [np.nan] * 7}):
        with pytest.raises(iq.BadInput, match=r"velocity_limit: found .*positive limits"):
            batches.DifferentialIK(POSE, 4, quaternion="wxyz", **limits)
    crossed = robot.position_upper, robot.position_lower
    with pytest.raises(iq.BadInput, match=r"position_limits: found .*lower <= upper"):
        batches.DifferentialIK(POSE, 4, quaternion="wxyz", position_limits=crossed)
