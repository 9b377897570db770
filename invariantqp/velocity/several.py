"""Several tasks at once: a weighted sum of convex objectives within a level, and strict priority between levels.

    level 1:  x_1 = argmin sum_i w_i 1/2 (x - x_i*)'H_i(x - x_i*)      inside the bounds, with the exact rows
    level 2:  likewise among the x with J_1 x = J_1 x_1, and so on

Each twist task brings the (H_i, c_i) that `convexify` makes of its form, so the sum is as invariant as its terms. A
joint task asks for a joint velocity: the way to a posture, or zero for little motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.damping import Damping, PaperLambda, damping_of
from invariantqp.velocity.exact import ExactRows, Reduction, reduce
from invariantqp.velocity.forms import Form, form_of
from invariantqp.velocity.law import Demand, assemble
from invariantqp.velocity.limits.box import Bounds
from invariantqp.velocity.limits.rows import polytope
from invariantqp.velocity.qp.backends import Backend, SolverFailure, backend_of, minimise
from invariantqp.velocity.solution import VelocitySolution, clipped, held


@dataclass(frozen=True, eq=False)
class TwistTask:
    """Move one body of the arm with a twist.

    Attributes:
        J: (6, m) joint twists of that body; zero columns for joints that do not move it.
        twist: (6,) wanted, in the frame of J.
        form: as in `solve_velocity`.
        weight: share in its level's sum [1], positive.
        priority: level, 0 first.
    """

    J: ArrayLike
    twist: ArrayLike
    form: Form | float | None = None
    weight: float = 1.0
    priority: int = 0

    def __post_init__(self) -> None:
        J, twist = arrays.columns(self.J), arrays.twist(self.twist)
        checked = {"J": J, "twist": twist, "form": form_of(self.form, J, twist), "weight": _weight(self.weight)}
        for name, value in checked.items():
            object.__setattr__(self, name, value)


@dataclass(frozen=True, eq=False)
class JointTask:
    """Move the joints themselves: towards a posture, gain (q_wanted - q), or zero for little motion.

    Attributes:
        velocity: (m,) wanted [rad/s, length/s].
        weight: share in its level's sum, positive [unit of the Gram matrices beside it: length for pitch forms].
        priority: level, 0 first.
    """

    velocity: ArrayLike
    weight: float = 1.0
    priority: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "velocity", arrays.vector(self.velocity, None, "velocity"))
        object.__setattr__(self, "weight", _weight(self.weight))


def _weight(weight: float) -> float:
    return arrays.number(weight, "weight", positive=True)


def solve_tasks(
    tasks: Sequence[TwistTask | JointTask],
    *,
    damping: Damping | float | None = None,
    bounds: Bounds | None = None,
    exact: ExactRows | None = None,
    joint_metric: ArrayLike | None = None,
    backend: Backend | str = "daqp",
) -> VelocitySolution:
    """Joint velocities for several tasks; lower levels never disturb what a higher one achieves inside the bounds.

    There is no descent guard here: it watches one twist, and several have no common error.

    Args:
        tasks: of one arm, any order; those of one priority are weighed against each other.
        damping: as in `solve_velocity`, for every twist task.
        bounds: joint velocity limits.
        exact: rows met before anything else; where the bounds forbid them the answer is "held".
        joint_metric: as in `solve_velocity`.
        backend: as in `solve_velocity`.

    Returns:
        VelocitySolution; residual is that of the first twist task of the highest level, zero where there is none.

    Raises:
        BadInput: no tasks, different numbers of joints, NaN, PaperLambda (which has no convex objective).
    """
    if not tasks:
        raise BadInput("tasks", "none", "at least one TwistTask or JointTask")
    m = _joints(tasks[0])
    for i, task in enumerate(tasks):
        if _joints(task) != m:
            raise BadInput(f"tasks[{i}]", f"{_joints(task)} joints", f"{m}, as in tasks[0]")
    policy = damping_of(damping)
    if isinstance(policy, PaperLambda):
        raise BadInput("damping", "PaperLambda", "a policy with a convex objective, such as Adaptive()")
    lower = np.full(m, -np.inf) if bounds is None else np.asarray(bounds.lower)
    upper = np.full(m, np.inf) if bounds is None else np.asarray(bounds.upper)
    if len(lower) != m:
        raise BadInput("bounds", f"{len(lower)} limits", f"{m}, one a joint")
    metric = None if joint_metric is None else arrays.positive_definite(joint_metric, m, "joint_metric")
    levels = [list(g) for _, g in groupby(sorted(tasks, key=lambda t: t.priority), key=lambda t: t.priority)]
    first = next((t for level in levels for t in level if isinstance(t, TwistTask)), None)
    J, s = (np.zeros((6, m)), np.zeros(6)) if first is None else (np.asarray(first.J), np.asarray(first.twist))
    demand = Demand(J, s, lower, upper, exact)
    solver = backend_of(backend)
    x, fixed, bounded = np.zeros(m), exact, False
    try:
        for level in levels:
            reduction = reduce(m, fixed, metric)
            x, met = _level(level, reduction, demand, policy, solver)
            bounded = bounded or met
            fixed = _with_rows(fixed, level, x)
    except SolverFailure as failure:
        return held(demand, f"no velocity found: {failure}")
    x, active = clipped(demand, x)
    reason = f"at the limits of joints {', '.join(map(str, active))}" if active else ""
    method = "qp" if bounded else "closed-form"
    return VelocitySolution(
        x, method, "ok", reason, active, s - J.dot(x), 1.0, 0.0, 0.0, solver.name if bounded else ""
    )


def _joints(task: TwistTask | JointTask) -> int:
    return np.shape(task.J)[1] if isinstance(task, TwistTask) else len(np.asarray(task.velocity))


def _level(
    level: list[TwistTask | JointTask], reduction: Reduction, demand: Demand, damping: Damping, backend: Backend
) -> tuple[Array, bool]:
    """The best velocity of one level, and whether a bound was met."""
    basis = reduction.basis
    n = len(demand.lower) if basis is None else basis.shape[1]
    if n == 0:
        return reduction.joint(np.empty(0)), False
    H, c = np.zeros((n, n)), np.zeros(n)
    for task in level:
        if isinstance(task, TwistTask):
            own = demand._replace(J=np.asarray(task.J), s=np.asarray(task.twist))
            data = form_of(task.form, own.J).gram_data(own.J, own.s)
            h, g = assemble(data, reduction, own, damping).convex.qp()
            H += task.weight * h
            c += task.weight * g
        else:
            H += task.weight * np.eye(n)
            c += task.weight * reduction.reduced(np.asarray(task.velocity))
    x = reduction.joint(np.asarray(np.linalg.solve(H, c), dtype=np.float64))
    if demand.allows(x):
        return x, False
    limits = polytope(demand.lower, demand.upper, None, reduction)
    return reduction.joint(minimise(backend, H, c, limits).z), True


def _with_rows(fixed: ExactRows | None, level: list[TwistTask | JointTask], x: Array) -> ExactRows:
    """What a level has achieved, as rows for the levels below."""
    m = len(x)
    rows = [np.asarray(t.J) if isinstance(t, TwistTask) else np.eye(m) for t in level]
    achieved = ExactRows(np.vstack(rows), np.concatenate([r.dot(x) for r in rows]))
    return achieved if fixed is None else fixed.with_rows(achieved)
