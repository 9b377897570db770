"""What a press of 5 N does on surfaces of many kinds, on four arms: a circle on each, with a sensor's noise.

Each surface pushes back along its own normal in proportion to how far the tip is in it; there is no friction. The
controller is told the surface, except where the table says that it is told wrong, and never the stiffness.

Run: python examples/22_contact_scenes.py [arm ...] [--seconds 5]
"""

from argparse import ArgumentParser
from math import cos, pi, sin

import numpy as np

import invariantqp as iq

DT, PRESS, TURN, SETTLED = 0.002, 5.0, 4.0, 1.0  # [s], [N], [s] a turn, [s] after the touch
ARMS = {  # joint positions at the start [rad], radius of the circle [m]
    "panda": ([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8], 0.03),
    "ur5": ([0.0, -1.2, 1.8, -2.2, -1.57, 0.0], 0.03),
    "xarm7": ([0.0, -0.3, 0.0, 1.0, 0.0, 1.3, 0.0], 0.03),
    "so101": ([0.1, -0.4, 0.5, 0.6, 0.2], 0.015),
}


def scenes(start):
    """Name, height (a function of a point, zero on the surface), stiffness [N/m], and what the controller is told."""
    z = -start[:3, 2]  # outwards, against the tool
    x = start[:3, 0]
    foot = start[:3, 3] - 0.002 * z

    def flat(n, k=1e4, told=None):
        told = n if told is None else told
        return lambda p: n @ (p - foot), k, lambda tool: iq.point_contact(tool[:3, 3], told)

    def round_(centre, radius, across):
        def height(p):
            return np.linalg.norm(across @ (p - centre)) - radius

        return height, 1e4, lambda tool: iq.contacts.surface_contact(tool[:3, 3], implicit=height)

    def turned(degrees):
        return iq.exp([*np.deg2rad(degrees) * x, 0, 0, 0])[:3, :3] @ z

    def wavy(p):
        return z @ (p - foot) + 0.01 * sin(40.0 * x @ (p - foot))

    return {
        "plane": flat(z),
        "plane, tilted 30 deg": flat(turned(30.0)),
        "normal told 5 deg wrong": flat(turned(5.0), told=z),
        "soft, 1e3 N/m": flat(z, 1e3),
        "hard, 1e5 N/m": flat(z, 1e5),
        "ball of 150 mm": round_(foot - 0.15 * z, 0.15, np.eye(3)),
        "bar of 100 mm": round_(foot - 0.1 * z, 0.1, np.eye(3) - np.outer(x, x)),
        "waves, by a function": (wavy, 1e4, lambda tool: iq.contacts.surface_contact(tool[:3, 3], implicit=wavy)),
    }


def run(robot, q, height, stiffness, contact, radius, seconds):
    """Error of the path [mm], rms and largest error of the true force [N], time of the touch [s], what was said."""
    random, start = np.random.default_rng(0), robot.pose(q)
    sensor = iq.WrenchSensor(np.eye(4), order="moment first", reads="reaction", cutoff=50.0, noise=0.1)
    exact = "position" if len(q) < 6 else None  # five joints turn the tool only as they can
    loop = iq.HybridController(robot, iq.HybridTask(contact, [PRESS]), dt=DT, sensor=sensor, exact=exact)
    touched, force, off, said = None, [], [], {}
    for k in range(round(seconds / DT)):
        tool, a = robot.pose(q), 2.0 * pi * k * DT / TURN
        p, n = tool[:3, 3], np.asarray(contact(tool).pose)[:3, 2]
        depth = max(0.0, -height(p))
        normal = np.array([height(p + 1e-6 * e) - height(p - 1e-6 * e) for e in np.eye(3)]) / 2e-6
        reading = np.concatenate((np.zeros(3), tool[:3, :3].T @ (stiffness * depth * normal)))
        reading += np.concatenate((np.zeros(3), random.normal(0.0, 0.1, 3)))
        target, ahead = start.copy(), np.zeros(6)
        target[:3, 3] += radius * start[:3, :3] @ [cos(a) - 1.0, sin(a), 0.0]
        ahead[3:] = 2.0 * pi / TURN * radius * start[:3, :3] @ [-sin(a), cos(a), 0.0]
        solution = loop.step(q, target, reading, ahead)
        q = q + DT * solution.velocity
        if depth and touched is None:
            touched = k * DT
        if touched is not None and k * DT > touched + SETTLED:
            miss = target[:3, 3] + DT * ahead[3:] - robot.pose(q)[:3, 3]
            off.append(1e3 * np.linalg.norm(miss - n * (n @ miss)))
            force.append(stiffness * depth - PRESS)
            said[solution.status] = said.get(solution.status, 0) + 1
    return max(off), np.sqrt(np.mean(np.square(force))), np.abs(force).max(), touched, max(said, key=said.get)


parser = ArgumentParser()
parser.add_argument("arms", nargs="*", choices=[[], *ARMS], default=[])
parser.add_argument("--seconds", type=float, default=5.0)
given = parser.parse_args()
print(f"{'arm':7s}{'surface':26s}{'path, mm':>10s}{'force rms, %':>14s}{'largest, %':>12s}{'touch, s':>10s}  mostly")
for name in given.arms or ARMS:
    q, radius = np.array(ARMS[name][0]), ARMS[name][1]
    robot = iq.load_robot(name)
    for surface, (height, stiffness, contact) in scenes(robot.pose(q)).items():
        path, rms, most, touched, said = run(robot, q, height, stiffness, contact, radius, given.seconds)
        shares = f"{100.0 * rms / PRESS:14.2f}{100.0 * most / PRESS:12.1f}"
        print(f"{name:7s}{surface:26s}{path:10.3f}{shares}{touched:10.2f}  {said}")
