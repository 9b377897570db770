"""MuJoCo's own contact, as it is by default, and its position servos: a referee that nobody made for this law."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from support.arms import ready
from support.mujoco_gantry import Gantry

import invariantqp as iq

SCENES = Path(__file__).parents[2] / "examples" / "shared" / "contact_scenes.py"
PRESS = 10.0


def pressed(dt, seconds, reads=None, speed=0.0, stands=(np.inf, np.inf), *, is_commanded=True, **options):
    """The true press of each tick [N] and its solution; the arm stands from stands[0] to stands[1] [s].

    `reads` is what the sensor reads from 2 s on; unless `is_commanded` no reading changes meanwhile.
    """
    cell, presses, reports = Gantry(dt, PRESS, **options), [], []
    for k in range(round(seconds / dt)):
        t, target, ahead = k * dt, cell.start.copy(), np.zeros(6)
        moves = not stands[0] <= t < stands[1]
        target[0, 3] += speed * max(0.0, t - 2.0)
        ahead[3] = speed * (t > 2.0)
        if is_commanded or moves:
            q, reading = cell.q, cell.reading(cell.press if reads is None or t < 2.0 else reads)
        reports.append(cell.loop.step(q, target, reading, ahead))
        cell.drive(reports[-1].velocity * moves)
        presses.append(cell.press)
    return np.array(presses), reports


@pytest.mark.parametrize("dt", [0.002, 0.01])
def test_a_press_is_held(dt):
    presses, reports = pressed(dt, 5.0)
    assert {str(one.status) for one in reports} == {"lost", "ok"}
    assert presses.max() < 1.2 * PRESS
    assert presses[-round(1.5 / dt) :] == pytest.approx(PRESS, abs=0.02 * PRESS)


@pytest.mark.parametrize("dt", [0.002, 0.01])
@pytest.mark.parametrize("share", [0.5, 0.9, 1.1, 1.9])
def test_a_reading_that_sticks_is_a_fault_before_it_presses_much_harder(share, dt):
    presses, reports = pressed(dt, 8.0, reads=share * PRESS)
    assert reports[-1].status == "fault"
    assert presses.max() < 4.0 * PRESS


@pytest.mark.parametrize("dt", [0.002])
def test_a_chattering_contact_is_held_in_its_mean(dt):
    presses, reports = pressed(dt, 8.0, speed=0.02)
    assert {"fault", "overload"}.isdisjoint(str(one.status) for one in reports)
    assert np.mean(presses[-round(4.0 / dt) :]) == pytest.approx(PRESS, rel=0.2)


@pytest.mark.parametrize("dt", [0.002, 0.01, 0.033])
@pytest.mark.parametrize(
    ("stands", "speed"), [((0.1, 1.1), 0.0), ((3.0, 4.0), 0.0), ((3.0, 4.0), 0.005), ((3.0, 4.0), -0.005)]
)
def test_an_arm_that_stands_for_a_while_goes_on_without_a_fault(dt, stands, speed):
    """Stopped on its way to the surface, at rest on it, and on its way along it."""
    presses, reports = pressed(dt, 7.5, speed=speed, stands=stands, acceleration_limit=2.0)
    release = round(np.ceil(stands[1] / dt - 1e-9))
    assert {"fault", "overload"}.isdisjoint(str(one.status) for one in reports)
    moved = np.array([one.velocity for one in reports]) * (np.arange(len(reports)) >= release)[:, None]
    # An approach at 4 mm/s is too slow to tell a stop from friction: it goes on at its speed.
    assert np.abs(np.diff(moved[: release + 20], axis=0)).max() < max(1.001 * 2.0 * dt, 0.005)
    # Sliding, it catches up, and this contact chatters.
    assert presses[release:].max() < (2.5 if speed else 1.2) * PRESS
    assert np.mean(presses[-round(2.5 / dt) :]) == pytest.approx(PRESS, rel=0.25 if speed else 0.1)


@pytest.mark.parametrize("dt", [0.002, 0.01, 0.033])
def test_constant_readings_of_an_arm_at_rest_are_no_stale_sensor(dt):
    presses, reports = pressed(dt, 6.0, stands=(3.0, 4.0), is_commanded=False, acceleration_limit=2.0)
    assert {"fault", "overload"}.isdisjoint(str(one.status) for one in reports)
    assert presses[-round(1.0 / dt) :] == pytest.approx(PRESS, rel=0.1)


@pytest.mark.cases(1)
@pytest.mark.parametrize("arm", ["panda", "ur5", "xarm7"])
def test_a_normal_declared_5_degrees_wrong_does_not_stop_the_slide(arm):
    from invariantqp.robots.load import urdf_of
    from invariantqp.workbench.runs.contactspec import Physics
    from invariantqp.workbench.runs.mujoco import MujocoPlant

    dt, robot, q, seconds = 0.002, iq.load_robot(arm), ready(arm), 3.5
    physics = Physics(delay=0.004, force_noise=0.3, moment_noise=0.01)
    scene = runpy.run_path(str(SCENES))["scenes"](robot.pose(q), 0.03)["normal told 5 deg wrong"]
    plant = MujocoPlant(urdf_of(arm), robot, q, dt, scene.touch, physics=physics.model_copy(update={"armature": 0.1}))
    sensor = iq.WrenchSensor(np.eye(4), order="moment first", reads="reaction", cutoff=50.0, noise=0.3)
    delay = physics.lag + physics.delay
    loop = iq.HybridController(robot, iq.HybridTask(scene.told, scene.wanted), dt=dt, sensor=sensor, delay=delay)
    touched, off = None, 0.0
    for k in range(round(10.0 / dt)):
        now = plant.state()
        if touched is None and np.abs(now.wrench).max() > 1e-6:
            touched = k * dt
        since = 0.0 if touched is None else k * dt - touched
        if since > seconds:
            break
        target, ahead = scene.path(max(0.0, since - 1.0))
        measured = plant.measure()
        solution = loop.step(measured.q, target, measured.wrench, ahead)
        plant.command(solution.velocity)
        assert "does not respond" not in solution.reason
        off = max(off, scene.off(now.pose, target)) if since > 1.5 else off
    assert since > seconds
    assert off < 1e-3
