"""Arms by name whose numbers are in the package, against DH parameters and poses that their makers print."""

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.robots.published import PUBLISHED

H = np.pi / 2
# Denavit-Hartenberg parameters as published (d, a, alpha), theta = q: Universal Robots, KUKA.
DH = {
    "ur3e": [(0.15185, 0, H), (0, -0.24355, 0), (0, -0.2132, 0), (0.13105, 0, H), (0.08535, 0, -H), (0.0921, 0, 0)],
    "ur5e": [(0.1625, 0, H), (0, -0.425, 0), (0, -0.3922, 0), (0.1333, 0, H), (0.0997, 0, -H), (0.0996, 0, 0)],
    "ur10e": [(0.1807, 0, H), (0, -0.6127, 0), (0, -0.57155, 0), (0.17415, 0, H), (0.11985, 0, -H), (0.11655, 0, 0)],
    "ur16e": [(0.1807, 0, H), (0, -0.4784, 0), (0, -0.36, 0), (0.17415, 0, H), (0.11985, 0, -H), (0.11655, 0, 0)],
    "iiwa7": [(0.34, 0, -H), (0, 0, H), (0.4, 0, H), (0, 0, -H), (0.4, 0, -H), (0, 0, H), (0.126, 0, 0)],
    "iiwa14": [(0.36, 0, -H), (0, 0, H), (0.42, 0, H), (0, 0, -H), (0.4, 0, -H), (0, 0, H), (0.126, 0, 0)],
}
# Kinova's user guide of the Gen3 with seven joints: (d, alpha), theta = q + pi but for the first; a = 0. To 0.1 mm.
GEN3 = [
    (-(0.1564 + 0.1284), H),
    (-(0.0054 + 0.0064), H),
    (-(0.2104 + 0.2104), H),
    (-(0.0064 + 0.0064), H),
    (-(0.2084 + 0.1059), H),
    (0.0, H),
    (-(0.1059 + 0.0615), np.pi),
]


def link(theta, d, a, alpha):
    turn, twist = iq.exp([0, 0, theta, 0, 0, 0]), iq.exp([alpha, 0, 0, 0, 0, 0])
    return turn @ iq.transform(translation=(a, 0, d)) @ twist


def states(name):
    m = len(iq.load_robot(name).names)
    return np.random.default_rng(m).uniform(-3.0, 3.0, size=(5, m))


@pytest.mark.parametrize("name", DH)
def test_poses_agree_with_the_makers_dh_parameters(name):
    arm = iq.load_robot(name)
    for q in states(name):
        T = np.linalg.multi_dot([link(angle, *row) for angle, row in zip(q, DH[name], strict=True)])
        np.testing.assert_allclose(arm.pose(q), T, rtol=0.0, atol=1e-12)


def test_the_gen3_agrees_with_its_user_guide():
    arm = iq.load_robot("gen3")
    for q in states("gen3"):
        T = iq.exp([np.pi, 0, 0, 0, 0, 0])
        for i, (angle, (d, alpha)) in enumerate(zip(q, GEN3, strict=True)):
            T = T @ link(angle + np.pi * (i > 0), d, 0.0, alpha)
        np.testing.assert_allclose(arm.pose(q), T, rtol=0.0, atol=5e-4)


def test_a_franka_research_3_has_the_joints_of_a_panda():
    fr3, panda = iq.load_robot("fr3"), iq.load_robot("panda", tool="panda_link8")
    for q in states("fr3"):
        np.testing.assert_allclose(fr3.pose(q), panda.pose(q), rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(fr3.jacobian(q), panda.jacobian(q), rtol=0.0, atol=1e-12)


def test_a_lite_6_at_zero_stands_in_a_plane_and_points_down():
    arm = iq.load_robot("lite6")
    height = 0.2435 + 0.2002 - 0.22761 - 0.0625  # up to the elbow, and down
    wanted = iq.transform(np.diag([1.0, -1.0, -1.0]), (0.087, 0.0, height))
    np.testing.assert_allclose(arm.pose(np.zeros(6)), wanted, rtol=0.0, atol=1e-15)
    axes = arm.jacobian(np.zeros(6))[:3].T
    np.testing.assert_array_equal(axes, [[0, 0, 1], [0, 1, 0], [0, -1, 0], [0, 0, -1], [0, 1, 0], [0, 0, -1]])


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_published_arm_needs_no_file(name, monkeypatch):
    from invariantqp.robots import load

    monkeypatch.setattr(load, "_example_data_folder", None)
    arm = iq.load_robot(name)
    part = iq.load_robot(name, joints=arm.names[:3], offset=iq.transform(translation=(0, 0, 0.1)))
    assert (part.names, part.tool) == (arm.names[:3], "tool0+offset")
    with pytest.raises(iq.errors.UnknownName, match="tool0"):
        iq.load_robot(name, tool="tool1")
    with pytest.raises(iq.errors.RobotModelError, match="known by its joints alone"):
        load.urdf_of(name)
