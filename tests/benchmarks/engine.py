"""Ticks of the engine beside those of the old C core, in one run: closed loops by group, the two in turn, microseconds.

    python tests/benchmarks/engine.py [--arms panda ur5e so101]

Both are called from Python with the numbers of the same tick; the laws differ: ticks are those of the new one's loop.
"""

import argparse
import gc
from dataclasses import replace
from functools import partial
from math import inf
from time import perf_counter_ns

import numpy as np
from invariantqp.control.definition import DefinitionController, tick_of

import invariantqp as iq
from invariantqp import _core
from invariantqp.legacy.compiled import compiled

STARTS = {"panda": [0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.7], "ur5e": [0.0, -1.2, 1.4, -1.0, -1.3, 0.2]}
STARTS |= {"xarm7": [0.0, -0.3, 0.0, 0.9, 0.0, 1.1, 0.0], "so101": [0.1, -0.4, 0.5, 0.6, 0.1]}


def fields(tick):
    """A tick as the engine takes it."""
    names = ("J", "root", "ahead", "error", "lower", "upper", "position_lower", "position_upper", "posture", "fastest")
    given = {name: getattr(tick, name) for name in (*names, "metric", "held", "before", "missed")}
    if tick.rows is not None:
        given["rows"] = tick.rows.C, tick.rows.lower, tick.rows.upper
        if tick.rows.speed < inf:
            given["tool_speed"] = tick.rows.P, tick.rows.speed
    if tick.exact is not None:
        given["exact"] = tick.exact
    return {name: value for name, value in given.items() if value is not None}


def recorded(robot, q, targets, **options):
    """The law, demand and tick of each tick of a closed loop."""
    found = []

    class Recorder(DefinitionController):
        def _solved(self, law, demand):
            found.append((replace(law, engine="compiled"), demand, tick_of(law, demand, self._last, self._missed)))
            return super()._solved(law, demand)

    loop = Recorder(robot, dt=0.002, **options)
    for target in targets:
        q = q + 0.002 * loop.step(q, target).velocity
    return found


def groups(robot, q):
    """Closed loops by what they meet."""
    rng, m = np.random.default_rng(0), len(q)
    home, far = robot.pose(q), robot.pose(q + 0.8 * rng.normal(size=m))
    slow = [home @ iq.transform(translation=(0.05 * np.sin(0.02 * k), 0.0, 0.0)) for k in range(150)]
    away = home @ iq.transform(translation=(0.0, 0.0, 3.0))
    rows = iq.limits.LimitRows(rng.normal(size=(8, m)), np.full(8, -0.4), np.full(8, 0.4))
    yield "free", recorded(robot, q, slow)
    yield "limits", recorded(robot, q, [far] * 150)
    yield "singular", recorded(robot, q, [away] * 250)[100:]
    yield "braking", recorded(robot, q, [far] * 150, acceleration_limit=np.full(m, 10.0))
    yield "exact", recorded(robot, q, slow, exact="position")
    yield "exact, limits", recorded(robot, q, [far] * 150, exact="position")
    yield "rows", recorded(robot, q, [far] * 150, limits=[rows])
    yield "tool speed", recorded(robot, q, [far] * 150, limits=[iq.limits.ToolSpeed(0.2)])


def in_turn(calls, repeats=9):
    """The median time of each call [us], called one after another."""
    spent = np.empty((repeats, len(calls)))
    gc.disable()
    for k in range(repeats):
        for i, call in enumerate(calls):
            start = perf_counter_ns()
            call()
            spent[k, i] = perf_counter_ns() - start
    gc.enable()
    return np.median(spent, axis=0) / 1e3


def row(name, pairs):
    """One line of the table for pairs of calls, the old one first."""
    times = np.array([in_turn(pair) for pair in pairs])
    old, new = times.T
    print(
        f"{name:28s} {np.median(old):8.2f} {np.percentile(old, 99):8.2f} {np.median(new):8.2f} "
        f"{np.percentile(new, 99):8.2f} {np.median(new / old):7.2f}"
    )


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", nargs="+", default=["panda", "ur5e", "so101"])
    print(f"{'us':28s} {'C core':>8s} {'p99':>8s} {'engine':>8s} {'p99':>8s} {'ratio':>7s}")
    for name in parser.parse_args().arms:
        robot, q = iq.load_robot(name), np.array(STARTS[name])
        for group, ticks in groups(robot, q):
            pairs = [
                (partial(compiled, law, demand), partial(_core.tick, **fields(tick)))
                for law, demand, tick in ticks[::3]
            ]
            row(f"{name}, {group}", pairs)


if __name__ == "__main__":
    main()
