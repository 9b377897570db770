"""A Panda at a share of its speed with a pen on paper, and half a circle to draw."""

import numpy as np

import invariantqp as iq
from support.spring_plane import PANDA, Bench, circle, pen

DT, RADIUS, PERIOD = 4e-3, 0.03, 0.4


def slow_bench(share=1.0 / 15.0, dt=DT, **task):
    """A Panda at a fifteenth of its speed, with a pen on paper."""
    robot = iq.load_robot("panda")
    limits = (robot.position_lower, robot.position_upper, share * robot.velocity_limit)
    return Bench(
        iq.robots.Chain(robot.screws, robot.home, robot.names, *limits),
        PANDA,
        pen(**task),
        dt=dt,
        acceleration_limit=5.0,
    )


def prepared(yields=0.0, **given):
    """That bench, half a circle on the paper, and a follower that has looked along it."""
    bench = slow_bench(yields=yields)
    path = circle(bench.start, RADIUS, PERIOD)
    follower = iq.PathFollower(bench.loop, lambda t: path(t)[0], end=PERIOD / 2, **given)
    follower.prepare(bench.q)
    return bench, path, follower


def off_circle(bench):
    return abs(np.linalg.norm(bench.robot.pose(bench.q)[:2, 3] - bench.start[:2, 3] + [RADIUS, 0.0]) - RADIUS)
