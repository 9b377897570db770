"""Record a demonstration: joint positions and a sensor's readings from a driver's loop, into a file for `identify`.

A person leads the arm by its wrist, the tool in contact. `Driver` stands for a driver's calls (libfranka, RTDE, ROS 2
topics): here an arm that is led along a door's hinge, with a sensor of 0.3 N noise. Everything else is as at a robot:

- read joints and sensor in the same tick, in one order that the header says;
- nothing is filtered: noise is told by its jitter;
- move every way the contact gives, push and pull every way it does not, three to ten seconds.

Run: python examples/30_record_a_demonstration.py [door.csv]
"""

import csv
import sys
from pathlib import Path
from tempfile import gettempdir

import numpy as np

import invariantqp as iq

HZ, SECONDS = 100, 5.0
NAMES = ("fx", "fy", "fz", "mx", "my", "mz")


class Driver:
    """An arm that is led: joints as they are read, and the reaction at the tool."""

    def __init__(self, robot, start):
        self.robot, self.q, self.time = robot, np.array(start), 0.0
        T = robot.pose(self.q)
        self.first, self.hinge = T, iq.revolute([0.0, 0.0, 1.0], T[:3, 3] + [0.0, 0.3, 0.0])
        self.random = np.random.default_rng(1)
        self.waves = self.random.uniform(0.2, 0.9, 6), self.random.uniform(0.0, 6.0, 6)

    def read(self):
        """Joint positions [rad] and a reading (forces, moments) of the sensor in the tool frame."""
        self.time += 1.0 / HZ
        door = iq.exp(0.3 * np.sin(2.0 * self.time) * self.hinge) @ self.first
        for _ in range(3):  # the hand keeps the tool on the door
            J, error = self.robot.jacobian(self.q), iq.log(door @ iq.inverse(self.robot.pose(self.q)))
            self.q = self.q + np.linalg.pinv(J) @ error
        push = np.repeat([0.3, 5.0], 3) * np.sin(2.0 * np.pi * self.waves[0] * self.time + self.waves[1])
        base = iq.coadjoint(self.robot.pose(self.q)) @ push
        base = base - self.hinge * (self.hinge @ base) / (self.hinge @ self.hinge)  # no push along the hinge's own way
        felt = -iq.coadjoint(iq.inverse(self.robot.pose(self.q))) @ base + self.random.normal(size=6) * np.repeat(
            [0.02, 0.3], 3
        )
        return self.q + 1e-5 * self.random.normal(size=len(self.q)), felt[[3, 4, 5, 0, 1, 2]]


def record(driver, file):
    """Read once a tick and write a line; a real loop waits for the next tick where this one goes on at once."""
    with Path(file).open("w", newline="", encoding="utf-8") as lines:
        table = csv.writer(lines)
        table.writerow(("time", *driver.robot.names, *NAMES))
        for tick in range(int(SECONDS * HZ)):
            q, reading = driver.read()
            table.writerow((f"{tick / HZ:.4f}", *(f"{x:.7f}" for x in q), *(f"{x:.5f}" for x in reading)))


def main():
    file = sys.argv[1] if len(sys.argv) > 1 else str(Path(gettempdir()) / "door.csv")
    robot = iq.load_robot("panda")
    driver = Driver(robot, [0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])
    record(driver, file)
    print(f"written: {file}; invariantqp identify {file} --robot panda --reads reaction")
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    poses = [robot.pose(q) for q in rows[:, 1:8]]
    sensor = iq.WrenchSensor(np.eye(4), order="force first", reads="reaction")
    found = iq.contacts.identify(poses, rows[:, 8:], sensor=sensor)
    print(
        found.kind,
        "about",
        np.round(found.axis, 3),
        "through",
        np.round(found.point, 3),
        "candidates",
        found.candidates,
    )
    if found.kind != "hinge":
        raise SystemExit("this is a hinge")


if __name__ == "__main__":
    main()
