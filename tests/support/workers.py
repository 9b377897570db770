"""What worker processes run; they find it by this module's name."""


def fail(error):
    """Raise what was sent."""
    raise error


def give(value):
    """Return what was sent."""
    return value


def steps(loop, q, target, count):
    """The joint velocities of a few ticks."""
    velocities = []
    for _ in range(count):
        velocities.append(loop.step(q, target).velocity)
        q = q + loop.dt * velocities[-1]
    return velocities
