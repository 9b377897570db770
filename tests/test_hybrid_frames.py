"""The same force/motion task in displaced frames: ours gives the same joint velocities, the textbook's does not."""

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.compare.raibert_craig import RaibertCraig

READY = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])


@pytest.fixture(scope="module")
def checks():
    found = iq.hybrid_frame_check(iq.load_robot("panda"), READY, seed=0, ticks=600)
    return {(c.law, c.tool): c for c in found}


@pytest.mark.parametrize("tool", ["pen", "sole"])
def test_ours_gives_the_same_joint_velocities(checks, tool):
    ours = checks["invariantqp", tool]
    assert 0.0 < ours.change < 1e-9
    assert ours.force_error < 0.02
    assert ours.displaced_force_error == pytest.approx(ours.force_error, abs=1e-9)


def test_the_textbook_is_as_good_where_all_frames_share_an_origin(checks):
    """A baseline that works as printed: what changes below is the frames' doing."""
    for tool in ("pen", "sole"):
        assert checks["Raibert-Craig", tool].force_error == pytest.approx(
            checks["invariantqp", tool].force_error, rel=0.05
        )


def test_the_textbook_presses_wrongly_where_moments_are_not_moved(checks):
    sole = checks["Raibert-Craig", "sole"]
    assert sole.change > 0.1
    assert sole.displaced_force_error > 10 * sole.force_error


def test_the_textbook_has_a_tick_and_limits():
    robot = iq.load_robot("panda")
    loop = RaibertCraig(
        robot,
        [1, 1, 1, 1, 1, 0],
        np.diag([1.0, -1.0, -1.0]),
        [0, 0, 0, 0, 0, 5.0],
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
