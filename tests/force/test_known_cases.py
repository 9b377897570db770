"""What users of force controllers report: a press straight down drifts sideways, a tool slides off its box.

Reports: fzi-forschungszentrum-informatik/cartesian_controllers, issues 31, 73 and 178. And the hybrid tests of
isaac-sim/IsaacLab (test_operational_space.py), three of which its pull request 7854 keeps as expected failures, since
motion and force are coupled there: targets that jump along a wall, other gains, a slope in its own frame.
"""

import numpy as np
import pytest
from support.plane import UP, force_at, tip

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


@pytest.mark.parametrize("gap", [0.008, 0.001])
def test_a_press_straight_down_does_not_drift_sideways(gap):
    aside, press, solution = pressed(gap, seconds=2.5 + 400.0 * gap)
    assert np.abs(aside).max() < 1e-5
    assert press[-100:].mean() == pytest.approx(4.0, rel=0.02)
    assert solution.status == "ok"


def test_a_tool_does_not_slide_off_the_box_it_presses_on():
    # 2 mm to the edge, no friction, a normal declared wrong.
    aside, press, solution = pressed(0.001, box=0.002, tilt=np.deg2rad(5.0))
    assert np.abs(aside).max() < 1e-4
    assert press[-100:].mean() * np.cos(np.deg2rad(5.0)) == pytest.approx(4.0, rel=0.02)
    assert solution.status in ("ok", "limited")


ALONG_X = [[0, 0, 1], [0, -1, 0], [1, 0, 0]]  # the tool presses along x
TURNED = iq.exp([0.0, 2.0 * np.arctan2(0.5774, 0.8165) - np.pi / 2.0, 0.0, 0.0, 0.0, 0.0])[:3, :3] @ ALONG_X
SLOPE = iq.exp([0.0, np.pi / 4.0, 0.0, 0.0, 0.0, 0.0])[:3, :3] @ ALONG_X  # 45 deg down
WALL = [((0.6, 0.2, 0.5), ALONG_X, 10.0), ((0.6, -0.29, 0.6), ALONG_X, 10.0), ((0.6, 0.1, 0.8), TURNED, 4.0)]
RAMP = [((0.6, 0.15, 0.3), SLOPE, 10.0), ((0.6, -0.3, 0.3), SLOPE, 10.0), ((0.8, 0.0, 0.5), SLOPE, 10.0)]
ELBOW = {  # a start in the middle of the joints' ranges
    id(WALL): [-1.311, -1.305, 1.359, -2.058, 2.603, 2.87, -0.572],
    id(RAMP): [-1.392, -0.887, 1.64, -2.222, 1.589, 2.709, 0.032],
}
HYBRID = {
    "fixed gains": (WALL, [1.0, 0.0, 0.0], {}),
    "other gains": (WALL, [1.0, 0.0, 0.0], {"gain": 12.0}),
    "a slope in its own frame, a posture": (RAMP, [np.sqrt(0.5), 0.0, -np.sqrt(0.5)], {"posture_gain": 2.0}),
}


@pytest.mark.cases(1)
@pytest.mark.parametrize("case", HYBRID)
def test_targets_that_jump_along_a_wall_do_not_change_the_press(case):
    goals, into, options = HYBRID[case]
    robot, into = iq.load_robot("panda"), np.array(into)
    targets = [iq.transform(rotation=R, translation=p) for p, R, _ in goals]
    q = iq.solve_pose(robot, targets[0], q0=ELBOW[id(goals)]).q
    foot = targets[0][:3, 3] + 0.005 * into
    task = iq.HybridTask(
        lambda tool: iq.point_contact(tool[:3, 3], -into), [10.0], stiffness=STIFFNESS, slide_speed=np.inf
    )
    loop = iq.HybridController(robot, task, dt=DT, order="moment first", **options)
    before = 0.0
    for target, (_, _, wanted) in zip(targets, goals, strict=True):
        press = []
        for _ in range(300):
            p = robot.pose(q)[:3, 3]
            press.append(STIFFNESS * max(0.0, float(into @ (p - foot))))
            solution = loop.step(q, target, force_at(p, press[-1] * into), wanted=[wanted])
            q = q + DT * solution.velocity
        # Half a metre at once, and the press is off by a quarter at most while the joints are as fast as they can.
        assert max(press) < 1.25 * max(wanted, before)
        assert press[-1] == pytest.approx(wanted, rel=5e-3)
        miss = robot.pose(q)[:3, 3] - target[:3, 3]
        assert np.linalg.norm(miss - into * (into @ miss)) < 1e-4
        assert solution.status == "ok"
        before = wanted
