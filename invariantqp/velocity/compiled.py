"""The ticks that the compiled core answers; Python has the others (`VelocityLaw.compiled` says which laws).

The core answers what this package's own Python would, or hands the tick back.
"""

from __future__ import annotations

from itertools import pairwise
from os import cpu_count
from typing import Any

import numpy as np

from invariantqp.engine import core
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.solution import VelocitySolution

# Rows below which a thread is not worth its start.
ROWS_A_THREAD = 1024


def compiled(law: VelocityLaw, demand: Demand) -> VelocitySolution | None:
    """The core's answer; None where Python has to answer."""
    policy = law.compiled
    if core is None or policy is None:
        return None
    J, s, root, lower, upper, exact, posture, rows, cone, row_rank = demand
    if cone is not None and cone.program is not None:
        return None
    demands = None if exact is None else (exact.A, exact.b, exact.of_twist, row_rank)
    slow = None if cone is None else (cone.J, cone.limit, cone.start)
    limits = None if rows is None else (rows.C, rows.lower, rows.upper)
    metric = _metric(law)
    found = core.tick(J, s, root, lower, upper, posture, law.dt, policy, demands, slow, limits, metric)
    return None if found is None else VelocitySolution._make(found)


def compiled_rows(
    law: VelocityLaw,
    J: Array,
    s: Array,
    roots: Array,
    box: tuple[Array, Array],
    posture: Array | None,
) -> tuple[Array, Array, dict[int, VelocitySolution | None]]:
    """Many ticks: velocity (N, m), residual (N, 6), and the solutions of rows whose closed form is not all there is.

    A row that is None there, and all rows of a core that refuses, are Python's. Large batches go to several threads.

    Args:
        law: of all rows.
        J: (N, 6, m).
        s: (N, 6).
        roots: (N, 6, 6).
        box: (N, m) each.
        posture: (N, m) or None.
    """
    n, _, m = J.shape
    velocity, residual = np.zeros((n, m)), np.zeros((n, 6))
    policy, metric = law.compiled, _metric(law)
    if core is None or policy is None or m > core.MOST_JOINTS:
        return velocity, residual, dict.fromkeys(range(n))

    def part(rows: slice) -> dict[int, Any]:
        arrays = [J[rows], s[rows], roots[rows], box[0][rows], box[1][rows]]
        wanted = None if posture is None else posture[rows]
        found = core.ticks(*arrays, wanted, policy, velocity[rows], residual[rows], metric)
        return {rows.start + i: fields for i, fields in found.items()}

    threads = max(1, min(n // ROWS_A_THREAD, cpu_count() or 1))
    edges = np.linspace(0, n, threads + 1).astype(int).tolist()
    slices = [slice(*edge) for edge in pairwise(edges)]
    if threads == 1:
        found = part(slices[0])
    else:
        from concurrent.futures import ThreadPoolExecutor  # with the first large batch

        with ThreadPoolExecutor(threads) as pool:
            found = {i: fields for some in pool.map(part, slices) for i, fields in some.items()}
    return velocity, residual, {i: None if f is None else VelocitySolution._make(f) for i, f in found.items()}


def _metric(law: VelocityLaw) -> tuple[Array | None, Array | None] | None:
    """(m, m) T and its inverse; None for the identity."""
    return None if law.metric is None else (law.to_joint, law.from_joint)
