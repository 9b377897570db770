"""The textbook's selection matrix: as good as ours where all frames share an origin, a law with a tick and limits."""

import numpy as np
import pytest
from support.arms import ready

import invariantqp as iq
from invariantqp.compare.frames import RaibertCraig

READY = ready("panda")


def test_the_textbook_has_a_tick_and_limits():
    robot = iq.load_robot("panda")
    loop = RaibertCraig(
        robot,
        np.array([1, 1, 1, 1, 1, 0]),
        np.diag([1.0, -1.0, -1.0]),
        np.array([0, 0, 0, 0, 0, 5.0]),
        dt=0.01,
        gain=5.0,
        compliance=np.ones(6),
        sensor_axes=np.eye(3),
    )
    solution = loop.step(READY, robot.pose(READY), np.zeros(6))
    assert solution.active
    assert (np.abs(solution.velocity) <= robot.velocity_limit).all()
    with pytest.raises(iq.BadInput, match="wrench"):
        loop.step(READY, robot.pose(READY), np.full(6, np.nan))
