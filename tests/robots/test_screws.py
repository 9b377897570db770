"""Joint screws are all that there is to an arm, or the arm is no chain."""

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.robots.screws import chain_of


@pytest.mark.parametrize("name", ["panda", "ur5", "so101", "xarm7", "z1", "kinova"])
def test_an_arm_is_its_screws(name):
    robot = iq.load_robot(name)
    chain = chain_of(robot)
    rng = np.random.default_rng(0)
    for _ in range(20):
        q = rng.normal(size=len(robot.names))
        np.testing.assert_allclose(chain.pose(q), robot.pose(q), rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(chain.jacobian(q), robot.jacobian(q), rtol=0.0, atol=1e-13)


def test_what_is_no_chain_is_none():
    robot = iq.load_robot("panda")

    class Bent(iq.robots.Chain):
        def jacobian(self, q):
            return 1.001 * super().jacobian(q)

    class Mine:
        def __getattr__(self, name):
            return getattr(robot, name)

    assert chain_of(Bent(robot.jacobian(np.zeros(7)), robot.pose(np.zeros(7)))) is None
    assert chain_of(Mine()) is None  # it may change
