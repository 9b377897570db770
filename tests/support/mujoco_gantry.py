"""A gantry with position servos, and a ball at its end that rubs on a table, in MuJoCo."""

import mujoco
import numpy as np

import invariantqp as iq

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


class Gantry:
    """The arm, its start, and a tick of its servos; the true press [N] is read with noise by a sensor at the tip."""

    def __init__(self, dt, press=10.0, **options):
        self.dt, self.model = dt, mujoco.MjModel.from_xml_string(GANTRY)
        self.model.opt.gravity[:] = 0.0
        self.robot = iq.load_robot(self.model, tool="tip", velocity_limit=np.ones(6))
        task = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], [0.0, 0.0, 1.0]), [press])
        sensor = iq.WrenchSensor(np.eye(4), order="force first", reads="reaction", noise=0.1)
        self.loop = iq.HybridController(self.robot, task, dt=dt, sensor=sensor, delay=0.02, **options)
        self.start, self.data = self.robot.pose(np.zeros(6)), mujoco.MjData(self.model)
        self.random, self.command, self.press = np.random.default_rng(1), np.zeros(6), 0.0

    @property
    def q(self):
        return self.data.qpos.copy()

    def reading(self, press):
        force = self.robot.pose(self.q)[:3, :3].T @ [0.0, 0.0, press] + self.random.normal(0.0, 0.1, 3)
        return np.append(force, np.zeros(3))

    def drive(self, velocity):
        for _ in range(round(self.dt / self.model.opt.timestep)):
            self.command = self.command + self.model.opt.timestep * velocity
            self.data.ctrl[:] = self.command
            mujoco.mj_step(self.model, self.data)
        self.press, force = 0.0, np.zeros(6)
        for c in range(self.data.ncon):
            mujoco.mj_contactForce(self.model, self.data, c, force)
            self.press += force[0]
