"""The form an arm is given when nobody chooses: its recommended pitch, or the metric carried by its tool.

Both come from the arm alone, once for the whole of its range, so nothing switches along a path.
"""

from __future__ import annotations

from math import inf

import numpy as np

from invariantqp.analysis.recommendation import recommend
from invariantqp.analysis.survey import spread, survey
from invariantqp.robots.kinematics import Robot, middle
from invariantqp.systems.centre import centre
from invariantqp.systems.report import describe
from invariantqp.velocity.forms import CarriedMetric, Form, PitchForm

# States looked at, some 10 ms in all: a planar arm is planar in each of them, and pitches are spread wide.
SAMPLES = 16


def tool_metric(robot: Robot) -> CarriedMetric:
    """diag(L^2 I, I) carried by the tool, L the arm's own length in the middle of its range.

    The form for arms on which no pitch form works: planar arms, SCARA, gantries. Where no joint turns, or all turn
    about one point, L is one unit of length.
    """
    length = centre(robot.jacobian(middle(robot))).length
    weight = length * length if 0.0 < length < inf else 1.0
    return CarriedMetric(np.repeat((weight, 1.0), 3))


def own_form(robot: Robot) -> tuple[Form, str]:
    """The form that `invariantqp inspect` recommends, and the reason for it in words."""
    J = robot.jacobian(middle(robot))
    advice = recommend(robot, describe(J), survey(robot, spread(robot, SAMPLES)), centre(J).length)
    form = tool_metric(robot) if advice.h is None else PitchForm(advice.h)
    return form, advice.reason
