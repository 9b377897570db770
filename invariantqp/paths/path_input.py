"""A path whose shape is kept, as the input of a follower: the way to its start, then the ticks along it."""

from __future__ import annotations

from typing import Any

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.paths.joint_limits import AT_LIMIT
from invariantqp.paths.joint_tracker import SPLICE, JointTracker
from invariantqp.paths.override import Override
from invariantqp.paths.path_drive import OFF_PATH, PAUSE, PathDrive
from invariantqp.paths.reference import JOINT_TOLERANCE, PUSHED_JOINT, Reference
from invariantqp.paths.solution import FollowerSolution
from invariantqp.paths.task_error import STILL
from invariantqp.paths.waypoints import POSE_TOLERANCE, WaypointIK, Waypoints
from invariantqp.robots.kinematics import unwrapped


class PathInput:
    """A path whose shape is kept.

    Attributes:
        drive: the path, its plan and its time scaling.
    """

    def __init__(self, drive: PathDrive, joints: JointTracker, ik: WaypointIK, override: Override) -> None:
        """Not driven yet."""
        self.drive = drive
        self._joints, self._ik, self._override = joints, ik, override
        self._start: Array | None = None  # (m,) joint positions at the path's start
        self._is_off = False  # whether it waits for joints that are off the path

    @property
    def is_driving(self) -> bool:
        """Whether the start has been reached."""
        return self.drive.motion is not None

    # On the way to the start

    def approach(self, measured: Array, clock: float | None, override: float, is_paused: bool) -> FollowerSolution:
        """A tick on the way to the path's start."""
        joints, drive = self._joints, self.drive
        before = joints.state.command
        share = 0.0 if is_paused else min(override, 1.0)
        solution = self._approach_in_joints(measured, before, share) if drive.limits_jerk else None
        if solution is None:
            solution = drive.approach_start(measured, before, share)
            joints.set_command(solution.velocity)
        joints.time = (joints.time if clock is None else clock) + joints.limits.dt
        joints.reference = None
        return solution

    def _approach_in_joints(self, measured: Array, before: Array, share: float) -> FollowerSolution | None:
        """The same inside jerk limits, in joint space; None at the path's start, or where that fails."""
        joints = self._joints
        state, limits = joints.state, joints.limits
        if self._start is None or state.unresponsive or np.abs(state.sent - measured).max() > PUSHED_JOINT:
            goal = Waypoints([self.drive.given.pose(0.0)], len(measured), "path")
            goal = self._ik.with_poses(goal, measured, leaps=True)
            (there,), (missed,) = self._ik.points(goal, measured, np.array((joints.time,)))
            if missed > POSE_TOLERANCE * joints.controller.measure.length:
                return None
            if self._start is not None:  # pushed
                state.acceleration = np.zeros(len(measured))
            self._start, state.position, state.velocity = there, measured, before
            state.begin(measured)
        else:
            state.send()
        joints.twist = None
        state.late = bool(np.abs(self._start - state.position).max() > AT_LIMIT) or not joints.is_at_rest
        if not state.late:
            return None
        joints.bounds = limits.scaled(np.full(len(measured), share))
        if share == 0.0:
            joints.twist = STILL
        reference = Reference(limits, self._start, joints.time)
        tracked = reference.tracked(joints.bounds, joints.controller.gain, keeps_shape=True)
        goal_of_tick = "motion" if joints.twist is None else "twist", None, False, 1.0, 0.0, joints.time, None
        fields = joints.tick(tracked, goal_of_tick, measured)
        joints.finish(fields, reference, 0.0)
        return self.drive.approach_solution(measured, np.asarray(fields[0]))

    def begin(self, measured: Array, clock: float | None) -> Array:
        """Drive the path whose start is reached; (m,) measured positions, of continuous joints near that start."""
        joints = self._joints
        self.drive.begin(joints.time if clock is None else clock)
        joints.reference = joints.twist = None
        start = self.drive.driven.joints(0.0)
        joints.state.measured = unwrapped(start, measured[None], joints.controller.turns)[0]
        return np.asarray(joints.state.measured)

    # Along the path

    def resume(self, measured: Array) -> bool:
        """Track the path from rest where it is, if the joints are there."""
        joints = self._joints
        state, motion = joints.state, self.drive.stopped(joints.time)
        state.position = there = motion.at(np.array((joints.time,)))[0, 0]
        state.velocity = state.acceleration = np.zeros(len(there))
        state.begin(there)
        if self.is_pushed(measured):
            return False
        joints.reference = Reference(joints.limits, there, joints.time)
        joints.reference.motion = motion
        return True

    def clock_jumped(self, reference: Reference, by: float) -> None:
        """The clock of `now` differs from the ticks by some time [s]: the path goes on from where it is."""
        reference.motion = self.drive.delayed(by)

    def is_pushed(self, measured: Array) -> bool:
        """Whether joints at measured positions (m,), or the tool, have been pushed."""
        joints = self._joints
        is_pushed = joints.is_pushed(measured)
        return is_pushed or (joints.error > JOINT_TOLERANCE and self.drive.is_off(measured, joints.time))

    def goes_on(self, reference: Reference, *, restarts: bool) -> bool:
        """Whether a reference is followed on; one that restarts on the path, from rest."""
        if restarts and not self._joints.state.late:
            reference.motion = self.drive.stopped(self._joints.time)
            return True
        return not restarts

    def restarted(self, reference: Reference) -> None:
        """The reference begins at the arm, off the path: it goes back to where it left it."""
        joints = self._joints
        motion = self.drive.stopped(joints.time)
        joints.state.late = not reference.splice(motion, joints.time, joints.through_ticks, SPLICE)

    def update(self, reference: Reference, override: float, is_paused: bool) -> None:
        """Set the path's time scaling to an override; it waits for joints that are off the path."""
        joints = self._joints
        joins = joints.state.late or joints.time < reference.splice_end
        self._is_off = joins or joints.error > (0.5 if self._is_off else 1.0) * JOINT_TOLERANCE
        self._override.value = override
        reference.motion = self.drive.order(joints.time, 0.0 if is_paused or self._is_off else override)

    def wait(self, reference: Reference, share: float) -> None:
        """Delay the path by a share of a tick."""
        reference.motion = self.drive.delayed(share * self._joints.limits.dt)

    def goal(self, is_paused: bool) -> tuple[Any, ...]:  # noqa: ARG002 (of all inputs)
        """The goal of a tick, as the engine takes it."""
        splice = self._joints.splice_time
        if splice and self._override.is_changing:
            splice = 0.0
        return "motion", None, False, 1.0, splice, self._joints.time, None

    def repeats_until(self, reference: Reference) -> float:
        """Until when nothing is due [s]; -inf where each tick decides."""
        joints, motion = self._joints, self.drive.motion
        is_joining = joints.state.late or reference.motion is not motion or joints.time <= reference.splice_end
        return -np.inf if is_joining or self._is_off or joints.state.unresponsive else self.drive.until

    # The report

    def plain_solution(self, fields: tuple[Any, ...], measured: Array) -> FollowerSolution:
        """The solution of a repeated tick, by its fields."""
        return self.drive.engine_solution(fields[0], measured, fields[1], fields[2], self._override.value)

    def solution(self, reference: Reference, measured: Array, command: Array, is_paused: bool) -> FollowerSolution:  # noqa: ARG002
        """The solution of a tick that began at measured positions (m,)."""
        joints, override = self._joints, self._override.value
        why = OFF_PATH if self._is_off else PAUSE if is_paused or override == 0.0 else ""
        solution = self.drive.solution(measured, command.copy(), joints.time, override, why=why)
        found = joints.loop_status(False, False) if joints.state.late else None
        if (found := joints.fault_status() or found) is not None:
            solution.status, solution.reason = found
        return solution
