"""The law and the demand of one tick from plain arrays, all checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.engine import ENGINES
from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, sizes
from invariantqp.geometry.arrays import Array
from invariantqp.legacy.damping import damping_of
from invariantqp.legacy.law import Demand, VelocityLaw
from invariantqp.velocity.arguments import measure_of, metric_of
from invariantqp.velocity.backends import backend_of
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.forms import Form, form_of
from invariantqp.velocity.guard import guard_of
from invariantqp.velocity.limits import Cone, LimitRows, ToolSpeed, bounds_of


def problem_of(J: ArrayLike, twist: ArrayLike, **options: Any) -> tuple[VelocityLaw, Demand]:
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


def law_of(options: Mapping[str, Any], form: Form | None, metric: Array | None, *, limited: bool) -> VelocityLaw:
    """The law that options describe, with a form and a metric (m, m) that are checked; `limited` as in `damping_of`."""
    return VelocityLaw(
        form=form,
        damping=damping_of(options.get("damping"), limited=limited),
        guard=guard_of(options.get("guard", True)),
        metric=metric,
        backend=backend_of(options.get("backend", "daqp")),
        engine=arrays.choice(options.get("engine", "compiled"), "engine", ENGINES),
    )


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
