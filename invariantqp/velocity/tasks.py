"""Several tasks at once: a weighted sum of objectives within a level, and strict priority between levels.

    level 1:  x_1 = argmin sum_i w_i 1/2 |A_i x - b_i|^2      inside the bounds, with the exact rows
    level 2:  likewise among the x with J_1 x = J_1 x_1, and so on

Each twist is measured at its own point, so the sum does not depend on frames. A joint task is a desired joint velocity:
towards a posture, or zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import groupby
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from invariantqp.engine import law
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, sizes
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.se3 import velocity_at
from invariantqp.velocity.arguments import Measure, measure_of, metric_of
from invariantqp.velocity.backends import backend_of
from invariantqp.velocity.definition import prioritised
from invariantqp.velocity.forms import CarriedMetric, Form, form_of
from invariantqp.velocity.problem import (
    check_joints,
    checked_options,
    row_names_of,
    solution_by_definition,
    solution_of,
    solve_velocity,
    tick_of,
)
from invariantqp.velocity.solution import VelocitySolution

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from invariantqp.velocity.problem import VelocityOptions

# Options that belong to each task.
UNSUPPORTED = {
    "form": "Give each TwistTask its own form.",
    "posture": "Add a JointTask of the last priority.",
    "point": "Give each TwistTask its own point.",
    "length": "Give each TwistTask its own point.",
    "guard": "Form and guard are for a twist by itself.",
}


@frozen(init=False, eq=False, repr=False, slots=False)
class TwistTask(Value):
    """Move one body of the arm with a twist."""

    J: Array = field(converter=own)
    twist: Array = field(converter=own)
    form: Form | CarriedMetric | None
    weight: float
    priority: int
    point: Array = field(converter=own)
    measure: Measure = field(eq=False, repr=False)

    def __init__(
        self,
        J: ArrayLike,
        twist: ArrayLike,
        form: Form | CarriedMetric | float | None = None,
        weight: float = 1.0,
        priority: int = 0,
        point: ArrayLike | str | None = None,
    ) -> None:
        """A task.

        Args:
            J: (6, m) joint twists of that body; zero columns for joints that do not move it.
            twist: (6,) desired, in the frame of J.
            form: what is attempted of a twist that the joints cannot achieve, as in `solve_velocity`.
            weight: share in its level's sum [1], positive.
            priority: level, 0 first.
            point: (3,) where the error is minimised if the twist cannot be achieved, as in `solve_velocity`.

        Raises:
            BadInput: NaN, shapes that do not fit, a weight that is not positive, something that is no form or point.
        """
        twists, desired, chosen = sizes.bounded_jacobian(J), sizes.bounded_twists(arrays.twist(twist)), form_of(form)
        measure = measure_of(twists, desired, chosen, point, None)
        share, level = arrays.number(weight, "weight", positive=True), arrays.count(priority, "priority")
        self.__attrs_init__(twists, desired, chosen, share, level, measure.point, measure)


@frozen(init=False, eq=False, repr=False, slots=False)
class JointTask(Value):
    """A desired joint velocity: towards a posture, gain (q_desired - q), or zero."""

    velocity: Array = field(converter=own)
    weight: float
    priority: int

    def __init__(self, velocity: ArrayLike, weight: float = 1.0, priority: int = 0) -> None:
        """A task.

        Args:
            velocity: (m,) desired [rad/s, length/s].
            weight: share in its level's sum, positive [length^2: a radian counts as that length at the tasks' points].
            priority: level, 0 first.

        Raises:
            BadInput: NaN, a weight that is not positive.
        """
        share, level = arrays.number(weight, "weight", positive=True), arrays.count(priority, "priority")
        self.__attrs_init__(arrays.vector(velocity, None, "velocity"), share, level)


def solve_tasks(tasks: Sequence[TwistTask | JointTask], **options: Unpack[VelocityOptions]) -> VelocitySolution:
    """Joint velocities for several tasks; lower levels keep what higher ones achieve inside the limits.

    Args:
        tasks: of one arm, in any order; those of one priority are weighted. With a form, a twist s is replaced by P s.
        options: damping, bounds, exact, joint_metric, backend, rows, tool_speed; see `VelocityOptions`. form, guard,
            point, length and posture belong to a task.

    Returns:
        VelocitySolution; residual is that of the first twist task of the highest level, zero where there is none.

    Raises:
        BadInput: no tasks, different numbers of joints, NaN, an option that is refused.
        NoPseudoinverse: the form of a task has no projector.
    """
    if not isinstance(tasks, Sequence) or not tasks:
        raise BadInput(
            "tasks", "none" if isinstance(tasks, Sequence) else excerpt(tasks), "a list of TwistTask, JointTask"
        )
    for name, remedy in UNSUPPORTED.items():
        if options.get(name) not in (None, False):
            raise BadInput(name, "given for several tasks", "None", remedy)
    m = _joints(tasks[0], 0)
    for i, task in enumerate(tasks):
        if _joints(task, i) != m:
            raise BadInput(f"tasks[{i}]", f"{_joints(task, i)} joints", f"{m}, as in tasks[0]")
    check_joints(m)
    ordered = sorted(tasks, key=lambda task: task.priority)
    first = next((task for task in ordered if isinstance(task, TwistTask)), None)
    fields, metric = checked_options(m, options), options.get("joint_metric")
    if first is None:
        fields["metric"] = None if metric is None else arrays.positive_definite(metric, m, "joint_metric")
    else:
        fields["metric"] = metric_of(metric, first.J, first.measure.point, first.measure.length)
    if "tool_speed" in fields:
        point, speed = fields["tool_speed"]
        fields["tool_speed"] = velocity_at(np.zeros((6, m)) if first is None else first.J, point), speed
    levels = [_stacked(list(level), fields["metric"]) for _, level in groupby(ordered, key=lambda task: task.priority)]
    backend = options.get("backend")
    if backend is None:
        solution = solution_of(law.solve_levels(levels, **fields), row_names_of(options.get("rows")))
    else:
        ticks, solver = [tick_of(J, s, root, fields) for J, root, s in levels], backend_of(backend)
        report = partial(law.solve_levels, levels, **fields)
        solution = solution_by_definition(report, partial(prioritised, ticks, solver), ticks[0], solver, options)
    residual = np.zeros(6) if first is None else first.twist - first.J.dot(solution.velocity)
    return solution._replace(residual=residual, multipliers=None, row_multipliers=None)


def _joints(task: TwistTask | JointTask, i: int) -> int:
    if isinstance(task, TwistTask):
        return int(task.J.shape[1])
    if isinstance(task, JointTask):
        return len(task.velocity)
    raise BadInput(f"tasks[{i}]", excerpt(task), "a TwistTask or a JointTask")


def _stacked(level: list[TwistTask | JointTask], metric: Array | None) -> tuple[Array, Array, Array]:
    """J (6 n, m), root (6 n, 6 n) and twists (6 n,) of a level; six joint velocities take the place of a twist."""
    parts = [_twist(task) if isinstance(task, TwistTask) else _velocity(task, metric) for task in level]
    J, roots, s = zip(*parts, strict=True)
    return np.vstack(J), np.asarray(block_diag(*roots)), np.concatenate(s)


def _twist(task: TwistTask) -> tuple[Array, Array, Array]:
    s = task.twist
    if task.measure.form is not None:
        point, length = task.measure.point, task.measure.length
        attempt = solve_velocity(task.J, s, form=task.measure.form, point=point, length=length)
        s = task.J.dot(attempt.velocity)
    return task.J, sqrt(task.weight) * task.measure.root, s


def _velocity(task: JointTask, metric: Array | None) -> tuple[Array, Array, Array]:
    m = len(task.velocity)
    rows = 6 * -(-m // 6)
    J, s = np.zeros((rows, m)), np.zeros(rows)
    J[:m] = np.eye(m) if metric is None else np.linalg.cholesky(metric).T
    s[:m] = J[:m].dot(task.velocity)
    return J, sqrt(task.weight) * np.eye(rows), s
