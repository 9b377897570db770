"""A path or a stream driven in contact: only its motion along the freedoms S of the contact counts, not its depth.

path      waits for limits and for the touch: the target is the place nearest the tool
stream    does not wait: a reference arm moves as it would without contact, and its tool pose is the target
tick      HybridController.step to the target, with its twist as feedforward; joints towards the planned ones
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.force.contact import contact_now
from invariantqp.force.contact_kinds import Contact
from invariantqp.force.control import HybridController, HybridSolution
from invariantqp.force.sensor import Wrench
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.paths.ahead import SHORTEST
from invariantqp.paths.curve import SLOW
from invariantqp.paths.fit import REACHED
from invariantqp.paths.reference import DISPLACED, JOINT_GAIN, STRAYED
from invariantqp.paths.shape import (
    ASTRAY,
    ON_THE_WAY,
    ON_THE_WAY_BACK,
    PATIENCE,
    PAUSE,
    PUSHED,
    STOPPED,
    Shape,
)
from invariantqp.paths.solution import FollowerSolution
from invariantqp.paths.task_error import TaskError, task_error
from invariantqp.robots.kinematics import joint_displacement
from invariantqp.velocity.solution import Status

# The tool touches from this share of the wanted press on.
TOUCH = 0.5
# Statuses of a hybrid tick that is not in contact.
NO_CONTACT = (Status.LOST, Status.OVERLOAD, Status.FAULT)
NO_TOUCH = "no contact"
# Statuses of a hybrid tick that come before those of a stream.
TROUBLE = (*NO_CONTACT, Status.HELD, Status.DEGRADED)
OFF = "the tool is not where it was sent along the contact"
# A tool this far off, relative to the measure, is late along a stream; along a path it slows down, and one that counts
# as pushed waits. Joints that are off the plan by motion that leaves the tool where it is slow it down from half of
# STRAYED on.
AWAY = 5e-3


def _along_contact(
    hybrid: HybridController, loop: Controller, q: Array, pose: Array, contact: Contact
) -> tuple[TaskError, Array]:
    """The error of the tool of q (m,) to a pose (4, 4), and the projector (6, 6) of twists on S, base frame."""
    P = hybrid.splits.at(contact, hybrid.robot.pose(q)).projectors.motion
    return task_error(loop, q, loop.robot.target(pose)), contact.adjoint.dot(P).dot(contact.coadjoint.T)


class Beside(NamedTuple):
    """The tool and its path at the beginning of a tick."""

    place: float  # nearest the tool along S
    off: float  # how far it is from there, along S
    away: float  # how far from where it was expected
    strayed: (
        float  # how far a joint is off the plan by motion that moves no tool, 0 below half of STRAYED [rad, length]
    )
    astray: Array  # (m,) the way back of the joints to the plan


class Pressed:
    """The drive of a hybrid controller along a path."""

    def __init__(self, hybrid: HybridController, controller: Controller) -> None:
        """Not touching yet; the controller, of the same arm, is what paths are planned with."""
        self.hybrid = hybrid
        self.controller = controller
        self._touching = self._pushed = False
        self._place = 0.0
        self._stood: tuple[float, float, float] | None = None  # where, for how long, and how far it was driven there

    def step(
        self,
        shape: Shape,
        q: Array,
        before: Array,
        time: float,
        override: float,
        given: tuple[Any, Contact | None, ArrayLike | Wrench | None],
        *,
        paused: bool,
    ) -> FollowerSolution:
        """A tick from a time on, from q (m,) and the velocity (m,) before; `given` are wrench, contact and wanted."""
        hybrid, loop, curve = self.hybrid, self.controller, shape.given.curve
        wrench, contact, wanted = given
        here = contact_now(hybrid.task, hybrid.robot.pose(q), contact)
        if loop.limits.wrong(q):
            answer = hybrid.step(q, curve.pose(self._place), wrench, None, None, before, wanted)
            return self._told(answer, shape, answer.status, answer.reason, inf, "joint positions")
        if shape.motion is None and shape.plan is not None:
            shape.begin(time)
        beside = self._beside(shape, q, here)
        far = PUSHED if not self._pushed else REACHED
        self._pushed = beside.away > far * loop.measure.length or beside.strayed > DISPLACED
        if shape.motion is None or self._pushed:
            posture = None if shape.motion is None else JOINT_GAIN * beside.astray
            answer = hybrid.step(q, curve.pose(self._place), wrench, None, here, before, wanted, posture)
            self._touching = self._touches(answer)
            if shape.motion is not None:
                shape.still(time)
                return self._told(answer, shape, Status.WAITING, ON_THE_WAY_BACK, beside.off, ASTRAY)
            shape.look_on(q)
            return self._told(answer, shape, Status.WAITING, ON_THE_WAY, beside.off, ON_THE_WAY)
        return self._along(shape, q, before, time, override, (wrench, here, wanted), beside, paused=paused)

    def _along(
        self,
        shape: Shape,
        q: Array,
        before: Array,
        time: float,
        override: float,
        given: tuple[Any, Contact, ArrayLike | Wrench | None],
        beside: Beside,
        *,
        paused: bool,
    ) -> FollowerSolution:
        """A tick along the path."""
        hybrid, loop, curve, plan = self.hybrid, self.controller, shape.given.curve, shape.driven
        dt, (wrench, here, wanted) = loop.dt, given
        why = NO_TOUCH if not self._touching else PAUSE if paused else ""
        # Before what blocks the path, at the edge of its reach, a pressed tool never has the plan's joints: they rest.
        there = bool(plan.blocked) and not shape.back and plan.end - beside.place <= STOPPED * curve.end
        away = min(max((PUSHED - beside.off / loop.measure.length) / (PUSHED - AWAY), 0.0), 1.0)
        near = min(away, 1.0 / max(beside.strayed / (0.5 * STRAYED), 1.0))
        share = 0.0 if why or there else near * override * (sqrt(hybrid.room) if override <= 1.0 else 1.0)
        rate_before = shape.rate(time)
        if rate_before != 0.0 or not why:
            shape.put(time, beside.place)
        motion = shape.order(time, share)
        middle = motion.clock.now(time + 0.5 * dt)
        r = motion.source.at(np.array((middle[0],)))[0]
        rate = middle[1] * float(r[1, -1])
        place = beside.place if rate_before != 0.0 or not why else self._place
        slope = middle[1] * r[1, :-1]
        posture = slope + (0.0 if there else JOINT_GAIN) * beside.astray
        ahead = rate * curve.tangent(min(max(place + 0.5 * dt * rate, 0.0), curve.end))
        answer = hybrid.step(q, curve.pose(place), wrench, ahead, here, before, wanted, posture)
        self._touching = self._touches(answer)
        after = motion.source.at(np.array((motion.place(time + dt),)))
        self._place = float(after[0, 0, -1]) if rate_before != 0.0 or not why else place
        stalls = self._stalls(place, rate, curve.end, waits=bool(why) or share == 0.0)
        astray = ASTRAY if near < 1.0 and not there else ""
        told = shape.told(q, answer.velocity, time + dt, override, why=why or astray, pressed=beside.off)
        told.hybrid = answer
        if why == NO_TOUCH:
            told.status, told.reason, told.ruling = Status.WAITING, answer.reason or NO_TOUCH, NO_TOUCH
        elif stalls and told.status not in (Status.DONE, Status.BLOCKED):
            at = f"the tool comes no farther than {shape.given.place(place):.4g}"
            reason = "; ".join(filter(None, (at, plan.blocked, answer.reason)))
            told.status, told.reason = Status.BLOCKED, reason
        elif not told.reason and told.status != Status.DONE:
            told.reason = answer.reason
        return told

    def _told(
        self, answer: HybridSolution, shape: Shape, status: Status, reason: str, off: float, ruling: str
    ) -> FollowerSolution:
        where = shape.given.place(self._place), 0.0, 0.0
        return FollowerSolution(answer.velocity, status, reason, where, lambda: off, ruling, answer)

    def _beside(self, shape: Shape, q: Array, contact: Contact) -> Beside:
        """Where the tool of q (m,) is, seen along S."""
        hybrid, loop, curve, plan = self.hybrid, self.controller, shape.given.curve, shape.plan
        way, P = _along_contact(hybrid, loop, q, curve.pose(self._place), contact)
        R = way.rows.dot(P)
        error = R.dot(way.error)
        away = float(np.linalg.norm(error))
        if plan is None or shape.motion is None:
            return Beside(self._place, away, away, 0.0, np.zeros(len(q)))
        ahead = R.dot(curve.tangent(self._place))
        # Where the path nearly stands still, or is short beside the error, feedback acts along it too.
        squares = float(ahead.dot(ahead)) + shape.given.slow**2 + float(error.dot(error)) / curve.end**2
        place = min(max(self._place - float(ahead.dot(error)) / squares, 0.0), plan.end)
        off = float(np.linalg.norm(error - (self._place - place) * ahead))
        astray = joint_displacement(q, plan.joints(place), loop.turns)
        if float(astray.dot(astray)) <= 0.25 * STRAYED * STRAYED:  # nor is any part of it more
            return Beside(place, off, away, 0.0, astray)
        _, sigma, Vt = np.linalg.svd(way.root.dot(way.state.J), full_matrices=False)
        moving = Vt[sigma > SLOW * sigma[0]]  # those that move the tool
        free = astray - moving.T.dot(moving.dot(astray))
        return Beside(place, off, away, float(np.abs(free).max()), astray)

    def _touches(self, answer: HybridSolution) -> bool:
        """Whether the tool is in contact."""
        if answer.status in NO_CONTACT:
            return False
        if self._touching:
            return True
        n = answer.contact.kind.presses
        wanted = np.linalg.lstsq(answer.contact.constraints, answer.wanted, rcond=None)[0]
        return bool((answer.intensities[:n] >= TOUCH * wanted[:n]).all())

    def _stalls(self, place: float, rate: float, end: float, *, waits: bool) -> bool:
        """Whether the tool comes no farther: pressed, it may not have what is planned."""
        dt, near, stood = self.controller.dt, STOPPED * end, self._stood
        if waits or stood is None or abs(place - stood[0]) > near:
            self._stood = None if waits else (place, 0.0, 0.0)
            return False
        self._stood = stood = stood[0], stood[1] + dt, stood[2] + dt * abs(rate)
        return stood[1] > PATIENCE and (abs(rate) * dt <= SHORTEST * end or stood[2] > 2.0 * near)


class Tracking(NamedTuple):
    """The pressed arm beside the reference, when a tick begins."""

    measured: Array  # (m,) joint positions, of continuous joints by whole turns near where they were sent
    astray: Array  # (m,) joint displacement from there to where they were sent [rad, length]
    off: float  # how far the tool is from where it was sent, along S, in the measure [length]
    begins: bool  # whether the reference begins here: at first, or where the arm was pushed or stopped
    tool: Array  # (4, 4) its pose
    projector: Array  # (6, 6) of twists on S, base frame


class PressedStream:
    """The drive of a hybrid controller by a stream: a reference arm moves, and the tool follows its tool along S.

    Attributes:
        hybrid: presses.
        controller: of the reference arm, which is where it is sent without delay.
        command: (m,) joint velocity of the last tick.
        tracking: where the arm was when the last tick began.
    """

    def __init__(self, hybrid: HybridController) -> None:
        """Nothing is followed yet."""
        self.hybrid = hybrid
        self.controller = Controller(hybrid.robot, **hybrid.loop.options | {"delay": 0.0})
        self.command: Array = np.zeros(len(hybrid.robot.names))
        self.tracking: Tracking
        self._sent: tuple[Array, ...] = ()  # (m,) of the reference, oldest first: commands of that tick show now
        self._contact: Contact | None = None  # of the last tick, with the normal found

    def step(
        self,
        q: Array,
        velocity: Array | None,
        state: Any,
        given: tuple[Any, Contact | None, ArrayLike | Wrench | None],
    ) -> HybridSolution:
        """A tick of the pressed arm, towards the reference.

        Args:
            q: (m,) measured joint positions [rad, length].
            velocity: (m,) as in `HybridController.step`.
            state: of the reference, a `FollowerState` of the engine.
            given: wrench, contact and wanted.

        Raises:
            BadInput: as `HybridController.step`; nothing has changed.
        """
        hybrid, robot = self.hybrid, self.hybrid.robot
        wrench, contact, wanted = given
        before = self.command if velocity is None else velocity
        tracking = self._track(q, before, contact)
        at, rate = q, before
        if not tracking.begins:  # in the coming tick, before the reference moves: input may still be refused
            at, rate = state.position, state.velocity + hybrid.loop.dt * state.acceleration
        target, ahead = robot.pose(q + tracking.astray), robot.jacobian(at).dot(rate)
        posture = rate + JOINT_GAIN * tracking.astray
        answer = hybrid.step(q, target, wrench, ahead, contact, velocity, wanted, posture)
        self.tracking, self.command, self._contact = tracking, answer.velocity, answer.contact
        return answer

    def _track(self, q: Array, before: Array, contact: Contact | None) -> Tracking:
        """Where the arm is at q (m,), with the velocity (m,) before the tick."""
        hybrid, loop, tool = self.hybrid, self.controller, self.hybrid.robot.pose(q)
        here = contact_now(hybrid.task, tool, contact) if self._contact is None else self._contact
        sent = self._sent[0] if self._sent else q
        astray = joint_displacement(q, sent, loop.turns)
        way, projector = _along_contact(hybrid, loop, q, hybrid.robot.pose(sent), here)
        off = float(np.linalg.norm(way.rows.dot(projector).dot(way.error)))
        pushed = off > PUSHED * loop.measure.length
        stopped = (np.abs(before - self.command) > loop.dt * np.asarray(loop.acceleration_limit)).any()
        if pushed or stopped or not self._sent or loop.limits.wrong(q):
            return Tracking(sent - astray, np.zeros(len(q)), 0.0, True, tool, projector)
        return Tracking(sent - astray, astray, off, False, tool, projector)

    def sent(self, *position: Array) -> None:
        """The reference is at a position (m,) when the next tick begins; without one it begins there."""
        loop, kept = self.hybrid.loop, () if self.tracking.begins else self._sent
        self._sent = (*kept, *position)[-1 - round(loop.delay / loop.dt) :]

    def along(self, twist: Array, *, at_base: bool) -> Array:
        """(6,) the part of a twist (6,) along S, as a screw in base coordinates."""
        screw = twist if at_base else np.concatenate((twist[:3], velocity_at(twist, -self.tracking.tool[:3, 3])))
        return np.asarray(self.tracking.projector.dot(screw))

    def told(self, told: FollowerSolution, answer: HybridSolution) -> FollowerSolution:
        """The solution of a tick, from that of the reference and the hybrid controller's answer."""
        told.velocity, told.hybrid = answer.velocity, answer
        if answer.status in TROUBLE:
            told.status, told.reason = answer.status, answer.reason
        elif self.tracking.off > AWAY * self.controller.measure.length and told.status in (Status.MOVING, Status.DONE):
            told.status, told.reason = Status.LATE, answer.reason or OFF
        elif not told.reason:
            told.reason = answer.reason
        return told
