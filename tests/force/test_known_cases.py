"""What users of force controllers report: a press straight down drifts sideways, a tool slides off its box.

Reports: fzi-forschungszentrum-informatik/cartesian_controllers, issues 31, 73 and 178.
"""

import numpy as np
import pytest
from support.spring_plane import UP, tip

import invariantqp as iq

DT, STIFFNESS = 0.004, 1e4
UR5 = np.array([0.0, -1.2, 1.8, -2.2, -1.57, 0.0])  # tool down


def pressed(gap, box=np.inf, tilt=0.0, seconds=2.0):
    """Sideways places [m] of a UR5's tip and presses [N]: 4 N straight down on a box, the target at rest."""
    robot = iq.load_robot("ur5")
    sensor = iq.WrenchSensor(np.eye(4), order="force first", reads="reaction", mass=0.8, centre=[0, 0, 0.05], noise=0.2)
    loop = iq.HybridController(robot, iq.HybridTask(tip, [4.0]), dt=DT, sensor=sensor)
    q, random, start = UR5.copy(), np.random.default_rng(0), robot.pose(UR5)
    foot = start[:3, 3] - [0.0, 0.0, gap]
    normal = iq.exp([0.0, tilt, 0.0, 0.0, 0.0, 0.0])[:3, :3] @ UP
    aside, press = [], []
    for _ in range(round(seconds / DT)):
        tool = robot.pose(q)
        beside = tool[:3, 3] - foot
        depth = max(0.0, -float(normal @ beside)) if np.abs(beside[:2]).max() < box else 0.0
        reading = iq.inverse(tool @ sensor.mount)[:3, :3] @ (STIFFNESS * depth * normal)
        touch = sensor.tare(tool) + np.concatenate((reading + random.normal(0.0, 0.2, 3), np.zeros(3)))
        solution = loop.step(q, start, touch)
        q = q + DT * solution.velocity
        aside.append(robot.pose(q)[:2, 3] - start[:2, 3])
        press.append(STIFFNESS * depth)
    return np.array(aside), np.array(press), solution


@pytest.mark.parametrize("gap", [0.02, 0.001])
def test_a_press_straight_down_does_not_drift_sideways(gap):
    aside, press, solution = pressed(gap, seconds=1.5 + 100.0 * gap)
    assert np.abs(aside).max() < 1e-5
    assert press[-100:].mean() == pytest.approx(4.0, rel=0.02)
    assert solution.status == "ok"


def test_a_tool_does_not_slide_off_the_box_it_presses_on():
    # 2 mm to the edge, no friction, a normal told wrong.
    aside, press, solution = pressed(0.001, box=0.002, tilt=np.deg2rad(5.0))
    assert np.abs(aside).max() < 1e-4
    assert press[-100:].mean() * np.cos(np.deg2rad(5.0)) == pytest.approx(4.0, rel=0.02)
    assert solution.status == "ok"
