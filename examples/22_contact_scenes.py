"""What a press does in contacts of many kinds, on four arms: on springs without mass, and on MuJoCo.

Surfaces, a corner, an edge, a peg, a door, a screw. The controller is told the contact, except where the table says
that it is told wrong, and the stiffness only where the table says so. A second after the touch the path begins, and
half a second later errors count: of the path in the directions that the contact leaves free, of the true force against
the wanted one, none in a peg, a door and a screw. MuJoCo adds friction 0.3 (none from 1e5 N/m on), motors that lag by
10 ms and yield, commands 4 ms late and 0.3 N of noise; lag and dead time are told. `frames` is the largest change of a
joint velocity where frames of tool, sensor and contact are displaced and readings are the same.
`shared/contact_scenes.py` has the scenes.

Run: python examples/22_contact_scenes.py [arm ...] [--physics mujoco] [--seconds 5] [--scene NAME]
"""

from argparse import ArgumentParser

import numpy as np
from shared.contact_scenes import scenes

import invariantqp as iq
from invariantqp.robots import urdf_of
from invariantqp.workbench.runs.contactspec import Physics
from invariantqp.workbench.runs.plant import Measurement, PlantState

DT = 0.002  # [s]
TOUCH, SETTLED, STARTED, LONGEST = 0.3, 1.0, 0.5, 20.0  # [s] of a touch, after it, of the path's start, until the touch
PHYSICS = Physics(delay=0.004, force_noise=0.3, moment_noise=0.01)
LATE = {"ideal": 0.0, "mujoco": PHYSICS.lag + PHYSICS.delay}  # [s]
NOISE = {"ideal": 0.1, "mujoco": PHYSICS.force_noise}  # [N] a force component
SLIPPERY = 1e5  # [N/m]: MuJoCo presses what slides with friction x speed x damper at least, here 7 N of a wanted 5
ARMATURE = {"so101": 0.028}  # inertia of the motors' rotors [kg m^2], as published models have it; 0.1 elsewhere
ARMS = {  # joint positions at the start [rad], radius of the circle [m]
    "panda": ([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8], 0.03),
    "ur5": ([0.0, -1.2, 1.8, -2.2, -1.57, 0.0], 0.03),
    "xarm7": ([0.0, -0.3, 0.0, 1.0, 0.0, 1.3, 0.0], 0.03),
    "so101": ([0.1, -0.4, 0.5, 0.6, 0.2], 0.015),
}
OTHER = [iq.exp(s) for s in np.random.default_rng(1).uniform(-0.5, 0.5, (3, 6))]  # of contact, tool and sensor


class Springs:
    """An arm that moves as it is told, in a scene's own world."""

    def __init__(self, robot, q, scene):
        self.robot, self.q, self.scene, self.twist = robot, np.array(q), scene, np.zeros(6)
        self.random = np.random.default_rng(0)

    def state(self):
        tool = self.robot.pose(self.q)
        return PlantState(self.q, tool, self.scene.world(tool, self.twist))

    def measure(self):
        now = self.state()
        reading = iq.coadjoint(iq.inverse(now.pose)) @ now.wrench
        reading[3:] += self.random.normal(0.0, NOISE["ideal"], 3)
        return Measurement(self.q, reading)

    def command(self, velocity):
        self.twist = self.robot.jacobian(self.q) @ velocity
        self.q = self.q + DT * velocity


def plant_of(physics, name, robot, q, scene):
    if physics == "ideal":
        return Springs(robot, q, scene)
    from invariantqp.workbench.runs.mujoco import MujocoPlant

    friction = PHYSICS.friction if scene.touch.stiffness < SLIPPERY else 0.0
    cell = PHYSICS.model_copy(update={"armature": ARMATURE.get(name, 0.1), "friction": friction})
    return MujocoPlant(urdf_of(name), robot, q, DT, scene.touch, physics=cell)


def loops(robot, scene, physics):
    """The controller, and the same in displaced frames of contact, tool and sensor."""
    X, Y, Z = OTHER
    sensor = iq.WrenchSensor(np.eye(4), order="moment first", reads="reaction", cutoff=50.0, noise=NOISE[physics])
    task = iq.HybridTask(scene.told, scene.wanted, **scene.options)
    five = len(robot.names) < 6  # five joints turn the tool only as they can
    for arm, its_task, its_sensor, tip in (
        (robot, task, sensor, np.zeros(3)),
        (robot.with_tool(Y), task.relabelled(X, Y), sensor.relabelled(Z, Y), iq.inverse(Y)[:3, 3]),
    ):
        exact = iq.control.ExactPoint(tip) if five else None
        yield iq.HybridController(arm, its_task, dt=DT, sensor=its_sensor, exact=exact, delay=LATE[physics])


def run(name, robot, q, scene, physics, seconds, *, frames=False):
    """Path error [mm], force error rms, most and at the touch [N], time of the touch [s], change by `frames`, said."""
    plant, (loop, other) = plant_of(physics, name, robot, q, scene), loops(robot, scene, physics)
    k, touched, begins, first, force, off, said, change = 0, None, np.inf, [0.0], [], [], {}, 0.0
    while k * DT < (LONGEST if touched is None else touched + seconds):
        now, (target, ahead) = plant.state(), scene.path(max(0.0, k * DT - begins))
        if touched is None and np.abs(now.wrench).max() > 1e-6:
            touched = k * DT
            begins = touched + SETTLED
        since = -1.0 if touched is None else k * DT - touched
        missing = scene.missing(now.pose, now.wrench)
        if 0.0 <= since < TOUCH:
            first.append(missing or 0.0)
        if since > SETTLED + STARTED:
            off.append(1e3 * scene.off(now.pose, target))
            force += [] if missing is None else [missing]
        measured = plant.measure()
        solution = loop.step(measured.q, target, measured.wrench, ahead)
        if frames:
            displaced = iq.coadjoint(iq.inverse(OTHER[2])) @ measured.wrench
            there = other.step(measured.q, target @ OTHER[1], displaced, ahead)
            change = max(change, np.abs(there.velocity - solution.velocity).max())
        said[solution.status] = said.get(solution.status, 0) + 1
        plant.command(solution.velocity)
        k += 1
    if solution.status in ("overload", "fault") or not (off and force):
        off = force = [np.nan]  # it has left, or stands: nothing was done that errors could count of
    rms, most = np.sqrt(np.mean(np.square(force))), np.abs(force).max()
    shares = ", ".join(f"{name} {100.0 * n / k:.0f} %" for name, n in said.items())
    return max(off), rms, most, max(first), np.nan if touched is None else touched, change, shares


parser = ArgumentParser()
parser.add_argument("arms", nargs="*", choices=[[], *ARMS], default=[])
parser.add_argument("--physics", choices=LATE, default="ideal")
parser.add_argument("--seconds", type=float, default=5.0, help="after the touch")
parser.add_argument("--scene", default="")
given = parser.parse_args()
print(
    f"{'arm':7s}{'contact':26s}{'path, mm':>9s}{'force rms, N':>14s}{'most':>8s}{'touch':>8s}{'after, s':>9s}", end=""
)
print(f"{'frames':>9s}  said" if given.physics == "mujoco" else "  said")
for name in given.arms or ARMS:
    start, radius = ARMS[name]
    robot = iq.load_robot(name)
    for contact, scene in scenes(robot.pose(start), radius).items():
        if given.scene not in contact:
            continue
        if given.physics == "mujoco" and scene.touch is None:
            print(f"{name:7s}{contact:26s}MuJoCo has no shape for it")
            continue
        frames = given.physics == "mujoco"
        found = run(name, robot, start, scene, given.physics, given.seconds, frames=frames)
        path, rms, most, first, touched, change, said = found
        shown = f"{change:9.0e}" if frames else ""
        print(f"{name:7s}{contact:26s}{path:9.3f}{rms:14.3f}{most:8.2f}{first:8.2f}{touched:9.2f}{shown}  {said}")
