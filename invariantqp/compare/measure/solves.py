"""Single solves against exact answers: without limits met, with limits met, and near a singularity.

    error    |x - x*| / |x*|,   x* the exact answer of the problem that the method solves; where limits are met, of that
             problem inside the limits

One solve is the twist inside the limits alone: no posture and no exact rows. Joint positions are uniformly distributed
over the joint range and twists are random; one seed determines them all.

Results: {"free": {"error", "error_max", "failed"}, "limited": {...}, "singular": {...}}.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from invariantqp.analysis.survey import joint_ranges
from invariantqp.compare.exact import NoReference
from invariantqp.compare.laws.loop import setting_of
from invariantqp.compare.measure.cell import Cell, Kind, Result
from invariantqp.compare.method import Method, Question, Setting, Solve
from invariantqp.compare.registry import methods
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.taskfile import load_task

Exact = Callable[[Method, str, int], Array | None]
SORTS = ("free", "limited", "singular")
# States of each sort of a full run, and of a quick one.
COUNT, QUICK_COUNT = 20, 4
# Standard deviation of each component of the wanted twists [rad/s, m/s].
TWIST = 0.3
# Smallest singular value over the largest, above which a state is not near a singularity.
REGULAR = 1e-2
# Velocity bounds as multiples of the largest joint speed of Moore-Penrose: never met, and met.
WIDE, NARROW = 10.0, 0.7
# The bounds of each joint are multiplied by a random factor from this range, since real joints differ.
UNEVEN = (0.7, 1.3)
# Distance from a singularity, as powers of ten of a radian.
NEAREST, FARTHEST = -4.0, -1.5


def questions(robot: Robot, sort: str, count: int, seed: int) -> list[Question]:
    """Random ticks of one of SORTS, in the tool frame; fewer than `count` if regular states are too rare."""
    rng = np.random.default_rng([seed, SORTS.index(sort)])
    low, high = joint_ranges(robot)
    found: list[Question] = []
    for _ in range(200 * count):
        if len(found) == count:
            break
        q = rng.uniform(low, high)
        q = _near_singular(robot, q, rng) if sort == "singular" else q
        J = se3.inverse_adjoint(robot.pose(q)).dot(robot.jacobian(q))
        sigma = np.linalg.svd(J, compute_uv=False)
        s, uneven = TWIST * rng.standard_normal(6), rng.uniform(*UNEVEN, len(q))
        if sort == "singular" or sigma[-1] > REGULAR * sigma[0]:
            size = float(np.abs(np.linalg.pinv(J).dot(s)).max())
            reach = uneven * size * (NARROW if sort == "limited" else WIDE)
            found.append(Question.plain(J, s, -reach, reach))
    return found


def _near_singular(robot: Robot, q: Array, rng: np.random.Generator) -> Array:
    """Joint positions close to a singularity, which a minimiser finds from q."""

    def distance(x: Array) -> float:
        sigma = np.linalg.svd(robot.jacobian(x), compute_uv=False)
        return float((sigma[-1] / sigma[0]) ** 2)

    low, high = joint_ranges(robot)
    singular = minimize(distance, q, method="L-BFGS-B", bounds=list(zip(low, high, strict=True)), tol=1e-14).x
    step = rng.standard_normal(len(q))
    away = singular + 10.0 ** rng.uniform(NEAREST, FARTHEST) * step / np.linalg.norm(step)
    return np.asarray(np.minimum(np.maximum(away, low), high))


def clipped_answer(solve: Solve, question: Question) -> Array | None:
    """A method's velocity clipped to the limits; None if it raises or its answer is not finite."""
    try:
        with np.errstate(all="ignore"):
            x = np.asarray(solve(question), dtype=np.float64)
    except Exception:  # noqa: BLE001 (whatever a solver raises is counted as a failure)
        return None
    return np.minimum(np.maximum(x, question.lower), question.upper) if np.isfinite(x).all() else None


def errors(cell: Cell) -> dict[str, Result]:
    """The error of every method; methods with the same problem share its exact answers."""
    from invariantqp.compare.exact.references import reference

    task = load_task(cell.task)
    robot = task.load_robot()
    setting = setting_of(robot, task.law)
    count = QUICK_COUNT if cell.quick else COUNT
    drawn = {sort: questions(robot, sort, count, cell.seed) for sort in SORTS}
    kept: dict[tuple[str, str, int], Array | None] = {}

    def exact(method: Method, sort: str, i: int) -> Array | None:
        key = (method.problem, sort, i)
        if key not in kept:
            try:
                kept[key] = reference(method.problem, drawn[sort][i], setting, limited=sort == "limited")
            except NoReference:
                kept[key] = None
        return kept[key]

    table = methods()
    return {
        name: {sort: _error(table[name], sort, drawn[sort], setting, exact) for sort in SORTS} for name in cell.methods
    }


def _error(method: Method, sort: str, drawn: list[Question], setting: Setting, exact: Exact) -> Result:
    make = method.make
    found, failed = [], 0
    solve = make(setting) if make is not None else None
    for i, question in enumerate(drawn):
        truth = exact(method, sort, i)
        x = None if solve is None else clipped_answer(solve, question)
        failed += x is None
        if truth is not None and x is not None:
            found.append(float(np.linalg.norm(x - truth) / np.linalg.norm(truth)))
    return {
        "error": float(np.median(found)) if found else None,
        "error_max": max(found) if found else None,
        "failed": failed / max(1, len(drawn)),
    }


def has_problem(name: str) -> bool:
    """Whether a method says which problem it solves."""
    method = methods()[name]
    return bool(method.problem) and method.make is not None


KINDS = {"error": Kind(errors, together=True, fits=has_problem, needs=("mpmath",))}
