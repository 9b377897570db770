"""Looking along a path from a place on it, a little at a time: ahead to its end and behind to its start."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.control.curve import Curve, Poses
from invariantqp.control.joint_path import SHORTEST, JointPath
from invariantqp.control.path_plan import PathPlan, plan_of
from invariantqp.geometry.arrays import Array

# On a path that grows, knots kept behind the tool; and what makes a plan worth making, new knots and a share of the
# scale: no tool should come to rest in the middle of a tight bend.
KEPT, WORTH, FAR = 3, 20, 1e-3


class Held(NamedTuple):
    """A curve whose ends go on for ever."""

    curve: Curve  # between its ends

    @property
    def end(self) -> float:
        """Where it comes to rest."""
        return self.curve.end

    def pose(self, at: float) -> Array:
        """(4, 4) the pose at a place."""
        return self.curve.pose(min(max(at, self.curve.knots[0]), self.curve.end))

    def tangent(self, at: float) -> Array:
        """(6,) the twist per unit of the parameter at a place, base frame."""
        inside = self.curve.knots[0] <= at <= self.curve.end
        return self.curve.tangent(at) if inside else np.zeros(6)


class Backward(NamedTuple):
    """A path the other way round, by the distance from a place on it."""

    path: Poses  # forward
    end: float  # the distance to its start
    place: float  # where to begin

    def pose(self, at: float) -> Array:
        """(4, 4) the pose at a distance."""
        return self.path.pose(self.place - at)

    def tangent(self, at: float) -> Array:
        """(6,) the twist per unit of the distance, base frame."""
        return -self.path.tangent(self.place - at)


class PathSearch:
    """The joint motion through joint positions at a place, found step by step."""

    def __init__(
        self,
        controller: Controller,
        curve: Curve,
        q: Array,
        place: float,
        *,
        rate: float | None,
        stops: bool,
        scale: float | None = None,
    ) -> None:
        """Nothing is found yet; it begins at a place, from q (m,) near it. All else is as in `JointPath`."""
        self._grows = scale is not None
        self._planned = 0.0
        self._plans: dict[float, PathPlan] = {}
        self._controller = controller
        self._path: Poses = curve if self._grows else Held(curve)
        self._place = place
        self._scale = scale = curve.end if scale is None else scale
        self._ahead = JointPath(controller, self._path, q, place, rate=rate, stops=stops, scale=scale)
        self._behind: JointPath | None = None
        left = place - curve.knots[0]
        if left > SHORTEST * scale:
            back = Backward(self._path, left, place)
            self._behind = JointPath(controller, back, q, rate=rate, stops=stops, scale=scale)

    @property
    def done(self) -> bool:
        """Whether all is found that there is."""
        return self._ahead.done and (self._behind is None or self._behind.done)

    @property
    def ready(self) -> bool:
        """Whether a plan is worth making."""
        knots = self._ahead.knots
        if self.done or not self._grows or len(knots) <= WORTH:
            return self.done
        return knots[-1 - WORTH].at >= self._planned and knots[-1].at - self._planned >= FAR * self._scale

    def extend(self) -> None:
        """One step."""
        self._plans.clear()
        if not self._ahead.done:
            self._ahead.extend()
        elif self._behind is not None and not self._behind.done:
            self._behind.extend()

    def plan(self, fastest: float = inf, smooth: float | None = None) -> PathPlan:
        """The plan of what is found, for `fastest` and `smooth` of `plan_of`; the tool stops at its ends."""
        if fastest in self._plans:
            return self._plans[fastest]
        knots = self._ahead.knots
        self._planned = knots[-1].at
        if self._behind is not None:
            back = self._behind.knots[:0:-1]
            knots = [k._replace(at=self._place - k.at, slope=-k.slope) for k in back] + knots
        plan = plan_of(self._controller, self._path, knots, self._ahead.blocked, fastest, smooth)
        self._plans[fastest] = plan
        return plan

    def grow(self, curve: Curve, place: float) -> None:
        """Go on along a curve that is the old one as far as that goes, and forget what lies behind a place."""
        self._plans.clear()
        self._path = self._ahead.curve = curve
        knots = self._ahead.knots
        while len(knots) > KEPT and knots[KEPT - 1].at < place:
            del knots[0]
        if self._behind is not None and knots and knots[0].at > self._place:
            self._behind = None
