"""The ticks that the compiled core answers; Python has the others (`VelocityLaw.compiled` says which laws).

The core answers what this package's own Python would, or hands the tick back.
"""

from __future__ import annotations

import os
from _thread import LockType, allocate_lock, start_new_thread
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from invariantqp.engine import core
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.backends import Backend, Daqp
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.qp import Cone, Optimum, Polytope, Quadratic, minimise
from invariantqp.velocity.solution import Status, VelocitySolution

# Rows below which a thread is not worth its start, and those that one takes at a time.
ROWS_A_THREAD, ROWS_AT_A_TIME = 1024, 16
# In place of the number of a record: a row that is Python's; -1 is a closed form and no more.
LEFT = -2
if core is not None:
    core.answer_as(VelocitySolution, Status)


def compiled(law: VelocityLaw, demand: Demand) -> VelocitySolution | None:
    """The core's answer; None where Python has to answer."""
    policy = law.compiled
    if core is None or policy is None:
        return None
    J, s, root, lower, upper, exact, posture, rows, cone, row_rank, chase, fastest = demand
    demands = None if exact is None else (exact.A, exact.b, exact.of_twist, row_rank)
    slow = None if cone is None else (cone.J, cone.limit, cone.start)
    limits = None if rows is None else (rows.C, rows.lower, rows.upper)
    metric = _metric(law)
    found: VelocitySolution | None = core.tick(
        J, s, root, lower, upper, posture, law.dt, policy, demands, slow, limits, metric, chase, fastest
    )
    return found


class Written(NamedTuple):
    """Answers to N ticks, written row by row."""

    velocity: Array  # (N, m)
    residual: Array  # (N, 6)
    record: NDArray[np.int32]  # (N,) the number of its record, `LEFT`, or -1
    method: NDArray[np.str_]  # (N,) strings, as in VelocitySolution
    status: NDArray[np.str_]  # likewise
    numbers: Array  # (N, 3) scale, damping, guard
    records: Array  # (k, r) for `core.solution`

    @classmethod
    def empty(cls, n: int, m: int, numbers: int) -> Written:
        """To be written for n ticks of m joints, with so many numbers a record."""
        records = np.empty(n, np.int32), np.empty(n, "U11"), np.empty(n, "U8"), np.empty((n, 3)), np.empty((n, numbers))
        return cls(np.empty((n, m)), np.empty((n, 6)), *records)

    def and_others(self, others: Written, order: NDArray[np.intp]) -> Written:
        """These rows and others, row i of all being the one of number order[i]."""
        further = np.where(others.record < 0, others.record, others.record + len(self.records))
        pairs: Iterator[Any] = zip(self, others._replace(record=further), strict=True)
        *rows, records = map(np.concatenate, pairs)
        return Written._make([*(one[order] for one in rows), records])


class Rows(Mapping[int, VelocitySolution]):
    """The answers to many ticks; those that are more than a closed form by their row, made when asked for.

    Attributes:
        written: of all rows.
        left: rows that are still to be solved, for `put`.
    """

    def __init__(self, written: Written) -> None:
        """What is told of answers."""
        self.written = written
        self.left: list[int] = np.flatnonzero(written.record == LEFT).tolist()
        self._made: dict[int, VelocitySolution] = {}

    def put(self, row: int, solution: VelocitySolution) -> None:
        """The answer to a row that was solved by itself."""
        velocity, residual, record, method, status, numbers, records = self.written
        velocity[row], residual[row] = solution.velocity, solution.residual
        method[row], status[row] = solution.method, solution.status
        numbers[row] = solution.scale, solution.damping, solution.guard
        record[row], self._made[row] = len(records), solution

    def __len__(self) -> int:
        return int(np.count_nonzero(self.written.record >= 0))

    def __iter__(self) -> Iterator[int]:
        return iter(np.flatnonzero(self.written.record >= 0).tolist())

    def __getitem__(self, row: int) -> VelocitySolution:
        if row not in self._made:
            record = self.written.record
            if core is None or not (isinstance(row, SupportsIndex) and 0 <= row < len(record) and record[row] >= 0):
                raise KeyError(row)
            self._made[row] = core.solution(self.written.records[record[row]])
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
    written = Written.empty(n, m, core.RECORD)
    taken = np.zeros(2, np.int32)
    arguments = J, s, roots, *box, posture, *written, policy, metric, taken, ROWS_AT_A_TIME
    threads = max(1, min(n // ROWS_A_THREAD, cpu_count()))
    helpers = [_started(core.ticks, arguments) for _ in range(threads - 1)]
    core.ticks(*arguments)
    for helper in helpers:
        helper.acquire()
    return written._replace(records=written.records[: taken[1]])


def cpu_count() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _started(ticks: Callable[..., None], arguments: tuple[Any, ...]) -> LockType:
    """A thread for `ticks`, and a lock that it releases at its end; `threading` would wait until it has begun."""
    done = allocate_lock()
    done.acquire()

    def work() -> None:
        try:
            ticks(*arguments)
        finally:
            done.release()

    start_new_thread(work, ())
    return done


def minimised(backend: Backend, problem: Quadratic, limits: Polytope, cone: Cone | None, inside: Array) -> Optimum:
    """`minimise` by the core where it can, from a z (n,) inside; it raises the same."""
    found = None
    if core is not None and type(backend) is Daqp and (cone is None or cone.J.any()):
        slow = None if cone is None else (cone.J, cone.limit, cone.start)
        found = core.optimum(*problem, limits.A, limits.lower, limits.upper, slow, inside)
    if found is None:
        return minimise(backend, problem, limits, cone, inside)
    z, multipliers, nu = found
    return Optimum(z, multipliers, "native" if nu > 0.0 or multipliers.any() else "", "", nu)


def _metric(law: VelocityLaw) -> tuple[Array | None, Array | None] | None:
    """(m, m) T and its inverse; None for the identity."""
    return None if law.metric is None else (law.to_joint, law.from_joint)
