"""What is told of a tick along a path: a status, why, and where the tool is."""

from __future__ import annotations

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.control.given_path import GivenPath
from invariantqp.control.joint_path import OFF_PATH
from invariantqp.control.path_drive import STANDING, Driven
from invariantqp.control.path_orders import PAUSE
from invariantqp.control.path_pace import ON_TIME, Pace
from invariantqp.control.path_plan import PathPlan
from invariantqp.control.path_solution import PathSolution
from invariantqp.control.path_state import PathState
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.reasons import told
from invariantqp.velocity.solution import Status

# The end is reached within this share of the path, by joints slower than this share of their limits; what blocks the
# path is reached within a larger one: at the edge of its reach an arm moves much for little.
ARRIVED, STOPPED, AT_REST = 1e-6, 2e-5, 1e-3
# What rules at the end of the path, before the joints are at rest and after.
SETTLING, ENDED = "settling", "the path's end"
# What rules where the path is driven backward and the tool is back where it set out.
BACK = "the start"
# What rules where joint positions cannot be true.
DISBELIEF = "joint positions"


def reported(
    controller: Controller, path: GivenPath, plan: PathPlan, driven: Driven, pace: Pace, *, tolerance: float, stop: str
) -> PathSolution:
    """The solution of a tick along a path; `stop` says why the tool was to come to rest, "" where it was not.

    How far from the path's end a tool that is there may be, `tolerance`, is in the measure.
    """
    answer, after, here, rate, ruling = driven
    dt = controller.dt
    at = path.place(after.place)
    i = plan.nearest(here.place)
    reachable = OFF_PATH * controller.measure.length
    still = not stop and stands(controller, answer.velocity)
    blocked = plan.blocked
    if plan.off[-1] > reachable:
        blocked = blocked or f"it is out of reach, by {plan.off[-1]:.3g}"
    near = (STOPPED if blocked else ARRIVED) * path.curve.end
    arrived = still and plan.end - after.place <= near
    status, why = Status.MOVING, answer.reasons
    if arrived and blocked:
        status, why = Status.BLOCKED, told(f"the path cannot be had from {at:.6g} on: {blocked}")
    elif arrived and here.off + dt * _speed(driven) <= tolerance:
        status, why, ruling = Status.DONE, (), ENDED
    elif plan.off[i] > reachable and plan.blocked and plan.off[0] > reachable:  # blocked at its start
        status, why = Status.WAITING, (*told("on the way to the path's start"), *why)
    elif plan.off[i] > reachable:
        status, why = Status.LEFT, told(f"the arm is {plan.off[i]:.3g} off the path, which it cannot reach here")
    else:
        stands_now = abs(rate) * dt <= STANDING * path.curve.end
        status, ruling = on_the_path(plan, after, ruling, near, stop=stop, stands=stands_now, still=still)
    lag = None if pace.rate is None else after.ticks * dt - at / pace.rate
    return PathSolution(
        answer.velocity, status, why, at, (at - path.place(here.place)) / dt, ruling, lag, here.off, answer
    )


def on_the_path(
    plan: PathPlan, after: PathState, ruling: str, near: float, *, stop: str, stands: bool, still: bool
) -> tuple[Status, str]:
    """Status and ruling of a tick, ruled by `ruling`, that is neither "done" nor in trouble.

    `near` is how near its ends the path is driven to them, `stop` why the tool was to come to rest, "" where it was
    not; `stands` whether it stands on the path; `still` whether it was not to come to rest, and joints are.
    """
    if stop == PAUSE and stands:
        return Status.PAUSED, ruling
    if still and after.back and after.place - plan.start <= near:
        return Status.PAUSED, BACK
    if not stop and plan.end - after.place <= near:
        return Status.MOVING, SETTLING
    return Status.MOVING if ruling == ON_TIME else Status.SLOWED, ruling


def stands(controller: Controller, velocity: Array) -> bool:
    """Whether joints at a velocity (m,) count as at rest."""
    limit = controller.robot.velocity_limit
    fastest = np.where(np.isfinite(limit), limit, 1.0)
    return bool((np.abs(velocity) <= AT_REST * fastest).all())


def _speed(driven: Driven) -> float:
    """How fast the tool moves in what is asked of it."""
    here = driven.here
    return float(np.linalg.norm(here.asked.dot(here.sighting.J.dot(driven.answer.velocity))))
