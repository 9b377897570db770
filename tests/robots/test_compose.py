"""Arms on rails, mobile bases and poses, one tool both_arms from another: against Pinocchio and finite differences."""

import numpy as np
import pinocchio as pin
import pytest
from support.arms import numerical_twists

import invariantqp as iq
from invariantqp.robots import mobile_base, rail, relative, stand_on
from invariantqp.robots.urdf import excluded_pairs

RNG = np.random.default_rng(4)
PLACE = iq.exp([0.3, -0.2, 1.0, 0.4, -0.1, 0.7])
FIRST_ANGULAR = [3, 4, 5, 0, 1, 2]


def appended(base, arm, place=None):
    """Pinocchio's own model of an arm on a base, and the pose and Jacobian of its tool."""
    model = pin.appendModel(base.model, arm.model, base.model.getFrameId(base.tool), pin.SE3(np.eye(4)))
    data = model.createData()

    def tool(q):
        J = pin.computeFrameJacobian(model, data, q, model.getFrameId(arm.tool), pin.ReferenceFrame.WORLD)
        return pin.updateFramePlacement(model, data, model.getFrameId(arm.tool)).homogeneous, J[FIRST_ANGULAR]

    return tool


@pytest.mark.parametrize(
    "base", [rail([0, 2.0, 1.0]), mobile_base(1.0, 2.0), iq.load_robot("so101")], ids=["rail", "mobile", "arm"]
)
def test_an_arm_on_a_base_agrees_with_pinocchios_appended_model(base):
    arm = iq.load_robot("ur5e")
    both = iq.load_robot("ur5e", base=base)
    assert both.names == (*base.names, *arm.names)
    assert both.velocity_limit.tolist() == [*base.velocity_limit, *arm.velocity_limit]
    tool = appended(base, arm)
    for _ in range(4):
        q = RNG.uniform(-2.0, 2.0, len(both.names))
        T, J = tool(q)
        np.testing.assert_allclose(both.pose(q), T, atol=1e-12)
        np.testing.assert_allclose(both.jacobian(q), J, atol=1e-12)


def test_an_arm_at_a_place_moves_as_it_does_in_its_own_frame():
    arm, q = iq.load_robot("panda"), RNG.uniform(-1.0, 1.0, 7)
    placed = iq.load_robot("panda", base=PLACE)
    np.testing.assert_allclose(placed.pose(q), PLACE @ arm.pose(q), atol=1e-13)
    np.testing.assert_allclose(placed.jacobian(q), iq.adjoint(PLACE) @ arm.jacobian(q), atol=1e-13)
    np.testing.assert_allclose(placed.origins(q), arm.origins(q) @ PLACE[:3, :3].T + PLACE[:3, 3], atol=1e-13)


def two_arms():
    return iq.load_robot("panda", base=PLACE), iq.load_robot("panda", base=iq.transform(translation=(0.0, 0.9, 0.0)))


def test_the_relative_pose_and_twists_of_two_tools():
    arm, other = two_arms()
    both_arms = relative(arm, other)
    for _ in range(4):
        p, q = RNG.uniform(-1.5, 1.5, (2, 7))
        both = np.concatenate((p[::-1], q))
        back = np.linalg.inv(other.pose(p))
        np.testing.assert_allclose(both_arms.pose(both), back @ arm.pose(q), atol=1e-12)
        J = iq.adjoint(back) @ np.hstack((-other.jacobian(p)[:, ::-1], arm.jacobian(q)))
        np.testing.assert_allclose(both_arms.jacobian(both), J, atol=1e-12)
    np.testing.assert_allclose(both_arms.jacobian(both), numerical_twists(both_arms, both), atol=1e-8)
    assert both_arms.names[:2] == ("other/panda_joint7", "other/panda_joint6")
    np.testing.assert_array_equal(both_arms.position_upper, [*other.position_upper[::-1], *arm.position_upper])


def test_exclusions_of_links_stay_within_each_arm():
    arm, other = two_arms()
    own = excluded_pairs(arm)
    others = {frozenset(f"other/{name}" for name in pair): why for pair, why in own.items()}
    assert len(own) == 35
    assert excluded_pairs(relative(arm, other)) == {**own, **others}
    kept = iq.limits.Clearance(relative(arm, other)).pairs
    assert ("other/panda_link5", "panda_link7") in kept  # one arm lets its own fifth link touch its own seventh


def test_a_relative_chain_may_be_relative_again():
    arm, other = two_arms()
    both_arms = relative(relative(arm, other), other)
    assert len(set(both_arms.names)) == 21


def test_two_joints_of_one_name_are_refused():
    with pytest.raises(iq.BadInput, match="panda_joint1"):
        stand_on(iq.load_robot("panda"), iq.load_robot("panda"))
