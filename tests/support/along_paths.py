"""Followers of paths, driven to their ends."""

import numpy as np

import invariantqp as iq
from support.streams import run


def speeds(robot):
    return np.where(np.isfinite(robot.velocity_limit), robot.velocity_limit, 2.0)


def straight(home, *way):
    """A path from a pose along a straight line."""
    return lambda u: iq.transform(home[:3, :3], home[:3, 3] + u * np.array(way))


def follower_on(robot, pose, at=None, dt=0.004, rise=0.2, *, options=None, **given):
    """Joints take `rise` to their speed, or nothing limits that; prepared where it is said to be."""
    loop = iq.Controller(robot, dt=dt, acceleration_limit=rise and speeds(robot) / rise, **(options or {}))
    follower = iq.PathFollower(loop, pose, **given)
    if at is not None:
        follower.prepare(at)
    return follower


def drive(follower, q, ticks=6000, during=None, override=None, push=None):
    """Solutions, joint positions and velocities until the path ends; `push` moves the joints in the tick it is for."""

    def before(k, q):
        if during is not None:
            during(k, follower)
        return q + (push or {}).get(k, 0.0)

    options = override and (lambda k, q: {"override": override(k)})
    end = {"dt": follower.controller.dt, "clock": None, "until": ("done", "blocked")}
    made = run(follower, q, ticks, before=before, options=options, **end)
    return made.answers, made.Q, made.V


def quickest(velocity, acceleration, joints, end=1.0):
    """The time that TOPP-RA needs for a path of the joints inside limits (m,)."""
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

    toppra.setup_logging("ERROR")
    grid = np.linspace(0.0, end, 201)
    limits = [
        kind(np.c_[-most, most])
        for kind, most in ((JointVelocityConstraint, velocity), (JointAccelerationConstraint, acceleration))
    ]
    way = toppra.SplineInterpolator(grid, np.array([joints(u) for u in grid]))
    return TOPPRA(limits, way, gridpoints=grid).compute_trajectory().duration
