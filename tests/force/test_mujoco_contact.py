"""MuJoCo's own contact, as it is by default, and its position servos: a referee that nobody made for this law."""

import numpy as np
import pytest

import invariantqp as iq

mujoco = pytest.importorskip("mujoco")

PRESS = 10.0
GANTRY = """
<mujoco>
  <option integrator="implicitfast" timestep="0.001"/>
  <worldbody>
    <geom name="table" type="plane" size="1 1 0.1" friction="0.3"/>
    <body pos="0 0 0.012">
      <joint name="x" type="slide" axis="1 0 0" range="-1 1" limited="true"/>
      <joint name="y" type="slide" axis="0 1 0" range="-1 1" limited="true"/>
      <joint name="z" type="slide" axis="0 0 1" range="-1 1" limited="true"/>
      <joint name="roll" axis="1 0 0" range="-1 1" limited="true"/>
      <joint name="pitch" axis="0 1 0" range="-1 1" limited="true"/>
      <joint name="yaw" axis="0 0 1" range="-1 1" limited="true"/>
      <geom name="tip" type="sphere" size="0.01" mass="8" friction="0.3"/>
      <site name="tip"/>
    </body>
  </worldbody>
  <actuator>
    <position joint="x" kp="5e4" kv="1000"/>
    <position joint="y" kp="5e4" kv="1000"/>
    <position joint="z" kp="5e4" kv="1000"/>
    <position joint="roll" kp="500" kv="10"/>
    <position joint="pitch" kp="500" kv="10"/>
    <position joint="yaw" kp="500" kv="10"/>
  </actuator>
</mujoco>
"""


def pressed(tmp_path, dt, seconds, reads=None, speed=0.0):
    """The true press of each tick [N] and its status; `reads` makes a reading of it, from 2 s on."""
    file = tmp_path / "gantry.xml"
    file.write_text(GANTRY)
    robot = iq.load_robot(file, tool="tip", velocity_limit=np.ones(6))
    task = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], [0.0, 0.0, 1.0]), [PRESS])
    sensor = iq.WrenchSensor(np.eye(4), order="force first", reads="reaction", noise=0.1)
    loop = iq.HybridController(robot, task, dt=dt, sensor=sensor, delay=0.02)
    model = mujoco.MjModel.from_xml_string(GANTRY)
    model.opt.gravity[:] = 0.0
    data, random, command, force = mujoco.MjData(model), np.random.default_rng(1), np.zeros(6), np.zeros(6)
    start, press, presses, said = robot.pose(np.zeros(6)), 0.0, [], []
    for k in range(round(seconds / dt)):
        q, t = data.qpos.copy(), k * dt
        read = press if reads is None or t < 2.0 else reads
        turn, target, ahead = robot.pose(q)[:3, :3], start.copy(), np.zeros(6)
        target[0, 3] += speed * max(0.0, t - 2.0)
        ahead[3] = speed * (t > 2.0)
        reading = np.concatenate((turn.T @ [0.0, 0.0, read] + random.normal(0.0, 0.1, 3), np.zeros(3)))
        solution = loop.step(q, target, reading, ahead)
        for _ in range(round(dt / model.opt.timestep)):
            command = command + model.opt.timestep * solution.velocity
            data.ctrl[:] = command
            mujoco.mj_step(model, data)
        press = 0.0
        for c in range(data.ncon):
            mujoco.mj_contactForce(model, data, c, force)
            press += force[0]
        presses.append(press)
        said.append(str(solution.status))
    return np.array(presses), said


@pytest.mark.parametrize("dt", [0.002, 0.01])
def test_a_press_is_held(tmp_path, dt):
    presses, said = pressed(tmp_path, dt, 5.0)
    assert set(said) == {"lost", "ok"}
    assert presses.max() < 1.2 * PRESS
    assert presses[-round(1.5 / dt) :] == pytest.approx(PRESS, abs=0.02 * PRESS)


@pytest.mark.parametrize("dt", [0.002, 0.01])
@pytest.mark.parametrize("share", [0.5, 0.9, 1.1, 1.9])
def test_a_reading_that_sticks_is_a_fault_before_it_presses_much_harder(tmp_path, share, dt):
    presses, said = pressed(tmp_path, dt, 8.0, reads=share * PRESS)
    assert said[-1] == "fault"
    assert presses.max() < 2.5 * PRESS


@pytest.mark.parametrize("dt", [0.002, 0.004])
def test_what_chatters_is_held_in_its_mean(tmp_path, dt):
    presses, said = pressed(tmp_path, dt, 8.0, speed=0.02)
    assert {"fault", "overload"}.isdisjoint(said)
    assert np.mean(presses[-round(4.0 / dt) :]) == pytest.approx(PRESS, rel=0.1)
