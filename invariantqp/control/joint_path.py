"""The joint motion that the law would choose along a path, knot by knot: what the look-ahead looks at.

    q_i+1 = q_i + h q'_i + h^2 / 2 q''_i,     then corrected until the tool is on the path
    q' = law(J(q), tangent, posture),         inside the position limits

No speed limit counts here: the motion is a function of place, not of time. In the null space joints go towards the
posture as if the arm were at full speed; where damping acts they keep their direction.

Where the arm cannot do all of the path, q' is the derivative of the joint positions of least error. Least squares for
the tangent are not: the error times the bend of the tool's motion is missing. Beside exact rows q' turns the tool
towards the least error instead, over some of the path.
"""

from __future__ import annotations

from dataclasses import replace
from math import sqrt
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from invariantqp.control.asked import asked, asked_part
from invariantqp.control.controller import Controller
from invariantqp.control.demands import View, rows_of
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Sighting
from invariantqp.velocity.damping import Adaptive
from invariantqp.velocity.law import Demand
from invariantqp.velocity.limits.box import JointBox
from invariantqp.velocity.solve import solve

# A tool this close to the path, relative to the measure's length, is on it.
ON_PATH = 1e-12
# A place that the arm comes no closer to than this, relative, cannot be reached: ten micrometres for a metre.
OFF_PATH = 1e-5
# A joint this close to a position limit [rad, length] is at it.
AT_LIMIT = 1e-6
# Steps of a path at least, and the shortest one as a share of it (or of another scale).
LEAST_STEPS = 200
SHORTEST = 1e-6
# The share of the slope by which it may differ from its extrapolation after a step.
TURN = 0.005
# A slope that changes by more than KINK of it at once, this near a singularity, is a turn to another branch:
# no arm can take it in motion.
KINK, BRANCH = 0.2, 1e-4
# Where a path is left: the damping, the share of a step by which damping grows with the distance (`calm`), and the
# share of the path over which the distance falls to 1/e on the way back. So an arm stretched out bends again in time.
PASSING, CALMING, REJOIN = Adaptive(1e-2, 3e-3), 0.1, 0.02
# The share of the path over which a tool with exact demands turns, or moves, to the least of the error beside them.
TURNING = 0.1
# A slope that takes joints along the whole path for less than this many seconds at full speed counts as that.
STILL = 0.05
# A step after which it differs by less than this share of TURN is followed by a longer one.
EASY = 0.2
# A joint motion that needs more knots has no end.
MOST_KNOTS = 5000
# Where an error of this size stays, relative, the slope is probed this share of a step ahead, until it changes by less
# than this share of it.
UNMET, PROBE, PROBED = 1e-6, 1e-3, 1e-6
# Corrections at a knot.
CORRECTIONS = 8


class Knot(NamedTuple):
    """The arm at a place of the path.

    Attributes:
        at: the path's parameter.
        q: (m,) joint positions.
        slope: (m,) q', per unit of the path's parameter.
        off: how far the tool is off the path in what is asked of it, in the measure.
        ratio: smallest singular value of the measured joint twists over the largest: how far from a singularity.
    """

    at: float
    q: Array
    slope: Array
    off: float
    ratio: float


class Poses(Protocol):
    """A path: a `Curve`, or one the other way round."""

    @property
    def end(self) -> float:
        """The largest parameter."""
        ...

    def pose(self, at: float) -> Array:
        """(4, 4) the pose at a place."""
        ...

    def tangent(self, at: float) -> Array:
        """(6,) the twist per unit of the parameter at a place, base frame."""
        ...


class JointPath:
    """Knots from a start on; `extend` finds the next one.

    Attributes:
        knots: what is found.
        blocked: why the path ends at the last of them, in words; "" where it does not.
    """

    def __init__(
        self,
        controller: Controller,
        curve: Poses,
        q: Array,
        start: float = 0.0,
        *,
        rate: float | None = None,
        stops: bool = True,
        scale: float | None = None,
    ) -> None:
        """Nothing is found yet.

        Args:
            controller: whose law chooses.
            curve: the path.
            q: (m,) joint positions near the path's start.
            start: the path's parameter where to begin.
            rate: of the parameter [1/s] at which the path is meant to be driven; None is as fast as limits allow.
            stops: whether to end before what cannot be reached; otherwise it is passed as near as the law goes.
            scale: of which steps are shares; None is the whole path.
        """
        self.controller = controller
        self.curve = curve
        self.blocked = ""
        self._stops = stops
        self._length = controller.measure.length
        self._reachable = OFF_PATH * self._length
        self.knots: list[Knot] = []
        self._no_limit = np.full(len(q), np.inf)
        self._scale: float = curve.end if scale is None else scale
        self._longest = self._scale / LEAST_STEPS
        self._law = replace(controller.law, dt=0.0)
        if not stops:
            self._law = replace(controller.law, dt=CALMING * self._longest, damping=PASSING)
        self._step = self._longest
        self._first = q.copy()
        self._start = start
        self._pace = 0.0 if rate is None else 1.0 / rate  # time per unit of the parameter
        speed = controller.robot.velocity_limit
        self._speed = np.where(np.isfinite(speed), speed, 1.0)

    @property
    def done(self) -> bool:
        """Whether the end is reached, or no more can be."""
        return bool(self.blocked) or (bool(self.knots) and self.knots[-1].at >= self.curve.end)

    def extend(self) -> None:
        """Try a step to the next knot: it is taken, or halved where the slope has turned too much."""
        if not self.knots:
            self.knots.append(self._knot(self._start, self._first, None))
            if self._stops and self.knots[0].off > self._reachable:
                self.blocked = self._cause(self.knots[0].q)
            return
        last = self.knots[-1]
        before = self.knots[-2] if len(self.knots) > 1 else last._replace(at=last.at - self._step)
        left = self.curve.end - last.at
        h = left if left <= self._step else min(self._step, 0.5 * left)
        expected = (last.slope - before.slope) * (h / (last.at - before.at))
        at = last.at + h if h < left else self.curve.end
        knot = self._knot(at, last.q + h * (last.slope + 0.5 * expected), last.slope)
        if knot.off > self._reachable and self._stops:
            if h > SHORTEST * self._scale:
                self._step = 0.5 * h
            else:
                self.blocked = self._cause(knot.q)
            return
        if len(self.knots) == MOST_KNOTS:
            self.blocked = "the joints would have to turn too often"
            return
        turned = float((np.abs(knot.slope - last.slope - expected) / self._speed).max())
        share = turned / max(float((np.abs(knot.slope) / self._speed).max()), STILL / self._scale)
        if share > TURN and h > SHORTEST * self._scale:
            self._step = 0.5 * h
            return
        if self._stops and share > KINK and knot.ratio < BRANCH:
            self.blocked = f"{self._cause(knot.q)}, and beyond it only after a turn in a singularity"
            return
        self.knots.append(knot)
        if share < EASY * TURN:
            self._step = min(2.0 * self._step, self._longest)

    def _knot(self, at: float, q: Array, before: Array | None) -> Knot:
        """The arm at a place, from joint positions near it and the slope before it."""
        curve, robot = self.curve, self.controller.robot
        target = robot.target(curve.pose(at))
        q = self._inside(q)
        box = self.controller.box
        at_limit = (q <= box.position_lower) | (q >= box.position_upper)
        tolerance = ON_PATH * self._length
        for k in range(CORRECTIONS if self._stops else 1):
            sighting = robot.sight(q, target)
            root = self.controller.measure.root(robot, sighting, target)
            rows = asked(self.controller, sighting, root)
            off = rows.dot(sighting.error)
            size = sqrt(float(off.dot(off)))
            if size <= tolerance or not self._stops:
                break
            back: Array = sighting.error
            still = None
            if self.controller.exact and len(rows) < 6:
                # A correction turns the tool the least, and takes a joint off its limit only where nothing else does:
                # turning towards the path is up to the slope.
                back = asked_part(rows, root).dot(back)
                still = at_limit if k < CORRECTIONS // 2 else None
            q = q + self._answer(q, sighting, root, back, 1.0, None, still)
        tangent = curve.tangent(at)
        if not self._stops or self.controller.exact:  # back to the path a little at a time
            share = TURNING if self._stops else REJOIN
            tangent = tangent + sighting.error / (share * self._scale)
        if before is None:
            before = self._answer(q, sighting, root, tangent, self._step, None)
        slope = self._answer(q, sighting, root, tangent, self._step, self._posture(q, before))
        unmet = root.dot(sighting.error)
        if self._stops and not self.controller.exact and sqrt(float(unmet.dot(unmet))) > UNMET * self._length:
            slope = self._bent(at, q, slope, self._answer(q, sighting, root, sighting.error, 1.0, None))
        sigma = np.linalg.svd(root.dot(sighting.J), compute_uv=False)
        return Knot(at, q, slope, size, float(sigma[-1] / sigma[0]) if sigma[0] > 0.0 else 0.0)

    def _bent(self, at: float, q: Array, slope: Array, here: Array) -> Array:
        """The slope (m,) at which the least error is kept, from the one that least squares give for the tangent.

        Where part of an error stays, its size times the bend of the tool's motion counts too.

        Args:
            at: the place.
            q: (m,) joint positions there.
            slope: (m,) of least squares.
            here: (m,) the correction there.
        """
        ahead = PROBE * self._longest
        if at + ahead > self.curve.end:
            ahead = -ahead
        robot = self.controller.robot
        target = robot.target(self.curve.pose(at + ahead))
        for _ in range(CORRECTIONS):
            there = q + ahead * slope
            sighting = robot.sight(there, target)
            root = self.controller.measure.root(robot, sighting, target)
            change = (self._answer(there, sighting, root, sighting.error, 1.0, None) - here) / ahead
            slope = slope + change
            if float(np.abs(change).max()) <= PROBED * float(np.abs(slope).max()):
                break
        return slope

    def _cause(self, q: Array) -> str:
        """Why the path is blocked where the arm came no closer than q."""
        box, names = self.controller.box, self.controller.robot.names
        at = [
            f"joint {i} ({names[i]}) is at its {side} position limit"
            for side, room in (("lower", q - box.position_lower), ("upper", box.position_upper - q))
            for i in np.flatnonzero(room <= AT_LIMIT).tolist()
        ]
        return " and ".join(at) or "it is out of reach"

    def _inside(self, q: Array) -> Array:
        box = self.controller.box
        return np.minimum(np.maximum(q, box.position_lower), box.position_upper)

    def _posture(self, q: Array, before: Array) -> Array:
        """The posture's velocity per unit of the parameter, from the slope of the knot before."""
        pull = self.controller.posture_pull(q)
        if pull is None:
            return before
        if self._pace == 0.0:
            self._pace = float((np.abs(before) / self._speed).max())
        return pull * self._pace

    def _answer(
        self,
        q: Array,
        sighting: Sighting,
        root: Array,
        twist: Array,
        h: float,
        posture: Array | None,
        still: NDArray[np.bool_] | None = None,
    ) -> Array:
        """The law's answer (m,) for a twist, such that q + h x is inside the position limits; `still` joints rest."""
        controller = self.controller
        box = JointBox(controller.box.position_lower, controller.box.position_upper, self._no_limit, h)
        lower, upper = box.at(q)
        if still is not None:
            lower, upper = np.where(still, 0.0, lower), np.where(still, 0.0, upper)
        exact = None
        if controller.exact:
            view = View(controller.robot, sighting, sighting.pose, 0.0, twist)
            exact = rows_of(controller.exact, view)
        demand = Demand(sighting.J, twist, root, lower, upper, exact, posture, row_rank=controller.row_rank)
        return solve(self._law, demand).velocity
