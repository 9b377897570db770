"""The velocity law as a function of plain arrays: all arguments are checked here, for every function that solves one.

Reference: [DS] Sect. 6.2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.engine import ENGINES, Engine
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, sizes
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.velocity.backends import Backend, backend_of
from invariantqp.velocity.compiled import compiled_problem
from invariantqp.velocity.damping import Damping, PaperLambda, damping_of
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.forms import CarriedMetric, Form, form_of
from invariantqp.velocity.law import Demand, Guard, VelocityLaw
from invariantqp.velocity.limits import Bounds, LimitRows, ToolSpeed, bounds_of
from invariantqp.velocity.measure import length_at, own_point, root_at
from invariantqp.velocity.qp import Cone
from invariantqp.velocity.reasons import TOOL_SPEED, row_name
from invariantqp.velocity.reasons import named as limits_in_words
from invariantqp.velocity.report import damped
from invariantqp.velocity.solution import VelocitySolution
from invariantqp.velocity.solve import solve
from invariantqp.velocity.tick import posed

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


def problem_of(J: ArrayLike, twist: ArrayLike, **options: Unpack[VelocityOptions]) -> tuple[VelocityLaw, Demand]:
    """The law, and the demand of one tick, from joint twists J (6, m), a twist (6,) and options, all checked.

    Raises:
        BadInput: NaN, shapes that do not fit, crossed bounds, a metric that is not positive definite.
        UnknownName: no such back end.
    """
    twists, s = sizes.joint_twists(J), sizes.not_too_fast(arrays.twist(twist))
    m = twists.shape[1]
    box = bounds_of(options.get("bounds"), m)
    lower, upper = np.asarray(box.lower), np.asarray(box.upper)
    exact, rows, point = options.get("exact"), options.get("rows"), options.get("point")
    if exact is not None:
        if not isinstance(exact, ExactRows):
            raise BadInput("exact", type(exact).__name__, "ExactRows(A, b)")
        _check_width("exact", np.shape(exact.A)[1], m)
    if rows is not None:
        if not isinstance(rows, LimitRows):
            raise BadInput("rows", type(rows).__name__, "LimitRows(C, lower, upper)")
        _check_width("rows", np.shape(rows.C)[1], m)
    measure = measure_of(twists, s, form_of(options.get("form")), point, options.get("length"))
    metric = metric_of(options.get("joint_metric"), twists, measure.point, measure.length)
    limited = bool(np.isfinite(lower).all() and np.isfinite(upper).all())
    law = law_of(options, measure.form, metric, limited=limited)
    posture, tool_speed = options.get("posture"), options.get("tool_speed")
    wanted = None if posture is None else arrays.vector(posture, m, "posture")
    cone = None if tool_speed is None else _cone(tool_speed, twists, None if point is None else measure.point)
    return law, Demand(twists, s, measure.root, lower, upper, exact, wanted, rows, cone)


def law_of(options: VelocityOptions, form: Form | None, metric: Array | None, *, limited: bool) -> VelocityLaw:
    """The law that options describe, with a form and a metric (m, m) that are checked; `limited` as in `damping_of`."""
    unknown = options.keys() - VelocityOptions.__annotations__.keys()
    if unknown:
        raise TypeError(f"no option {min(unknown)!r}; there are {', '.join(VelocityOptions.__annotations__)}")
    return VelocityLaw(
        form=form,
        damping=damping_of(options.get("damping"), limited=limited),
        guard=guard_of(options.get("guard", True)),
        metric=metric,
        backend=backend_of(options.get("backend", "daqp")),
        engine=arrays.choice(options.get("engine", "compiled"), "engine", ENGINES),
    )


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
    return solve(*problem_of(J, twist, **options))


def method_for(J: ArrayLike, twist: ArrayLike, **options: Unpack[VelocityOptions]) -> MethodChoice:
    """Which method `solve_velocity` would use for the same arguments, and why; no QP is solved.

    Raises:
        BadInput: as `solve_velocity`.
        UnknownName: no such back end.
    """
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


class Measure(NamedTuple):
    """How twists are measured: root (6, 6), its point (3,) and length; and the form, unless it is a CarriedMetric."""

    root: Array
    point: Array
    length: float
    form: Form | None


def measure_of(
    J: Array, s: Array, form: Form | CarriedMetric | None, point: ArrayLike | str | None, length: float | None
) -> Measure:
    """The measure for checked J (6, m) and s (6,).

    Raises:
        BadInput: not a point, or not a positive length.
    """
    if isinstance(point, str) and point != "own":
        raise BadInput("point", excerpt(point), '"own" or (3,) in the frame of J')
    named = point is not None and not isinstance(point, str)
    p = sizes.not_too_far(arrays.vector(point, 3, "point")) if named else own_point(J, s)  # type: ignore[arg-type]
    L = length_at(J, p, s) if length is None else sizes.usual_length(length)
    if isinstance(form, CarriedMetric):
        return Measure(form.root(), p, L, None)
    return Measure(root_at(p, L), p, L, form)


def metric_of(joint_metric: ArrayLike | None, J: Array, point: Array, length: float) -> Array | None:
    """(m, m) the joint metric, None for the identity.

    Without a `joint_metric`, L of a prismatic joint counts as one radian of a revolute one. Where no joint turns that
    still makes joint speeds, by which loops are damped, free of the unit of length.

    Raises:
        BadInput: not symmetric positive definite.
    """
    if joint_metric is not None:
        return arrays.positive_definite(joint_metric, J.shape[1], "joint_metric")
    slides = prismatic(J, point, length)
    if not slides.any():
        return None
    return np.diag(np.where(slides, 1.0 / (length * length), 1.0))


def prismatic(J: Array, point: Array, length: float) -> NDArray[np.bool_]:
    """(m,) which joints of J (6, m) only slide: beside the velocity of the point (3,), they hardly turn."""
    turning, moving = (np.sqrt((part * part).sum(axis=0)) for part in (J[:3], velocity_at(J, point)))
    return np.asarray((turning * length <= NEGLIGIBLE * moving) & (moving > 0.0))


def guard_of(guard: Guard | bool) -> Guard | None:
    """The guard for an argument: True is the default one, False none.

    Raises:
        BadInput: neither.
    """
    if isinstance(guard, Guard):
        return guard
    if not isinstance(guard, bool):
        raise BadInput("guard", type(guard).__name__, "a Guard, True or False")
    return Guard() if guard else None


def _check_width(argument: str, width: int, m: int) -> None:
    if width != m:
        raise BadInput(argument, f"rows on {width} joints", f"rows on {m}, one for each column of J")


def _cone(tool_speed: ToolSpeed, J: Array, point: Array | None) -> Cone:
    if not isinstance(tool_speed, ToolSpeed):
        raise BadInput("tool_speed", type(tool_speed).__name__, "ToolSpeed(limit, point)")
    where = point if tool_speed.point is None else np.asarray(tool_speed.point)
    if where is None:
        raise BadInput("tool_speed", "no point", "ToolSpeed(limit, point)", "Say which point, in the frame of J.")
    return tool_speed.cone(J, where)
