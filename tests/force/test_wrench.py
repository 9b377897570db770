"""A sensor's reading becomes the wrench the tool exerts; Pinocchio's own force transport is the reference."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_systems import motion
from support.wrist import wrist

import invariantqp as iq

G = np.array([0.0, 0.0, -9.80665])


def stacked(force):
    return np.concatenate((force.angular, force.linear))


def reading_by_pinocchio(tool, mount, world, mass, centre, bias):
    """What a wrist sensor shows when the world does `world` (linear, angular; base frame) to the tool."""
    sensor = pin.SE3(tool @ mount)
    hangs = sensor.translation + sensor.rotation @ centre
    weight = pin.Force(mass * G, np.cross(hangs, mass * G))
    return stacked(sensor.actInv(world) + sensor.actInv(weight)) + bias


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**31), opposite=st.booleans())
def test_weight_bias_and_transport_against_pinocchio(seed, opposite):
    rng = np.random.default_rng(seed)
    tool, mount, centre, bias = motion(rng), motion(rng, 0.2), 0.1 * rng.normal(size=3), rng.normal(size=6)
    world = pin.Force(rng.normal(size=3) * 10, rng.normal(size=3))
    sensor = wrist(
        mount=mount,
        mass=1.3,
        centre=centre,
        bias=-bias if opposite else bias,
        reads="action" if opposite else "reaction",
    )
    reading = reading_by_pinocchio(tool, mount, world, 1.3, centre, bias)
    measured = sensor.wrench(-reading if opposite else reading, tool)
    np.testing.assert_allclose(measured, -stacked(world), atol=1e-11)
    nothing = reading_by_pinocchio(tool, mount, pin.Force.Zero(), 1.3, centre, bias)
    np.testing.assert_allclose(sensor.tare(tool), -nothing if opposite else nothing, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_relabelled_frames_change_nothing(seed):
    rng = np.random.default_rng(seed)
    tool, mount, X, Y = motion(rng), motion(rng, 0.2), motion(rng, 0.2), motion(rng, 0.2)
    sensor = wrist(
        mount=mount,
        mass=0.8,
        centre=[0.01, 0.02, 0.05],
        bias=[0.1, 0.2, 0.3, 1, 2, 3],
        force_deadband=0.5,
        moment_deadband=0.2,
        origin=[0.0, 0.01, 0.02],
    )
    reading = rng.normal(size=6) * 3
    other = sensor.relabelled(X, Y)
    there = iq.coadjoint(iq.inverse(X)) @ reading
    np.testing.assert_allclose(other.wrench(there, tool @ Y), sensor.wrench(reading, tool), atol=1e-11)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-10, 10), min_size=6, max_size=6), st.floats(0, 3))
def test_the_deadband_is_soft_continuous_and_keeps_direction(numbers, width):
    a, b = np.array(numbers[:3]), np.array(numbers[3:])
    sensor = wrist(force_deadband=width)
    soft_a, soft_b = (sensor.deadband([0.0, 0.0, 0.0, *force])[3:] for force in (a, b))
    assert np.linalg.norm(soft_a - soft_b) <= np.linalg.norm(a - b) * (1 + 1e-12)
    assert np.linalg.norm(soft_a) == pytest.approx(max(0.0, np.linalg.norm(a) - width), abs=1e-12)
    assert np.linalg.norm(np.cross(soft_a, a)) <= 1e-12 * (1 + a @ a)


def test_forces_and_moments_have_deadbands_of_their_own():
    sensor = wrist(force_deadband=1.0, moment_deadband=0.1, reads="action")
    measured = sensor.wrench([0.3, 0, 0, 0, 0.9, 0], np.eye(4))
    np.testing.assert_allclose(measured, [0.2, 0, 0, 0, 0, 0], atol=1e-15)
    measured = sensor.wrench([0.05, 0, 0, 0, 3.0, 0], np.eye(4))
    np.testing.assert_allclose(measured, [0, 0, 0, 0, 2.0, 0], atol=1e-15)


def smoothed(cutoff, dt):
    """What a controller makes of a reading (6,), tick by tick, in the sensor's frame."""
    robot = iq.load_robot("panda")
    q = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])
    sensor = iq.WrenchSensor(np.eye(4), order="moment first", reads="action", cutoff=cutoff)
    task = iq.HybridTask(iq.point_contact(robot.pose(q)[:3, 3], [0, 0, 1]), [5.0], max_force=1e3, max_moment=1e3)
    loop = iq.HybridController(robot, task, dt=dt, sensor=sensor, tare=False)
    to_sensor = np.linalg.inv(iq.coadjoint(robot.pose(q)))
    return lambda reading: to_sensor @ loop.step(q, robot.pose(q), reading).wrench


@pytest.mark.parametrize(("cutoff", "dt"), [(10.0, 1e-3), (50.0, 2e-3), (0.5, 0.01)])
def test_the_low_pass_is_first_order_with_its_cutoff(cutoff, dt):
    smooth = smoothed(cutoff, dt)
    np.testing.assert_allclose(smooth(np.zeros(6)), 0.0, atol=1e-15)
    answers = [smooth(np.ones(6))[0] for _ in range(200)]
    time = dt * np.arange(1, 201)
    np.testing.assert_allclose(answers, 1.0 - np.exp(-2 * np.pi * cutoff * time), atol=1e-12)


def test_the_first_reading_starts_the_filter_and_inf_is_no_filter():
    np.testing.assert_allclose(smoothed(5.0, 0.01)(np.arange(6.0)), np.arange(6.0), atol=1e-12)
    smooth = smoothed(np.inf, 0.01)
    smooth(np.zeros(6))
    np.testing.assert_allclose(smooth(np.arange(6.0)), np.arange(6.0), atol=1e-12)


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"mass": -1.0}, "mass"),
        ({"cutoff": 0.0}, "cutoff"),
        ({"force_deadband": -0.1}, "force_deadband"),
        ({"moment_deadband": -0.1}, "moment_deadband"),
        ({"mount": np.ones((4, 4))}, "mount"),
        ({"reads": "both"}, "reads"),
        ({"centre": [0, 0, np.inf]}, "centre"),
    ],
)
def test_sensors_that_cannot_be(options, argument):
    with pytest.raises(iq.BadInput) as caught:
        wrist(**options)
    assert caught.value.argument == argument
