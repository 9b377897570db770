"""Ticks of every kind, for whoever watches the engine."""

import numpy as np

import invariantqp as iq
from support.streams import Arm


def clearances(arm, rng):
    """Goals beside a table, a box and a ball that comes nearer, with and without acceleration limits and a delay."""
    tool = arm.robot.pose(arm.start)
    ball = iq.limits.Sphere(tool[:3, 3] + [0.0, 0.2, 0.1], 0.08, name="ball")
    box = iq.limits.Box(iq.transform(translation=tool[:3, 3] + [0.25, 0.0, 0.0]), [0.1, 0.1, 0.1], name="box")
    table = iq.limits.HalfSpace([0.0, 0.0, tool[2, 3] - 0.1], [0.0, 0.0, 1.0], name="table")
    finger = iq.limits.Capsule([0.0, 0.0, 0.0], [0.0, 0.0, 0.1], 0.03, name="finger")
    clearance = iq.limits.Clearance(arm.robot, {"tool": [finger]}, [table, box, ball], distance=0.02)
    for options in ({}, {"delay": 0.008}, {"acceleration_limit": arm.acceleration, "delay": 0.008}):
        loop, q = iq.Controller(arm.robot, dt=arm.dt, limits=[clearance], exact=arm.exact, **options), arm.start
        for k in range(25):
            target = tool @ iq.transform(translation=0.3 * rng.normal(size=3))
            ball.move(iq.transform(translation=[0.0, -0.002 * k, 0.0]), [0.0, 0.0, 0.0, 0.0, -1.0, 0.0])
            q = q + arm.dt * loop.step(q, target).velocity


def presses(arm, rng):
    """A stiff surface that is come to and slid along."""
    tool = arm.robot.pose(arm.start)
    task = iq.HybridTask(iq.point_contact(tool[:3, 3], [0.0, 0.0, 1.0]), [5.0])
    sensor = iq.WrenchSensor(np.eye(4), order="force first", reads="reaction", cutoff=50.0)
    loop, q = iq.HybridController(arm.robot, task, dt=arm.dt, sensor=sensor), arm.start
    for k in range(80):
        depth = tool[2, 3] - 1e-3 - arm.robot.pose(q)[2, 3]
        force = arm.robot.pose(q)[:3, :3].T[:, 2] * 2e4 * max(0.0, depth) + 0.1 * rng.normal(size=3)
        reading = np.concatenate((force, np.zeros(3)))
        q = q + arm.dt * loop.step(q, tool @ iq.transform(translation=[5e-4 * k, 0.0, 0.0]), reading).velocity


def follows(arm, rng):
    """Points, another chunk of them, a twist, and a path."""
    follower, q = arm.follower(), arm.start
    follower.follow([arm.robot.pose(q), arm.robot.pose(q + 0.1)], [0.0, 0.2])
    for k in range(120):
        if k == 30:
            follower.follow(q + 0.05 * rng.normal(size=(3, len(q))), [0.1, 0.2, 0.3])
        elif k == 60:
            follower.twist([0.0, 0.0, 0.2, 0.1, 0.0, 0.0])
        q = q + arm.dt * follower.step(q, now=arm.dt * k).velocity
    path, q = iq.PathFollower(arm.controller(), lambda u: arm.robot.pose(arm.start + 0.2 * u)), arm.start
    path.prepare(q)
    for _ in range(60):
        q = q + arm.dt * path.step(q).velocity


def main():
    for name in ("panda", "ur5", "so101"):
        arm, rng = Arm(name), np.random.default_rng(0)
        clearances(arm, rng)
        follows(arm, rng)
        if len(arm.start) > 5:
            presses(arm, rng)
        iq.solve_pose(arm.robot, arm.robot.pose(arm.start + 0.3 * rng.normal(size=len(arm.start))))
        iq.solve_velocity(arm.robot.jacobian(arm.start), rng.normal(size=6))


if __name__ == "__main__":
    main()
