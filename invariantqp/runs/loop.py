"""The tick loop of a run: measure, step, command. It notes what happens and judges nothing."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter_ns
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.progress import Progress
from invariantqp.runs.pilots import Pilot
from invariantqp.runs.plants.plant import PlantState
from invariantqp.runs.prepare import Setup
from invariantqp.velocity.solution import VelocitySolution

Observer = Callable[[int, PlantState, VelocitySolution], None]


class Record(NamedTuple):
    """What happened in n ticks.

    Attributes:
        states: n + 1, the plant before the first tick and after each.
        solutions: n, what the controller answered.
        tick_ns: (n,) how long that took [ns].
        read: (n, 6) the wrench that the tool exerts as the controller read it in each tick, base frame.
    """

    states: list[PlantState]
    solutions: list[VelocitySolution]
    tick_ns: Array
    read: Array


# An elastic path may take this many times as long as its timing says.
LONGEST = 10


def loop(setup: Setup, pilot: Pilot, progress: Progress | None = None, observer: Observer | None = None) -> Record:
    """Run all ticks of a setup; an elastic path ends when the pilot is done.

    Args:
        setup: from `prepare`; its plant moves.
        pilot: what steers the plant.
        progress: called with (ticks done, ticks in all).
        observer: called after each tick with (its number, the plant's state then, the solution).
    """
    plant, goals = setup.plant, setup.brief.goals()
    states, solutions = [plant.state()], []
    n = len(goals)
    tick_ns, read = [], []
    for k in range(n if setup.brief.elastic is None else LONGEST * n):
        measured = plant.measure()
        measured = measured._replace(q=measured.q + setup.noise[k % n])
        before = perf_counter_ns()
        solution = pilot.step(measured, goals[min(k, n - 1)])
        tick_ns.append(perf_counter_ns() - before)
        read.append(pilot.wrench)
        plant.command(solution.velocity)
        solutions.append(solution)
        states.append(plant.state())
        if observer is not None:
            observer(k, states[-1], solution)
        if progress is not None:
            progress(min(k + 1, n), n)
        if pilot.done:
            break
    return Record(states, solutions, np.array(tick_ns), np.array(read))
