"""The ROS nodes of the examples, driven by a stand-in for rclpy."""

import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from support import ros
from support.repeats import repeats

import invariantqp as iq

EXAMPLES = Path(__file__).parents[2] / "examples"
UR5 = iq.load_robot("ur5")
START = np.array([0.0, -1.2, 1.8, -2.2, -1.57, 0.0])
STIFFNESS, NOISE = 2e4, 0.2  # [N/m], [N]


def run_node(name, monkeypatch, arguments=("ur5",)):
    node = ros.installed(monkeypatch)
    monkeypatch.setattr("sys.argv", [name, *arguments])
    runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    return node[0]


def state_of(q, robot=UR5):
    return ros.message("JointState", name=[*robot.names, "gripper"], position=[*q, 0.1])


@pytest.fixture
def press(monkeypatch):
    return run_node("38_force_ros", monkeypatch)


def publish_wrench(node, reading):
    """The wrench topic: force and moment (6,)."""
    vectors = (SimpleNamespace(x=v[0], y=v[1], z=v[2]) for v in (reading[:3], reading[3:]))
    wrench = SimpleNamespace(**dict(zip(("force", "torque"), vectors, strict=True)))
    node.subscribed["wrench"](ros.message("WrenchStamped", wrench=wrench))


def publish_contact(node, q, table, random):
    """The wrench topic, of a table and half a kilogram."""
    tool = UR5.pose(q)
    depth = max(0.0, table - tool[2, 3])
    at = tool[:3, :3].T @ np.array([0.0, 0.0, STIFFNESS * depth - 0.5 * 9.80665])
    moment = np.cross([0.0, 0.0, -0.03], tool[:3, :3].T @ [0.0, 0.0, -0.5 * 9.80665])
    publish_wrench(node, np.concatenate((at + random.normal(0.0, NOISE, 3), moment)))
    return STIFFNESS * depth


def pose_message(pose):
    """A PoseStamped of a pose (4, 4)."""
    R = pose[:3, :3]
    w = 0.5 * np.sqrt(max(0.0, 1.0 + np.trace(R)))
    x, y, z = iq.log(iq.transform(R))[:3]
    angle = max(np.linalg.norm([x, y, z]), 1e-12)
    share = np.sin(0.5 * angle) / angle
    place = SimpleNamespace(**dict(zip("xyz", pose[:3, 3], strict=True)))
    turn = SimpleNamespace(x=share * x, y=share * y, z=share * z, w=w)
    return ros.message("PoseStamped", pose=SimpleNamespace(position=place, orientation=turn))


@pytest.mark.parametrize("arm", repeats(["panda", "ur5"], ["ur5"]))
def test_a_press_on_a_table_in_mujoco(arm, monkeypatch):
    """A touch of 2e4 N/m, along it and back by poses that come every tenth tick, a quarter of a second of silence."""
    pytest.importorskip("mujoco")
    monkeypatch.syspath_prepend(str(EXAMPLES))
    from shared.cells import Cell, table

    node, cell, forces = run_node("38_force_ros", monkeypatch, (arm,)), Cell(arm, table(arm, 0.001), tick=0.002), []
    node.subscribed["press"](ros.message("Float64", data=8.0))
    for k in range(2000):
        if k % 10 == 0:
            aside = 0.01 * (1.0 - np.cos(max(0.0, 0.004 * k - 2.0)))
            node.subscribed["pose"](pose_message(iq.transform(translation=[0.0, aside, 0.0]) @ cell.home))
        q, reading = cell.read()
        if not 1250 < k < 1375:
            publish_wrench(node, reading)
            node.subscribed["joint_states"](state_of(q, cell.robot))
        elif k % 25 == 0:
            node.timers[0][1]()
        cell.drive(np.array(node.published[-1].data))
        forces.append(cell.pressed()[2])
    off = np.abs(np.array(forces) - 8.0)
    assert max(forces) < 9.5
    assert np.sqrt(np.mean(off[500:] ** 2)) < 0.2
    assert off[1250:1375].max() < 0.5
    statuses = {line.split(":")[0] for line in node.logged}
    assert "lost" in statuses <= {"lost", "limited"}  # as it brakes at the touch
    assert abs(cell.robot.pose(q)[1, 3] - cell.home[1, 3] - aside) < 1e-3


def test_missing_messages_stop_the_arm(press):
    press.subscribed["joint_states"](state_of(START))
    assert press.published == []  # no reading yet
    publish_contact(press, START, 0.0, np.random.default_rng(0))
    press.subscribed["joint_states"](state_of(START))
    assert np.abs(press.published[-1].data).max() > 0.0  # it approaches
    (period, watch), *_ = press.timers
    watch()
    assert len(press.published) == 1
    watch()
    assert press.published[-1].data == [0.0] * 6
    assert period == 0.05


def test_an_overload_is_logged_and_reset(press):
    for _ in range(3):
        wrench = SimpleNamespace(
            force=SimpleNamespace(x=0.0, y=0.0, z=90.0), torque=SimpleNamespace(x=0.0, y=0.0, z=0.0)
        )
        press.subscribed["wrench"](ros.message("WrenchStamped", wrench=wrench))
        press.subscribed["joint_states"](state_of(START))
    assert "overload: " in press.logged[-1]
    assert press.served["reset"](None, SimpleNamespace(success=False)).success
    publish_contact(press, START, 0.0, np.random.default_rng(0))
    press.subscribed["joint_states"](state_of(START))
    assert "lost: " in press.logged[-1]


def driven(node, topic, message, ticks, every=1):
    """Joint positions after ticks of a servo node that receives a message on every so many of them."""
    q, (_, tick) = START.copy(), node.timers[0]
    for k in range(ticks):
        if k % every == 0:
            node.subscribed[topic](message)
        node.subscribed["joint_states"](state_of(q))
        tick()
        q = q + 0.002 * np.array(node.published[-1].data)
    return q


def twist_message(linear=(0.0, 0.0, 0.0), angular=(0.0, 0.0, 0.0)):
    v, w = (SimpleNamespace(**dict(zip("xyz", part, strict=True))) for part in (linear, angular))
    return ros.message("TwistStamped", twist=SimpleNamespace(linear=v, angular=w))


def test_a_servo_node_follows_twists_and_stops_without_joint_states(monkeypatch):
    node = run_node("18_servo_ros", monkeypatch)
    q = driven(node, "servo/twist", twist_message(linear=(0.0, 0.05, 0.0)), 250, every=10)
    _, tick = node.timers[0]
    assert 0.015 < UR5.pose(q)[1, 3] - UR5.pose(START)[1, 3] < 0.03
    for _ in range(12):
        tick()
    assert node.published[-1].data == [0.0] * 6


def test_a_rotation_about_the_tool_does_not_translate_it(monkeypatch):
    node = run_node("18_servo_ros", monkeypatch)
    q = driven(node, "servo/twist", twist_message(angular=(0.2, 0.0, 0.0)), 500, every=10)
    moved = UR5.pose(q) @ iq.inverse(UR5.pose(START))
    assert np.linalg.norm(UR5.pose(q)[:3, 3] - UR5.pose(START)[:3, 3]) < 1e-3
    assert iq.log(moved)[0] == pytest.approx(0.2, abs=0.03)


def test_a_servo_node_goes_to_a_pose(monkeypatch):
    node = run_node("18_servo_ros", monkeypatch)
    target = iq.transform(translation=[0.0, 0.0, 0.05]) @ UR5.pose(START)
    q = driven(node, "servo/pose", pose_message(target), 1000)
    assert np.abs(UR5.pose(q) - target).max() < 1e-3
