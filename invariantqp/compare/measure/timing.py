"""Times of short calls. Each round calls all functions in turn, so that a change of the clock rate affects all alike.

Every call is timed by itself with the nanosecond counter; medians and percentiles are those of single calls.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping
from time import perf_counter_ns

import numpy as np

from invariantqp.geometry.arrays import Array

# First rounds that do not count: they allocate workspaces and fill caches.
WARM_UP = 3


def interleaved(calls: Mapping[str, Callable[[int], object]], count: int, rounds: int) -> dict[str, Array]:
    """Times [us] of call(i) for i in 0..count-1, with each call made `rounds` times: {name: (rounds * count,)}.

    Args:
        calls: functions of the index of a state, by name.
        count: number of states.
        rounds: how often each function is timed in each state.
    """
    taken: dict[str, list[int]] = {name: [] for name in calls}
    before = gc.isenabled()
    gc.disable()
    try:
        for turn in range(-min(WARM_UP, rounds), rounds):
            for name, call in calls.items():
                times = []
                for i in range(count):
                    start = perf_counter_ns()
                    call(i)
                    times.append(perf_counter_ns() - start)
                if turn >= 0:
                    taken[name] += times
    finally:
        if before:
            gc.enable()
    return {name: np.array(times) / 1e3 for name, times in taken.items()}


def spread(times: Array) -> dict[str, float]:
    """Median and 99th percentile [us], with the keys of results.json."""
    return {"median_us": float(np.median(times)), "p99_us": float(np.percentile(times, 99.0))}
