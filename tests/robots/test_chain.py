"""The product of exponentials, beside that of se3.exp; Pinocchio sees the same."""

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.robots.pinocchio import pin


def random_chain(rng, m):
    """Hinges, screws and slides of every rate; one hinge is so far away that it is nearly a slide."""
    screws = rng.normal(size=(6, m)) * 10.0 ** rng.uniform(-2, 2, size=m)
    screws[:3, rng.random(m) < 0.3] = 0.0
    screws[:3, 0] *= 1e-8
    return iq.robots.Chain(screws, iq.exp(rng.normal(size=6)))


@pytest.mark.parametrize("m", [1, 2, 6, 7, 20])
def test_poses_are_products_of_exponentials(m):
    rng = np.random.default_rng(m)
    for size in (1e-7, 1e-3, 1.0, 5.0):
        arm = random_chain(rng, m)
        q = size * rng.normal(size=m) / np.maximum(np.linalg.norm(arm.screws, axis=0), 1.0)
        T, J = np.eye(4), np.empty((6, m))
        for i, angle in enumerate(q):
            J[:, i] = iq.adjoint(T) @ arm.screws[:, i]
            T = T @ iq.exp(angle * arm.screws[:, i])
        twists, pose = arm.jacobian(q), arm.pose(q)
        scale = np.abs(J).max()
        np.testing.assert_allclose(pose, T @ arm.home, rtol=0.0, atol=1e-13 * max(1.0, np.abs(T).max()))
        np.testing.assert_allclose(twists, J, rtol=0.0, atol=1e-13 * scale * max(1.0, np.abs(T).max()))


@pytest.mark.parametrize("name", ["panda", "so101", "tiago", "fr3"])
def test_the_pinocchio_model_agrees_with_the_screws(name):
    arm, rng = iq.load_robot(name), np.random.default_rng(0)
    data, tool = arm.model.createData(), arm.model.nframes - 1
    for q in rng.normal(size=(50, len(arm.names))):
        J, pose = arm.jacobian(q), arm.pose(q)
        twists = pin.computeJointJacobians(arm.model, data, q)[[3, 4, 5, 0, 1, 2]]
        np.testing.assert_allclose(twists, J, rtol=0.0, atol=1e-14)
        seen = pin.updateFramePlacement(arm.model, data, tool).homogeneous
        np.testing.assert_allclose(seen, pose, rtol=0.0, atol=1e-14)


def test_with_tool_renames_the_tool():
    arm = iq.robots.Chain(np.eye(6), np.eye(4), tool="pen")
    assert (arm.tool, arm.with_tool(np.eye(4)).tool) == ("pen", "pen+offset")
    with pytest.raises(iq.BadInput, match="tool: found 3"):
        iq.robots.Chain(np.eye(6), np.eye(4), tool=3)


def test_with_limits_changes_only_limits():
    arm = iq.load_robot("ur5e")
    slow = arm.with_limits(velocity_limit=0.5, position_upper=np.full(6, 1.0))
    np.testing.assert_array_equal(slow.velocity_limit, np.full(6, 0.5))
    np.testing.assert_array_equal(slow.position_upper, np.full(6, 1.0))
    np.testing.assert_array_equal(slow.position_lower, arm.position_lower)
    assert (slow.tool, slow.names) == (arm.tool, arm.names)
    np.testing.assert_array_equal(slow.pose(np.full(6, 0.3)), arm.pose(np.full(6, 0.3)))
    with pytest.raises(iq.BadInput, match="velocity_limit"):
        arm.with_limits(velocity_limit=-1.0)
