"""An arm led by hand: in all directions, in those that are chosen, and how heavy it feels.

A hand pulls at the tool with a spring of 300 N/m and goes 100 mm aside and 50 mm up in two seconds. A contact
says what stays under control, its freedoms; in its constraints a force of zero is wanted, so the tool yields there.

Run: python examples/33_hand_guiding.py [arm ...]
"""

import sys

import numpy as np
from shared.cells import ARMS, DELAY, DT, Cell

import invariantqp as iq
from invariantqp.contacts import Contact, ContactKind

EASE = 0.01  # how fast the tool yields [m/s per N]: with 10 N it moves by 0.1 m/s
TURNS, X, Y, Z = np.eye(6)[:, :3], *np.eye(6)[3:, :, None]  # twists (omega; v)
KEPT = {  # what stays where it is told to be; in all else the tool follows the hand
    "in all directions": TURNS,
    "on a level alone": np.hstack((TURNS, Z)),
    "up and down alone": np.hstack((TURNS, X, Y)),
}


def led(kept):
    """A contact that keeps these twists under control and gives way to the rest, at the tool, along the base's axes."""
    kind = ContactKind("hand", kept)
    return lambda tool: Contact(kind, iq.transform(translation=tool[:3, 3]))


for arm in sys.argv[1:] or ARMS:
    for name, kept in KEPT.items():
        cell = Cell(arm)
        task = iq.HybridTask(led(kept), np.zeros(6 - kept.shape[1]), compliance=EASE, max_force=60.0)
        loop = iq.HybridController(cell.robot, task, dt=DT, sensor=cell.sensor, delay=DELAY)
        most, statuses = 0.0, set()
        for tick in range(round(3.0 / DT)):
            q, reading = cell.read()
            share = min(1.0, tick * DT / 2.0)
            hand = cell.home[:3, 3] + share * np.array([0.0, 0.1, 0.05])
            force = 300.0 * (hand - cell.robot.pose(q)[:3, 3])
            cell.pull(force)
            solution = loop.step(q, cell.home, reading)
            cell.drive(solution.velocity)
            most = max(most, np.linalg.norm(force)) if share < 1.0 and "all" in name else most
            statuses.add(solution.status)
        moved = 1e3 * (cell.robot.pose(q)[:3, 3] - cell.home[:3, 3])
        turned = np.degrees(np.linalg.norm(iq.log(iq.inverse(cell.home) @ cell.robot.pose(q))[:3]))
        pull = f", pulled with {most:.1f} N" if most else ""
        print(f"{arm:6s} {name:21s} moved by {moved.round(1)} mm, turned by {turned:.2f} deg{pull}; {statuses}")
