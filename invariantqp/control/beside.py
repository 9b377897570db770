"""Where the tool is beside its path: how far along, and how far across.

    e = log(P T^-1) = shift t + e_across,     t the path's tangent
    shift = <t, e> / (<t, t> + slow^2 + <e, e> / end^2)

P is the place where the tool is expected; it is behind that by `shift`, and feedback is left with e_across. Both are
measured in what is asked of the arm, whose part of e is its own (`asked`). Where the path nearly stands still, or is
short beside e, feedback acts along it too. A tool beyond an end of the path is beside that end: what it is beyond is
then part of e_across.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

from invariantqp.control.asked import way_to
from invariantqp.control.controller import Controller
from invariantqp.control.curve import Curve
from invariantqp.control.given_path import GivenPath
from invariantqp.control.path_plan import PathPlan
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Sighting

# A planned joint motion farther off the path than this, relative to the measure's length, is followed in its place: a
# tool that chases what it does not reach would stay there.
ASIDE = 1e-7


class Beside(NamedTuple):
    """The tool and its path at the beginning of a tick."""

    sighting: Sighting  # the arm
    target: Any  # the pose where it was expected, in the form that `robot.sight` takes
    asked: Array  # (k, 6) rows of what is asked
    place: float  # on the path nearest the tool
    joints: Array  # (m,) the plan's joint positions there
    across: Array  # (6,) the twist back to that place
    off: float  # its size in what is asked
    left: bool  # whether the plan is aside the path here, and its joint motion is followed instead


def look(controller: Controller, path: GivenPath, plan: PathPlan, q: Array, expected: float, tangent: Array) -> Beside:
    """Where the tool of an arm at q (m,) is, expected at a place of the path with tangent (6,).

    Where the path cannot be had, the plan's joint motion is the path.
    """
    robot = controller.robot
    left = plan.leaves(expected, ASIDE * controller.measure.length)
    target = robot.target(robot.pose(plan.joints(expected)) if left else path.curve.pose(expected))
    way = way_to(controller, q, target)
    place, rest = nearest(path, plan, expected, way.rows.dot(tangent), way.rows.dot(way.error))
    across, off = way.error - (expected - place) * tangent, sqrt(float(rest.dot(rest)))
    return Beside(way.sighting, target, way.rows, place, plan.joints(place), across, off, left)


def nearest(path: GivenPath, plan: PathPlan, expected: float, ahead: Array, error: Array) -> tuple[float, Array]:
    """The place on the path nearest the tool, between the plan's ends, and what it is off there.

    `ahead` (k,) is the path's tangent at the expected place and `error` (k,) the way from the tool to it, both measured
    in what is asked.
    """
    short = float(error.dot(error)) / path.curve.end**2
    shift = float(ahead.dot(error)) / (float(ahead.dot(ahead)) + path.slow * path.slow + short)
    place = min(max(expected - shift, plan.start), plan.end)
    return place, error - (expected - place) * ahead


def tangent_at(controller: Controller, curve: Curve, plan: PathPlan, at: float, *, left: bool) -> Array:
    """(6,) the tangent of what is followed at a place: of the path or, where that is left, of the joint motion."""
    if not left:
        return curve.tangent(at)
    tangent: Array = controller.robot.jacobian(plan.joints(at)).dot(plan.slope(at))
    return tangent
