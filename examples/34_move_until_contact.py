"""Moves that a touch ends: straight down until a table is felt, and along a path until something is in its way.

A touch is one comparison: the wrench that the tool exerts, its weight taken off, against what the sensor's noise cannot
be. Then the joints brake inside their acceleration limits. What is read late presses on meanwhile, by stiffness times
speed times what is late, so the speed decides how hard it is. A `HybridController` can take over at the touch.

Run: python examples/34_move_until_contact.py
"""

import numpy as np
from shared.cells import ARMS, DELAY, DT, Cell, table

import invariantqp as iq

BELOW, SPEED, TOUCH = 0.03, 0.02, 3.0  # where the table is [m], how fast [m/s], what is a touch: 15 sigma of noise [N]


def moved_until_touch(cell, controller, move):
    """Where the tool was when it felt something (4, 4), and the most that it pressed with [N]."""
    felt, most = None, 0.0
    for _ in range(round(10.0 / DT)):
        q, reading = cell.read()
        tool = cell.robot.pose(q)
        if felt is None and np.linalg.norm(cell.sensor.wrench(reading, tool)[3:]) > TOUCH:
            felt = tool
        solution = move(q) if felt is None else controller.rest(q, "touched")
        cell.drive(solution.velocity)
        most = max(most, np.linalg.norm(cell.pressed()))
        if felt is not None and np.abs(solution.velocity).max() < 1e-3:
            return felt, most
    raise SystemExit("nothing was in the way")


def straight_down(_cell, controller):
    """What is asked for in a tick: (omega; v), the velocity of the tool point along the base's axes."""
    return lambda q: controller.follow(q, [0.0, 0.0, 0.0, 0.0, 0.0, -SPEED])


def along_an_arc(cell, controller):
    """Forwards and down, 0.1 m about a point below, as fast."""

    def arc(time):
        angle = SPEED * time / 0.1
        return iq.transform(translation=[0.0, 0.1 * np.sin(angle), 0.1 * (np.cos(angle) - 1.0)]) @ cell.home

    follower = iq.PathFollower(controller, arc, end=8.0, rate=1.0)
    follower.prepare(cell.read()[0])
    return follower.step


for arm in ARMS:
    for way in (straight_down, along_an_arc):
        cell = Cell(arm, table(arm, BELOW))
        controller = iq.Controller(cell.robot, dt=DT, delay=DELAY, acceleration_limit=20.0)
        tool, most = moved_until_touch(cell, controller, way(cell, controller))
        past = 1e3 * (cell.home[2, 3] - BELOW - tool[2, 3])
        name = way.__name__.replace("_", " ")
        print(f"{arm:6s} {name:14s} felt {past:.2f} mm behind the surface, {most:.1f} N at most")
