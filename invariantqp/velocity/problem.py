"""The velocity law as a function of plain arrays: all arguments are checked here, for every function that solves one.

Reference: [DS] Sect. 6.2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.engine import Engine
from invariantqp.legacy.compiled import compiled_problem
from invariantqp.legacy.damping import Damping, PaperLambda
from invariantqp.legacy.problem import problem_of
from invariantqp.legacy.report import damped
from invariantqp.legacy.solve import solve
from invariantqp.legacy.tick import posed
from invariantqp.velocity.backends import Backend
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.forms import CarriedMetric, Form
from invariantqp.velocity.guard import Guard
from invariantqp.velocity.limits import Bounds, LimitRows, ToolSpeed
from invariantqp.velocity.reasons import TOOL_SPEED, row_name
from invariantqp.velocity.reasons import named as limits_in_words
from invariantqp.velocity.solution import VelocitySolution

if TYPE_CHECKING:
    from typing_extensions import Unpack


class MethodChoice(NamedTuple):
    """Which method `solve_velocity` would use, and why.

    Attributes:
        method: "closed-form", "damped" or "qp".
        reason: in words.
        damping: lambda that would be used [length; unit of root J].
        conditioning: smallest singular value of the measured joint twists over the largest, in [0, 1]: how far from a
            singularity.
    """

    method: str
    reason: str
    damping: float
    conditioning: float


class VelocityOptions(TypedDict, total=False):
    """The keyword arguments of `solve_velocity`, `solve_velocities`, `solve_tasks` and `method_for`.

    form: what is attempted of a twist that the joints cannot do: None (the default) is least squares at the point; a
        pitch h [length/rad], PitchForm, Complement or a form of yours; CarriedMetric replaces the measure instead.
    damping: lambda >= 0 [length], or a policy; None is `Adaptive()`, which acts near singularities only, more strongly
        where some joint has no bound. PaperLambda is [DS]'s own problem.
    bounds: joint velocity limits, `Bounds` or (lower, upper); None is no limits.
    exact: rows A x = b, met before anything is minimised; they slow down where limits forbid their full speed.
    joint_metric: (m, m) or (m,) positive definite M, the size of a joint velocity is x'Mx; None is the identity, with
        1/L^2 for prismatic joints.
    backend: "daqp", any solver that qpsolvers has, or a `Backend` of yours: it says which limits are near.
    guard: the descent guard of a form; False switches it off.
    posture: (m,) joint velocity wanted where the twist leaves joints free; None is zero.
    rows: limits on combinations of joint velocities; they give way where they contradict the bounds.
    tool_speed: speed limit of a point; it gives way where it contradicts bounds or rows.
    point: (3,) in the frame of J, the physical point at which the error is least where the twist cannot be met; None or
        "own" is the arm's own point, which its joints move least. Name one where the joint axes nearly meet in a point.
    length: L [length/rad]: a radian counts as much as L units of length at the point; None is the arm's reach to it.
    engine: "compiled" (the default) for the compiled core where there is one, "python" for Python alone.
    """

    form: Form | CarriedMetric | float | None
    damping: Damping | PaperLambda | float | None
    bounds: Bounds | tuple[ArrayLike, ArrayLike] | None
    exact: ExactRows | None
    joint_metric: ArrayLike | None
    backend: Backend | str
    guard: Guard | bool
    posture: ArrayLike | None
    rows: LimitRows | None
    tool_speed: ToolSpeed | None
    point: ArrayLike | str | None
    length: float | None
    engine: Engine


def known(options: VelocityOptions) -> None:
    """Refuse options that there are not.

    Raises:
        TypeError: one is unknown.
    """
    unknown = options.keys() - VelocityOptions.__annotations__.keys()
    if unknown:
        raise TypeError(f"no option {min(unknown)!r}; there are {', '.join(VelocityOptions.__annotations__)}")


def solve_velocity(J: ArrayLike, twist: ArrayLike, **options: Unpack[VelocityOptions]) -> VelocitySolution:
    """Joint velocities for a twist, the same in every frame and unit, inside the bounds.

    Where joints and limits can do the whole twist, they do, in closed form. Otherwise the error is least in the measure
    |s|^2 = L^2 |omega|^2 + |v at the point|^2, taken at one physical point. A form changes what is attempted of the
    part that the joints cannot do.

    Args:
        J: (6, m) joint twists (omega; v) as columns, in any one frame, the joint at the base first.
        twist: (6,) wanted twist in the same frame [rad/s; length/s].
        options: form, damping, bounds, exact, joint_metric, backend, guard, posture, rows, tool_speed, point, length,
            see `VelocityOptions`.

    Returns:
        VelocitySolution: velocity (m,) inside the bounds, with method, status and reason.

    Raises:
        BadInput: NaN, a twist above 1e12, shapes that do not fit, crossed bounds, a metric that is not positive
            definite.
        UnknownName: no such back end.

    Reference: [DS] Sect. 6.2 for forms. A stationary point of an indefinite form is not a minimum, hence the guard.
    """
    found = compiled_problem(J, twist, **options)
    if found is not None:
        return found
    known(options)
    return solve(*problem_of(J, twist, **options))


def method_for(J: ArrayLike, twist: ArrayLike, **options: Unpack[VelocityOptions]) -> MethodChoice:
    """Which method `solve_velocity` would use for the same arguments, and why; no QP is solved.

    Raises:
        BadInput: as `solve_velocity`.
        UnknownName: no such back end.
    """
    known(options)
    law, demand = problem_of(J, twist, **options)
    if isinstance(law.damping, PaperLambda):
        return MethodChoice("damped", "[DS]'s formula as it is printed, clipped to the bounds", 0.0, 1.0)
    problem = posed(law, demand, law.damping)
    objective = problem.objective(1.0)
    x = problem.reduction.full + problem.reduction.basis.dot(objective.centre())
    x = x if law.to_joint is None else law.to_joint.dot(x)
    if not demand.allows(x):
        joints = np.flatnonzero((x < demand.lower) | (x > demand.upper)).tolist()
        rows = [TOOL_SPEED] if demand.cone is not None and not demand.cone.allows(x) else []
        if demand.rows is not None:
            rows += [row_name(i, demand.rows.names) for i in np.flatnonzero(demand.rows.excess(x)).tolist()]
        exceeded = limits_in_words(joints, rows)
        reason = f"the closed form exceeds the limits of {exceeded}; solved by {law.backend.name}"
        return MethodChoice("qp", reason, objective.damping, objective.ratio)
    if objective.damping > 0.0:
        return MethodChoice("damped", str(damped(objective)), objective.damping, objective.ratio)
    return MethodChoice("closed-form", "no limit is active and no singularity is near", 0.0, objective.ratio)
