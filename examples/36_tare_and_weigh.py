"""What hangs on a wrist, what it weighs, and a tare before each approach, with a sensor of which nothing is known.

Five tilts in free air give order, sign, mass, centre of mass and bias. A part that is picked up later is the force that
is then there beyond it. A bias that has drifted since is taken off by one reading in the air: bias = reading - tare.

Run: python examples/36_tare_and_weigh.py
"""

import numpy as np
from shared.cells import ARMS, DELAY, DT, NOISE, Cell

import invariantqp as iq

TOOL, PART = 0.5, 0.312  # [kg]
TILTS = 0.5 * np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])  # rotation vectors [rad]


def read(cell, seconds=0.5):
    """The mean of the readings of an arm that stands still, and the tool's pose."""
    readings = []
    for _ in range(round(seconds / DT)):
        q, reading = cell.read()
        cell.drive(np.zeros(len(q)))
        readings.append(reading)
    return np.mean(readings, axis=0), cell.robot.pose(q)


def tilted(cell):
    """Readings and poses of five tilts."""
    controller, found = iq.Controller(cell.robot, dt=DT, delay=DELAY, acceleration_limit=10.0), []
    for tilt in TILTS:
        target = cell.home @ iq.exp([*tilt, 0.0, 0.0, 0.0])
        for _ in range(round(2.0 / DT)):
            cell.drive(controller.step(cell.read()[0], target).velocity)
        found.append(read(cell))
    return found


for arm in ARMS:
    cell = Cell(arm, mass=TOOL, bias=1.5)
    readings, poses = zip(*tilted(cell), strict=True)
    guess = iq.WrenchSensor(np.eye(4), order="moment first", reads="action", noise=NOISE)  # wrong, but for the place
    check = guess.check(readings, poses)
    print(f"{arm:6s} {check.found}")
    sensor = check.sensor

    loaded = Cell(arm, mass=TOOL + PART, bias=1.5, seed=1)  # the same arm with the part in its hand
    reading, pose = read(loaded)
    weight = np.linalg.norm(sensor.load(reading, pose)[3:]) / 9.80665
    print(f"       the part weighs {1e3 * weight:.0f} g")

    cell.bias = cell.bias + np.array([0.8, 0.0, -0.6, 0.0, 0.0, 0.0])  # it drifts, as sensors do
    reading, pose = read(cell)
    before = np.linalg.norm(sensor.wrench(reading, pose)[3:])
    known = {"order": sensor.order, "reads": sensor.reads, "mass": sensor.mass, "centre": sensor.centre, "noise": NOISE}
    unloaded = iq.WrenchSensor(np.eye(4), **known)  # without a bias
    tared = iq.WrenchSensor(np.eye(4), **known, bias=reading - unloaded.tare(pose))
    after = np.linalg.norm(tared.wrench(*read(cell))[3:])
    print(f"       in the air it reads {before:.2f} N after a drift, {after:.2f} N after a tare")
