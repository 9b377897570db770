"""A tick along a planned path: how fast, and the joint velocity that goes so far and no farther off.

    s = P'(sigma) v + gain e_across,     v <= what the joints can do here and can still brake from before what comes

The tangent P' and the arm are taken in the middle of the tick, so that a straight step follows a bent path to third
order. Where limits take the tool off all the same, the tick is solved again with s as exact rows, which slow down.
With exact demands, or fewer than six joints, s is the twist of the planned joint motion but for what is exact.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from invariantqp.control.asked import asked, asked_part
from invariantqp.control.beside import Beside, tangent_at
from invariantqp.control.controller import Controller
from invariantqp.control.curve import Curve
from invariantqp.control.path_pace import Pace
from invariantqp.control.path_plan import PathPlan
from invariantqp.control.path_rate import rate_inside
from invariantqp.control.path_state import PathState
from invariantqp.control.tracking import braking_share
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.report import PROGRESS_SHARE
from invariantqp.velocity.solution import Status, VelocitySolution

# A tool this far off, relative, slows down, and at AWAY_STOP times that waits until feedback has brought it back.
AWAY, AWAY_STOP = 5e-3, 4.0
# A tick that drives less than this share of the path is at rest: a drive may turn.
STANDING = 1e-7
# The slope is taken in the middle of a tick, whose length hangs on it: until the rate changes by less, or so often.
SAME_RATE, PASSES = 1e-4, 8
# Gain [1/s] towards the joint motion that was looked at, where the path leaves joints free.
JOINT_GAIN = 5.0
# Below this ratio of singular values the tool follows that motion also where the path leaves nothing free; above the
# second one it follows the path's own tangent, and so do joints that are farther than STRAYED [rad, length] from it.
# Those also slow down: at full speed a joint at its limit may leave them no room to come back.
SINGULAR, REGULAR = 1e-2, 3e-2
STRAYED = 1e-2
# Where limits would take the tool this far off its path in a tick, relative to the measure's length, the tick is solved
# again with the twist as exact rows, which slow down instead.
MISSED = 1e-6
# Where limits leave exact rows less than this share of their speed, they follow the joint motion that was looked at.
HELD = 0.9


class Driven(NamedTuple):
    """A tick along a path."""

    answer: VelocitySolution  # of the law
    state: PathState  # after the tick
    here: Beside  # where the tool was before it
    rate: float  # of the place, negative backward
    ruling: str  # what rules it, in words


def drive(
    controller: Controller,
    curve: Curve,
    plan: PathPlan,
    state: PathState,
    here: Beside,
    q: Array,
    pace: Pace,
    *,
    override: float,
    stop: str,
    back: bool,
) -> Driven:
    """One tick of the drive from its state after the tick before, with the joint velocity now; the tool is `here`.

    `override` is the share of the speed asked for. `stop` says why the tool is to come to rest, "" where it is not;
    `back` whether it is to go backward, once at rest.
    """
    dt, place = controller.dt, here.place
    astray = here.joints - q
    strayed = float(np.abs(astray).max()) / STRAYED
    near = share_near(here.off / controller.measure.length, strayed)
    speed, possible, ruling = pace.speed(plan, state, place, near=near, override=override, stop=stop)
    rate = possible_rate(controller, plan, state, place, -speed if state.back else speed, possible)
    middle = min(max(place + 0.5 * dt * rate, plan.start), plan.end)
    slope = plan.slope(middle)
    tangent = tangent_at(controller, curve, plan, middle, left=here.left)
    sighting = controller.robot.sight(q + 0.5 * dt * rate * slope, here.target)
    posture = rate * slope + JOINT_GAIN * astray
    # Near a singularity the twist of the joint motion that was looked at: no other asks as little of the joints.
    i = plan.piece(place)
    regular = (min(plan.ratio[i], plan.ratio[i + 1]) - SINGULAR) / (REGULAR - SINGULAR)
    own = min(max(regular, strayed, 0.0), 1.0)
    turning = sighting.J.dot(slope)
    along = tangent if own == 1.0 else (1.0 - own) * turning + own * tangent
    # The way back to the path, carried along with the tool to the middle of the tick.
    across = here.across + se3.lie(0.5 * dt * rate * turning, here.across)
    gain, home = controller.gain, sighting.J.dot(astray)
    if controller.braking is not None:  # no faster back than joints can brake
        gain *= braking_share(astray, controller.braking.acceleration, gain)
    # What is least squares follows the planned motion: an error that stays changes its own least squares.
    if controller.exact:
        root = controller.measure.root_for(sighting.J, sighting.pose)
        part = asked_part(asked(controller, sighting, root), root)
        along, across = turning + part.dot(along - turning), home + part.dot(across - home)
    elif len(q) < 6:
        along, across = turning, home
    twist = rate * along + gain * across
    answer = controller.follow(q, twist, state.velocity, None, sighting, None, posture, calm=False)
    if controller.exact and answer.scale < HELD:  # as the planned motion, which joints can do
        twist = rate * turning + gain * home
        answer = controller.follow(q, twist, state.velocity, None, sighting, None, posture, calm=False)
    kept = answer.scale if controller.exact else 1.0
    if not controller.exact and controller.braking is None and answer.active and rate != 0.0:
        missed = here.asked.dot(answer.residual)
        if sqrt(float(missed.dot(missed))) * dt > MISSED * controller.measure.length:
            rows = ExactRows.of(sighting.J, here.asked, here.asked.dot(twist))
            slower = controller.follow(q, twist, state.velocity, rows, sighting, None, posture, calm=False)
            if slower.status in (Status.OK, Status.SCALED) and slower.scale > PROGRESS_SHARE:
                answer, kept = slower, slower.scale
    went = _went(slope, answer.velocity, kept * rate, rate)
    rate *= kept
    after = state.after(
        place, rate, dt, STANDING * plan.end, back=back, along=went * slope, velocity=answer.velocity.copy()
    )
    return Driven(answer, after._replace(tangent=tangent), here, rate, ruling)


def share_near(off: float, strayed: float) -> float:
    """The share of its speed for a tool so far off its path, relative, and joints so many STRAYED off the plan."""
    away = max(off / AWAY, 1.0)
    return min(max(0.0, (AWAY_STOP - away) / (AWAY_STOP - 1.0)), 1.0 / max(strayed, 1.0))


def possible_rate(
    controller: Controller,
    plan: PathPlan,
    state: PathState,
    place: float,
    wanted: float,
    possible: float,
    room: float = 1.0,
) -> float:
    """The rate nearest the wanted one inside the joints' limits and the ends of the plan, never the other way.

    `room` is the share of the joints' acceleration that is left to the path.
    """
    dt, rate = controller.dt, wanted
    if controller.braking is not None:
        step, limit, kept = room * dt * controller.braking.acceleration, controller.robot.velocity_limit, 0.0
        for _ in range(PASSES):  # with the slope where the rate before leads
            slope, before = plan.slope(place + 0.5 * dt * rate), rate
            rate = rate_inside(slope, wanted, possible, state.along, step, limit)
            if abs(rate - before) <= SAME_RATE * abs(rate):
                break
            if (np.abs(before * slope - state.along) <= step).all():
                kept = before
        else:  # where the slope changes within a tick, the last rate that could be done where it leads
            rate = kept
        rate = min(rate, 0.0) if state.back else max(rate, 0.0)
    return min(max(rate, (plan.start - place) / dt), (plan.end - place) / dt)


def _went(slope: Array, velocity: Array, kept: float, rate: float) -> float:
    """The rate of the joints; where limits slow exact rows down to `kept`, joints may keep more: they have to brake."""
    low, high = sorted((kept, rate))
    squares = float(slope.dot(slope))
    if low == high or squares == 0.0:
        return rate
    return min(max(float(slope.dot(velocity)) / squares, low), high)
