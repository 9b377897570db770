"""The part controller in robosuite's own loop. `.ci/run` makes the environment that robosuite needs."""

import logging

import numpy as np
import pytest

import invariantqp as iq

pytest.importorskip("robosuite")
logging.disable(logging.WARNING)  # robosuite says where its optional files are
import robosuite  # noqa: E402

from invariantqp.robosuite import controller_config  # noqa: E402

PART = "right"


def make(task, robot, **options):
    given = {"has_renderer": False, "has_offscreen_renderer": False, "use_camera_obs": False, "control_freq": 20}
    env = robosuite.make(task, robots=robot, controller_configs=controller_config(robot, **options), seed=0, **given)
    env.reset()
    return env, env.robots[0].part_controllers[PART]


def action_of(env, pose, speed=(0.0, 0.0, 0.0), press=0.0):
    arm = [*pose[:3, 3], *iq.log(iq.transform(pose[:3, :3], np.zeros(3)))[:3], *speed, press]
    return np.concatenate((arm, np.zeros(env.action_dim - 10)))


@pytest.mark.parametrize("robot", ["Panda", "UR5e"])
def test_an_arm_reaches_a_pose_inside_its_limits(robot):
    env, part = make("Lift", robot, velocity_limit=0.7, acceleration_limit=20.0)
    target = iq.transform(translation=[0.1, 0.08, 0.1]) @ part._tool()
    target[:3, :3] = target[:3, :3] @ iq.exp([0.0, 0.0, 0.4, 0.0, 0.0, 0.0])[:3, :3]
    fastest = 0.0
    for _ in range(50):
        env.step(action_of(env, target))
        fastest = max(fastest, np.abs(env.sim.data.qvel[part.qvel_index]).max())
    part.update(force=True)
    assert np.abs(part._tool() - target).max() < 1e-3
    assert 0.5 < fastest < 0.8  # commanded at most 0.7
    assert part.solution.status == "ok"


def test_a_target_moves_between_two_actions():
    env, part = make("Lift", "Panda")
    pose = part._tool().copy()
    for k in range(40):
        at = iq.transform(translation=[0.0, 0.05 * 0.05 * k, 0.0]) @ pose
        env.step(action_of(env, at, speed=(0.0, 0.05, 0.0)))
    part.update(force=True)
    assert abs(part._tool()[1, 3] - pose[1, 3] - 0.05 * 2.0) < 2e-3


def test_the_sensor_has_the_models_load():
    env, part = make("Lift", "Panda")
    for turn in ([0.4, 0.0, 0.0], [0.0, 0.4, 0.0]):
        pose = part._tool() @ iq.exp([*turn, 0.0, 0.0, 0.0])
        for _ in range(30):
            env.step(action_of(env, pose))
        part.update(force=True)
        reading = np.concatenate([part._read(name) for name in ("force_ee", "torque_ee")])
        assert np.linalg.norm(reading[:3]) > 5.0  # the hand's weight
        assert np.linalg.norm(part.hybrid.sensor.wrench(reading, part._tool())[3:]) < 0.05


def test_the_force_on_robosuites_table_is_the_commanded_press():
    env, part = make("Wipe", "Panda", press={"max_force": 60.0}, position_margin=0.12)
    down = np.diag([1.0, -1.0, -1.0])
    table = env.model.mujoco_arena.table_offset[2]
    above = iq.transform(down @ iq.exp([0, 0, np.pi / 2, 0, 0, 0])[:3, :3], [*part._tool()[:2, 3], table + 0.01])
    for _ in range(40):
        env.step(action_of(env, above))
    pressed = []
    for _ in range(120):
        env.step(action_of(env, above, press=20.0))
        pressed.append(np.linalg.norm(env.robots[0].ee_force[PART]))
    assert part.solution.status in ("ok", "degraded")
    assert abs(np.mean(pressed[-20:]) - 20.0) < 1.5
    assert max(pressed) < 60.0
    env.step(action_of(env, above))
    assert part.solution.status == "ok"


def test_invalid_actions_are_named():
    env, _ = make("Lift", "Panda")
    with pytest.raises(iq.BadInput, match="action"):
        env.step(np.full(env.action_dim, np.nan))
    with pytest.raises(iq.BadInput, match="gain"):
        make("Lift", "Panda", gain=-1.0)
