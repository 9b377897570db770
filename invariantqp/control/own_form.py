"""The form of an arm when none is given: its recommended pitch, or the metric carried by its tool.

Both depend on the arm alone and are chosen once for the whole of its range, so that the form never switches on a path.
"""

from __future__ import annotations

from math import inf
from typing import Literal

import numpy as np

from invariantqp.analysis.recommendation import recommend
from invariantqp.analysis.survey import spread, survey
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot, middle, require_robot
from invariantqp.systems.centre import centre
from invariantqp.systems.report import describe
from invariantqp.velocity.forms import CarriedMetric, Form, PitchForm, form_of

# States to examine, some 10 ms in all: enough, since a planar arm is planar in each and pitches are spread wide.
SAMPLES = 16


def tool_metric(robot: Robot) -> CarriedMetric:
    """diag(L^2 I, I) carried by the tool, L the arm's own length in the middle of its range.

    The form for arms on which no pitch form works: planar arms, SCARA, gantries. Where no joint turns, or all turn
    about one point, L is one unit of length.
    """
    length = centre(require_robot(robot).jacobian(middle(robot))).length
    weight = length * length if 0.0 < length < inf else 1.0
    return CarriedMetric(np.repeat((weight, 1.0), 3))


def own_form(robot: Robot) -> tuple[Form, str]:
    """The form that `invariantqp inspect` recommends, and the reason for it in words."""
    J = require_robot(robot).jacobian(middle(robot))
    advice = recommend(robot, describe(J), survey(robot, spread(robot, SAMPLES)), centre(J).length)
    form = tool_metric(robot) if advice.h is None else PitchForm(advice.h)
    return form, advice.reason


def choose_form(robot: Robot, form: Form | float | Literal["auto"] | None, J: Array) -> tuple[Form, str, bool]:
    """The form of a loop, the reason for it, and whether no pitch form was found to choose.

    Args:
        robot: the arm.
        form: the caller's; None or "auto" is the arm's own.
        J: (6, m) joint twists of the arm in some state.

    Raises:
        BadInput: no form.
    """
    if form is not None and not (isinstance(form, str) and form == "auto"):
        return form_of(form, J), "as asked", False
    chosen, reason = own_form(robot)
    return chosen, reason, isinstance(chosen, CarriedMetric)
