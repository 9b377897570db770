"""Noise of the force at acceleration limits: a tool in contact stays on its path, driven as fast as it can be."""

import numpy as np
import pytest
from support.plane import PANDA, UP, exerted
from support.repeats import repeats
from support.wrist import wrist

import invariantqp as iq

DT = 0.002


def wiped(noise, acceleration, stiffness=1e4, cutoff=np.inf, declared=None):
    """A circle of 120 mm, pressed with 5 N: off the path [mm], seconds, hybrid statuses, last answer."""
    rng, robot, q = np.random.default_rng(0), iq.load_robot("panda"), PANDA.copy()
    start = robot.pose(q)

    def circle(sigma):
        T, a = start.copy(), 2.0 * np.pi * sigma
        T[:3, 3] += [0.06 * (np.cos(a) - 1.0), 0.06 * np.sin(a), 0.0]
        return T

    task = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], UP), [5.0], stiffness=declared)
    sensor = wrist(noise=noise, cutoff=cutoff)
    loop = iq.HybridController(robot, task, dt=DT, sensor=sensor, acceleration_limit=acceleration)
    follower = iq.PathFollower(loop, circle)
    follower.prepare(q)
    off, reports = [0.0], set()
    ticks = 0
    while ticks < 4000:
        ticks += 1
        tool = robot.pose(q)
        wrench = exerted([tool[:3, 3]], start[2, 3] - 5e-4, stiffness)
        reading = -iq.coadjoint(iq.inverse(tool)) @ wrench
        answer = follower.step(q, wrench=reading + noise * rng.normal(size=6) * np.repeat([0.03, 1.0], 3))
        if answer.place > 0.02:
            x, y, _ = tool[:3, 3] - start[:3, 3]
            off.append(1e3 * abs(np.hypot(x + 0.06, y) - 0.06))
            reports.add((answer.hybrid.status, answer.hybrid.reason))
        q = q + DT * answer.velocity
        if answer.status == "done":
            break
    return max(off), DT * ticks, reports, answer


@pytest.mark.parametrize(
    ("noise", "acceleration", "stiffness", "seconds"),
    repeats([(0.3, 20.0, 1e4, 1.2), (0.1, 5.0, 1e3, 3.0)], [(0.3, 20.0, 1e4, 1.2)]),
)
def test_noise_does_not_take_a_tool_off_its_path(noise, acceleration, stiffness, seconds):
    off, time, _, answer = wiped(noise, acceleration, stiffness)
    assert answer.status == "done"
    assert off < 0.05
    assert time < 1.1 * seconds


def test_a_gain_lowered_for_noise_is_reported_unless_there_is_a_low_pass():
    *_, reports, _ = wiped(1.0, 5.0, stiffness=1e3)
    assert any("of the force gain is left; give the sensor a lower cutoff=" in why for _, why in reports)
    *_, reports, _ = wiped(0.1, 5.0, cutoff=20.0)
    assert not any("of the force gain is left" in why for _, why in reports)


@pytest.mark.parametrize(("noise", "limit"), [(0.02, np.inf), (0.02, 4.0), (0.0, 4.0), (0.02, None)])
def test_the_acceleration_share_is_that_of_the_joint_with_the_least(noise, limit):
    robot = iq.load_robot("ur5")
    q = np.array([0.0, -1.2, 1.8, -2.2, -1.57, 0.0])
    limits = None if limit is None else np.array([5.0, 6.0, 7.0, 8.0, 9.0, limit])
    tool = robot.pose(q)
    contact = iq.point_contact(tool[:3, 3], UP)
    sensor = wrist(noise=noise)
    loop = iq.HybridController(
        robot, iq.HybridTask(contact, [5.0]), dt=DT, sensor=sensor, acceleration_limit=limits, tare=False
    )
    for press in [0.0] * 3 + [5.0] * 40:
        wrench = np.concatenate((np.cross(tool[:3, 3], -press * UP), -press * UP))
        loop.step(q, tool, -iq.coadjoint(iq.inverse(tool)) @ wrench)
    if noise == 0.0 or limit is None:
        assert loop.acceleration_share == 1.0
        return
    down = np.concatenate((np.zeros(3), -UP))  # of a unit rate
    most = np.where(np.isfinite(limits), limits, 90.0)
    share = 1.5 * noise * np.sqrt(2.0) / DT * np.abs(np.linalg.solve(robot.jacobian(q), down) / most).max()
    assert 1.0 - loop.acceleration_share == pytest.approx(share * loop.state.gain, rel=1e-9)
    assert 0.0 < 1.0 - loop.acceleration_share < 0.5
