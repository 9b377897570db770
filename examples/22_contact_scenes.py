"""What a press does in contacts of many kinds, on four arms, with a sensor's noise.

Surfaces, a corner, an edge, a peg, a door, a screw. The controller is told the contact, except where the table says
that it is told wrong, and the stiffness only where the table says so. Errors count from a second after the touch: of
the path in the directions that the contact leaves free, of the force against the wanted one, none in a peg, a door and
a screw. `shared/contact_scenes.py` has the scenes.

Run: python examples/22_contact_scenes.py [arm ...] [--seconds 5] [--scene NAME]
"""

from argparse import ArgumentParser

import numpy as np
from shared.contact_scenes import scenes

import invariantqp as iq

DT, NOISE, TOUCH, SETTLED = 0.002, 0.1, 0.3, 1.0  # [s], [N] a force component, [s] of a touch, [s] after it
ARMS = {  # joint positions at the start [rad], radius of the circle [m]
    "panda": ([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8], 0.03),
    "ur5": ([0.0, -1.2, 1.8, -2.2, -1.57, 0.0], 0.03),
    "xarm7": ([0.0, -0.3, 0.0, 1.0, 0.0, 1.3, 0.0], 0.03),
    "so101": ([0.1, -0.4, 0.5, 0.6, 0.2], 0.015),
}


def run(robot, q, scene, seconds):
    """Path error [mm], force error rms, most and at the touch [N], time of the touch [s], shares of what was said."""
    random = np.random.default_rng(0)
    sensor = iq.WrenchSensor(np.eye(4), order="moment first", reads="reaction", cutoff=50.0, noise=NOISE)
    task = iq.HybridTask(scene.told, scene.wanted, **scene.options)
    exact = "position" if len(q) < 6 else None  # five joints turn the tool only as they can
    loop = iq.HybridController(robot, task, dt=DT, sensor=sensor, exact=exact)
    touched, first, force, off, said, twist = None, [0.0], [], [], {}, np.zeros(6)
    for k in range(round(seconds / DT)):
        tool, (target, ahead) = robot.pose(q), scene.path(k * DT)
        wrench = scene.world(tool, twist)
        if wrench.any() and touched is None:
            touched = k * DT
        since = -1.0 if touched is None else k * DT - touched
        missing = scene.missing(tool, wrench)
        if 0.0 <= since < TOUCH:
            first.append(missing or 0.0)
        if since > SETTLED:
            off.append(1e3 * scene.off(tool, target))
            force += [] if missing is None else [missing]
        reading = iq.coadjoint(iq.inverse(tool)) @ wrench
        reading[3:] += random.normal(0.0, NOISE, 3)
        solution = loop.step(q, target, reading, ahead)
        said[solution.status] = said.get(solution.status, 0) + 1
        twist = robot.jacobian(q) @ solution.velocity
        q = q + DT * solution.velocity
    if solution.status == "overload":
        off = force = [np.nan]  # it has left
    rms, most = np.sqrt(np.mean(np.square(force))), np.abs(force).max()
    shares = ", ".join(f"{name} {100.0 * n / sum(said.values()):.0f} %" for name, n in said.items())
    return max(off), rms, most, max(first), touched, shares


parser = ArgumentParser()
parser.add_argument("arms", nargs="*", choices=[[], *ARMS], default=[])
parser.add_argument("--seconds", type=float, default=5.0)
parser.add_argument("--scene", default="")
given = parser.parse_args()
print(f"{'arm':7s}{'contact':26s}{'path, mm':>9s}{'force rms, N':>14s}{'most':>8s}{'touch':>8s}{'after, s':>9s}  said")
for name in given.arms or ARMS:
    q, radius = np.array(ARMS[name][0]), ARMS[name][1]
    robot = iq.load_robot(name)
    for contact, scene in scenes(robot.pose(q), radius).items():
        if given.scene in contact:
            path, rms, most, first, touched, said = run(robot, q, scene, given.seconds)
            print(f"{name:7s}{contact:26s}{path:9.3f}{rms:14.3f}{most:8.2f}{first:8.2f}{touched:9.2f}  {said}")
