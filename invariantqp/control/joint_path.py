"""The joint motion that the law would choose along a path, knot by knot: what the look-ahead looks at.

    q_i+1 = q_i + h q'_i + h^2 / 2 q''_i,     then corrected until the tool is on the path

Knots (`path_knot`) are as dense as it takes for the slope q' to turn little between them. The path ends where there is
no knot on it, or none that an arm can go on to in motion.
"""

from __future__ import annotations

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.control.curve import Poses
from invariantqp.control.path_knot import BACK, Knot, KnotFinder
from invariantqp.geometry.arrays import Array

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
# A slope that takes joints along the whole path for less than this many seconds at full speed counts as that.
STILL = 0.05
# A step after which it differs by less than this share of TURN is followed by a longer one.
EASY = 0.2
# Where the path is left, the joint motion itself is followed, and this share and a longer shortest step are enough.
TURN_LEFT, SHORTEST_LEFT = 0.03, 1e-4
# A joint motion that needs more knots has no end.
MOST_KNOTS = 5000
# An arm that is off the path at its end may take this share of the path's length, while it is held there, to come back.
RETURN = 0.5


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
        self.knots: list[Knot] = []
        self._stops = stops
        self._returning = not stops
        self._length = controller.measure.length
        self._reachable = OFF_PATH * self._length
        self._scale: float = curve.end if scale is None else scale
        self._longest = self._scale / LEAST_STEPS
        self._finder = KnotFinder(controller, self._scale, self._longest, rate=rate, stops=stops)
        self._step = self._longest
        self._first = q.copy()
        self._start = start
        speed = controller.robot.velocity_limit
        self._speed = np.where(np.isfinite(speed), speed, 1.0)

    @property
    def done(self) -> bool:
        """Whether the end is reached, or no more can be."""
        return bool(self.blocked) or (bool(self.knots) and self.knots[-1].at >= self._end)

    @property
    def _end(self) -> float:
        """Where the knots end: with the path, or later where the arm is off it then and comes back to its end."""
        last, end = self.knots[-1], self.curve.end
        away = self._returning and last.at >= end and last.off > BACK * self._length
        return end + RETURN * self._scale if away else end

    def extend(self) -> None:
        """Try a step to the next knot: it is taken, or halved where the slope has turned too much."""
        if not self.knots:
            self.knots.append(self._finder.knot(self.curve, self._start, self._first, None, self._step))
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
        knot = self._finder.knot(self.curve, at, last.q + h * (last.slope + 0.5 * expected), last, self._step)
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
        share = turned / max(float((np.abs(knot.slope) / self._speed).max()), STILL / self._scale)
        turn, shortest = TURN, SHORTEST
        if min(last.off, knot.off) > self._reachable:
            turn, shortest = TURN_LEFT, SHORTEST_LEFT
        if share > turn and h > shortest * self._scale:
            self._step = 0.5 * h
            return
        if self._stops and share > KINK and knot.ratio < BRANCH:
            self.blocked = f"{self._cause(knot.q)}, and beyond it only after a turn in a singularity"
            return
        self.knots.append(knot)
        self._give_up(end)
        if share < EASY * turn:
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
        few = len(names) < 6 and not self.controller.exact
        return f'{why} (exact="position" would turn the tool instead)' if few else why
