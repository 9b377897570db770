"""Which form an arm should be given, and why: one pitch for the whole of its joint range, or a carried metric.

    h = the smallest of +-4 L, +-6 L, +-8 L, ... with |h - h_i| >= |h| / 2 in (nearly) every state; L for rank 6

L is the arm's own length: with |h| near or below it projectors are oblique and large, with |h| far above it orientation
comes first. Where no h works in most states, none is offered.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, inf, log10
from typing import Literal

import numpy as np

from invariantqp.analysis.survey import Survey
from invariantqp.errors import written
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.systems.report import SystemReport, describe
from invariantqp.velocity.forms import FEW_JOINTS_PITCH

# |h - h_i| >= 0.5 |h|: the direction of principal pitch h_i then counts at least half of what it would alone.
CLEARANCE = 0.5
# Pitches tried, of the one that an arm with fewer than six joints is given.
MULTIPLES = (1.0, 1.5, 2.0, 3.0, 4.0)
# A larger pitch must be clear in this many more of the states to be worth it.
WORTHWHILE = 0.02
# An arm of which more than this share of the states has no pitch is one on which no pitch works.
MOSTLY = 0.5


@dataclass(frozen=True)
class Recommendation:
    """What to measure twists by.

    Attributes:
        form: "pitch" (`PitchForm(h)`) or "tool" (`tool_metric(robot)`, the metric carried by the tool).
        h: pitch [length/rad]; None with that metric.
        length: what a radian counts in that metric [length/rad]; None with a pitch form.
        reason: in words.
    """

    form: Literal["pitch", "tool"]
    h: float | None
    length: float | None
    reason: str


def recommend(robot: Robot, report: SystemReport, survey: Survey, own_length: float) -> Recommendation:
    """The form for an arm.

    Args:
        robot: the arm.
        report: the state of most interest.
        survey: states of its range.
        own_length: L [length/rad] in the middle of the range: inf where no joint turns, 0 where all axes meet.
    """
    if survey.blind_share > MOSTLY:
        return _carried(_blind_example(robot, report, survey), survey.blind_share, own_length)
    unit = own_length if 0.0 < own_length < inf else 1.0
    if survey.attainable_rank == 6:
        h = rounded(unit)
        reason = (
            f"The arm has rank 6: away from singularities and limits every h gives the same joint velocities. Where "
            f"something must give, an h of the order of the arm's own length, {written(own_length, 3)}, lets rotation "
            "and translation count alike."
        )
        return Recommendation("pitch", h, None, reason)
    pitches = survey.pitches[np.where(survey.regular, survey.blind, 1) == 0]
    if report.rank == survey.attainable_rank and not report.blind_directions.shape[1]:
        own = np.full((1, pitches.shape[1]), np.nan)
        own[0, : len(report.principal_pitches)] = report.principal_pitches
        pitches = np.vstack((own, pitches))
    h = _clear_pitch(pitches, FEW_JOINTS_PITCH * own_length if 0.0 < own_length < inf else 1.0)
    return Recommendation("pitch", h, None, _pitch_reason(h, pitches, survey, own_length))


def rounded(x: float) -> float:
    """A number to two digits: what a person would type."""
    return round(x, 1 - floor(log10(abs(x))))


def crowded(pitches: Array, h: float) -> float:
    """Share of the states, rows of (n, 6) principal pitches, in which one is nearer to h than half of |h|."""
    return float(np.mean((np.abs(pitches - h) < CLEARANCE * abs(h)).any(axis=1)))


def _clear_pitch(pitches: Array, unit: float) -> float:
    best = rounded(unit)
    for multiple in MULTIPLES:
        for h in (rounded(multiple * unit), -rounded(multiple * unit)):
            if crowded(pitches, h) < crowded(pitches, best) - WORTHWHILE:
                best = h
    return best


def _pitch_reason(h: float, pitches: Array, survey: Survey, own_length: float) -> str:
    share = 1.0 - crowded(pitches, h)
    finite = pitches[np.isfinite(pitches)]
    size = "the arm's axes all meet, so that it has no length of its own and any h but 0 does the same"
    if own_length > 0.0:
        times = abs(h) / own_length
        why = "a smaller pitch would project obliquely, a larger one put orientation first"
        size = f"about {times:.2g} times the arm's own length, {written(own_length, 3)}: {why}"
    clear = "in every state looked at" if share == 1.0 else f"in {100.0 * share:.3g} % of the states looked at"
    said = f"{size[0].upper()}{size[1:]}; {clear} it is {written(CLEARANCE * abs(h), 2)} or more from a principal pitch"
    if len(finite):
        nearest = finite[np.abs(finite - h).argmin()]
        said += f" (the nearest is {written(float(nearest), 3)})"
    said += "."
    if survey.blind_share > 0.0:
        said += f" In {100.0 * survey.blind_share:.3g} % of the states no h works: damping and the guard act there."
    return said


def _blind_example(robot: Robot, report: SystemReport, survey: Survey) -> Array:
    """(6, b) the blind directions of the state asked for, or of another where it has none or is singular."""
    if report.rank == survey.attainable_rank and report.blind_directions.shape[1]:
        return report.blind_directions
    example = int(np.argmax(np.where(survey.regular, survey.blind, 0)))
    return describe(robot.jacobian(survey.q[example])).blind_directions


def _carried(blind: Array, share: float, own_length: float) -> Recommendation:
    listed = directions(blind)
    where = "" if share == 1.0 else f" in {100.0 * share:.3g} % of the states"
    length = own_length if 0.0 < own_length < inf else 1.0
    named = "the arm's own length" if length == own_length else "one unit of length, as the arm has none of its own"
    reason = (
        f"No h works{where}: every pitch form is blind to translation along {listed}; it would neither ask for such a "
        f"motion nor correct it. Measure twists at the tool instead, |v|^2 + L^2 |omega|^2 with L = {length:.3g}, "
        f"{named}. Or name what may be given up: Complement(Z)."
    )
    return Recommendation("tool", None, length, reason)


def directions(blind: Array) -> str:
    """(6, b) translations as a list in words."""
    return " and ".join("(" + ", ".join(written(x, 3) for x in v) + ")" for v in blind[3:].T)
