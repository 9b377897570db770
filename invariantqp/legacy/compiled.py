"""The ticks that the compiled core answers; Python has the others (`VelocityLaw.compiled` says which laws).

The core answers what this package's own Python would, or hands the tick back.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from threading import Thread
from typing import TYPE_CHECKING, Any, NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.engine import core
from invariantqp.geometry.arrays import Array
from invariantqp.legacy.damping import damping_of
from invariantqp.legacy.law import Demand, VelocityLaw
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.limits import Bounds, Cone, LimitRows, ToolSpeed
from invariantqp.velocity.solution import Status, VelocitySolution

if TYPE_CHECKING:
    from invariantqp.engine import Task

# Rows below which a thread is not worth its start, and those that one takes at a time.
ROWS_A_THREAD, ROWS_AT_A_TIME = 1024, 16
# In place of the number of a record: a row that is Python's; -1 is a closed form and no more.
LEFT = -2
if core is not None:
    core.answer_as(VelocitySolution, Status)


def compiled(law: VelocityLaw, demand: Demand) -> VelocitySolution | None:
    """The core's answer; None where Python has to answer."""
    fixed, cone, exact, rows, chase = law.compiled, demand.cone, demand.exact, demand.rows, demand.chase
    if core is None or fixed is None:
        return None
    fields: dict[str, Any] = {
        "J": demand.J,
        "s": demand.s,
        "root": demand.root,
        "lower": demand.lower,
        "upper": demand.upper,
        "posture": demand.posture,
        "fastest": demand.fastest,
        "before": demand.before,
        "change": demand.change,
        "held": demand.held,
        **_fields(rows, exact, cone),
    }
    if exact is not None:
        fields["row_rank"] = -1 if demand.row_rank is None else demand.row_rank
        if len(exact.b) > core.MOST_ROWS:
            return None
    if chase is not None:
        fields |= {"chase_ahead": chase.ahead, "chase_rows_ahead": chase.rows_ahead, "chase_lower": chase.lower}
        fields |= {"chase_upper": chase.upper, "chase_slack": chase.slack, "chase_apart": chase.apart}
    if fixed.form == "brought" and law.form is not None:
        fields["brought"] = np.asarray(law.form.matrix(np.asarray(np.linalg.inv(demand.root))), np.float64)
    return _with_names(core.tick(fixed, **fields), rows)


def _fields(rows: LimitRows | None, exact: ExactRows | None, cone: Cone | None) -> dict[str, Any]:
    """Limits and exact rows as the core takes them."""
    fields: dict[str, Any] = {}
    if rows is not None:
        fields |= {"G": rows.C, "least": rows.lower, "most": rows.upper}
    if exact is not None:
        fields |= {"C": exact.A, "e": exact.b, "D": exact.of_twist}
    if cone is not None:
        fields |= {"cone_limit": cone.limit, "cone_start": cone.start, "cone_J": cone.J}
    return fields


# The laws of `solve_velocity` without options for one: where each joint has limits, and where one has none.
LAWS = VelocityLaw().compiled, VelocityLaw(damping=damping_of(None, limited=False)).compiled
# Options that the core does not have, and that solve nothing where they are None.
UNSET = {"form", "damping", "joint_metric"}
UNBOUNDED = [(np.full(m, -np.inf), np.full(m, np.inf)) for m in range(17)]


def _box(m: int, bounds: Any) -> tuple[Any, Any]:
    """Lower and upper bounds, None for others than a pair."""
    if type(bounds) is Bounds:
        return bounds.lower, bounds.upper
    box = UNBOUNDED[m] if bounds is None else bounds
    return box if type(box) is tuple and len(box) == 2 else (None, None)


def _point(value: Any) -> Any:
    """An array for a list or a tuple of numbers."""
    numbers = type(value) in {list, tuple} and set(map(type, value)) <= {int, float}
    return np.array(value, np.float64) if numbers else value


def _fits(J: Any, length: Any, parts: Iterable[tuple[Any, type]]) -> bool:
    """Whether joint twists, a length, and parts that may be None are of the kinds that the core takes."""
    if type(J) is not np.ndarray or J.shape[:-1] != (6,) or core is None or J.shape[1] > core.MOST_JOINTS:
        return False
    given = length is None or (type(length) in {int, float} and length > 0.0)
    return given and all(type(part) in {kind, type(None)} for part, kind in parts)


def compiled_problem(
    J: Any,
    twist: ArrayLike,
    tasks: tuple[Task, ...] = (),
    *,
    bounds: Any = None,
    rows: Any = None,
    exact: Any = None,
    tool_speed: Any = None,
    point: Any = None,
    length: Any = None,
    posture: Any = None,
    engine: str = "compiled",
    **others: Any,
) -> VelocitySolution | None:
    """`solve_velocity`, with its checks, by the core; None where Python has to answer, or to say what is wrong.

    With `tasks`, by their priorities, it is `solve_tasks`; J and twist are then the first one's. Of other options none
    may have a value.
    """
    law, unlimited = LAWS
    unset = all(value is None and name in UNSET for name, value in others.items())
    kinds = (rows, LimitRows), (exact, ExactRows), (tool_speed, ToolSpeed)
    if core is None or law is None or engine != "compiled" or not (unset and _fits(J, length, kinds)):
        return None
    lower, upper = _box(J.shape[1], bounds)
    if lower is None:
        return None
    cone = None
    if tool_speed is not None:
        if tool_speed.point is None or J.dtype != np.float64:
            return None
        cone = tool_speed.cone(J, tool_speed.point)
    fields = {"J": J, "s": twist, "lower": lower, "upper": upper, "point": _point(point), "posture": posture}
    fields |= _fields(rows, exact, cone) | ({} if length is None else {"length": float(length)})
    call = partial(core.tasks, law, unlimited, tasks) if tasks else partial(core.tick, law, unlimited)
    found: VelocitySolution | None = call(**fields)
    if found is not None and tasks:  # of which level would they be?
        found = found._replace(multipliers=None, row_multipliers=None)
    return _with_names(found, rows)


def _with_names(found: VelocitySolution | None, rows: LimitRows | None) -> VelocitySolution | None:
    """The core's answer with what its rows are called."""
    return found if found is None or rows is None or not rows.names else found._replace(row_names=rows.names)


class Written(NamedTuple):
    """Answers to N ticks, written row by row."""

    velocity: Array  # (N, m)
    residual: Array  # (N, 6)
    record: NDArray[np.intp]  # (N,) the number of its record, `LEFT`, or -1
    method: NDArray[np.str_]  # (N,) strings, as in VelocitySolution
    status: NDArray[np.str_]  # likewise
    numbers: Array  # (N, 3) scale, damping, guard
    records: Array  # (k, r) for `core.solution`


class Rows(Mapping[int, VelocitySolution]):
    """The answers to many ticks; those that are more than a closed form by their row, made when they are read.

    Attributes:
        written: of all rows.
        left: rows that are still to be solved, for `put`.
    """

    def __init__(self, written: Written) -> None:
        """What answers say."""
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
    laws: tuple[VelocityLaw, VelocityLaw],
    J: Array,
    s: Array,
    box: tuple[Array, Array],
    **others: Array | None,
) -> Written:
    """Many ticks, each without dt, but for those that are left. Large batches go to several threads.

    Args:
        laws: of rows in which all joints have bounds, and of others.
        J: (N, 6, m).
        s: (N, 6).
        box: (N, m) each.
        others: or None: posture (N, m), roots (N, 6, 6), or points (N, 3) and lengths (N, 1) to measure at.
    """
    n, _, m = J.shape
    fixed, unlimited = (law.compiled for law in laws)
    if core is None or fixed is None or unlimited is None or fixed.form == "brought" or m > core.MOST_JOINTS:
        words = np.empty(n, "U11"), np.empty(n, "U8")
        return Written(np.empty((n, m)), np.empty((n, 6)), np.full(n, LEFT), *words, np.empty((n, 3)), np.empty((n, 0)))
    lower, upper = box
    made = {"velocity": np.empty((n, m)), "residual": np.empty((n, 6)), "numbers": np.zeros((n, 6))}
    made["records"], taken = np.empty((n, core.RECORD)), np.zeros(2, np.int32)
    fields = {"J": J, "s": s, "lower": lower, "upper": upper, **others, **made}
    ticks = partial(core.ticks, fixed, unlimited, taken, ROWS_AT_A_TIME, **fields)
    helpers = [Thread(target=ticks) for _ in range(min(n // ROWS_A_THREAD, cpu_count()) - 1)]
    for helper in helpers:
        helper.start()
    ticks()
    for helper in helpers:
        helper.join()
    velocity, residual, numbers, records = made.values()
    record, method, status = numbers[:, :3].T.astype(np.intp)
    plain = np.where(record == LEFT, 0, (method, status))  # of a row that is left nothing is written
    words = np.array(core.METHODS)[plain[0]], np.array(core.STATUSES)[plain[1]]
    return Written(velocity, residual, record, *words, numbers[:, 3:], records[: taken[1]])


def cpu_count() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
