"""The velocity law as a function of arrays: `solve_velocity`.

The engine reads the arguments. If it refuses them, they are checked here for an error with found, expected and remedy.
Other solvers solve `velocity.definition`.

Reference: [DS] Sect. 6.2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from math import inf
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.engine import law
from invariantqp.errors import BadInput, InvariantQPError
from invariantqp.geometry import arrays, sizes
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.systems.pseudoinverses import factors, no_pseudoinverse
from invariantqp.systems.system import ScrewSystem
from invariantqp.velocity.arguments import damping_of, measure_of, metric_of
from invariantqp.velocity.backends import Backend, SolverFailure, backend_of
from invariantqp.velocity.definition import Answer, Rows, Tick, velocity
from invariantqp.velocity.exact import ExactRows, whitened
from invariantqp.velocity.forms import CarriedMetric, Complement, Form, PitchForm, form_of
from invariantqp.velocity.guard import Guard, guard_of
from invariantqp.velocity.limits import Bounds, LimitRows, ToolSpeed, bounds_of
from invariantqp.velocity.reasons import TOOL_SPEED, Code, Reason
from invariantqp.velocity.solution import ACTIVE_TOLERANCE, Status, VelocitySolution, at_bounds

if TYPE_CHECKING:
    from typing_extensions import Unpack

# An approach scale this close to 1 is the softness of its problem, and not reported.
SCALE_TOLERANCE = 1e-3
# In the order of the engine's enums.
METHODS = ("closed-form", "damped", "qp", "hold")
STATUSES = (Status.OK, Status.LIMITED, Status.GUARDED, Status.SCALED, Status.DEGRADED, Status.HELD)


class VelocityOptions(TypedDict, total=False):
    """The keyword arguments of `solve_velocity`, `solve_velocities` and `solve_tasks`.

    form: what is attempted of a twist that the joints cannot achieve: None is least squares at the point, a pitch h
        [length/rad] is J^{+h} s; or a PitchForm, a Complement, a definite form of yours. A CarriedMetric replaces the
        measure instead.
    damping: lambda >= 0. Without a form, adds lambda^2 |x|^2 to the squared error [length]; with a pitch form, that of
        `systems.damped_pseudoinverse`. None is 0: joints near a singularity are then as fast as the bounds allow.
    bounds: joint velocity limits, `Bounds` or (lower, upper); None is no limits.
    exact: equality constraints A x = b, scaled down where limits forbid their full speed.
    joint_metric: (m, m) or (m,) positive definite M, |x|^2 = x'Mx; None is the identity, with 1/L^2 for prismatic
        joints.
    backend: None is the engine; "daqp", any solver that qpsolvers has, or a `Backend` of yours solves
        `velocity.definition` instead, in milliseconds.
    guard: True or a `Guard` shortens what a form attempts so that the error decreases where no limit is active.
    posture: (m,) desired joint velocity in the null space; None is zero.
    rows: limits on linear combinations of joint velocities; relaxed where they conflict with the bounds.
    tool_speed: speed limit of a point; relaxed where it conflicts with bounds or rows.
    point: (3,) in the frame of J, where the error is minimised if the twist cannot be achieved; None or "own" is the
        arm's own point, which its joints move least. Name one where the joint axes nearly meet in a point.
    length: L [length/rad]: a radian counts as L units of length at the point; None is the arm's reach to it.
    """

    form: Form | CarriedMetric | float | None
    damping: float | None
    bounds: Bounds | tuple[ArrayLike, ArrayLike] | None
    exact: ExactRows | None
    joint_metric: ArrayLike | None
    backend: Backend | str | None
    guard: Guard | bool
    posture: ArrayLike | None
    rows: LimitRows | None
    tool_speed: ToolSpeed | None
    point: ArrayLike | str | None
    length: float | None


def solve_velocity(J: ArrayLike, twist: ArrayLike, **options: Unpack[VelocityOptions]) -> VelocitySolution:
    """Joint velocities for a twist, the same in every frame and unit, inside the bounds.

    A twist that joints and limits allow is achieved, in closed form. Otherwise the error is minimised in the measure
    |s|^2 = L^2 |omega|^2 + |v at the point|^2. A form changes what is attempted of the part that the joints cannot
    achieve: with `form=h` and no active limit, the velocity is J^{+h} s.

    Args:
        J: (6, m) joint twists (omega; v) as columns, in any one frame, the joint at the base first; m up to 64.
        twist: (6,) desired twist in the same frame [rad/s; length/s].
        options: form, damping, bounds, exact, joint_metric, backend, guard, posture, rows (up to 256), tool_speed,
            point, length, see `VelocityOptions`.

    Returns:
        VelocitySolution: velocity (m,) inside the bounds, with method, status and reason.

    Raises:
        BadInput: NaN, a twist above 1e12, shapes that do not fit, crossed bounds, a metric that is not positive
            definite.
        NoPseudoinverse: the form has no projector for these twists, and no damping is given.
        UnknownName: no such back end.

    Reference: [DS] Sect. 6.2 for forms.
    """
    if options.get("backend") is None:
        try:
            return solution_of(law.solve(J, twist, **engine_options(options)), row_names_of(options.get("rows")))
        except (ValueError, TypeError, AttributeError, KeyError):
            pass
        except ArithmeticError:
            raise no_projector(sizes.bounded_jacobian(J), form_of(options.get("form"))) from None
    return _checked_solution(J, twist, options)


def solution_of(
    fields: tuple[Any, ...], row_names: Iterable[str] = (), joint_names: tuple[str, ...] = ()
) -> VelocitySolution:
    """The solution of the engine's fields, with names of limit rows and joints."""
    x, method, status, reasons, active, residual, scale, damping, guard, multipliers, row_multipliers = fields
    backend = "engine" if METHODS[method] == "qp" else ""
    return VelocitySolution(
        x,
        METHODS[method],
        STATUSES[status],
        reasons,
        active,
        residual,
        scale,
        damping,
        guard,
        backend,
        multipliers,
        row_multipliers,
        row_names,
        joint_names,
    )


def row_names_of(rows: LimitRows | None) -> tuple[str, ...]:
    """The names of rows, () for none."""
    return () if rows is None else rows.names


def engine_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options as the engine takes them, not checked: wrong ones raise AttributeError or are refused."""
    fields: dict[str, Any] = {}
    for name, value in options.items():
        if value is not None:
            fields |= ENGINE_OPTIONS[name](value, options)
    return fields


def _bounds(bounds: Any, _options: Mapping[str, Any]) -> dict[str, Any]:
    lower, upper = (bounds.lower, bounds.upper) if isinstance(bounds, Bounds) else bounds
    return {"lower": lower, "upper": upper}


def _tool_speed(tool_speed: Any, options: Mapping[str, Any]) -> dict[str, Any]:
    point = options.get("point") if tool_speed.point is None else tool_speed.point
    return {"tool_speed": (point, tool_speed.limit)}


def _guard(guard: Any, _options: Mapping[str, Any]) -> dict[str, Any]:
    return {} if guard is False else {"guard": Guard().fraction if guard is True else guard.fraction}


def _point(point: Any, _options: Mapping[str, Any]) -> dict[str, Any]:
    return {} if isinstance(point, str) and point == "own" else {"point": point}


# Engine arguments of each option; a joint metric is checked first.
ENGINE_OPTIONS: dict[str, Callable[[Any, Mapping[str, Any]], dict[str, Any]]] = {
    "form": lambda form, _: form_fields(form_of(form)),
    "damping": lambda damping, _: {"damping": damping},
    "bounds": _bounds,
    "exact": lambda rows, _: {"exact": (rows.A, rows.b, rows.of_twist)},
    "guard": _guard,
    "posture": lambda posture, _: {"posture": posture},
    "rows": lambda rows, _: {"rows": (rows.C, rows.lower, rows.upper)},
    "tool_speed": _tool_speed,
    "point": _point,
    "length": lambda length, _: {"length": length},
}


def form_fields(form: Form | CarriedMetric | None) -> dict[str, Any]:
    """A form as the engine takes it."""
    if form is None:
        return {}
    if isinstance(form, CarriedMetric):
        return {"root": form.root()}
    if isinstance(form, PitchForm):
        return {"form": ("pitch", form.h)}
    if isinstance(form, Complement):
        return {"form": ("complement", form.Z)}
    return {"form": ("definite", form.matrix(np.eye(6)))}


def checked_options(m: int, options: Mapping[str, Any]) -> dict[str, Any]:
    """Checked options for m joints as the engine takes them, without the joint metric.

    Raises:
        BadInput: an option is wrong.
        TypeError: no such option.
    """
    unknown = options.keys() - VelocityOptions.__annotations__.keys()
    if unknown:
        raise TypeError(f"no option {min(unknown)!r}; there are {', '.join(VelocityOptions.__annotations__)}")
    fields = _checked_limits(m, options)
    fields["damping"], posture = damping_of(options.get("damping")), options.get("posture")
    guard = guard_of(options.get("guard", False))
    if guard is not None:
        fields["guard"] = guard.fraction
    if posture is not None:
        fields["posture"] = arrays.vector(posture, m, "posture")
    return fields | form_fields(form_of(options.get("form")))


def _checked_limits(m: int, options: Mapping[str, Any]) -> dict[str, Any]:
    """Checked bounds, exact rows, rows and tool speed."""
    box = bounds_of(options.get("bounds"), m)
    fields: dict[str, Any] = {"lower": np.asarray(box.lower), "upper": np.asarray(box.upper)}
    exact, rows, tool_speed = options.get("exact"), options.get("rows"), options.get("tool_speed")
    if exact is not None:
        if not isinstance(exact, ExactRows):
            raise BadInput("exact", type(exact).__name__, "ExactRows(A, b)")
        _check_width("exact", np.shape(exact.A)[1], m)
        fields["exact"] = np.asarray(exact.A), np.asarray(exact.b), exact.of_twist
    if rows is not None:
        if not isinstance(rows, LimitRows):
            raise BadInput("rows", type(rows).__name__, "LimitRows(C, lower, upper)")
        _check_width("rows", np.shape(rows.C)[1], m)
        if len(rows.C) > law.MOST_ROWS:
            raise BadInput("rows", f"{len(rows.C)} rows", f"at most {law.MOST_ROWS}")
        fields["rows"] = np.asarray(rows.C), np.asarray(rows.lower), np.asarray(rows.upper)
    if tool_speed is not None:
        if not isinstance(tool_speed, ToolSpeed):
            raise BadInput("tool_speed", type(tool_speed).__name__, "ToolSpeed(limit, point)")
        at = options.get("point") if tool_speed.point is None else tool_speed.point
        if at is None or isinstance(at, str):
            raise BadInput("tool_speed", "no point", "ToolSpeed(limit, point)", "Say which point, in the frame of J.")
        fields["tool_speed"] = arrays.vector(at, 3, "point"), tool_speed.limit
    return fields


def _checked_solution(J: ArrayLike, twist: ArrayLike, options: VelocityOptions) -> VelocitySolution:
    """The solution for arguments that the engine refused, or for another solver."""
    twists, s = sizes.bounded_jacobian(J), sizes.bounded_twists(arrays.twist(twist))
    check_joints(twists.shape[1])
    fields, form, backend = (
        checked_options(twists.shape[1], options),
        form_of(options.get("form")),
        options.get("backend"),
    )
    measure = measure_of(twists, s, form, options.get("point"), options.get("length"))
    metric = metric_of(options.get("joint_metric"), twists, measure.point, measure.length)
    fields |= {"point": measure.point, "length": measure.length, "metric": metric}
    try:
        if backend is None:
            return solution_of(law.solve(twists, s, **fields), row_names_of(options.get("rows")))
        return _by_definition(twists, s, measure.root, fields, options, backend_of(backend))
    except ArithmeticError:
        raise no_projector(twists, form) from None
    except InvariantQPError:
        raise
    except ValueError as refusal:
        raise BadInput("the arguments", str(refusal), "numbers that can be computed with") from None


def check_joints(m: int) -> None:
    """Check the number of joints.

    Raises:
        BadInput: more than the engine supports.
    """
    if m > law.MOST_JOINTS:
        raise BadInput("J", f"{m} joints", f"at most {law.MOST_JOINTS}", "Leave out joints that stand still.")


def _check_width(argument: str, width: int, m: int) -> None:
    if width != m:
        raise BadInput(argument, f"rows on {width} joints", f"rows on {m}, one for each column of J")


def no_projector(J: Array, form: Form | CarriedMetric | None) -> Exception:
    """The exception that says why a form has no projector for joint twists J (6, m)."""
    system = ScrewSystem(J)
    if isinstance(form, PitchForm):
        return no_pseudoinverse(system, form.h, factors(system, form.h))
    try:
        if isinstance(form, Complement):
            system.pseudoinverse(complement=np.asarray(form.Z))
    except InvariantQPError as reason:
        return reason
    return BadInput("form", "a form without a projector for these twists", "another form", "Or give a damping.")


def tick_of(J: Array, s: Array, root: Array, fields: Mapping[str, Any], form: Form | None = None) -> Tick:
    """The tick of a single call for `velocity.definition`, from arguments of the engine."""
    m, rows, P, speed = J.shape[1], fields.get("rows"), None, inf
    if "tool_speed" in fields:
        at, speed = fields["tool_speed"]
        P = at if np.ndim(at) == 2 else velocity_at(J, at)
    C, low, high = (np.zeros((0, m)), np.zeros(0), np.zeros(0)) if rows is None else rows
    exact = None
    if "exact" in fields:
        demands = ExactRows(*fields["exact"])
        M = whitened(demands, root[:6, :6])[0]
        exact = M.T.dot(np.asarray(demands.A)), M.T.dot(np.asarray(demands.b)), np.zeros(M.shape[1])
    return Tick(
        J=J,
        root=root,
        feedforward=s,
        error=np.zeros(len(s)),
        lower=fields["lower"],
        upper=fields["upper"],
        position_lower=np.full(m, -inf),
        position_upper=np.full(m, inf),
        rows=None if rows is None and P is None else Rows(C, low, high, (), P, speed),
        exact=exact,
        posture=fields.get("posture"),
        metric=fields["metric"],
        form=form,
        damping=fields.get("damping", 0.0),
        guard=fields.get("guard"),
    )


def answer_fields(answer: Answer, tick: Tick) -> tuple[Any, ...]:
    """An answer of the definition as the engine takes it for its report."""
    x = np.clip(answer.velocity, tick.lower, tick.upper)
    relaxed, speed_excess = None, 0.0
    for name, by in answer.relaxed:
        if name == TOOL_SPEED:
            speed_excess = by
        elif tick.rows is not None:
            relaxed = np.zeros(len(tick.rows.C)) if relaxed is None else relaxed
            relaxed[int(name.removeprefix("row "))] = by
    limited = bool(at_bounds(x, tick.lower, tick.upper).any()) or answer.approach_scale < 1.0 - SCALE_TOLERANCE
    if tick.rows is not None:
        C, lower, upper, _, P, speed = tick.rows
        limited = limited or bool(at_bounds(C.dot(x), lower, upper).any())
        limited = limited or (P is not None and float(np.linalg.norm(P.dot(x))) >= speed * (1.0 - ACTIVE_TOLERANCE))
    scale = float(np.clip(answer.scale, 0.0, 1.0))
    return x, answer.approach_scale, scale, answer.residual, answer.form_share, limited, relaxed, speed_excess


def _by_definition(
    J: Array, s: Array, root: Array, fields: dict[str, Any], options: VelocityOptions, backend: Backend
) -> VelocitySolution:
    form = form_of(options.get("form"))
    tick = tick_of(J, s, root, fields, None if isinstance(form, CarriedMetric) else form)
    return solution_by_definition(
        partial(law.solve, J, s, **fields), partial(velocity, tick, backend), tick, backend, options
    )


def solution_by_definition(
    report: Callable[..., tuple[Any, ...]],
    answer: Callable[[], Answer],
    tick: Tick,
    backend: Backend,
    options: Mapping[str, Any],
) -> VelocitySolution:
    """The solution of the definition by a back end, "held" without one."""
    names = row_names_of(options.get("rows"))
    try:
        found = answer()
    except (SolverFailure, np.linalg.LinAlgError) as failure:
        rest = np.clip(np.zeros(tick.J.shape[1]), tick.lower, tick.upper)
        held = solution_of(report(found=(rest, 1.0, 0.0, 0.0, 1.0, True, None, 0.0)), names)
        why = (Reason(Code.NO_SOLUTION, words=str(failure)),)
        return held._replace(method="hold", status=Status.HELD, reasons=why, scale=0.0, backend="")
    solution = solution_of(report(found=answer_fields(found, tick)), names)
    return solution._replace(backend=backend.name if solution.method == "qp" else "")
