"""The ticks that the compiled core answers; Python has the others (`VelocityLaw.compiled` says which laws).

The core answers what this package's own Python would, or hands the tick back.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from os import cpu_count
from threading import Thread
from typing import NamedTuple

import numpy as np

from invariantqp.engine import core
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.limits.cone import Cone, minimise_in_cone
from invariantqp.velocity.qp.backends import Backend, Daqp
from invariantqp.velocity.qp.polytope import Polytope
from invariantqp.velocity.qp.quadratic import Optimum, Quadratic
from invariantqp.velocity.solution import VelocitySolution

# Rows below which a thread is not worth its start, and the least that one takes at a time.
ROWS_A_THREAD, ROWS_AT_A_TIME = 1024, 32
# What the core calls by number: methods, statuses, and rows that are Python's, a closed form and no more, or recorded.
METHODS = np.array(["closed-form", "damped", "qp"], dtype="U11")
STATUSES = np.array(["ok", "scaled", "guarded", "degraded"], dtype="U8")
LEFT, PLAIN, RECORDED = 0.0, 1.0, 2.0
if core is not None:
    core.answer_as(VelocitySolution)


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
    found: VelocitySolution | None = core.tick(
        J, s, root, lower, upper, posture, law.dt, policy, demands, slow, limits, metric
    )
    return found


class Written(NamedTuple):
    """Answers to N ticks, written row by row.

    Attributes:
        velocity: (N, m).
        residual: (N, 6).
        told: (N, 6) kind of answer, method, status, scale, damping, guard.
        records: (N, r) for `core.solution`.
    """

    velocity: Array
    residual: Array
    told: Array
    records: Array


class Rows(Mapping[int, VelocitySolution]):
    """The answers to many ticks; those that are more than a closed form by their row, made when asked for.

    Attributes:
        velocity: (N, m).
        residual: (N, 6).
        left: rows that are still to be solved, for `put`.
        method: (N,) strings, as in VelocitySolution.
        status: likewise.
        numbers: (3, N) scale, damping, guard.
    """

    def __init__(self, written: Written) -> None:
        """What is told of answers."""
        self.velocity, self.residual, told, records = written
        self.left: list[int] = np.flatnonzero(told[:, 0] == LEFT).tolist()
        self.method = METHODS[told[:, 1].astype(np.intp)]
        self.status = STATUSES[told[:, 2].astype(np.intp)]
        self.numbers: Array = told[:, 3:].T.copy()
        rows = np.flatnonzero(told[:, 0] == RECORDED)
        self._records = records if len(rows) == len(records) else records[rows]
        self._place = dict(zip(rows.tolist(), range(len(rows)), strict=True))
        self._made: dict[int, VelocitySolution] = {}

    def put(self, row: int, solution: VelocitySolution) -> None:
        """The answer to a row that was solved by itself."""
        self.velocity[row], self.residual[row] = solution.velocity, solution.residual
        self.method[row], self.status[row] = solution.method, solution.status
        self.numbers[:, row] = solution.scale, solution.damping, solution.guard
        self._place[row], self._made[row] = -1, solution

    def __len__(self) -> int:
        return len(self._place)

    def __iter__(self) -> Iterator[int]:
        return iter(self._place)

    def __getitem__(self, row: int) -> VelocitySolution:
        if row not in self._made:
            if core is None or row not in self._place:
                raise KeyError(row)
            self._made[row] = core.solution(self._records[self._place[row]])
        return self._made[row]


def compiled_rows(
    law: VelocityLaw,
    J: Array,
    s: Array,
    roots: Array,
    box: tuple[Array, Array],
    posture: Array | None,
) -> Written | None:
    """Many ticks, each without dt; None where all are Python's. Large batches go to several threads.

    Args:
        law: of all rows.
        J: (N, 6, m).
        s: (N, 6).
        roots: (N, 6, 6).
        box: (N, m) each.
        posture: (N, m) or None.
    """
    n, _, m = J.shape
    policy, metric = law.compiled, _metric(law)
    if core is None or policy is None or m > core.MOST_JOINTS:
        return None
    ticks = core.ticks
    written = Written(np.empty((n, m)), np.empty((n, 6)), np.zeros((n, core.TOLD)), np.empty((n, core.RECORD)))
    threads = max(1, min(n // ROWS_A_THREAD, cpu_count() or 1))
    parts = iter(_parts(n, threads))

    def work() -> None:
        for rows in parts:  # the next one for whichever thread asks
            arrays = [J[rows], s[rows], roots[rows], box[0][rows], box[1][rows]]
            wanted = None if posture is None else posture[rows]
            ticks(*arrays, wanted, policy, metric, *[array[rows] for array in written])

    helpers = [Thread(target=work) for _ in range(threads - 1)]
    for helper in helpers:
        helper.start()
    work()
    for helper in helpers:
        helper.join()
    return written


def _parts(n: int, threads: int) -> list[slice]:
    """n rows in parts that become smaller, so that all threads end together: half of an even share of what is left."""
    if threads == 1:
        return [slice(n)]
    parts, begin = [], 0
    while begin < n:
        end = begin + max((n - begin) // (2 * threads), ROWS_AT_A_TIME)
        parts.append(slice(begin, end))
        begin = end
    return parts


def minimised(backend: Backend, problem: Quadratic, limits: Polytope, cone: Cone | None, inside: Array) -> Optimum:
    """`minimise_in_cone`, by the core where it can.

    Args:
        backend: the solver that Python asks.
        problem: what is minimised.
        limits: on z.
        cone: likewise, or None.
        inside: (n,) a z inside both.

    Raises:
        SolverFailure: as `minimise_in_cone`.
    """
    found = None
    if core is not None and type(backend) is Daqp and (cone is None or (cone.program is None and cone.J.any())):
        slow = None if cone is None else (cone.J, cone.limit, cone.start)
        found = core.optimum(*problem, limits.A, limits.lower, limits.upper, slow, inside)
    if found is None:
        return minimise_in_cone(backend, problem, limits, cone, inside)
    z, multipliers, nu = found
    return Optimum(z, multipliers, "native" if nu > 0.0 or multipliers.any() else "", "", nu)


def _metric(law: VelocityLaw) -> tuple[Array | None, Array | None] | None:
    """(m, m) T and its inverse; None for the identity."""
    return None if law.metric is None else (law.to_joint, law.from_joint)
