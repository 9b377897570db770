"""The joint motion that the law would choose along a path, knot by knot.

    q_i+1 = q_i + h q'_i + h^2 / 2 q''_i,     then corrected until the tool is on the path
    q' = law(J(q), tangent, posture),         inside the position limits

No speed limit counts here: the motion is a function of place, not of time. In the null space joints go towards the
posture as if the arm were at full speed; where damping acts they keep their direction. Knots are as dense as it takes
for the slope q' to turn little between them. The path ends where there is no knot on it, or none that an arm can go on
to in motion.

Where the arm cannot do all of the path, q' is the derivative of the joint positions of least error. Least squares for
the tangent are not: the error times the bend of the tool's motion is missing. Beside exact rows q' turns the tool
towards the least error instead, over some of the path.

Where the path may be left, and beside exact rows, least squares are damped by what they miss:

    |A x - b|^2 + mu |x|^2,     mu = (LEAST_DAMPING |A|)^2 + share (longest step) |A| r

for r = |A x - b| with the first term of mu alone; a form is left out there.

Exact rows that cannot be met are left smoothly, for near that edge they need unbounded joint speeds:

    q' = (1 - t) q'_rows + t q'_least,        t the share of the rows that damped least squares miss

q'_rows meets the rows as far as damped least squares do, q'_least is damped least squares in which they count most.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.paths.curve import Curve
from invariantqp.paths.fit import REACHED
from invariantqp.paths.task_error import TaskError, task_error
from invariantqp.paths.time_law import AT_LIMIT, usual

# The damping above, and its share for the path where it may be left and for the rest of the twist beside exact rows. So
# an arm that stretches out goes on smoothly and bends again in time.
LEAST_DAMPING, LEAVING, STRAYING = 2e-3, 0.05, 0.5
# Where a path may be left, an arm nearer a singularity than this share is not corrected: small errors would take large
# joint motion.
SINGULAR = 1e-2
# The share of the path over which the distance falls to 1/e on the way back.
REJOIN = 0.02
# The weight of the rest of a twist beside exact rows.
REST = 0.05
# The share of the path over which a tool with exact demands turns, or moves, to the least of the error beside them.
TURNING = 0.1
# An error of more than this, relative, stays: the slope is probed so large a share of a step ahead, until it changes by
# no more than this share of itself. Where a path may be left, a regular arm is put on it, if it gets there: from a knot
# on the path on where it has reached it, on the way back where no more than this is left.
UNMET, PROBE = 1e-6, 1e-3
# Corrections at a knot.
CORRECTIONS = 8
# A place that the arm comes no closer to than this, relative, cannot be reached: ten micrometres for a metre. Within as
# much the tool is at the path's start, or its end.
OFF_PATH = 1e-5
# Steps of a path at least, and the shortest one as a share of it (or of another scale).
LEAST_STEPS = 200
SHORTEST = 1e-6
# The share of the slope by which it may differ from its extrapolation after a step.
TURN = 0.005
# A slope that changes by more than KINK of it at once, this near a singularity, is a turn to another branch:
# no arm can take it in motion.
KINK, BRANCH = 0.2, 1e-4
# Where the path is left, the joint motion itself is followed, and a longer shortest step is enough.
SHORTEST_LEFT = 1e-4
# A step after which it differs by less than this share of TURN is followed by a longer one.
EASY = 0.2
# A joint motion that needs more knots has no end.
MOST_KNOTS = 5000
# An arm that is off the path at its end may take this share of the path's length, while it is held there, to come back.
RETURN = 0.5


class Knot(NamedTuple):
    """The arm at a place of the path."""

    at: float  # the path's parameter
    q: Array  # (m,) joint positions
    slope: Array  # (m,) q', per unit of the path's parameter
    off: float  # how far the tool is off the path in what is wanted of it, in the measure
    ratio: float  # smallest singular value of the measured joint twists over the largest: how far from a singularity


def _ratio(seen: TaskError) -> float:
    """The smallest singular value of the measured joint twists over the largest."""
    sigma = np.linalg.svd(seen.root.dot(seen.state.J), compute_uv=False)
    return float(sigma[-1] / sigma[0]) if sigma[0] > 0.0 else 0.0


class JointPath:
    """Knots from the start on; `extend` finds the next one.

    Attributes:
        knots: what is found.
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
        """Nothing is found yet.

        Args:
            controller: whose law chooses.
            curve: the path.
            q: (m,) joint positions near its start.
            rate: of the parameter [1/s] at which the path is meant to be driven; None is as fast as limits allow.
            mean: the length of the path per unit of the parameter, in the measure.
            stops: whether to end before what cannot be reached; otherwise it is passed as near as the law goes.
        """
        self.controller = controller
        self.curve = curve
        self.blocked = ""
        self.knots: list[Knot] = []
        self._stops = stops
        self._returning = not stops
        self._length = controller.measure.length
        self._reachable = OFF_PATH * self._length
        self._scale: float = curve.end
        self._longest = self._scale / LEAST_STEPS
        self._exact = bool(controller.exact)
        metric = controller.in_engine.law["metric"]
        self._to_joint: Array = np.eye(len(q)) if metric is None else np.linalg.inv(np.linalg.cholesky(metric)).T
        self._pace = 0.0 if rate is None else 1.0 / rate  # time per unit of the parameter
        self._mean = mean
        self._step = self._longest
        self._first = q.copy()
        self._speed = usual(controller.box.velocity_limit)

    @property
    def done(self) -> bool:
        """Whether the end is reached, or no more can be."""
        return bool(self.blocked) or (bool(self.knots) and self.knots[-1].at >= self._end)

    @property
    def _end(self) -> float:
        """Where the knots end: with the path, or later where the arm is off it then and comes back to its end."""
        last, end = self.knots[-1], self.curve.end
        away = self._returning and last.at >= end and last.off > UNMET * self._length
        return end + RETURN * self._scale if away else end

    def extend(self) -> None:
        """Try a step to the next knot: it is taken, or halved where the slope has turned too much."""
        if not self.knots:
            self.knots.append(self._knot(0.0, self._first, None, self._step))
            if self._stops and self.knots[0].off > self._reachable:
                self.blocked = self._cause(self.knots[0].q)
            return
        last = self.knots[-1]
        before = self.knots[-2] if len(self.knots) > 1 else last._replace(at=last.at - self._step)
        end = self._end
        left = end - last.at
        h = left if left <= self._step else min(self._step, 0.5 * left)
        expected = (last.slope - before.slope) * (h / (last.at - before.at))
        at = last.at + h if h < left else end
        knot = self._knot(at, last.q + h * (last.slope + 0.5 * expected), last, self._step)
        if self._stops and (why := self._obstacle(knot)):
            if h > SHORTEST * self._scale:
                self._step = 0.5 * h
            else:
                self.blocked = why
            return
        if len(self.knots) == MOST_KNOTS:
            self.blocked = "the joints would have to turn too often"
            return
        turned = float((np.abs(knot.slope - last.slope - expected) / self._speed).max())
        least = self.controller.dt / self._scale  # all of the path at full speed in a tick: no more is told apart
        share = turned / max(float((np.abs(knot.slope) / self._speed).max()), least)
        shortest = SHORTEST_LEFT if min(last.off, knot.off) > self._reachable else SHORTEST
        if share > TURN and h > shortest * self._scale:
            self._step = 0.5 * h
            return
        if self._stops and share > KINK and knot.ratio < BRANCH:
            self.blocked = f"{self._cause(knot.q)}, and beyond it only after a turn in a singularity"
            return
        self.knots.append(knot)
        self._give_up(end)
        if share < EASY * TURN:
            self._step = min(2.0 * self._step, self._longest)

    def _give_up(self, end: float) -> None:
        """Where the knots are at their end, leave out what of the way back brought the arm no nearer."""
        knots, least = self.knots, self.knots[-1].off + self._reachable
        while len(knots) > 1 and knots[-1].at >= end > self.curve.end <= knots[-2].at and knots[-2].off <= least:
            del knots[-1]
            end, self._returning = knots[-1].at, False

    def _obstacle(self, knot: Knot) -> str:
        """Why the path ends before a knot, "" where it goes on: the arm does not get there, or bodies are too near."""
        if knot.off > self._reachable:
            return self._cause(knot.q)
        rows = self.controller.joint_rows
        return "" if rows is None else rows.blocked(knot.q)

    def _cause(self, q: Array) -> str:
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
        """The arm at a place, from q (m,) near it; for `step` the slope has to stay inside the position limits."""
        controller = self.controller
        robot, box = controller.robot, controller.box
        q = np.minimum(np.maximum(q, box.position_lower), box.position_upper)
        q, seen, size = self._corrected(
            q,
            self.curve.target(robot, at),
            REACHED if before is None or before.off <= UNMET * self._length else UNMET,
        )
        root, part, error = seen.root, seen.part, seen.error
        tangent = self.curve.tangent(at)
        if self._exact or not self._stops:  # back to the path a little at a time
            met = part.dot(error) if self._exact else error
            share = TURNING if self._stops else REJOIN
            tangent = tangent + (met / share + (error - met) / TURNING) / self._scale
        ahead = self._answer(q, seen, tangent, step, None) if before is None else before.slope
        speed = root.dot(self.curve.tangent(at))
        slope = self._answer(q, seen, tangent, step, self._posture(q, ahead, sqrt(float(speed.dot(speed)))))
        unmet = root.dot(error)
        if self._stops and not self._exact and sqrt(float(unmet.dot(unmet))) > UNMET * self._length:
            slope = self._bent(at, q, slope, self._answer(q, seen, error, 1.0, None))
        return Knot(at, q, slope, size, _ratio(seen))

    def _corrected(self, q: Array, target: Any, close: float) -> tuple[Array, TaskError, float]:
        """Joint positions with the tool on its target, or near it; the arm there, and how far off it is."""
        box = self.controller.box
        at_limit = (q <= box.position_lower) | (q >= box.position_upper)
        seen = task_error(self.controller, q, target)
        size = seen.off
        given = q, seen, size
        if not self._stops and (size > close * self._length or _ratio(seen) < SINGULAR):
            return given
        for k in range(CORRECTIONS):
            if size <= arrays.ROUNDING * self._length:
                return q, seen, size
            few = self._exact and len(seen.rows) < 6
            lower, upper = box.position_lower - q, box.position_upper - q
            if few and k < CORRECTIONS // 2:
                # A correction turns the tool the least, and takes a joint off its limit only where nothing else does:
                # turning towards the path is up to the slope.
                lower, upper = np.where(at_limit, 0.0, lower), np.where(at_limit, 0.0, upper)
            twist = seen.part.dot(seen.error) if few else seen.error
            q = q + seen.answer(self.controller, q, twist, 1.0, lower=lower, upper=upper)[0]
            seen = task_error(self.controller, q, target)
            size = seen.off
        return (q, seen, size) if self._stops or size <= arrays.ROUNDING * self._length else given

    def _bent(self, at: float, q: Array, slope: Array, here: Array) -> Array:
        """The slope (m,) at which the least error is kept, from the one (m,) that least squares give for the tangent.

        Where part of an error stays, its size times the bend of the tool's motion counts too; `here` (m,) is the
        correction at the place.
        """
        ahead = PROBE * self._longest
        if at + ahead > self.curve.end:
            ahead = -ahead
        target = self.curve.target(self.controller.robot, at + ahead)
        for _ in range(CORRECTIONS):
            there = q + ahead * slope
            seen = task_error(self.controller, there, target)
            change = (self._answer(there, seen, seen.error, 1.0, None) - here) / ahead
            slope = slope + change
            if float(np.abs(change).max()) <= UNMET * float(np.abs(slope).max()):
                break
        return slope

    def _posture(self, q: Array, before: Array, speed: float) -> Array:
        """The posture's velocity per unit of the parameter, from the slope of the knot before and the tool's speed."""
        pull = self.controller.in_engine.posture_pull(q)
        if pull is None:
            return before if len(before) <= self.curve.size else np.zeros_like(before)
        if self._pace == 0.0:
            self._pace = float((np.abs(before) / self._speed).max())
        return pull * (self._pace * speed / self._mean)  # while the tool moves

    def _answer(self, q: Array, seen: TaskError, twist: Array, h: float, posture: Array | None) -> Array:
        """The law's answer (m,) for a twist, such that q + h x is inside the position limits."""
        if not self._exact:
            if self._stops:
                return seen.answer(self.controller, q, twist, h, posture)[0]
            return self._damped(LEAVING, q, seen, twist, h, posture)[0]
        weighted = seen.root.dot(seen.part + REST * (np.eye(6) - seen.part))
        if self._stops:
            return self._damped(STRAYING, q, seen, twist, h, posture, root=weighted)[0]
        rows, J = seen.rows, seen.state.J
        only = np.vstack((rows, np.zeros((6 - len(rows), 6))))
        nearest, missed = self._damped(LEAVING, q, seen, twist, h, exact=False, root=only)
        size = float(np.linalg.norm(rows.dot(twist)))
        t = min(missed / size, 1.0) if size > 0.0 else 0.0
        met = twist + seen.part.dot(J.dot(nearest) - twist)
        x, _ = self._damped(STRAYING, q, seen, met, h, posture, root=weighted)
        least, _ = self._damped(STRAYING, q, seen, twist, h, posture, exact=False, root=weighted)
        return (1.0 - t) * x + t * least

    def _damped(
        self, share: float, q: Array, seen: TaskError, twist: Array, h: float, posture: Array | None = None, **more: Any
    ) -> tuple[Array, float]:
        """The law's answer (m,) damped by a share of what it misses, and the size of what that misses."""
        size = float(np.linalg.norm(more.get("root", seen.root).dot(seen.state.J).dot(self._to_joint)))
        least = LEAST_DAMPING * size
        _, missed = seen.answer(self.controller, q, twist, h, posture, form=None, damping=least, **more)
        damping = sqrt(least * least + share * self._longest * size * missed)
        return seen.answer(self.controller, q, twist, h, posture, form=None, damping=damping, **more)
