"""A Panda or a UR5 in MuJoCo, as a driver offers it: joint positions and a wrench in, joint velocities out.

Motors lag by 10 ms and commands come 4 ms late, as `DELAY` tells; the sensor in the wrist has 0.2 N of noise, reads
forces first, what the world does to the tool, and carries the tool. Replace `Cell` by the calls of your own driver.
"""

import numpy as np

import invariantqp as iq
from invariantqp.robots import urdf_of
from invariantqp.workbench.runs.contactspec import Physics
from invariantqp.workbench.runs.mujoco import MujocoPlant
from invariantqp.workbench.runs.plant import Plane, SimulatedSensor, SurfaceSprings

DT, DELAY, NOISE = 0.004, 0.014, 0.2  # [s], [s], [N]
# Joint positions with the tool straight down [rad].
ARMS = {"panda": [0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8], "ur5": [0.0, -1.2, 1.8, -2.1708, -1.5708, 0.0]}


class Cell:
    """One arm at its start, and what touches it; `home` is the tool's pose there."""

    def __init__(self, arm, touch=None, mass=0.5, centre=(0.0, 0.0, -0.03), bias=0.0, seed=0, tick=DT):
        self.robot = iq.load_robot(arm)
        self.home = self.robot.pose(ARMS[arm])
        self.bias = np.array([bias, -bias, bias, 0.0, 0.0, 0.0])
        physics = Physics(delay=0.004, force_noise=NOISE, moment_noise=0.01, armature=0.1, seed=seed)
        hangs = SimulatedSensor(np.eye(4), mass, centre)
        self.plant = MujocoPlant(urdf_of(arm), self.robot, np.array(ARMS[arm]), tick, touch, hangs, physics)
        # What the controller is told of the sensor.
        self.sensor = iq.WrenchSensor(
            np.eye(4), order="force first", reads="reaction", mass=mass, centre=centre, cutoff=30.0, noise=NOISE
        )

    def read(self):
        """Joint positions [rad], and the sensor's six numbers."""
        q, wrench = self.plant.measure()
        return q, np.concatenate((wrench[3:], wrench[:3])) + self.bias

    def drive(self, velocity):
        """Joint velocities for one tick [rad/s]."""
        self.plant.command(velocity)

    def pull(self, force):
        """A hand that pulls at the tool from now on [N], base frame."""
        self.plant.data.xfrc_applied[self.plant.model.body("sensor").id, :3] = force

    def pressed(self):
        """What really pushes on the tool [N], base frame."""
        return self.plant.state().wrench[3:]


def table(arm, below=0.02, stiffness=2e4):
    """A table under an arm's tip, `below` its start [m], of a stiffness [N/m]."""
    tip = iq.load_robot(arm).pose(ARMS[arm])[:3, 3]
    up = np.array([0.0, 0.0, 1.0])
    return SurfaceSprings(np.zeros((1, 3)), Plane(tip - below * up, up, ()), stiffness)
