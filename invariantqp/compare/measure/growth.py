"""How the time of a solve grows with the number of joints, tasks and limit rows, and with the size of a batch.

    time ~ size^slope,   fitted to the larger half of the sizes

Places instead of tasks: "joints" (no limit active), "joints, limits active" (some active), "tasks", "rows", "batch".
Result: {"size": [...], "median_us": [...], "slope": x}; of a batch the time for each row of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from invariantqp.compare.cell import Cell, Kind, Result
from invariantqp.compare.measure.solves import clipped_answer, has_solver
from invariantqp.compare.measure.timing import interleaved
from invariantqp.compare.method import Method, Question, Setting
from invariantqp.compare.names import OURS
from invariantqp.compare.registry import methods
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.screws import revolute
from invariantqp.velocity.batch import solve_velocities
from invariantqp.velocity.limits.box import Bounds
from invariantqp.velocity.limits.rows import LimitRows
from invariantqp.velocity.request import solve_velocity
from invariantqp.velocity.several import TwistTask, solve_tasks

JOINTS, QUICK_JOINTS = (3, 4, 5, 6, 7, 10, 15, 20, 30, 40, 60), (3, 6, 15, 60)
TASKS, QUICK_TASKS = (1, 2, 3, 4, 6, 8), (1, 4, 8)
ROWS, QUICK_ROWS = (1, 2, 5, 10, 20, 50, 100), (1, 10, 100)
BATCH, QUICK_BATCH = (1, 3, 10, 30, 100, 300, 1000, 3000, 10000), (1, 30, 1000)
ROUNDS, QUICK_ROUNDS = 30, 5
# States for each size.
STATES = 3
# Joints of the robot where something else grows: as many as a humanoid has for tasks, an arm for rows and batches.
MANY, FEW = 30, 7
# Pitch of the forms [m/rad], about half the width of the chains.
PITCH = 0.5
# Velocity bounds, as multiples of the largest joint speed without bounds: never active, and active.
WIDE, NARROW = 10.0, 0.6

Call = Callable[[int], object]


def random_chain(rng: np.random.Generator, m: int) -> Array:
    """(6, m) twists of revolute joints, with random axes through random points of a cube with sides of a metre."""
    return np.column_stack([revolute(rng.standard_normal(3), rng.uniform(-0.5, 0.5, 3)) for _ in range(m)])


def slope(size: Sequence[float], cost: Sequence[float]) -> float:
    """The exponent of cost ~ size^slope, fitted to the larger half of the sizes."""
    half = len(size) // 2
    return float(np.polyfit(np.log(size[half:]), np.log(cost[half:]), 1)[0])


def growth(cell: Cell) -> dict[str, Result]:
    """The times of every method for one quantity that grows."""
    rounds = QUICK_ROUNDS if cell.quick else ROUNDS
    sizes, calls = _AXES[cell.task](cell)
    found: dict[str, dict[int, float]] = {}
    for size in sizes:
        for name, taken in interleaved(calls(size), STATES, rounds).items():
            found.setdefault(name, {})[size] = float(np.median(taken)) / (size if cell.task == "batch" else 1)
    return {
        name: {
            "size": list(cost),
            "median_us": list(cost.values()),
            "slope": slope(list(cost), list(cost.values())) if len(cost) > 2 else None,
        }
        for name, cost in found.items()
    }


Axis = tuple[Sequence[int], Callable[[int], dict[str, Call]]]


def _joints(cell: Cell, share: float) -> Axis:
    def calls(m: int) -> dict[str, Call]:
        rng = np.random.default_rng([cell.seed, m])
        setting = Setting(m, pitch=PITCH)
        questions = []
        for _ in range(STATES):
            J, s = random_chain(rng, m), rng.standard_normal(6)
            reach = np.full(m, share * float(np.abs(np.linalg.pinv(J).dot(s)).max()))
            questions.append(Question(J, s, -reach, reach))
        found = {}
        for name in cell.methods:
            call = _solving(methods()[name], setting, questions)
            if call is not None:
                found[name] = call
        return found

    return QUICK_JOINTS if cell.quick else JOINTS, calls


def _solving(method: Method, setting: Setting, questions: list[Question]) -> Call | None:
    """A method on these states; None if it fails in one of them, since the time of a failure means nothing."""
    if method.make is None:
        return None
    solve = method.make(setting)
    if any(clipped_answer(solve, question) is None for question in questions):
        return None
    return lambda i: solve(*questions[i])


def _tasks(cell: Cell) -> Axis:
    def calls(count: int) -> dict[str, Call]:
        rng = np.random.default_rng([cell.seed, count])
        states = []
        for _ in range(STATES):
            J = random_chain(rng, MANY)
            # Bodies along a chain: each is moved by the joints between the base and itself.
            bodies = [J * (np.arange(MANY) < MANY - 2 * k) for k in range(count)]
            twists = [body.dot(0.1 * rng.standard_normal(MANY)) for body in bodies]
            states.append(list(zip(bodies, twists, strict=True)))
        bounds = Bounds(np.full(MANY, -0.2), np.full(MANY, 0.2))

        def weighed(i: int) -> object:
            return solve_tasks([TwistTask(J, s) for J, s in states[i]], bounds=bounds)

        def ordered(i: int) -> object:
            tasks = [TwistTask(J, s, priority=k) for k, (J, s) in enumerate(states[i])]
            return solve_tasks(tasks, bounds=bounds)

        return {f"{OURS}, weighed": weighed, f"{OURS}, in order": ordered}

    return QUICK_TASKS if cell.quick else TASKS, calls


def _rows(cell: Cell) -> Axis:
    def calls(count: int) -> dict[str, Call]:
        rng = np.random.default_rng([cell.seed, count])
        states = []
        for _ in range(STATES):
            J, s = random_chain(rng, FEW), rng.standard_normal(6)
            x = np.linalg.pinv(J).dot(s)
            C = rng.standard_normal((count, FEW))
            side = NARROW * float(np.abs(C.dot(x)).max()) * np.ones(count)
            reach = WIDE * float(np.abs(x).max()) * np.ones(FEW)
            states.append((J, s, Bounds(-reach, reach), LimitRows(C, -side, side)))

        def by(backend: str) -> Call:
            def call(i: int) -> object:
                J, s, bounds, rows = states[i]
                return solve_velocity(J, s, bounds=bounds, rows=rows, backend=backend)

            return call

        return {f"{OURS}, DAQP": by("daqp"), f"{OURS}, OSQP": by("osqp")}

    return QUICK_ROWS if cell.quick else ROWS, calls


def _batch(cell: Cell) -> Axis:
    def calls(count: int) -> dict[str, Call]:
        rng = np.random.default_rng([cell.seed, count])
        J = np.array([random_chain(rng, FEW) for _ in range(count)])
        s = rng.standard_normal((count, 6))

        def together(_: int) -> object:
            return solve_velocities(J, s)

        def in_a_loop(_: int) -> object:
            return [solve_velocity(*question) for question in zip(J, s, strict=True)]

        def pinv(_: int) -> object:
            return np.matmul(np.linalg.pinv(J), s[:, :, None])

        return {f"{OURS}, solve_velocities": together, f"{OURS}, in a loop": in_a_loop, "numpy pinv, stacked": pinv}

    return QUICK_BATCH if cell.quick else BATCH, calls


_AXES: dict[str, Callable[[Cell], Axis]] = {
    "joints": lambda cell: _joints(cell, WIDE),
    "joints, limits active": lambda cell: _joints(cell, NARROW),
    "tasks": _tasks,
    "rows": _rows,
    "batch": _batch,
}

KINDS: dict[str, Kind] = {"growth": Kind(growth, alone=True, tasks=tuple(_AXES), fits=has_solver)}
