"""Several tasks at once: a weighted sum of objectives within a level, and strict priority between levels.

    level 1:  x_1 = argmin sum_i w_i 1/2 |K_i (x - x_i*)|^2      inside the bounds, with the exact rows
    level 2:  likewise among the x with J_1 x = J_1 x_1, and so on

Each twist task has the objective that it would have alone, measured at its point, so the sum does not depend on frames
either. A joint task asks for a joint velocity: towards a posture, or zero for little motion. Each level moves only what
the levels above leave free, x = x_1 + B z with J_1 B = 0, so no lower level disturbs a higher one.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from math import sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.engine import core
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, sizes
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.linear import rank_of
from invariantqp.legacy.attempted import attempted
from invariantqp.legacy.compiled import compiled_problem
from invariantqp.legacy.damping import Damping, PaperLambda
from invariantqp.legacy.exact import Reduction, reduce
from invariantqp.legacy.law import Demand, VelocityLaw
from invariantqp.legacy.objective import least_squares, spectrum_of
from invariantqp.legacy.problem import problem_of
from invariantqp.legacy.qp import Quadratic
from invariantqp.legacy.report import WHOLE_SPEED, at_limits, row_troubles, slowed_rows, status_of
from invariantqp.legacy.solution import clipped
from invariantqp.legacy.solve import computed
from invariantqp.legacy.tick import Room, room_within
from invariantqp.velocity.arguments import Measure, measure_of
from invariantqp.velocity.exact import ROW_TOLERANCE
from invariantqp.velocity.forms import CarriedMetric, Form, form_of
from invariantqp.velocity.problem import known
from invariantqp.velocity.reasons import Code, Reason, worst_first
from invariantqp.velocity.solution import VelocitySolution

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from invariantqp.engine import Task
    from invariantqp.velocity.problem import VelocityOptions

# Options that belong to each task.
REFUSED = {
    "form": "Give each TwistTask its own form.",
    "posture": "Add a JointTask of the last priority.",
    "point": "Give each TwistTask its own point.",
    "length": "Give each TwistTask its own point.",
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
            twist: (6,) wanted, in the frame of J.
            form: what is attempted of a twist that the joints cannot do, as in `solve_velocity`.
            weight: share in its level's sum [1], positive.
            priority: level, 0 first.
            point: (3,) at which the error is least where the twist cannot be met, as in `solve_velocity`.

        Raises:
            BadInput: NaN, shapes that do not fit, a weight that is not positive, something that is no form or point.
        """
        twists, wanted, chosen = sizes.joint_twists(J), sizes.not_too_fast(arrays.twist(twist)), form_of(form)
        measure = measure_of(twists, wanted, chosen, point, None)
        share, level = arrays.number(weight, "weight", positive=True), arrays.count(priority, "priority")
        self.__attrs_init__(twists, wanted, chosen, share, level, measure.point, measure)


@frozen(init=False, eq=False, repr=False, slots=False)
class JointTask(Value):
    """Move the joints themselves: towards a posture, gain (q_wanted - q), or zero for little motion."""

    velocity: Array = field(converter=own)
    weight: float
    priority: int

    def __init__(self, velocity: ArrayLike, weight: float = 1.0, priority: int = 0) -> None:
        """A task.

        Args:
            velocity: (m,) wanted [rad/s, length/s].
            weight: share in its level's sum, positive [length^2: a radian counts as that length at the tasks' points].
            priority: level, 0 first.

        Raises:
            BadInput: NaN, a weight that is not positive.
        """
        share, level = arrays.number(weight, "weight", positive=True), arrays.count(priority, "priority")
        self.__attrs_init__(arrays.vector(velocity, None, "velocity"), share, level)


def solve_tasks(tasks: Sequence[TwistTask | JointTask], **options: Unpack[VelocityOptions]) -> VelocitySolution:
    """Joint velocities for several tasks; lower levels never disturb what a higher one achieves inside the limits.

    There is no descent guard here: it needs the error of one twist.

    Args:
        tasks: of one arm, any order; those of one priority are weighed against each other.
        options: damping, bounds, exact, joint_metric, backend, rows, tool_speed; see `VelocityOptions`. form,
            point, length and posture belong to a task.

    Returns:
        VelocitySolution; residual is that of the first twist task of the highest level, zero where there is none.

    Raises:
        BadInput: no tasks, different numbers of joints, NaN, an option that is refused, PaperLambda.
    """
    if not isinstance(tasks, Sequence) or not tasks:
        raise BadInput(
            "tasks", "none" if isinstance(tasks, Sequence) else excerpt(tasks), "a list of TwistTask, JointTask"
        )
    for name, remedy in REFUSED.items():
        if options.get(name) is not None:
            raise BadInput(name, "given for several tasks", "None", remedy)
    m = _joints(tasks[0], 0)
    for i, task in enumerate(tasks):
        if _joints(task, i) != m:
            raise BadInput(f"tasks[{i}]", f"{_joints(task, i)} joints", f"{m}, as in tasks[0]")
    levels = [list(g) for _, g in groupby(sorted(tasks, key=lambda t: t.priority), key=lambda t: t.priority)]
    first = next((t for level in levels for t in level if isinstance(t, TwistTask)), None)
    J, s = (np.zeros((6, m)), np.zeros(6)) if first is None else (first.J, first.twist)
    found = _compiled(levels, J, s, options)
    if found is not None:
        return found
    known(options)
    law, demand = problem_of(J, s, **options)
    if isinstance(law.damping, PaperLambda):
        raise BadInput("damping", "PaperLambda", "a policy with a convex objective, such as Adaptive()")
    damping = law.damping
    return computed(demand, lambda: _solved(levels, law, demand, damping))


def _compiled(
    levels: list[list[TwistTask | JointTask]], J: Array, s: Array, options: VelocityOptions
) -> VelocitySolution | None:
    """The answer of the core, which has no forms here, and no more than 16 tasks; None where Python has to answer."""
    tasks = [(i, task) for i, level in enumerate(levels) for task in level]
    if core is None or len(tasks) > core.MOST_JOINTS or J.shape[1] > core.MOST_JOINTS:
        return None
    told: list[Task] = []
    for priority, task in tasks:
        fields: dict[str, Any] = {"priority": priority, "weight": task.weight}
        if isinstance(task, JointTask):
            fields |= {"velocity": task.velocity}
        elif task.measure.form is None:
            fields |= {"J": task.J, "s": task.twist, "root": task.measure.root}
        else:
            return None
        told.append(core.Task(**fields))
    return compiled_problem(J, s, tuple(told), **options)


def _joints(task: TwistTask | JointTask, i: int) -> int:
    if isinstance(task, TwistTask):
        return int(task.J.shape[1])
    if isinstance(task, JointTask):
        return len(task.velocity)
    raise BadInput(f"tasks[{i}]", excerpt(task), "a TwistTask or a JointTask")


def _solved(
    levels: list[list[TwistTask | JointTask]], law: VelocityLaw, demand: Demand, damping: Damping
) -> VelocitySolution:
    T = np.eye(len(demand.lower)) if law.to_joint is None else law.to_joint
    reduction = Reduction.without_rows(len(T))
    if demand.exact is not None:
        reduction = reduce(demand.exact.on(law.to_joint), demand.root)
    room = room_within(law, demand, reduction)
    troubles = [*room.limits.troubles, *row_troubles(demand, reduction)]
    bounded, backend = False, ""
    for level in levels:
        if not room.basis.shape[1]:
            break
        found = room.nearest(law.backend, _sum(level, room, T, damping))
        room = room.narrowed(found.z, _left(level, T.dot(room.basis)))
        bounded = bounded or found.nu > 0.0 or bool(found.multipliers.any())
        backend = found.backend or backend
        if found.trouble:
            troubles.append(Reason(Code.SOLVER, words=found.trouble))
    x, active = clipped(demand, T.dot(room.origin))
    slowed = slowed_rows(demand, room, law.to_joint)
    reasons = [*troubles, *slowed, *at_limits(demand, x, active, None)]
    share, residual = room.share.value, demand.s - demand.J.dot(x)
    status = status_of(troubles, share, 0.0, limited=bool(slowed))
    method = "qp" if bounded or share < WHOLE_SPEED else "closed-form"
    return VelocitySolution(x, method, status, worst_first(reasons), active, residual, share, 0.0, 0.0, backend)


def _sum(level: list[TwistTask | JointTask], room: Room, T: Array, damping: Damping) -> Quadratic:
    """The weighted sum of a level's objectives over z."""
    n = room.basis.shape[1]
    roots, wanted = [], []
    for task in level:
        weight = sqrt(task.weight)
        if isinstance(task, TwistTask):
            measure = task.measure
            A, b = measure.root.dot(task.J).dot(T), measure.root.dot(task.twist)
            whole = spectrum_of(A)
            if measure.form is not None:
                b = attempted(measure.form, np.asarray(np.linalg.inv(measure.root)), whole, b, damping, None)
            spectrum = spectrum_of(A.dot(room.basis), whole.largest)
            objective = least_squares(spectrum, room.share.value * b - A.dot(room.origin), None, damping)
            root = np.sqrt(objective.weights)
            roots.append(weight * root[:, None] * objective.V.T)
            wanted.append(weight * root * objective.optimum)
        else:
            roots.append(weight * np.eye(n))
            wanted.append(weight * room.coordinates(np.asarray(np.linalg.solve(T, task.velocity), np.float64)))
    return Quadratic.weighted(np.vstack(roots), np.concatenate(wanted))


def _left(level: list[TwistTask | JointTask], B: Array) -> Array:
    """(n, k) directions of z that move none of the level's bodies."""
    n = B.shape[1]
    twists = [t.measure.root.dot(t.J).dot(B) for t in level if isinstance(t, TwistTask)]
    if len(twists) < len(level):  # a joint task leaves nothing free
        return np.empty((n, 0))
    _, sigma, Vt = np.linalg.svd(np.vstack(twists))
    rank = rank_of(sigma, ROW_TOLERANCE)
    free: Array = Vt[rank:].T
    return free
