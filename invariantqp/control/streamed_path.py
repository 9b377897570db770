"""A path that comes pose by pose while it is driven: the tool stays on it, and stops smoothly where it ends.

    poses -> pieces of a curve, each with a tangent at both of its ends that never changes once the tool may drive there

The tangent at a pose is known when the next one has come: the path ends one pose before the newest, until the stream
pauses. Where poses double back the path has a corner, in which the tool comes to rest. In every tick the tool could
stop before the end of what has come, so a late pose makes it slow, never jump.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.control.curve import Curve, curve_through
from invariantqp.control.given_path import SLOW, GivenPath
from invariantqp.control.path_driver import PathDriver
from invariantqp.control.path_report import stands
from invariantqp.control.path_search import PathSearch
from invariantqp.control.path_solution import PathSolution
from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import middle
from invariantqp.velocity.solution import Status

# Poses nearer to one another than this, relative to the measure's length, make no piece: which way they lie is noise.
SPACING = 1e-3
# Pieces kept behind the tool.
PIECES_BEHIND = 2


class StreamedPath(PathDriver):
    """Drives the tool of a controller along poses as they come; `step` is one tick.

    The path's parameter is the length along it in the controller's measure, from pose to pose.
    """

    def __init__(
        self,
        controller: Controller,
        *,
        speed: float | None = None,
        acceleration: float | None = None,
        jerk: float | None = None,
        timeout: float = 0.1,
        tolerance: float | None = None,
    ) -> None:
        """A path without poses.

        Args:
            controller: a velocity controller with an acceleration limit.
            speed: along the path, at most [length/s]; None is as fast as limits allow.
            acceleration: along the path [length/s^2]; None is as much as the joints allow.
            jerk: along the path [length/s^3]; None is no limit of jerk.
            timeout: after how long without a pose the stream is late [s]; the tool then goes on to the newest one.
            tolerance: as in `PathFollower`.

        Raises:
            BadInput: a controller without an acceleration limit, or a number that is not positive.
        """
        fast = None if speed is None else arrays.number(speed, "speed", "a speed along the path", positive=True)
        super().__init__(controller, rate=fast, acceleration=acceleration, jerk=jerk, stops=True, tolerance=tolerance)
        if controller.braking is None:
            raise BadInput("controller", "one without an acceleration limit", "Controller(acceleration_limit=...)")
        self.timeout: float = arrays.number(timeout, "timeout", "seconds", positive=True)
        self._J = controller.robot.jacobian(middle(controller.robot))
        self._age = 0.0
        self._closed = False
        self._newest: Array | None = None  # a pose whose tangent is not known yet
        self._tip: Array | None = None  # one that came after it and is not far enough from it
        self._ends: list[tuple[float, Array, Array]] = []  # the last two places, poses and tangents of the path
        self._curve: Curve | None = None

    def add(self, pose: ArrayLike) -> None:
        """The next pose; one nearer than a thousandth of the measure's length to the one before makes no piece of path.

        Args:
            pose: (4, 4) in the base frame, or a `pinocchio.SE3`.

        Raises:
            BadInput: not a rigid motion, or the path is closed.
        """
        if self._closed:
            raise BadInput("pose", "a pose after close()", "a new StreamedPath")
        T = arrays.pose(getattr(pose, "homogeneous", pose), "pose").copy()
        self._age = 0.0
        last = self._newest if self._newest is not None else self._ends[-1][1] if self._ends else None
        if last is None:
            self._goal = self.controller.robot.target(T)
        elif not self._makes_piece(last, T):
            self._tip = None if self._newest is None else T
            return
        else:
            self._open(T)
        self._newest, self._tip = T, None

    def close(self) -> None:
        """No pose comes after the newest: the tool is "done" there."""
        self._closed = True
        self._open_all()

    def step(self, q: ArrayLike, velocity: ArrayLike | None = None, override: float = 1.0) -> PathSolution:
        """One tick, as `PathFollower.step`.

        Returns:
            PathSolution: "waiting" at the end of what has come; `reason` says how long no pose has come, once that is
            longer than the timeout.

        Raises:
            BadInput: as there.
        """
        answer = super().step(q, velocity, override)
        self._age += self.controller.dt
        if self._closed and self._curve is None:  # fewer than two poses that are apart
            there = answer.across <= self._tolerance and stands(self.controller, answer.velocity)
            return answer._replace(status=Status.DONE, reasons="", ruling="the path's end") if there else answer
        late = self._age > self.timeout and not self._closed
        if late:
            self._open_all()
        words = [f"no pose for {self._age:.3g} s"] if late else []
        seen = self._search is not None and self._search.done
        if answer.status is not Status.DONE or (self._closed and seen):
            return answer._replace(lag=None, reasons=(*answer.reasons, *words))
        reason, ruling = words[0] if late else "at the end of what has come", "the end of the stream"
        if not seen:  # poses came faster than ticks look along them
            reason, ruling = "; ".join(["looking along the path", *words]), "the look ahead"
        return answer._replace(status=Status.WAITING, ruling=ruling, lag=None, reasons=reason)

    def _open_all(self) -> None:
        """Let the tool drive to the very last pose."""
        if self._tip is not None:
            # The tip takes the newest pose's place: a piece between the two would point anywhere.
            if not self._ends:
                self._goal = self.controller.robot.target(self._tip)
            if not self._ends or self._makes_piece(self._ends[-1][1], self._tip):
                self._newest = self._tip
            self._tip = None
        self._open(None)

    def _open(self, after: Array | None) -> None:
        """Let the tool drive to the newest pose; `after` is the one after it, None where none has come."""
        here = self._newest
        if here is None or (not self._ends and after is None):
            return
        self._newest = None
        if not self._ends:
            self._ends = [(0.0, here, np.zeros(6))]  # its tangent is known with that of the next
            return
        at, before, tangent = self._ends[-1]
        d, h = self._way(before, here)
        last = d / h
        if self._doubles_back(here, tangent, d):  # after a pause
            tangent = last
        onward = ahead = 2.0 * last - tangent if len(self._ends) > 1 else last
        if after is not None:
            e, k = self._way(here, after)
            if self._doubles_back(here, d, e):
                ahead, onward = last, e / k
            else:  # the tangent of the parabola through three poses
                onward = ahead = (k * last + h * e / k) / (h + k)
        if len(self._ends) == 1:
            tangent = 2.0 * last - ahead
        piece = curve_through(np.array((at, at + h)), np.array((before, here)), np.array((tangent, ahead)))
        self._ends = [(at, before, tangent), (at + h, here, onward)]
        self._grow(piece)

    def _grow(self, piece: Curve) -> None:
        """Join a piece to the path, and forget what lies behind the tool."""
        old, place = self._curve, self._state.place
        curve = piece
        if old is not None:
            first = max(old.piece(place) - PIECES_BEHIND, 0)
            at = np.append(old.at[first:], piece.at[1:])
            poses = np.concatenate((old.poses[first:], piece.poses[1:]))
            curve = Curve(at, poses, np.concatenate((old.cubics[first:], piece.cubics)), at.tolist())
        self._curve = curve
        self._path = GivenPath(curve, curve.at, SLOW)
        if self._search is not None:
            self._search.grow(curve, place)

    def _search_from(self, path: GivenPath, q: Array, place: float) -> PathSearch:
        scale = self.controller.measure.length
        return PathSearch(self.controller, path.curve, q, place, rate=self._pace.rate, stops=True, scale=scale)

    def _makes_piece(self, a: Array, b: Array) -> bool:
        """Whether two poses are far enough apart for a piece of path between them."""
        return self._way(a, b)[1] > SPACING * self.controller.measure.length

    def _doubles_back(self, pose: Array, before: Array, after: Array) -> bool:
        """Whether two twists at a pose go apart by more than a right angle, in the measure: a corner, not a bend."""
        root = self.controller.measure.root_for(self._J, pose)
        return float(root.dot(before).dot(root.dot(after))) < 0.0

    def _way(self, a: Array, b: Array) -> tuple[Array, float]:
        """The twist (6,) from one pose to another, and its size in the measure."""
        d = se3.displacement(a, b)
        v = self.controller.measure.root_for(self._J, a).dot(d)
        return d, sqrt(float(v.dot(v)))
