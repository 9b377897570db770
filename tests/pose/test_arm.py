import numpy as np
import pytest
from support.inverse_kinematics import ARMS, NO_LIMIT, is_inside

import invariantqp as iq
from invariantqp.pose.ik import engine_arm

UR5 = ARMS["ur5"]


def test_only_hinges_whose_range_holds_a_turn_turn_over():
    screws = np.column_stack(
        [
            iq.revolute([0, 0, 2.0]),
            2.0 * iq.revolute([0, 1, 0]),
            iq.se3.helical([0, 0, 1], pitch=0.1),
            iq.se3.prismatic([1, 0, 0]),
        ]
    )
    wide = engine_arm(iq.robots.Chain(screws, np.eye(4), (), -4.0, 4.0))
    turns = np.array([2.0 * np.pi, np.pi, 0.0, 0.0])  # the second screw is twice a unit one
    np.testing.assert_allclose(wide.wrapped([5.0, 5.0, 5.0, 5.0]), [5.0 - turns[0], 5.0 - turns[1], 4.0, 4.0])
    narrow = engine_arm(iq.robots.Chain(screws, np.eye(4), (), -1.5, 1.5))
    np.testing.assert_array_equal(narrow.wrapped(np.full(4, -5.0)), np.full(4, -1.5))


@pytest.mark.parametrize("q", [[0.0] * 6, [7.0] * 6, [-40.0, 40.0, 3.0, -9.0, 1e3, 6.5]])
def test_whole_turns_into_the_limits_do_not_move_the_tool(q):
    inside = engine_arm(UR5).wrapped(q)
    assert is_inside(UR5, inside)
    free = np.array(q)
    free[2] = inside[2]  # the elbow's range is one turn; 7 rad are shifted into it as well
    np.testing.assert_allclose(UR5.pose(inside), UR5.pose(free), atol=1e-9)


def test_a_hinge_that_can_turn_over_is_shifted_by_whole_turns():
    q = np.array([6.2, -1.0, 1.0, 0.5, 1.0, 6.0])
    past = q + np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.5])  # both beyond 2 pi
    found = iq.solve_pose(UR5, UR5.pose(past), q0=q, **NO_LIMIT)
    assert found.success
    assert found.other_branch  # two joints turn the other way round
    assert found.displacement > np.pi
    turned = (past - found.q) / (2.0 * np.pi)
    alone = iq.solve_pose(UR5, UR5.pose(past), q0=past - 2.0 * np.pi * np.array([1, 0, 0, 0, 0, 1]), **NO_LIMIT)
    np.testing.assert_allclose(alone.q, past - 2.0 * np.pi * np.array([1, 0, 0, 0, 0, 1]), atol=1e-6)
    assert not alone.other_branch
    assert alone.displacement < 1e-6
    assert np.abs(turned).max() > 0.5


def test_at_a_limit_a_joint_does_not_turn_over():
    q = np.array([2.0 * np.pi, -1.0, 1.0, 0.5, 1.0, -2.0 * np.pi])
    start = q + np.array([-0.2, 0.1, 0.1, -0.1, 0.1, 0.2])
    found = iq.solve_pose(UR5, UR5.pose(q), q0=start, **NO_LIMIT)
    np.testing.assert_allclose(found.q, q, atol=1e-6)
    assert (found.q <= UR5.position_upper).all()
    assert (found.success, found.other_branch) == (True, False)


def test_of_equal_joint_positions_the_nearest_to_the_start_is_chosen():
    q = np.array([5.0, -1.0, 1.0, 0.5, 1.0, -5.0])
    for start in (q, q - 2.0 * np.pi * np.array([1, 0, 0, 0, 0, -1])):
        found = iq.solve_pose(UR5, UR5.pose(q), q0=start, **NO_LIMIT)
        np.testing.assert_allclose(found.q, start, atol=1e-6)
    kinova = ARMS["kinova"]  # its first joint has no limits at all
    far = np.array([40.0, 3.0, 2.0, -30.0, 3.0, 20.0])
    found = iq.solve_pose(kinova, kinova.pose(far + 0.05), q0=far, **NO_LIMIT)
    assert np.abs(found.q - far).max() < 1.0
