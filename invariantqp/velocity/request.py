"""The velocity law as a function of plain arrays; `invariantqp.velocity.solve` is the computation.

Reference: [DS] Sect. 6.2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.velocity.compiled import compiled_problem
from invariantqp.velocity.damping import PaperLambda
from invariantqp.velocity.posed import posed
from invariantqp.velocity.problem import VelocityProblem
from invariantqp.velocity.qp.quadratic import named
from invariantqp.velocity.report import damping_reason
from invariantqp.velocity.solution import VelocitySolution
from invariantqp.velocity.solve import solve

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from invariantqp.velocity.problem import VelocityOptions


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
    problem = VelocityProblem.of(J, twist, **options)
    return solve(problem.law, problem.demand)


def method_for(J: ArrayLike, twist: ArrayLike, **options: Unpack[VelocityOptions]) -> MethodChoice:
    """Which method `solve_velocity` would use for the same arguments, and why; no QP is solved.

    Raises:
        BadInput: as `solve_velocity`.
        UnknownName: no such back end.
    """
    question = VelocityProblem.of(J, twist, **options)
    law, demand = question.law, question.demand
    if isinstance(law.damping, PaperLambda):
        return MethodChoice("damped", "[DS]'s formula as it is printed, clipped to the bounds", 0.0, 1.0)
    problem = posed(law, demand, law.damping)
    objective = problem.objective(1.0)
    x = problem.left(1.0).joint(objective.centre())
    x = x if law.to_joint is None else law.to_joint.dot(x)
    if not demand.allows(x):
        outside = np.flatnonzero((x < demand.lower) | (x > demand.upper)).tolist()
        m = len(x)
        if demand.rows is not None:
            outside += [m + i for i in np.flatnonzero(demand.rows.excess(x)).tolist()]
        exceeded = [named(outside, m)] if outside else []
        if demand.cone is not None and not demand.cone.allows(x):
            exceeded.append("the tool")
        reason = f"the closed form exceeds the limits of {' and '.join(exceeded)}; solved by {law.backend.name}"
        return MethodChoice("qp", reason, objective.damping, objective.ratio)
    if objective.damping > 0.0:
        return MethodChoice("damped", damping_reason(objective), objective.damping, objective.ratio)
    return MethodChoice("closed-form", "no limit is active and no singularity is near", 0.0, objective.ratio)
