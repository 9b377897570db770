"""Poses and Jacobians of rows, against the arm's own."""

import numpy as np
import pytest

import invariantqp as iq
from invariantqp import batches


@pytest.mark.parametrize("library", ["numpy", "torch", "jax"])
def test_rows_are_the_arms_own(library):
    """Arms with hinges, slides and screws."""
    xp = np if library == "numpy" else pytest.importorskip(library)
    if library == "jax":
        xp.config.update("jax_enable_x64", val=True)
    array = xp.tensor if library == "torch" else xp.numpy.asarray if library == "jax" else np.asarray
    rng = np.random.default_rng(0)
    mixed = rng.normal(size=(6, 3))
    mixed[:3, 1] = 0.0
    for robot in (iq.load_robot("fr3"), iq.robots.Chain(mixed, iq.exp(rng.normal(size=6)))):
        q = rng.normal(size=(2, 5, len(robot.names)))
        found = batches.kinematics(robot, array(q))
        for i in np.ndindex(2, 5):
            np.testing.assert_allclose(np.asarray(found.pose)[i], robot.pose(q[i]), rtol=0.0, atol=1e-13)
            np.testing.assert_allclose(np.asarray(found.jacobian)[i], robot.jacobian(q[i]), rtol=0.0, atol=1e-13)
        if library == "jax":
            return  # compiled operation by operation: one arm takes a second


def test_no_rows_one_row_and_a_bad_row():
    robot = iq.load_robot("fr3")
    assert batches.kinematics(robot, np.empty((0, 7))).jacobian.shape == (0, 6, 7)
    q = np.zeros((2, 7))
    q[0, 3] = np.nan
    found = batches.kinematics(robot, q)
    np.testing.assert_array_equal(found.jacobian[1], batches.kinematics(robot, q[1]).jacobian)
    with pytest.raises(iq.BadInput, match=r"q: found shape \(6,\)"):
        batches.kinematics(robot, np.zeros(6))
    with pytest.raises(iq.BadInput, match="robot: found 3"):
        batches.kinematics(3, q)
