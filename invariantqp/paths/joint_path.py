"""The joint motion of the velocity law along a path, knot by knot (numerical continuation).

    q_i+1 = q_i + h q'_i + h^2 / 2 q''_i,     then corrected until the tool is on the path
    q' = law(J(q), tangent, posture),         inside the position limits

The motion is a function of place, not of time: no speed limit applies. In the null space joints move towards the
posture as at full speed; where damping acts they keep their direction. Knots are so dense that the slope q' changes
little between them. The path ends where the next knot is off the path, or on another branch.

Where the arm cannot follow all of the path, q' is the derivative of the joint positions of least error, which is least
squares for the tangent plus the error times the curvature of the tool's motion. Beside exact rows q' turns the tool
towards the least error instead, over a share of the path.

Where the path may be left, and beside exact rows, least squares are damped by their residual r:

    |A x - b|^2 + mu |x|^2,     mu = (LEAST_DAMPING |A|)^2 + share (longest step) |A| r

for r = |A x - b| with the first term of mu alone; forms do not apply there.

Exact rows that cannot be met are left smoothly, as joint speeds are unbounded at that edge:

    q' = (1 - t) q'_rows + t q'_least,        t the relative residual of the rows in damped least squares

q'_rows meets the rows as far as damped least squares do, q'_least is damped least squares with a large weight of them.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.paths.curve import CURVE_TOLERANCE, Curve
from invariantqp.paths.joint_limits import AT_LIMIT, speed_scale
from invariantqp.paths.task_error import TaskError, task_error
from invariantqp.paths.waypoints import POSE_TOLERANCE

# The damping above, and its share where the path may be left and for the rest of the twist beside exact rows: an arm
# that stretches out goes on smoothly and bends again in time.
LEAST_DAMPING, OFF_PATH_DAMPING, EXACT_DAMPING = 2e-3, 0.05, 0.5
# The weight of the rest of a twist beside exact rows.
SECONDARY_WEIGHT = OFF_PATH_DAMPING
# Where a path may be left, an arm nearer a singularity than this is not corrected: small errors would take large joint
# motion.
SINGULAR_RATIO = 1e-2
# The share of the path over which the distance falls to 1/e on the way back.
REJOIN_SHARE = 0.02
# The share of the path over which a tool with exact demands moves to the least error beside them.
SECONDARY_SHARE = 0.1
# The share of a step ahead at which the slope is probed.
PROBE_SHARE = 1e-3
# Corrections at a knot at most.
MAX_CORRECTIONS = 8
# Tolerance of the distance to the path, its start and its end, relative to the measure's length: ten micrometres for a
# metre.
PATH_TOLERANCE = 1e-5
# Steps of a path at least, and the shortest one as a share of it. The slope's extrapolation over a step is within the
# share of a longest one.
MIN_STEPS, MIN_STEP = 200, CURVE_TOLERANCE
SLOPE_TOLERANCE = 1.0 / MIN_STEPS
# A slope that changes by more than this share at once, this near a singularity, leads to another branch, which no arm
# can take in motion.
KINK_SHARE, BRANCH_RATIO = 0.2, 1e-4
# A step within this share of SLOPE_TOLERANCE is followed by a longer one.
LENGTHEN_BELOW = 0.2
# Knots of a joint motion at most.
MAX_KNOTS = 5000
# An arm that is off the path at its end may take this share of the path's length to return to the end.
RETURN_SHARE = 0.5


class Knot(NamedTuple):
    """Joint positions at a place of the path."""

    at: float  # the path's parameter
    q: Array  # (m,) joint positions
    slope: Array  # (m,) q', per unit of the path's parameter
    off: float  # distance of the tool from the path, in the measure [length]
    ratio: float  # of the smallest and the largest singular value: distance from a singularity


def _ratio(task: TaskError) -> float:
    """The smallest singular value of the measured joint twists over the largest."""
    sigma = np.linalg.svd(task.root.dot(task.state.J), compute_uv=False)
    return float(sigma[-1] / sigma[0]) if sigma[0] > 0.0 else 0.0


class JointPath:
    """The knots from the start on; `extend` finds the next one.

    Attributes:
        knots: those that are found.
        blocked: why the path ends at the last of them, in words; "" where it does not.
    """

    def __init__(
        self,
        controller: Controller,
        curve: Curve,
        q: Array,
        *,
        rate: float | None = None,
        mean: float = 1.0,
        stops: bool = True,
    ) -> None:
        """No knots yet.

        Args:
            controller: whose law it is.
            curve: the path.
            q: (m,) joint positions near its start.
            rate: desired rate of the parameter [1/s]; None is as fast as limits allow.
            mean: the length of the path per unit of the parameter, in the measure.
            stops: whether to end before a part out of reach; otherwise it is passed at the least distance.
        """
        self.controller = controller
        self.curve = curve
        self.blocked = ""
        self.knots: list[Knot] = []
        self._stops = stops
        self._returning = not stops
        self._length = controller.measure.length
        self._reachable = PATH_TOLERANCE * self._length
        self._scale: float = curve.end
        self._longest = self._scale / MIN_STEPS
        self._exact = bool(controller.exact)
        metric = controller.in_engine.law["metric"]
        self._joint_scaling: Array = np.eye(len(q)) if metric is None else np.linalg.inv(np.linalg.cholesky(metric)).T
        self._pace = 0.0 if rate is None else 1.0 / rate  # time per unit of the parameter
        self._mean = mean
        self._step = self._longest
        self._first = q.copy()
        self._speed = speed_scale(controller.box.velocity_limit)

    @property
    def done(self) -> bool:
        """Whether the end is reached, or no more can be."""
        return bool(self.blocked) or (bool(self.knots) and self.knots[-1].at >= self._end)

    @property
    def _end(self) -> float:
        """Where the knots end: with the path, or later if the arm is off it there and returns to its end."""
        last, end = self.knots[-1], self.curve.end
        away = self._returning and last.at >= end and last.off > CURVE_TOLERANCE * self._length
        return end + RETURN_SHARE * self._scale if away else end

    def extend(self) -> None:
        """Try a step to the next knot: it is taken, or halved where the slope changes too much."""
        if not self.knots:
            self.knots.append(self._knot(0.0, self._first, None, self._step))
            if self._stops and self.knots[0].off > self._reachable:
                self.blocked = self._limit_reason(self.knots[0].q)
            return
        last = self.knots[-1]
        before = self.knots[-2] if len(self.knots) > 1 else last._replace(at=last.at - self._step)
        end = self._end
        left = end - last.at
        h = left if left <= self._step else min(self._step, 0.5 * left)
        expected = (last.slope - before.slope) * (h / (last.at - before.at))
        at = last.at + h if h < left else end
        knot = self._knot(at, last.q + h * (last.slope + 0.5 * expected), last, self._step)
        if self._stops and (why := self._block_reason(knot)):
            if h > MIN_STEP * self._scale:
                self._step = 0.5 * h
            else:
                self.blocked = why
            return
        if len(self.knots) == MAX_KNOTS:
            self.blocked = "the joints would have to turn too often"
            return
        changed = float((np.abs(knot.slope - last.slope - expected) / self._speed).max())
        least = self.controller.dt / self._scale  # all of the path at full speed in a tick: the resolution
        share = changed / max(float((np.abs(knot.slope) / self._speed).max()), least)
        # Where the path is left the joint motion itself is followed, and a longer shortest step suffices.
        shortest = POSE_TOLERANCE if min(last.off, knot.off) > self._reachable else MIN_STEP
        if share > SLOPE_TOLERANCE and h > shortest * self._scale:
            self._step = 0.5 * h
            return
        if self._stops and share > KINK_SHARE and knot.ratio < BRANCH_RATIO:
            self.blocked = f"{self._limit_reason(knot.q)}, and beyond it only after a turn in a singularity"
            return
        self.knots.append(knot)
        self._drop_return(end)
        if share < LENGTHEN_BELOW * SLOPE_TOLERANCE:
            self._step = min(2.0 * self._step, self._longest)

    def _drop_return(self, end: float) -> None:
        """At the end, drop the last knots of the return if they brought the arm no nearer."""
        knots, least = self.knots, self.knots[-1].off + self._reachable
        while len(knots) > 1 and knots[-1].at >= end > self.curve.end <= knots[-2].at and knots[-2].off <= least:
            del knots[-1]
            end, self._returning = knots[-1].at, False

    def _block_reason(self, knot: Knot) -> str:
        """Why the path ends before a knot, out of reach or with bodies too near; "" where it goes on."""
        if knot.off > self._reachable:
            return self._limit_reason(knot.q)
        rows = self.controller.joint_rows
        return "" if rows is None else rows.blocked(knot.q)

    def _limit_reason(self, q: Array) -> str:
        """Why the path is blocked where the arm came no closer than q."""
        box, names = self.controller.box, self.controller.robot.names
        at = [
            f"joint {i} ({names[i]}) is at its {side} position limit"
            for side, room in (("lower", q - box.position_lower), ("upper", box.position_upper - q))
            for i in np.flatnonzero(room <= AT_LIMIT).tolist()
        ]
        why = " and ".join(at) or "it is out of reach"
        few = len(names) < self.curve.size and not self.controller.exact
        return f'{why} (exact="position" would turn the tool instead)' if few else why

    # A knot

    def _knot(self, at: float, q: Array, before: Knot | None, step: float) -> Knot:
        """The knot at a place, from q (m,) near it; its slope stays inside the position limits over a step."""
        controller = self.controller
        robot, box = controller.robot, controller.box
        q = np.minimum(np.maximum(q, box.position_lower), box.position_upper)
        q, task, size = self._corrected(
            q,
            self.curve.target(robot, at),
            POSE_TOLERANCE if before is None or before.off <= CURVE_TOLERANCE * self._length else CURVE_TOLERANCE,
        )
        root, part, error = task.root, task.part, task.error
        tangent = self.curve.tangent(at)
        if self._exact or not self._stops:  # back to the path a little at a time
            met = part.dot(error) if self._exact else error
            share = SECONDARY_SHARE if self._stops else REJOIN_SHARE
            tangent = tangent + (met / share + (error - met) / SECONDARY_SHARE) / self._scale
        ahead = self._slope(q, task, tangent, step, None) if before is None else before.slope
        speed = root.dot(self.curve.tangent(at))
        slope = self._slope(q, task, tangent, step, self._posture(q, ahead, sqrt(float(speed.dot(speed)))))
        unmet = root.dot(error)
        if self._stops and not self._exact and sqrt(float(unmet.dot(unmet))) > CURVE_TOLERANCE * self._length:
            slope = self._curved(at, q, slope, self._slope(q, task, error, 1.0, None))
        return Knot(at, q, slope, size, _ratio(task))

    def _corrected(self, q: Array, target: Any, close: float) -> tuple[Array, TaskError, float]:
        """Joint positions with the tool on its target, or near it; the task error there, and its size."""
        box = self.controller.box
        at_limit = (q <= box.position_lower) | (q >= box.position_upper)
        task = task_error(self.controller, q, target)
        size = task.off
        uncorrected = q, task, size
        if not self._stops and (size > close * self._length or _ratio(task) < SINGULAR_RATIO):
            return uncorrected
        for k in range(MAX_CORRECTIONS):
            if size <= arrays.ROUNDING * self._length:
                return q, task, size
            few = self._exact and len(task.rows) < 6
            lower, upper = box.position_lower - q, box.position_upper - q
            if few and k < MAX_CORRECTIONS // 2:
                # A correction turns the tool as little as possible, and moves a joint off its limit only if it must:
                # the slope turns the tool towards the path.
                lower, upper = np.where(at_limit, 0.0, lower), np.where(at_limit, 0.0, upper)
            twist = task.part.dot(task.error) if few else task.error
            q = q + task.joint_velocity(self.controller, q, twist, 1.0, lower=lower, upper=upper)[0]
            task = task_error(self.controller, q, target)
            size = task.off
        return (q, task, size) if self._stops or size <= arrays.ROUNDING * self._length else uncorrected

    def _curved(self, at: float, q: Array, slope: Array, here: Array) -> Array:
        """The slope (m,) that keeps the error least, from the least squares slope (m,) for the tangent.

        It adds the error times the curvature of the tool's motion; `here` (m,) is the correction at the place.
        """
        ahead = PROBE_SHARE * self._longest
        if at + ahead > self.curve.end:
            ahead = -ahead
        target = self.curve.target(self.controller.robot, at + ahead)
        for _ in range(MAX_CORRECTIONS):
            there = q + ahead * slope
            task = task_error(self.controller, there, target)
            change = (self._slope(there, task, task.error, 1.0, None) - here) / ahead
            slope = slope + change
            if float(np.abs(change).max()) <= CURVE_TOLERANCE * float(np.abs(slope).max()):
                break
        return slope

    def _posture(self, q: Array, before: Array, speed: float) -> Array:
        """(m,) posture velocity per unit of the parameter, from the slope of the knot before and the tool's speed."""
        pull = self.controller.in_engine.posture_pull(q)
        if pull is None:
            return before if len(before) <= self.curve.size else np.zeros_like(before)
        if self._pace == 0.0:
            self._pace = float((np.abs(before) / self._speed).max())
        return pull * (self._pace * speed / self._mean)  # while the tool moves

    def _slope(self, q: Array, task: TaskError, twist: Array, h: float, posture: Array | None) -> Array:
        """(m,) the law's slope x for a twist, which keeps q + h x inside the position limits."""
        if not self._exact:
            if self._stops:
                return task.joint_velocity(self.controller, q, twist, h, posture)[0]
            return self._damped(OFF_PATH_DAMPING, q, task, twist, h, posture)[0]
        weighted = task.root.dot(task.part + SECONDARY_WEIGHT * (np.eye(6) - task.part))
        if self._stops:
            return self._damped(EXACT_DAMPING, q, task, twist, h, posture, root=weighted)[0]
        rows, J = task.rows, task.state.J
        only = np.vstack((rows, np.zeros((6 - len(rows), 6))))
        nearest, missed = self._damped(OFF_PATH_DAMPING, q, task, twist, h, exact=False, root=only)
        size = float(np.linalg.norm(rows.dot(twist)))
        t = min(missed / size, 1.0) if size > 0.0 else 0.0
        met = twist + task.part.dot(J.dot(nearest) - twist)
        x, _ = self._damped(EXACT_DAMPING, q, task, met, h, posture, root=weighted)
        least, _ = self._damped(EXACT_DAMPING, q, task, twist, h, posture, exact=False, root=weighted)
        return (1.0 - t) * x + t * least

    def _damped(
        self, share: float, q: Array, task: TaskError, twist: Array, h: float, posture: Array | None = None, **more: Any
    ) -> tuple[Array, float]:
        """(m,) the law's slope damped by a share of its residual, and the size of the residual."""
        size = float(np.linalg.norm(more.get("root", task.root).dot(task.state.J).dot(self._joint_scaling)))
        least = LEAST_DAMPING * size
        _, missed = task.joint_velocity(self.controller, q, twist, h, posture, form=None, damping=least, **more)
        damping = sqrt(least * least + share * self._longest * size * missed)
        return task.joint_velocity(self.controller, q, twist, h, posture, form=None, damping=damping, **more)
