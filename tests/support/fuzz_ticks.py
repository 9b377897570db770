"""Random ticks: any robot, limits, state, target, form and damping; what may never happen is counted, tick by tick.

`INVARIANTQP_FUZZ_TICKS=1000000 pytest tests/properties/test_stability_fuzz.py -n 0` runs a million.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

import invariantqp as iq
from invariantqp.errors import BadInput
from support.random_systems import motion

INSIDE = 1e-9
LOOP = 100  # ticks of one controller
NAMED = ("panda", "ur5", "so101")


def random_chain(rng):
    """1 to 8 joints, some repeated, some sliding, of any size."""
    m = int(rng.integers(1, 9))
    size = 10.0 ** rng.uniform(-3, 3) if rng.random() < 0.2 else 1.0
    slides = rng.random() < 0.2
    screws = []
    for _ in range(m):
        axis = rng.normal(size=3)
        if screws and rng.random() < 0.2:
            screws.append(screws[rng.integers(len(screws))])
        elif slides and rng.random() < 0.3:
            screws.append(size * iq.se3.prismatic(axis))
        else:
            aligned = np.eye(3)[rng.integers(3)]
            axis = aligned if rng.random() < 0.5 else axis
            screws.append(iq.revolute(axis, size * rng.normal(size=3) * (rng.random() > 0.1)))
    home = motion(rng, size)
    wide = rng.random() < 0.3
    low = -np.inf if wide else -rng.uniform(0.0, 3.0, m)
    high = np.inf if wide else rng.uniform(0.0, 3.0, m)
    speed = np.inf if rng.random() < 0.1 else 10.0 ** rng.uniform(-2, 1, m)
    return iq.robots.Chain(np.column_stack(screws), home, (), low, high, speed)


def random_form(rng, m):
    kind = rng.integers(5)
    if kind == 0:
        return float(rng.normal())
    if kind == 1:
        A = rng.normal(size=(6, 6))
        return iq.CarriedMetric(A @ A.T + 1e-3 * np.eye(6))
    if kind == 2:
        return iq.Complement(rng.normal(size=(6, max(1, 6 - m))))
    return None


def random_damping(rng):
    return (None, 0.0, 10.0 ** rng.uniform(-6, 0))[rng.integers(3)]


def random_state(rng, robot):
    """Anywhere in the range, often at a singular place, a limit, or outside."""
    m = len(robot.names)
    low, high = np.maximum(robot.position_lower, -3.0), np.minimum(robot.position_upper, 3.0)
    q = rng.uniform(low, high)
    place = rng.random(m)
    q = np.where(place < 0.1, 0.0, q)
    q = np.where((place > 0.1) & (place < 0.15), low, q)
    q = np.where((place > 0.15) & (place < 0.2), high, q)
    return q + (rng.normal(size=m) * 0.2 if rng.random() < 0.2 else 0.0)


def random_target(rng, robot, q):
    kind = rng.integers(4)
    if kind == 0:
        return robot.pose(q)
    if kind == 1:
        return motion(rng, 3.0)
    near = iq.exp(0.1 * rng.normal(size=6)) if kind == 2 else iq.exp([0.0, 0.0, np.pi, 0.0, 0.0, 0.0])
    return near @ robot.pose(q)


def spoilt(rng, q, target, ahead):
    """One of the inputs with a number that is none."""
    bad = (np.nan, np.inf, -np.inf)[rng.integers(3)]
    which = rng.integers(3)
    q, target, ahead = q.copy(), target.copy(), np.zeros(6) if ahead is None else ahead.copy()
    if which == 0:
        q[rng.integers(len(q))] = bad
    elif which == 1:
        target[rng.integers(3), rng.integers(4)] = bad
    else:
        ahead[rng.integers(6)] = bad
    return q, target, ahead


def fuzz(ticks, seed=0):  # noqa: C901 (one loop, every way to fail)
    """(counts of what happened, descriptions of what may not)."""
    rng = np.random.default_rng(seed)
    named = [iq.load_robot(name) for name in NAMED]
    counts, failures = Counter(), []
    done = 0

    def wrong(what):
        failures.append(f"{what}: seed {seed}, tick {done}, {robot!r}, {loop.options!r}")

    while done < ticks:
        robot = named[rng.integers(3)] if rng.random() < 0.3 else random_chain(rng)
        m = len(robot.names)
        dt = 10.0 ** rng.uniform(-4, -1)
        loop = iq.Controller(
            robot,
            dt=dt,
            gain=(None, 1.0 / dt, 1.01)[rng.integers(3)],  # of 1 and less it is asked whether 1/s is meant
            form=random_form(rng, m),
            damping=random_damping(rng),
            guard=bool(rng.random() < 0.8),
            exact="position" if rng.random() < 0.1 else None,
            point=(None, None, "own", rng.normal(size=3))[rng.integers(4)],
            length=10.0 ** rng.uniform(-3, 3) if rng.random() < 0.2 else None,
        )
        q = random_state(rng, robot)
        target = random_target(rng, robot, q)
        for _ in range(LOOP):
            if rng.random() < 0.1:
                q, target = random_state(rng, robot), random_target(rng, robot, q)
            ahead = rng.normal(size=6) * 10.0 ** rng.uniform(-3, 3) if rng.random() < 0.3 else None
            done += 1
            broken = rng.random() < 0.05
            asked = spoilt(rng, q, target, ahead) if broken else (q, target, ahead)
            try:
                solution = loop.step(*asked)
            except BadInput as error:
                counts["refused"] += 1
                if not broken and "millimetres" not in str(error):  # a small arm, and a target far away
                    wrong("refused")
                continue
            except Exception as error:  # noqa: BLE001
                wrong(f"{type(error).__name__} {error}")
                continue
            if broken:
                wrong("accepted bad input")
                continue
            x = solution.velocity
            counts[solution.status] += 1
            if not np.isfinite(x).all():
                wrong("not finite")
                continue
            moved = q + dt * x
            beyond = np.maximum(robot.position_lower - q, q - robot.position_upper).clip(0.0)
            after = np.maximum(robot.position_lower - moved, moved - robot.position_upper)
            if (np.abs(x) > robot.velocity_limit + INSIDE).any() or (after > beyond + INSIDE).any():
                wrong("outside limits")
                continue
            q = moved
    return counts, failures
