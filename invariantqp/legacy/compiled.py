"""The ticks that the compiled core answers; Python has the others (`VelocityLaw.compiled` says which laws).

The core answers what this package's own Python would, or hands the tick back.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from invariantqp.engine import core
from invariantqp.legacy.law import Demand, VelocityLaw
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.limits import Cone, LimitRows
from invariantqp.velocity.solution import Status, VelocitySolution

if core is not None:
    core.answer_as(VelocitySolution, Status)


def compiled(law: VelocityLaw, demand: Demand) -> VelocitySolution | None:
    """The core's answer; None where Python has to answer."""
    fixed, cone, exact, rows, chase = law.compiled, demand.cone, demand.exact, demand.rows, demand.chase
    if core is None or fixed is None:
        return None
    fields: dict[str, Any] = {
        "J": demand.J,
        "s": demand.s,
        "root": demand.root,
        "lower": demand.lower,
        "upper": demand.upper,
        "posture": demand.posture,
        "fastest": demand.fastest,
        "before": demand.before,
        "change": demand.change,
        "held": demand.held,
        **_fields(rows, exact, cone),
    }
    if exact is not None:
        fields["row_rank"] = -1 if demand.row_rank is None else demand.row_rank
        if len(exact.b) > core.MOST_ROWS:
            return None
    if chase is not None:
        fields |= {"chase_ahead": chase.ahead, "chase_rows_ahead": chase.rows_ahead, "chase_lower": chase.lower}
        fields |= {"chase_upper": chase.upper, "chase_slack": chase.slack, "chase_apart": chase.apart}
    if fixed.form == "brought" and law.form is not None:
        fields["brought"] = np.asarray(law.form.matrix(np.asarray(np.linalg.inv(demand.root))), np.float64)
    return _with_names(core.tick(fixed, **fields), rows)


def _fields(rows: LimitRows | None, exact: ExactRows | None, cone: Cone | None) -> dict[str, Any]:
    """Limits and exact rows as the core takes them."""
    fields: dict[str, Any] = {}
    if rows is not None:
        fields |= {"G": rows.C, "least": rows.lower, "most": rows.upper}
    if exact is not None:
        fields |= {"C": exact.A, "e": exact.b, "D": exact.of_twist}
    if cone is not None:
        fields |= {"cone_limit": cone.limit, "cone_start": cone.start, "cone_J": cone.J}
    return fields


def _with_names(found: VelocitySolution | None, rows: LimitRows | None) -> VelocitySolution | None:
    """The core's answer with what its rows are called."""
    return found if found is None or rows is None or not rows.names else found._replace(row_names=rows.names)
