"""The ideal plant and its springs."""

import numpy as np
import pytest
from support.arms import ready
from support.random_systems import motion
from support.wrist import wrist

import invariantqp as iq
from invariantqp.workbench.runs.plant import HingeSprings, IdealPlant, Plane, SimulatedSensor, SurfaceSprings

UP = np.array([0.0, 0.0, 1.0])
EDGE = np.array([[-0.03, 0.0, 0.0], [0.03, 0.0, 0.0]])
FACE = np.array([[-0.03, -0.02, 0.0], [0.03, -0.02, 0.0], [0.03, 0.02, 0.0], [-0.03, 0.02, 0.0]])
READY = ready("panda")


def turned(axis, angle, point=(0.0, 0.0, 0.0)):
    return iq.exp(angle * iq.revolute(axis, point))


def test_a_surface_pushes_in_proportion_to_depth_and_does_not_pull():
    pen = SurfaceSprings(np.zeros((1, 3)), Plane(np.zeros(3), UP), 2e4)
    at = np.array([0.3, -0.2, -0.001])
    pushed = pen.wrench(iq.transform(translation=at))
    np.testing.assert_allclose(pushed, [*np.cross(at, 20.0 * UP), *(20.0 * UP)], atol=1e-12)
    np.testing.assert_array_equal(pen.wrench(iq.transform(translation=-at)), np.zeros(6))


def test_the_tilting_stiffness_of_an_edge_and_a_face():
    """k L^2 / 4 about an edge's middle, k b^2 / 4 and k a^2 / 4 for a face of sides a and b."""
    k, angle, deep = 2e4, 1e-4, iq.transform(translation=[0.0, 0.0, -0.001])
    edge = SurfaceSprings(EDGE, Plane(np.zeros(3), UP), k)
    face = SurfaceSprings(FACE, Plane(np.zeros(3), UP), k)
    for touch, axis, stiffness in (
        (edge, [0.0, 1.0, 0.0], k * 0.06**2 / 4),
        (face, [1.0, 0.0, 0.0], k * 0.04**2 / 4),
        (face, [0.0, 1.0, 0.0], k * 0.06**2 / 4),
    ):
        back = touch.wrench(deep @ turned(axis, angle))
        np.testing.assert_allclose(back[5], k * 0.001, rtol=1e-9)
        np.testing.assert_allclose(back[:3], -stiffness * angle * np.array(axis), rtol=1e-6, atol=1e-9)
    assert edge.wrench(deep @ turned([1.0, 0.0, 0.0], 0.3))[0] == pytest.approx(0.0, abs=1e-15)


def test_a_tilted_face_rests_on_the_corners_that_reach():
    face = SurfaceSprings(FACE, Plane(np.zeros(3), UP), 2e4)
    tipped = face.wrench(turned([0.0, 1.0, 0.0], 0.1))  # two corners above, two below
    assert tipped[5] == pytest.approx(5e3 * 2 * 0.03 * np.sin(0.1))


def test_a_door_turns_freely_and_resists_other_motions():
    home = motion(np.random.default_rng(0), 0.5)
    axis, point = np.array([0.0, 0.6, 0.8]), home[:3, 3] + [0.3, 0.0, 0.1]
    door = iq.revolute(axis, point)
    grip = HingeSprings(FACE, home, door, 2e4)
    swung = iq.exp(0.9 * door) @ home
    angle = grip.angle(swung, 0.85)
    assert angle == pytest.approx(0.9, abs=1e-12)
    np.testing.assert_allclose(grip.wrench(swung, angle), 0.0, atol=1e-9)
    strained = iq.transform(translation=[0.001, -0.002, 0.003]) @ swung
    wrench = grip.wrench(strained, grip.angle(strained, 0.9))
    assert np.linalg.norm(wrench[3:]) > 10.0
    assert abs(wrench @ door) < 1e-6 * np.linalg.norm(wrench)  # a free hinge carries no torque about itself


def test_the_wrench_is_the_gradient_of_the_springs_energy():
    """Power: k/2n sum depth^2 changes by -W.s along any twist."""
    T = iq.transform(translation=[0.2, 0.1, -0.001]) @ turned([0.6, 0.8, 0.0], 0.01)
    touch = SurfaceSprings(FACE, Plane(np.array([0.2, 0.1, 0.0]), UP), 2e4)

    def energy(pose):
        depths = [touch.surface.depth(p) for p in FACE @ pose[:3, :3].T + pose[:3, 3]]
        return 0.5 * touch.stiffness / 4 * sum(max(d, 0.0) ** 2 for d in depths)

    for s in np.eye(6):
        slope = (energy(iq.exp(1e-7 * s) @ T) - energy(iq.exp(-1e-7 * s) @ T)) / 2e-7
        assert slope == pytest.approx(-touch.wrench(T) @ s, rel=1e-5, abs=1e-6)


def test_the_plant_moves_as_commanded_and_its_sensor_measures_contact_and_weight():
    robot = iq.load_robot("panda")
    T = robot.pose(READY)
    real = SimulatedSensor(motion(np.random.default_rng(1), 0.1), 0.4, (0.01, 0.02, 0.03))
    plant = IdealPlant(
        robot, READY, 0.002, SurfaceSprings(np.zeros((1, 3)), Plane(T[:3, 3] + 1e-3 * UP, UP), 2e4), real
    )
    velocity = np.linspace(-0.1, 0.1, 7)
    for _ in range(3):
        plant.command(velocity)
    now = plant.state()
    np.testing.assert_allclose(now.q, READY + 0.006 * velocity, atol=1e-15)
    np.testing.assert_array_equal(now.pose, robot.pose(now.q))
    assert np.linalg.norm(now.wrench[3:]) > 10.0
    task_sensor = wrist(real.mount, mass=real.mass, centre=real.centre)  # what a controller makes of the reading
    measured = plant.measure()
    np.testing.assert_array_equal(measured.q, now.q)
    np.testing.assert_allclose(task_sensor.wrench(measured.wrench, now.pose), -now.wrench, atol=1e-10)


def test_commands_act_after_the_dead_time():
    robot = iq.load_robot("panda")
    plant = IdealPlant(robot, READY, 0.004, delay=0.012)
    velocity = np.linspace(-0.1, 0.1, 7)
    for k in range(3):
        plant.command((k + 1.0) * velocity)
        np.testing.assert_array_equal(plant.measure().q, READY)
    plant.command(np.zeros(7))
    np.testing.assert_allclose(plant.measure().q, READY + 0.004 * velocity, atol=1e-15)
    plant.command(np.zeros(7))
    np.testing.assert_allclose(plant.measure().q, READY + 0.012 * velocity, atol=1e-15)


def test_a_plant_without_contact_has_no_wrench():
    robot = iq.load_robot("panda")
    plant = IdealPlant(robot, READY, 0.002)
    assert not plant.measure().wrench.any()
    np.testing.assert_array_equal(plant.state().wrench, np.zeros(6))
