"""Looking along a path from a place on it, a little at a time: ahead to its end and behind to its start."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from invariantqp.control.controller import Controller
from invariantqp.control.curve import Curve
from invariantqp.control.joint_path import JointPath
from invariantqp.control.path_plan import PathPlan, plan_of
from invariantqp.geometry.arrays import Array


class Backward(NamedTuple):
    """A curve the other way round: its pose and tangent at a distance from the end.

    Attributes:
        curve: forward.
    """

    curve: Curve

    @property
    def end(self) -> float:
        """The parameter at the last knot, which is the first of the curve."""
        return self.curve.end

    def pose(self, at: float) -> Array:
        """(4, 4) the pose at a place."""
        return self.curve.pose(self.end - at)

    def tangent(self, at: float) -> Array:
        """(6,) the twist per unit of the parameter at a place, base frame."""
        return -self.curve.tangent(self.end - at)


class PathSearch:
    """The joint motion through joint positions at a place, found step by step."""

    def __init__(
        self, controller: Controller, curve: Curve, q: Array, place: float, *, rate: float | None, stops: bool
    ) -> None:
        """Nothing is found yet.

        Args:
            controller: whose law chooses.
            curve: the path.
            q: (m,) joint positions near the place.
            place: where to begin.
            rate: as in `JointPath`.
            stops: as in `JointPath`.
        """
        self.place = place
        self._controller = controller
        self._curve = curve
        self._ahead = JointPath(controller, curve, q, place, rate=rate, stops=stops)
        self._behind: JointPath | None = None
        if place > 0.0:
            self._behind = JointPath(controller, Backward(curve), q, curve.end - place, rate=rate, stops=stops)

    @property
    def done(self) -> bool:
        """Whether all is found that there is."""
        return self._ahead.done and (self._behind is None or self._behind.done)

    def extend(self) -> None:
        """One step."""
        if not self._ahead.done:
            self._ahead.extend()
        elif self._behind is not None and not self._behind.done:
            self._behind.extend()

    def plan(self, fastest: float = inf) -> PathPlan:
        """The plan of what is found; the tool stops at its ends.

        Args:
            fastest: the largest speed that will be asked for.
        """
        knots = self._ahead.knots
        if self._behind is not None:
            end = self._curve.end
            behind = [k._replace(at=end - k.at, slope=-k.slope) for k in self._behind.knots[:0:-1]]
            knots = behind + knots
        return plan_of(self._controller, self._curve, knots, self._ahead.blocked, fastest)
