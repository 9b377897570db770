"""Waypoints, and their inverse kinematics: joint positions each near those of the waypoint before.

    poses (n, 4, 4)      solved one from the other, beginning with the arm's own joints: one branch, no jump
    joints (n, m)        as they are, inside the position limits
    points (n, 3), targets that leave something free      the poses that meet them, each near the joints before

The joints for a pose out of reach are a local least squares solution. If that lasts, or the pose has no time, restarts
look for another branch.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.control.target import Target, checked_target
from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.paths.task_error import TaskError, task_error
from invariantqp.pose.ik import PoseSearch
from invariantqp.robots.kinematics import Robot, unwrapped

# A pose missed by more than this, relative to the arm's length and in radians, is not reached.
POSE_TOLERANCE = 1e-4
# A pose that is missed for this long [s] is solved again from joint positions so far away [rad, length], in turn.
STALL_TIME = 0.2
RESTART_DISTANCES = (0.3, 0.6, 1.0, 1.5, 2.2)
# Progress towards a pose: its distance falls below this share of the largest.
STALL_RATIO = 0.9
# Share of the speed limits of joints on the way to poses out of reach, which leaves time for accelerations.
UNREACHABLE_SPEED = 0.4
# Restarts for each pose, at most.
MAX_RESTARTS = 3


class Waypoints:
    """Points of one kind, as a caller gave them.

    Attributes:
        poses: (n, 4, 4), or None.
        joints: (n, m), or None.
        targets: n of them that leave something free, or None; `WaypointIK.with_poses` makes poses of them.
        missed: (n,) by how much these poses miss the targets [length], or None.
    """

    def __init__(self, points: Any, m: int, name: str) -> None:
        """Check the points.

        Raises:
            BadInput: neither poses nor joint positions nor targets.
        """
        self.poses: Array | None = None
        self.joints: Array | None = None
        self.targets: tuple[Target, ...] | None = None
        self.missed: Array | None = None
        if isinstance(points, (list, tuple)):
            if any(isinstance(p, Target) for p in points):
                self.targets = tuple(checked_target(p, name) for p in points)
                return
            points = [arrays.pose_matrix(p) for p in points]
        expected = f"poses (n, 4, 4), joint positions (n, {m}), points (n, 3), or several iq.Target"
        found = arrays.array(points, name, expected)
        if found.ndim == 3 and found.shape[1:] == (4, 4) and len(found):
            self.poses = arrays.poses(found, name)
        elif found.ndim == 2 and found.shape[1] == m and len(found):
            self.joints = arrays.matrix(found, (None, m), name).copy()
        elif found.ndim == 2 and found.shape[1] == 3 and len(found):
            self.targets = tuple(checked_target(p, name) for p in found)
        else:
            raise BadInput(name, f"shape {found.shape}", expected)

    def __len__(self) -> int:
        several = next(a for a in (self.poses, self.joints, self.targets) if a is not None)
        return len(several)

    @property
    def places(self) -> Array:
        """(k, 3) positions wanted of points of the tool; none of joints."""
        if self.poses is not None:
            return self.poses[:, :3, 3]
        found = [target.point for target in self.targets or () if target.point is not None]
        return np.array(found).reshape(-1, 3)

    def chosen(self, which: slice) -> Waypoints:
        """Some of the points."""
        new = copy(self)
        for name, points in vars(self).items():
            setattr(new, name, None if points is None else points[which])
        return new

    def pose_at(self, time: float, stamps: Array, robot: Robot) -> Array:
        """(4, 4) the pose wanted at a time, between points with stamps (n,)."""
        i = int(np.clip(np.searchsorted(stamps, time) - 1, 0, max(len(stamps) - 2, 0)))
        j = min(i + 1, len(stamps) - 1)
        share = float(np.clip((time - stamps[i]) / (stamps[j] - stamps[i]), 0.0, 1.0)) if j > i else 0.0
        if self.poses is None:
            joints = np.asarray(self.joints)
            return np.asarray(robot.pose((1.0 - share) * joints[i] + share * joints[j]))
        displacement = se3.displacement(self.poses[i], self.poses[j])
        between: Array = se3.exp(share * displacement, check=False).dot(self.poses[i])
        return between


class WaypointIK:
    """Joint positions for waypoints, each near the one before."""

    def __init__(self, controller: Controller, tolerance: float) -> None:
        """For a loop's arm and exact demands; a pose missed by more than `tolerance` is not reached."""
        self._loop = controller
        self._lower, self._upper = controller.box.position_lower, controller.box.position_upper
        self._tolerance = tolerance
        self._search = PoseSearch(controller.robot, exact=controller.exact or None, restarts=0, time_limit=inf)
        self._free = PoseSearch(controller.robot, restarts=0, time_limit=inf)  # of targets, whose poses are then exact
        self._random = np.random.default_rng(0)
        self._stalled: tuple[float, float] | None = None  # since when a pose is missed, and by how much at most
        self._tried = 0

    def pose(self, target: Array, near: Array, time: float, step: float) -> tuple[Array, float]:
        """(m,) joint positions for a pose at a time [s], and by how much they miss it [length].

        The joints are near (m,) `step` [s] before; inf gives them as long as they need.
        """
        reached, missed = self._search.descend(target, near), 0.0
        if reached is None:
            found = self._search.solve(target, near)
            reached, missed = found.q, self._missed(found)
        close = bool((np.abs(reached - near) <= self._loop.box.velocity_limit * step).all())
        if missed <= self._tolerance and (close or self._stalled is None):
            self._stalled = None
            return reached, 0.0
        if step == inf:
            other = next((q for _ in RESTART_DISTANCES if (q := self._restarted(target, near)) is not None), None)
            return (reached, missed) if other is None else (other, 0.0)
        far = reached if missed <= self._tolerance else None  # too far for a step
        q = self._stepped(target, near, step)
        missed = task_error(self._loop, q, self._loop.robot.target(target)).off
        if self._stalled is None or time < self._stalled[0] or missed < STALL_RATIO * self._stalled[1]:
            self._stalled = time, missed
            self._tried = 0
            return q, missed
        self._stalled = self._stalled[0], max(missed, self._stalled[1])
        if time - self._stalled[0] >= STALL_TIME * (1 + self._tried // len(RESTART_DISTANCES)):
            other = self._restarted(target, near) if far is None else far
            if other is not None:
                self._stalled = None
                return other, 0.0
        return q, missed

    def points(self, given: Waypoints, near: Array, times: Array, before: float | None = None) -> tuple[Array, Array]:
        """(n, m) joint positions for waypoints at times (n,), and (n,) by how much each is missed.

        The joints are near (m,) at the time `before`; None is any time before.
        """
        if given.poses is None:
            joints = unwrapped(near, np.asarray(given.joints), self._loop.turns)
            inside = np.clip(joints, self._lower, self._upper)
            return inside, np.abs(joints - inside).max(axis=1)
        T, n, fastest = given.poses, len(given), self._loop.box.velocity_limit
        answer, missed, q, steps = np.zeros((n, len(near))), np.zeros(n), near, np.diff(times)
        k = 0  # the next
        while k < n:
            answer[k], missed[k] = self.pose(T[k], q, float(times[k]), inf if before is None else times[k] - before)
            k += 1
            if self._stalled is None and k < n:  # as far as they are reached
                there = self._search.descend_along(T[k:], answer[k - 1], fastest, steps[k - 1 :])
                answer[k : k + len(there)] = there
                k += len(there)
            q, before = answer[k - 1], float(times[k - 1])
        if given.missed is not None:
            missed = np.maximum(missed, given.missed)
        return np.clip(answer, self._lower, self._upper), missed

    def with_poses(self, given: Waypoints, near: Array, *, leaps: bool) -> Waypoints:
        """Poses in place of targets that leave something free, each near the joints (m,) before.

        With `leaps` the first is also solved from other joint positions if it is not reached.
        """
        if given.targets is None:
            return given
        new, robot = given.chosen(slice(None)), self._loop.robot
        new.targets, new.poses, new.missed = None, np.zeros((len(given), 4, 4)), np.zeros(len(given))
        for i, target in enumerate(given.targets):
            found = self._free.solve(target, near)
            for far in RESTART_DISTANCES if leaps and i == 0 else ():
                if found.success:
                    break
                start = near + far * self._random.uniform(-1.0, 1.0, len(near))
                other = self._free.solve(target, np.clip(start, self._lower, self._upper))
                found = min(found, other, key=self._missed)
            near, new.missed[i] = found.q, self._missed(found)
            new.poses[i] = robot.pose(near)
        return new

    def _restarted(self, target: Array, near: Array) -> Array | None:
        """(m,) joint positions of another branch that reach a pose, or None."""
        for _ in range(MAX_RESTARTS):
            start = near + RESTART_DISTANCES[self._tried % len(RESTART_DISTANCES)] * self._random.uniform(
                -1.0, 1.0, len(near)
            )
            self._tried += 1
            other = self._search.solve(target, np.clip(start, self._lower, self._upper))
            if self._missed(other) <= self._tolerance:
                return np.asarray(other.q)
        return None

    def displacement(self, target: Array, q: Array, twist: Array | None = None) -> Array:
        """(m,) the joint displacement of the law from q (m,) to a pose (4, 4), to first order.

        It is damped as in a tick of the loop. With a twist (6,): the joint velocity for that. Both keep exact demands.
        """
        loop = self._loop
        here = task_error(loop, q, loop.robot.target(target))
        if twist is not None:
            return self._from_rest(here, q, twist, 1.0)
        return self._from_rest(here, q, loop.gain * here.error, 1.0 / loop.gain) / loop.gain

    def _from_rest(self, here: TaskError, q: Array, twist: Array, h: float, **bounds: Array) -> Array:
        """(m,) the joint velocity of a loop's first tick for a twist, damped by its residual."""
        first: dict[str, Any] = {"last_velocity": np.zeros(len(q)), **bounds}
        _, missed = here.joint_velocity(self._loop, q, twist, h, **first)
        return here.joint_velocity(self._loop, q, twist, h, last_residual=missed, hold_time=self._loop.dt, **first)[0]

    def _stepped(self, target: Array, q: Array, step: float) -> Array:
        """(m,) joint positions after a step [s] of the loop's law towards a pose."""
        loop = self._loop
        here = task_error(loop, q, loop.robot.target(target))
        speed = UNREACHABLE_SPEED * loop.box.velocity_limit
        lower = np.clip((self._lower - q) / step, -speed, 0.0)
        upper = np.clip((self._upper - q) / step, 0.0, speed)
        x = self._from_rest(here, q, here.error / step, step, lower=lower, upper=upper)
        return np.asarray(q + step * x)

    def _missed(self, found: Any) -> float:
        """The distance of a solution from the pose in the loop's measure, 0 where its demands are met [length]."""
        if found.success:
            return 0.0
        return float(np.hypot(found.position_error, self._loop.measure.length * found.orientation_error))


def sampled(function: Callable[[float], ArrayLike], times: Array, m: int) -> Waypoints:
    """The points of a function of time at times (n,)."""
    points = [arrays.pose_matrix(p) for p in map(function, times.tolist())]
    return Waypoints(points, m, "points")
