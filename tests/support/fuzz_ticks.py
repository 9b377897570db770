"""Random ticks: any robot, limits, state, target, form and damping; what may never happen is counted, tick by tick.

`INVARIANTQP_FUZZ_TICKS=1000000 pytest tests/properties/test_stability_fuzz.py -n 0` runs a million.
"""

from __future__ import annotations

import re
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


def random_limits(rng, m, dt):
    """Options of a controller: limits that standing still meets, and a delay of some ticks."""
    rows, k = {}, int(rng.integers(1, 6))
    if rng.random() < 0.3:
        C, wide = rng.normal(size=(k, m)), 10.0 ** rng.uniform(-3, 1, (2, k))
        rows["rows"] = iq.limits.LimitRows(C, -wide[0], wide[1])
    return rows | {
        "acceleration_limit": 10.0 ** rng.uniform(-1, 2, m) if rng.random() < 0.4 else None,
        "tool_speed": 10.0 ** rng.uniform(-2, 1) if rng.random() < 0.3 else None,
        "delay": float(rng.integers(1, 5)) * dt if rng.random() < 0.2 else 0.0,
    }


def refuses_form(loop, error):
    """Whether a form without a guard has no projector."""
    formed = loop.form is not None and loop.guard is None
    return formed and (isinstance(error, iq.NoPseudoinverse) or re.search("complement|projector", str(error)))


def broken_limits(loop, q, x, before, solution, speed):
    """Which limits a joint velocity at q breaks, coming from another; "" for none."""
    fastest, robot = loop.robot.velocity_limit, loop.robot
    moved = q + loop.dt * x
    beyond = np.maximum(robot.position_lower - q, q - robot.position_upper).clip(0.0)
    after = np.maximum(robot.position_lower - moved, moved - robot.position_upper)
    if (np.abs(x) > fastest + INSIDE).any() or (after > beyond + INSIDE).any():
        return "outside limits"
    if loop.acceleration_limit is not None:
        most = loop.dt * loop.acceleration_limit
        if (np.abs(x - before) > most + INSIDE * (1.0 + np.abs(before) + most)).any():
            return "faster than it can"
    if solution.status in {"degraded", "held"}:
        return ""
    rows, size = loop.options["rows"], 1e-6 * (1.0 + np.abs(x).max())
    if rows is not None:
        over = np.maximum(rows.lower - rows.C @ x, rows.C @ x - rows.upper)
        if (over > size * np.linalg.norm(rows.C, axis=1)).any():
            return f"rows {over.max():g} of {np.abs(rows.C @ x).max():g}"
    if loop.tool_speed is not None and speed == 1.0:  # with less, a tool that is faster slows down
        J, p = robot.jacobian(q), robot.pose(q)[:3, 3]
        P = J[3:] + np.cross(J[:3].T, p).T
        if np.linalg.norm(P @ x) > loop.options["tool_speed"] * (1.0 + 1e-4) + size * np.linalg.norm(P):
            return f"tool speed {np.linalg.norm(P @ x):g} of {loop.options['tool_speed']:g}"
    return ""


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
        limited = rng.random() < 0.5
        limits = random_limits(rng, m, dt) if limited else {}
        loop = iq.Controller(
            robot,
            dt=dt,
            gain=(None, 1.0 / dt, 1.01)[rng.integers(3)],  # of 1 and less it is asked whether 1/s is meant
            form=random_form(rng, m),
            damping=random_damping(rng),
            guard=bool(rng.random() < 0.8),
            exact=(None, None, "position", iq.control.ExactAxis([0, 0, 1]))[rng.integers(4)],
            point=(None, None, "own", rng.normal(size=3))[rng.integers(4)],
            length=10.0 ** rng.uniform(-3, 3) if rng.random() < 0.2 else None,
            **limits,
        )
        jumps = limits.get("acceleration_limit") is None and not limits.get("delay")
        q = random_state(rng, robot)
        q = q if jumps else np.clip(q, robot.position_lower, robot.position_upper)
        target, before = random_target(rng, robot, q), np.zeros(m)
        flying = [before] * round(limits.get("delay", 0.0) / dt)
        for _ in range(LOOP):
            if rng.random() < 0.1:
                q = random_state(rng, robot) if jumps else q
                target = random_target(rng, robot, q)
            ahead = rng.normal(size=6) * 10.0 ** rng.uniform(-3, 3) if rng.random() < 0.3 else None
            done += 1
            broken, speed = rng.random() < 0.05, rng.random() if limited and rng.random() < 0.1 else 1.0
            asked = spoilt(rng, q, target, ahead) if broken else (q, target, ahead)
            try:
                if ahead is not None and not broken and rng.random() < 0.3:
                    solution = loop.follow(q, ahead)
                else:
                    solution = loop.step(*asked, speed=speed)
            except (BadInput, iq.NoPseudoinverse) as error:
                counts["refused"] += 1
                # a small arm, and a target far away; or a form without a projector
                if not broken and "millimetres" not in str(error) and not refuses_form(loop, error):
                    wrong(f"refused: {error}")
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
            there = q + dt * sum(flying) if flying else q  # when the command acts
            if what := broken_limits(loop, there, x, before, solution, speed):
                wrong(f"{what} ({solution.status}, {solution.reason})")
            flying.append(x)
            q, before = q + dt * flying.pop(0), x
    return counts, failures
