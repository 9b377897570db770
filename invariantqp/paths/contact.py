"""A path or a stream followed in contact: only its motion along the freedoms S of the contact counts, not its depth.

path      waits for limits and for contact: the target is the place nearest the tool
stream    does not wait: a reference arm moves as it would without contact, and its tool pose is the target
tick      HybridController.step to the target, with its twist as feedforward; joints towards the planned ones
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.force.contact_kinds import Contact
from invariantqp.force.control import HybridController, HybridSolution
from invariantqp.force.wrench import Wrench
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.paths.curve import SLOW_SHARE
from invariantqp.paths.joint_path import MIN_STEP
from invariantqp.paths.path_drive import (
    BLOCKED_TOLERANCE,
    OFF_PATH,
    ON_THE_WAY,
    ON_THE_WAY_BACK,
    PAUSE,
    PUSHED_TOOL,
    STUCK_TIME,
    PathDrive,
)
from invariantqp.paths.reference import JOINT_GAIN, JOINT_TOLERANCE, PUSHED_JOINT
from invariantqp.paths.solution import FollowerSolution
from invariantqp.paths.task_error import TaskError, task_error
from invariantqp.paths.waypoints import POSE_TOLERANCE
from invariantqp.robots.kinematics import joint_displacement
from invariantqp.velocity.solution import Status

# Wrench, contact and wrench to exert of a tick, as in `HybridController.step`.
ContactInput: TypeAlias = tuple[Any, Contact | None, ArrayLike | Wrench | None]
# The tool is in contact from this share of the wanted press on.
TOUCH_SHARE = 0.5
# Statuses of a hybrid tick that is not in contact.
NO_CONTACT = (Status.LOST, Status.OVERLOAD, Status.FAULT)
NO_TOUCH = "no contact"
# Statuses of a hybrid tick that take precedence over those of a stream.
TROUBLE = (*NO_CONTACT, Status.HELD, Status.DEGRADED)
OFF = "tool tracking error along the contact"
# A tool error from which a stream is late and a path slows down, relative to the measure's length; a pushed tool waits.
# The null-space error of joints slows a path down from half of JOINT_TOLERANCE on.
LATE_TOOL = 5e-3


def _error_in_contact(
    hybrid: HybridController, loop: Controller, q: Array, pose: Array, contact: Contact
) -> tuple[TaskError, Array]:
    """The error of the tool of q (m,) to a pose (4, 4), and the projector (6, 6) of twists on S, base frame."""
    P = hybrid.splits.at(contact, hybrid.robot.pose(q)).projectors.motion
    return task_error(loop, q, loop.robot.target(pose)), contact.adjoint.dot(P).dot(contact.coadjoint.T)


class ToolOnPath(NamedTuple):
    """The tool beside its path at the beginning of a tick."""

    place: float  # of the path, nearest the tool along S
    error: float  # distance along S from there
    displaced: float  # distance along S from the place of the last tick
    null_space_error: float  # largest joint error in the null space, 0 below half of JOINT_TOLERANCE
    joint_error: Array  # (m,) joint displacement to the plan


class PathInContact:
    """A hybrid controller that follows a path."""

    def __init__(self, hybrid: HybridController, controller: Controller) -> None:
        """Not in contact yet; the controller, of the same arm, plans paths."""
        self.hybrid = hybrid
        self.controller = controller
        self._touching = self._pushed = False
        self._place = 0.0
        self._stall: tuple[float, float, float] | None = None  # place, time [s], and how far the motion went on

    def step(
        self,
        path: PathDrive,
        q: Array,
        before: Array,
        time: float,
        override: float,
        given: ContactInput,
        *,
        paused: bool,
    ) -> FollowerSolution:
        """A tick at a time, from q (m,) and the velocity (m,) before; `given` are wrench, contact and wanted."""
        hybrid, loop, curve = self.hybrid, self.controller, path.given.curve
        wrench, contact, wanted = given
        here = hybrid.task.contact_at(hybrid.robot.pose(q), contact)
        if loop.limits.implausible(q):
            answer = hybrid.step(q, curve.pose(self._place), wrench, None, None, before, wanted)
            return self._solution(answer, path, answer.status, answer.reason, inf, "joint positions")
        if path.motion is None and path.plan is not None:
            path.begin(time)
        tool = self._tool_on_path(path, q, here)
        far = PUSHED_TOOL if not self._pushed else POSE_TOLERANCE
        self._pushed = tool.displaced > far * loop.measure.length or tool.null_space_error > PUSHED_JOINT
        if path.motion is None or self._pushed:
            posture = None if path.motion is None else JOINT_GAIN * tool.joint_error
            answer = hybrid.step(q, curve.pose(self._place), wrench, None, here, before, wanted, posture)
            self._touching = self._is_touching(answer)
            if path.motion is not None:
                path.stopped(time)
                return self._solution(answer, path, Status.WAITING, ON_THE_WAY_BACK, tool.error, OFF_PATH)
            path.extend_search(q)
            return self._solution(answer, path, Status.WAITING, ON_THE_WAY, tool.error, ON_THE_WAY)
        return self._along(path, q, before, time, override, (wrench, here, wanted), tool, paused=paused)

    def _along(
        self,
        path: PathDrive,
        q: Array,
        before: Array,
        time: float,
        override: float,
        given: tuple[Any, Contact, ArrayLike | Wrench | None],
        tool: ToolOnPath,
        *,
        paused: bool,
    ) -> FollowerSolution:
        """A tick along the path."""
        hybrid, loop, curve, plan = self.hybrid, self.controller, path.given.curve, path.driven
        dt, (wrench, here, wanted) = loop.dt, given
        why = NO_TOUCH if not self._touching else PAUSE if paused else ""
        # Where the path is blocked, at the edge of the reach, a pressed tool never has the plan's joints: they rest.
        there = bool(plan.blocked) and not path.back and plan.end - tool.place <= BLOCKED_TOLERANCE * curve.end
        slowdown = min(max((PUSHED_TOOL - tool.error / loop.measure.length) / (PUSHED_TOOL - LATE_TOOL), 0.0), 1.0)
        near = min(slowdown, 1.0 / max(tool.null_space_error / (0.5 * JOINT_TOLERANCE), 1.0))
        share = 0.0 if why or there else near * override * (sqrt(hybrid.acceleration_share) if override <= 1.0 else 1.0)
        rate_before = path.rate(time)
        if rate_before != 0.0 or not why:
            path.set_place(time, tool.place)
        motion = path.order(time, share)
        middle = motion.clock.now(time + 0.5 * dt)
        r = motion.base.at(np.array((middle[0],)))[0]
        rate = middle[1] * float(r[1, -1])
        place = tool.place if rate_before != 0.0 or not why else self._place
        slope = middle[1] * r[1, :-1]
        posture = slope + (0.0 if there else JOINT_GAIN) * tool.joint_error
        ahead = rate * curve.tangent(min(max(place + 0.5 * dt * rate, 0.0), curve.end))
        answer = hybrid.step(q, curve.pose(place), wrench, ahead, here, before, wanted, posture)
        self._touching = self._is_touching(answer)
        after = motion.base.at(np.array((motion.base_time(time + dt),)))
        self._place = float(after[0, 0, -1]) if rate_before != 0.0 or not why else place
        stalls = self._stalls(place, rate, curve.end, waits=bool(why) or share == 0.0)
        off_path = OFF_PATH if near < 1.0 and not there else ""
        solution = path.solution(q, answer.velocity, time + dt, override, why=why or off_path, pressed=tool.error)
        solution.hybrid = answer
        if why == NO_TOUCH:
            solution.status, solution.reason, solution.ruling = Status.WAITING, answer.reason or NO_TOUCH, NO_TOUCH
        elif stalls and solution.status not in (Status.DONE, Status.BLOCKED):
            at = f"the tool comes no farther than {path.given.place(place):.4g}"
            reason = "; ".join(filter(None, (at, plan.blocked, answer.reason)))
            solution.status, solution.reason = Status.BLOCKED, reason
        elif not solution.reason and solution.status != Status.DONE:
            solution.reason = answer.reason
        return solution

    def _solution(
        self, answer: HybridSolution, path: PathDrive, status: Status, reason: str, off: float, ruling: str
    ) -> FollowerSolution:
        where = path.given.place(self._place), 0.0, 0.0
        return FollowerSolution(answer.velocity, status, reason, where, lambda: off, ruling, answer)

    def _tool_on_path(self, path: PathDrive, q: Array, contact: Contact) -> ToolOnPath:
        """The tool of q (m,) beside the path, along S."""
        hybrid, loop, curve, plan = self.hybrid, self.controller, path.given.curve, path.plan
        task, P = _error_in_contact(hybrid, loop, q, curve.pose(self._place), contact)
        R = task.rows.dot(P)
        error = R.dot(task.error)
        displaced = float(np.linalg.norm(error))
        if plan is None or path.motion is None:
            return ToolOnPath(self._place, displaced, displaced, 0.0, np.zeros(len(q)))
        ahead = R.dot(curve.tangent(self._place))
        # Where the path nearly stands still, or is short compared with the error, feedback acts along it too.
        squares = float(ahead.dot(ahead)) + path.given.slow**2 + float(error.dot(error)) / curve.end**2
        place = min(max(self._place - float(ahead.dot(error)) / squares, 0.0), plan.end)
        off = float(np.linalg.norm(error - (self._place - place) * ahead))
        joint_error = joint_displacement(q, plan.joints(place), loop.turns)
        if float(joint_error.dot(joint_error)) <= (0.5 * JOINT_TOLERANCE) ** 2:
            return ToolOnPath(place, off, displaced, 0.0, joint_error)
        _, sigma, Vt = np.linalg.svd(task.root.dot(task.state.J), full_matrices=False)
        moving = Vt[sigma > SLOW_SHARE * sigma[0]]  # joint motions that move the tool
        free = joint_error - moving.T.dot(moving.dot(joint_error))
        return ToolOnPath(place, off, displaced, float(np.abs(free).max()), joint_error)

    def _is_touching(self, answer: HybridSolution) -> bool:
        """Whether the tool is in contact."""
        if answer.status in NO_CONTACT:
            return False
        if self._touching:
            return True
        n = answer.contact.kind.presses
        wanted = np.linalg.lstsq(answer.contact.constraints, answer.wanted, rcond=None)[0]
        return bool((answer.intensities[:n] >= TOUCH_SHARE * wanted[:n]).all())

    def _stalls(self, place: float, rate: float, end: float, *, waits: bool) -> bool:
        """Whether the tool comes no farther: in contact it may not reach the plan."""
        dt, near, stall = self.controller.dt, BLOCKED_TOLERANCE * end, self._stall
        if waits or stall is None or abs(place - stall[0]) > near:
            self._stall = None if waits else (place, 0.0, 0.0)
            return False
        self._stall = stall = stall[0], stall[1] + dt, stall[2] + dt * abs(rate)
        return stall[1] > STUCK_TIME and (abs(rate) * dt <= MIN_STEP * end or stall[2] > 2.0 * near)


class TrackingState(NamedTuple):
    """The tracking errors of the pressed arm when a tick begins."""

    measured: Array  # (m,) joint positions, of continuous joints by whole turns near where they were sent
    joint_error: Array  # (m,) joint tracking error [rad, length]
    tool_error: float  # along S, in the measure [length]
    restarts: bool  # whether the reference restarts here: at first, or where the arm was pushed or stopped
    pose: Array  # (4, 4) of the tool
    projector: Array  # (6, 6) of twists on S, base frame


class StreamInContact:
    """A hybrid controller that follows a stream: a reference arm moves, and the tool follows its tool along S.

    Attributes:
        hybrid: of the pressed arm.
        controller: of the reference arm, which has no delay.
        command: (m,) joint velocity of the last tick.
        tracking: the errors of the arm when the last tick began.
    """

    def __init__(self, hybrid: HybridController) -> None:
        """No stream yet."""
        self.hybrid = hybrid
        self.controller = Controller(hybrid.robot, **hybrid.loop.options | {"delay": 0.0})
        self.command: Array = np.zeros(len(hybrid.robot.names))
        self.tracking: TrackingState
        self._sent: tuple[Array, ...] = ()  # (m,) positions of the reference, oldest first: its command shows now
        self._contact: Contact | None = None  # of the last tick, with its estimated normal

    def step(self, q: Array, velocity: Array | None, state: Any, given: ContactInput) -> HybridSolution:
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
        if not tracking.restarts:  # before the reference moves: input may still be refused
            at, rate = state.position, state.velocity + hybrid.loop.dt * state.acceleration
        target, ahead = robot.pose(q + tracking.joint_error), robot.jacobian(at).dot(rate)
        posture = rate + JOINT_GAIN * tracking.joint_error
        answer = hybrid.step(q, target, wrench, ahead, contact, velocity, wanted, posture)
        self.tracking, self.command, self._contact = tracking, answer.velocity, answer.contact
        return answer

    def _track(self, q: Array, before: Array, contact: Contact | None) -> TrackingState:
        """The tracking errors at q (m,), with the velocity (m,) before the tick."""
        hybrid, loop, tool = self.hybrid, self.controller, self.hybrid.robot.pose(q)
        here = hybrid.task.contact_at(tool, contact) if self._contact is None else self._contact
        sent = self._sent[0] if self._sent else q
        joint_error = joint_displacement(q, sent, loop.turns)
        task, projector = _error_in_contact(hybrid, loop, q, hybrid.robot.pose(sent), here)
        off = float(np.linalg.norm(task.rows.dot(projector).dot(task.error)))
        pushed = off > PUSHED_TOOL * loop.measure.length
        stopped = (np.abs(before - self.command) > loop.dt * np.asarray(loop.acceleration_limit)).any()
        if pushed or stopped or not self._sent or loop.limits.implausible(q):
            return TrackingState(sent - joint_error, np.zeros(len(q)), 0.0, True, tool, projector)
        return TrackingState(sent - joint_error, joint_error, off, False, tool, projector)

    def sent(self, *position: Array) -> None:
        """The reference is at a position (m,) when the next tick begins; without one it restarts there."""
        loop, kept = self.hybrid.loop, () if self.tracking.restarts else self._sent
        self._sent = (*kept, *position)[-1 - round(loop.delay / loop.dt) :]

    def along(self, twist: Array, *, at_base: bool) -> Array:
        """(6,) the part of a twist (6,) along S, as a screw in base coordinates."""
        screw = twist if at_base else np.concatenate((twist[:3], velocity_at(twist, -self.tracking.pose[:3, 3])))
        return np.asarray(self.tracking.projector.dot(screw))

    def solution(self, solution: FollowerSolution, answer: HybridSolution) -> FollowerSolution:
        """The solution of a tick, from those of the reference and of the hybrid controller."""
        solution.velocity, solution.hybrid = answer.velocity, answer
        if answer.status in TROUBLE:
            solution.status, solution.reason = answer.status, answer.reason
        elif self.tracking.tool_error > LATE_TOOL * self.controller.measure.length and solution.status in (
            Status.MOVING,
            Status.DONE,
        ):
            solution.status, solution.reason = Status.LATE, answer.reason or OFF
        elif not solution.reason:
            solution.reason = answer.reason
        return solution
