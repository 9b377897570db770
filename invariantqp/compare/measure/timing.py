"""Times of short calls, side by side: rounds go through all in turn, so that a drift of the clock hits all alike.

One call is timed by the nanosecond counter around it; medians and 99th percentiles are of single calls.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping
from time import perf_counter_ns

import numpy as np

from invariantqp.geometry.arrays import Array

# Rounds run first and not counted: workspaces are made, caches filled.
WARM_UP = 3


def interleaved(calls: Mapping[str, Callable[[int], object]], count: int, rounds: int) -> dict[str, Array]:
    """Times [us] of each call(i), i in 0..count-1, `rounds` times each: {name: (rounds * count,)}.

    Args:
        calls: named functions of a state's index.
        count: how many states there are.
        rounds: how often each is timed on each state.
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
    """Median and 99th percentile [us], as results.json has them."""
    return {"median_us": float(np.median(times)), "p99_us": float(np.percentile(times, 99.0))}
