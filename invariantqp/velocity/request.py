"""The velocity law as a function of plain arrays: everything is checked here, once.

Reference: [DS] Sect. 6.2; `invariantqp.velocity.solve` for what is done with it.
"""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.damping import Damping, damping_of
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.forms import CarriedMetric, Form, form_of
from invariantqp.velocity.guard import Guard
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.limits.box import Bounds
from invariantqp.velocity.limits.rows import LimitRows, named
from invariantqp.velocity.limits.toolspeed import Cone, ToolSpeed
from invariantqp.velocity.qp.backends import Backend, backend_of
from invariantqp.velocity.solution import VelocitySolution, conditioning, damping_reason
from invariantqp.velocity.solve import solve

BLIND = "no pitch form sees all of these joints: twists are measured by diag(L^2 I, I) at their own point"


class MethodChoice(NamedTuple):
    """Which way `solve_velocity` would take, and why.

    Attributes:
        method: "closed-form", "damped" or "qp".
        reason: in words.
        damping: lambda that would be used [unit of G].
        conditioning: smallest |mu| over largest: the distance from a singularity or a principal pitch, in [0, 1].
    """

    method: str
    reason: str
    damping: float
    conditioning: float


class UnitsMixed(UserWarning):
    """Prismatic and revolute joints without a joint metric: what is shortest depends on the unit of length."""

    ADVICE = (
        "prismatic and revolute joints without a joint_metric: where joints are redundant or limited, the answer "
        "depends on the unit of length. Pass joint_metric, for instance ones with 1/length^2 at the prismatic joints."
    )


def units_mix(J: Array) -> bool:
    """Whether some joints of (6, m) twists turn and some only slide."""
    turns = np.abs(J[:3]).max(axis=0) > 0.0
    slides = ~turns & (np.abs(J[3:]).max(axis=0) > 0.0)
    return bool(turns.any() and slides.any())


def _asked(
    J: ArrayLike,
    twist: ArrayLike,
    form: Form | float | None,
    damping: Damping | float | None,
    bounds: Bounds | None,
    exact: ExactRows | None,
    joint_metric: ArrayLike | None,
    backend: Backend | str,
    guard: Guard | bool,
    posture: ArrayLike | None,
    rows: LimitRows | None,
    tool_speed: ToolSpeed | None,
) -> tuple[VelocityLaw, Demand]:
    twists, s = arrays.columns(J), arrays.twist(twist)
    m = twists.shape[1]
    if bounds is None:
        lower, upper = np.full(m, -np.inf), np.full(m, np.inf)
    elif isinstance(bounds, Bounds):
        lower, upper = np.asarray(bounds.lower), np.asarray(bounds.upper)
        if len(lower) != m:
            raise BadInput("bounds", f"{len(lower)} limits", f"{m}, one for each column of J")
    else:
        raise BadInput("bounds", type(bounds).__name__, "Bounds(lower, upper)")
    if exact is not None:
        if not isinstance(exact, ExactRows):
            raise BadInput("exact", type(exact).__name__, "ExactRows(A, b)")
        if np.shape(exact.A)[1] != m:
            raise BadInput("exact", f"rows on {np.shape(exact.A)[1]} joints", f"rows on {m}, one for each column of J")
    _check_rows(rows, m)
    metric = None if joint_metric is None else arrays.positive_definite(joint_metric, m, "joint_metric")
    if metric is None and units_mix(twists):
        warnings.warn(UnitsMixed.ADVICE, UnitsMixed, stacklevel=3)
    chosen = form_of(form, twists, s)
    law = VelocityLaw(
        form=chosen,
        damping=damping_of(damping),
        guard=guard_of(guard),
        metric=metric,
        backend=backend_of(backend),
        note=BLIND if form is None and isinstance(chosen, CarriedMetric) else "",
    )
    wanted = None if posture is None else arrays.vector(posture, m, "posture")
    return law, Demand(twists, s, lower, upper, exact, wanted, rows=rows, cone=_cone(tool_speed, twists))


def _check_rows(rows: LimitRows | None, m: int) -> None:
    if rows is None:
        return
    if not isinstance(rows, LimitRows):
        raise BadInput("rows", type(rows).__name__, "LimitRows(C, lower, upper)")
    if np.shape(rows.C)[1] != m:
        raise BadInput("rows", f"rows on {np.shape(rows.C)[1]} joints", f"rows on {m}, one for each column of J")


def _cone(tool_speed: ToolSpeed | None, J: Array) -> Cone | None:
    if tool_speed is None:
        return None
    if not isinstance(tool_speed, ToolSpeed):
        raise BadInput("tool_speed", type(tool_speed).__name__, "ToolSpeed(limit, point)")
    if tool_speed.point is None:
        raise BadInput("tool_speed", "no point", "ToolSpeed(limit, point)", "Say which point, in the frame of J.")
    return tool_speed.cone(J, np.asarray(tool_speed.point))


def guard_of(guard: Guard | bool) -> Guard | None:
    """The guard meant: True is the default one, False none."""
    if isinstance(guard, Guard):
        return guard
    if not isinstance(guard, bool):
        raise BadInput("guard", type(guard).__name__, "a Guard, True or False")
    return Guard() if guard else None


def solve_velocity(
    J: ArrayLike,
    twist: ArrayLike,
    *,
    form: Form | float | None = None,
    damping: Damping | float | None = None,
    bounds: Bounds | None = None,
    exact: ExactRows | None = None,
    joint_metric: ArrayLike | None = None,
    backend: Backend | str = "daqp",
    guard: Guard | bool = True,
    posture: ArrayLike | None = None,
    rows: LimitRows | None = None,
    tool_speed: ToolSpeed | None = None,
) -> VelocitySolution:
    """Joint velocities for a twist, the same in every frame: the stationary point of the form, inside the bounds.

    Closed form where it exists and no bound is met, the convex QP with the same optimum otherwise.

    Args:
        J: (6, m) joint twists (omega; v) as columns, in any one frame.
        twist: (6,) wanted twist in the same frame [rad/s; length/s].
        form: a pitch h [length/rad], PitchForm, CarriedMetric or Complement; None is the pitch form of the arm's own
            length.
        damping: lambda >= 0 [unit of G, a length for pitch forms], or a policy; None is `Adaptive()`, which acts near
            singularities and principal pitches only.
        bounds: joint velocity limits; None is none.
        exact: rows A x = b met before anything is minimised, slowed down where the bounds forbid them.
        joint_metric: (m, m) or (m,) positive definite, what counts as a short joint velocity; None is the identity.
        backend: "daqp", "osqp", any solver qpsolvers has, or a `Backend` of yours (a kept `Osqp()`, for instance).
        guard: the descent guard; False switches it off.
        posture: (m,) joint velocity wanted where the twist leaves joints free; None is zero.
        rows: limits on combinations of joint velocities; they give way where they contradict the bounds.
        tool_speed: speed limit of a point; it gives way where it contradicts bounds or rows.

    Returns:
        VelocitySolution: velocity (m,) inside the bounds, with method, status and reason.

    Raises:
        BadInput: NaN, shapes that do not fit, crossed bounds, a metric that is not positive definite.
        UnknownName: no such back end.

    Reference: [DS] Sect. 6.2. A stationary point of an indefinite form is not a minimum; the guard sees to descent.
    """
    law, demand = _asked(
        J, twist, form, damping, bounds, exact, joint_metric, backend, guard, posture, rows, tool_speed
    )
    return solve(law, demand)


def method_for(
    J: ArrayLike,
    twist: ArrayLike,
    *,
    form: Form | float | None = None,
    damping: Damping | float | None = None,
    bounds: Bounds | None = None,
    exact: ExactRows | None = None,
    joint_metric: ArrayLike | None = None,
    backend: Backend | str = "daqp",
    guard: Guard | bool = True,
    posture: ArrayLike | None = None,
    rows: LimitRows | None = None,
    tool_speed: ToolSpeed | None = None,
) -> MethodChoice:
    """Which way `solve_velocity` would take for the same arguments, and why; no QP is solved.

    Raises:
        BadInput: as `solve_velocity`.
        UnknownName: no such back end.
    """
    law, demand = _asked(
        J, twist, form, damping, bounds, exact, joint_metric, backend, guard, posture, rows, tool_speed
    )
    problem = law.build(demand)
    x = problem.unconstrained()
    lam = problem.convex.damping
    if not demand.allows(x):
        outside = np.flatnonzero((x < demand.lower) | (x > demand.upper)).tolist()
        m = len(x)
        if rows is not None:
            outside += [m + i for i in np.flatnonzero(rows.excess(x)).tolist()]
        who = [named(outside, m)] if outside else []
        if demand.cone is not None and not demand.cone.allows(x):
            who.append("the tool")
        reason = f"the closed form would take {' and '.join(who)} past their limits; {law.backend.name}"
        return MethodChoice("qp", reason, lam, conditioning(problem.convex))
    if lam > 0.0:
        return MethodChoice("damped", damping_reason(problem.convex), lam, conditioning(problem.convex))
    reason = f"the {law.form.describe()} has a stationary point and no bound is met"
    return MethodChoice("closed-form", reason, lam, conditioning(problem.convex))
