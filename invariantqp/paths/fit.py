"""From what a caller gives, poses or joint positions, to joint positions near where the arm is.

    poses (n, 4, 4)      solved one from the other, beginning with the arm's own joints: one branch, no leap
    joints (n, m)        as they are, inside the position limits

Where a pose is out of reach its joints are the closest downhill; `Solver` counts for how long, and looks for another
branch where that lasts although the pose can be reached.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.pose.ik import PoseSearch
from invariantqp.robots.kinematics import Robot

# A pose missed by more than this, relative to the arm's length and in radians, is not reached.
REACHED = 1e-4
# A pose that is missed for this long [s] is tried from other joint positions, so far away [rad, length], in turn.
PATIENCE = 0.2
ELSEWHERE = (0.3, 0.6, 1.0, 1.5, 2.2)
# Tries from elsewhere for each pose, at most.
TRIES = 3


class Given:
    """What a caller gave: points of one kind, with stamps.

    Attributes:
        poses: (n, 4, 4), or None.
        joints: (n, m), or None.
    """

    def __init__(self, points: Any, m: int, name: str) -> None:
        """Checked.

        Raises:
            BadInput: neither poses nor joint positions.
        """
        self.poses: Array | None = None
        self.joints: Array | None = None
        if isinstance(points, (list, tuple)):
            points = [getattr(p, "homogeneous", p) for p in points]
        found = arrays.array(points, name, f"poses (n, 4, 4), or joint positions (n, {m})")
        if found.ndim == 3 and found.shape[1:] == (4, 4) and len(found):
            self.poses = np.array([arrays.pose(T, f"{name}[{i}]") for i, T in enumerate(found)])
        elif found.ndim == 2 and found.shape[1] == m and len(found):
            self.joints = found.copy()
        else:
            raise BadInput(name, excerpt(points), f"poses (n, 4, 4), or joint positions (n, {m})")

    def __len__(self) -> int:
        return len(self.joints) if self.poses is None and self.joints is not None else len(np.asarray(self.poses))

    def chosen(self, which: Array) -> Given:
        """Those alone that are chosen."""
        new = Given.__new__(Given)
        new.poses = None if self.poses is None else self.poses[which]
        new.joints = None if self.joints is None else self.joints[which]
        return new

    def pose_at(self, time: float, stamps: Array, robot: Robot) -> Array:
        """(4, 4) the pose asked for at a time, between points with stamps (n,)."""
        i = int(np.clip(np.searchsorted(stamps, time) - 1, 0, max(len(stamps) - 2, 0)))
        j = min(i + 1, len(stamps) - 1)
        share = float(np.clip((time - stamps[i]) / (stamps[j] - stamps[i]), 0.0, 1.0)) if j > i else 0.0
        if self.poses is None:
            joints = np.asarray(self.joints)
            return np.asarray(robot.pose((1.0 - share) * joints[i] + share * joints[j]))
        way = se3.displacement(self.poses[i], self.poses[j])
        between: Array = se3.exp(share * way, check=False).dot(self.poses[i])
        return between


class Solver:
    """Joint positions for points, near one another."""

    def __init__(self, controller: Controller, tolerance: float) -> None:
        """For a loop's arm and what it meets exactly; a pose missed by more than `tolerance` is not reached."""
        self._robot = controller.robot
        self._lower, self._upper = controller.box.position_lower, controller.box.position_upper
        self._exact = controller.exact or None
        self._length = controller.measure.length
        self._search = PoseSearch(self._robot, exact=self._exact, restarts=0, time_limit=inf)
        self._tolerance = tolerance
        self._random = np.random.default_rng(0)
        self._missed_since: float | None = None
        self._tried = 0

    def pose(self, target: Array, near: Array, time: float) -> tuple[Array, float]:
        """(m,) joint positions for a pose that is wanted at a time [s], and by how much it is missed [length]."""
        found = self._search.solve(target, near)
        missed = self._off(found)
        if missed <= self._tolerance:
            self._missed_since = None
            return found.q, missed
        if self._missed_since is None or time < self._missed_since:
            self._missed_since, self._tried = time, 0
        if time - self._missed_since >= PATIENCE * (1 + self._tried // len(ELSEWHERE)):
            for _ in range(TRIES):
                start = near + ELSEWHERE[self._tried % len(ELSEWHERE)] * self._random.uniform(-1.0, 1.0, len(near))
                self._tried += 1
                other = self._search.solve(target, np.clip(start, self._lower, self._upper))
                if self._off(other) <= self._tolerance:
                    self._missed_since = None
                    return other.q, self._off(other)
        return found.q, missed

    def points(self, given: Given, near: Array, times: Array) -> tuple[Array, Array]:
        """(n, m) joint positions for points wanted at times (n,), and (n,) by how much each is missed."""
        if given.poses is None:
            joints = np.asarray(given.joints)
            inside = np.clip(joints, self._lower, self._upper)
            return inside, np.abs(joints - inside).max(axis=1)
        answer, missed, q = [], [], near
        for T, t in zip(given.poses, times.tolist(), strict=True):
            q, off = self.pose(T, q, t)
            answer.append(q)
            missed.append(off)
        return np.clip(np.array(answer), self._lower, self._upper), np.array(missed)

    def _off(self, found: Any) -> float:
        """How far a solution is from what is asked of the pose [length]; a turn counts as in the loop's measure."""
        if found.success:  # what is exact is met, and nothing else is asked
            return 0.0
        return float(np.hypot(found.position_error, self._length * found.orientation_error))


def sampled(function: Callable[[float], ArrayLike], times: Array, m: int) -> Given:
    """A function of time at times (n,)."""
    points = [getattr(p, "homogeneous", p) for p in map(function, times.tolist())]
    return Given(points, m, "points")
