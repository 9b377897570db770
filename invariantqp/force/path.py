"""A path in contact: motion along S waits for limits, force does not.

    s = P (P'(sigma) v + gain e_across) + force part,     v <= what the joints can do here and brake from in time

The path's parameter sigma is the place on it nearest the tool, seen along S alone: how deep the tool is pressed counts
for nothing. How fast is planned as for a `PathFollower`; the force part is the `HybridController`'s, and goes on
whatever the path does. Until the tool touches, and while it has lost contact, the path waits. A tool that is pushed
far off along S, or joints that are where the path leaves them free, come back under the force, and the path is looked
along again with the joints as they are then.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.asked import way_to
from invariantqp.control.beside import nearest
from invariantqp.control.given_path import GivenPath, given_path
from invariantqp.control.path_drive import AWAY, AWAY_STOP, JOINT_GAIN, STRAYED, possible_rate
from invariantqp.control.path_driver import DISPLACED, PUSHED
from invariantqp.control.path_pace import Pace
from invariantqp.control.path_plan import PathPlan
from invariantqp.control.path_report import ARRIVED, SETTLING, stands
from invariantqp.control.path_search import PathSearch
from invariantqp.control.path_state import PathState, at_rest
from invariantqp.errors import BadInput, excerpt
from invariantqp.force.hybrid import HybridController
from invariantqp.force.kept_split import contact_now
from invariantqp.force.path_solution import HybridPathSolution
from invariantqp.force.reading import Wrench
from invariantqp.force.solution import HybridSolution
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.systems.contacts import Contact

# The tool touches from this share of the wanted press on.
TOUCH = 0.5
# How near the end a tool is that is there, along S, relative to the measure's length.
AT_END = 1e-4
NO_CONTACT = ("lost", "overload", "fault")
# A singular value below this share of the largest moves no tool: joints are free to move along it.
STILL = 1e-3


class _Beside(NamedTuple):
    """Where the tool is beside its path.

    Attributes:
        place: nearest it along S.
        off: how far it is from there, along S.
        strayed: how far a joint is off the plan by motion that leaves the tool where it is [rad, length], 0 where that
            is less than STRAYED.
        astray: (m,) the way back of the joints to the plan, there.
    """

    place: float
    off: float
    strayed: float
    astray: Array


class HybridFollower:
    """Drives a tool in contact along a path; `step` is one tick.

    Attributes:
        hybrid: whose forces, law and limits hold.
        plan: what the look-ahead found, None before it is found.
    """

    def __init__(
        self,
        hybrid: HybridController,
        path: Callable[[float], ArrayLike] | ArrayLike,
        *,
        end: float = 1.0,
        times: ArrayLike | None = None,
        rate: float | None = None,
        acceleration: float | None = None,
        jerk: float | None = None,
    ) -> None:
        """Fit the path; the joint motion along it is found by `prepare`, or in the first ticks.

        Args:
            hybrid: a hybrid controller.
            path: as in `PathFollower`, on the surface that the tool touches; and so are the others.
            end: of a function's parameter.
            times: (n,) the parameter of poses.
            rate: how fast the parameter is meant to go [1/s].
            acceleration: of the speed along the path.
            jerk: likewise.

        Raises:
            BadInput: not a hybrid controller, or what `PathFollower` refuses.
        """
        if not isinstance(hybrid, HybridController):
            raise BadInput("hybrid", excerpt(hybrid), "a HybridController")
        self.hybrid = hybrid
        self.plan: PathPlan | None = None
        loop = hybrid.loop
        most = inf
        if acceleration is not None:
            most = arrays.number(acceleration, "acceleration", "an acceleration", positive=True)
        smooth = None if jerk is None else arrays.number(jerk, "jerk", "a jerk", positive=True)
        fast = None if rate is None else arrays.number(rate, "rate", "a rate in 1/s", positive=True)
        self._pace = Pace(loop.dt, fast, most, smooth)
        self._path: GivenPath = given_path(loop.robot, loop.measure, path, end, times, timed=rate is not None)
        self._search: PathSearch | None = None
        self._touching = False
        self._state: PathState = at_rest(0.0, np.zeros(len(loop.robot.names)))

    def prepare(self, q: ArrayLike) -> None:
        """Find the joint motion along the path now, as `PathFollower.prepare`.

        Args:
            q: (m,) joint positions near the path's start [rad, length].

        Raises:
            BadInput: NaN or a wrong shape.
        """
        positions = arrays.vector(q, len(self.hybrid.robot.names), "q")
        while self.plan is None:
            self._look_on(positions)

    def step(
        self,
        q: ArrayLike,
        wrench: Any,
        velocity: ArrayLike | None = None,
        contact: Contact | None = None,
        wanted: ArrayLike | Wrench | None = None,
    ) -> HybridPathSolution:
        """One tick: the joint velocity to command until the next.

        Args:
            q: (m,) measured joint positions [rad, length].
            wrench: as in `HybridController.step`, and so are the others.
            velocity: (m,) joint velocity now; None is the one commanded last.
            contact: the contact now; None takes the task's.
            wanted: what to exert in this tick; None takes the task's.

        Returns:
            HybridPathSolution: "waiting" until the tool touches, where contact is lost, and on the way back
                from a push.

        Raises:
            BadInput: NaN or wrong shapes; the follower is as it was.
        """
        hybrid, curve = self.hybrid, self._path.curve
        loop, robot = hybrid.loop, hybrid.robot
        positions = arrays.vector(q, len(robot.names), "q")
        before = self._state.velocity if velocity is None else velocity
        tool = robot.pose(positions)
        here = contact_now(hybrid.task, tool, contact)
        beside = self._beside(positions, tool, here)
        far = beside.off > PUSHED * loop.measure.length or beside.strayed > DISPLACED
        again = far and self._state.place > 0.0
        plan = self.plan
        if plan is None or again:
            answer = hybrid.step(positions, curve.pose(self._state.place), wrench, None, here, before, wanted)
            if again:
                self.plan, self._search = None, None
            return self._waiting(answer, positions, beside.off)
        place, off, strayed, astray = beside
        rate, slope, ruling = self._pace_at(plan, place, off, strayed)
        middle = min(place + 0.5 * loop.dt * rate, plan.end)
        posture = rate * slope + JOINT_GAIN * astray
        ahead = rate * curve.tangent(middle)
        answer = hybrid.step(positions, curve.pose(place), wrench, ahead, here, before, wanted, posture)
        waits, state = not self._touching, self._state
        self._touching = self._touches(answer)
        self._state = state._replace(
            place=place + loop.dt * rate,
            speed=rate,
            acceleration=(rate - state.speed) / loop.dt,
            along=rate * slope,
            velocity=answer.velocity,
            ticks=state.ticks + 1,
        )
        if not waits and self._at_end(plan):
            ruling = SETTLING
        status, reason = "moving" if ruling in ("the rate asked for", SETTLING) else "slowed", answer.reason
        if waits:
            status, reason = "waiting", answer.reason or "no contact"
        elif self._arrived(plan, off):
            status, reason = "done", ""
            if plan.blocked:
                status, reason = "blocked", plan.blocked
        return self._told(answer, status, reason, rate, ruling, off)

    def _waiting(self, answer: HybridSolution, q: Array, off: float) -> HybridPathSolution:
        """What is told of a tick without a plan: on the way back to the path, or looking along it."""
        state, pushed = self._state, self._state.place > 0.0
        self._touching = self._touches(answer)
        reason = "pushed off the path, on the way back"
        if self._search is not None or not pushed or off <= AT_END * self.hybrid.loop.measure.length:
            reason = "looking along the path"
            self._look_on(q)
        self._state = at_rest(state.place, answer.velocity, state.ticks + 1 if pushed else 0)
        return self._told(answer, "waiting", reason, 0.0, "a push" if pushed else "the start", off)

    def _pace_at(self, plan: PathPlan, place: float, off: float, strayed: float) -> tuple[float, Array, str]:
        """The rate of this tick, the slope of the joint motion along it, and what rules it."""
        loop, state = self.hybrid.loop, self._state
        away = max(off / (AWAY * loop.measure.length), 1.0)
        near = min(max(0.0, (AWAY_STOP - away) / (AWAY_STOP - 1.0)), 1.0 / max(strayed / STRAYED, 1.0))
        stop = "" if self._touching else "no contact"
        speed, possible, ruling = self._pace.speed(plan, state, place, near=near, override=1.0, stop=stop)
        rate = possible_rate(loop, plan, state, place, speed, possible)
        return rate, plan.slope(place + 0.5 * loop.dt * rate), ruling

    def _at_end(self, plan: PathPlan) -> bool:
        """Whether all of the path has been driven."""
        return plan.end - self._state.place <= ARRIVED * self._path.curve.end

    def _arrived(self, plan: PathPlan, off: float) -> bool:
        """Whether the tool rests at the end of the path."""
        loop, state = self.hybrid.loop, self._state
        there = self._at_end(plan) and off <= AT_END * loop.measure.length
        return there and stands(loop, state.velocity)

    def _beside(self, q: Array, tool: Array, contact: Contact) -> _Beside:
        """Where the tool is; without a plan, beside the place where it is expected."""
        loop, curve, expected = self.hybrid.loop, self._path.curve, self._state.place
        target = loop.robot.target(curve.pose(expected))
        way = way_to(loop, q, target)
        P = self.hybrid.splits.at(contact, tool).projectors.motion
        A, B = se3.adjoint(contact.pose, check=False), se3.coadjoint(contact.pose, check=False)
        R = way.rows.dot(A).dot(P).dot(B.T)
        plan = self.plan
        if plan is None:
            return _Beside(expected, float(np.linalg.norm(R.dot(way.error))), 0.0, np.zeros(len(q)))
        ahead, error = R.dot(curve.tangent(expected)), R.dot(way.error)
        place, rest = nearest(self._path, plan, expected, ahead, error)
        astray, off = plan.joints(place) - q, sqrt(float(rest.dot(rest)))
        if float(astray.dot(astray)) <= STRAYED * STRAYED:  # nor is any part of it more
            return _Beside(place, off, 0.0, astray)
        _, sigma, Vt = np.linalg.svd(way.root.dot(way.sighting.J), full_matrices=False)
        moving = Vt[sigma > STILL * sigma[0]]
        free = astray - moving.T.dot(moving.dot(astray))
        return _Beside(place, off, float(np.abs(free).max()), astray)

    def _touches(self, answer: HybridSolution) -> bool:
        """Whether the tool is in contact."""
        if answer.status in NO_CONTACT:
            return False
        if self._touching:
            return True
        n = answer.contact.kind.presses
        wanted = np.linalg.lstsq(answer.contact.constraints, answer.wanted, rcond=None)[0]
        return bool((answer.intensities[:n] >= TOUCH * wanted[:n]).all())

    def _look_on(self, q: Array) -> None:
        if self._search is None:
            curve = self._path.curve
            place = self._state.place
            self._search = PathSearch(self.hybrid.loop, curve, q, place, rate=self._pace.rate, stops=True)
        self._search.extend()
        if self._search.done:
            self.plan = self._search.plan(inf if self._pace.rate is None else self._pace.rate, self._pace.smooth)

    def _told(
        self, answer: HybridSolution, status: str, reason: str, speed: float, ruling: str, off: float
    ) -> HybridPathSolution:
        state, rate = self._state, self._pace.rate
        at = self._path.place(state.place)
        lag = None if rate is None else state.ticks * self.hybrid.loop.dt - at / rate
        inner = answer.velocity_solution
        return HybridPathSolution(answer.velocity, status, reason, at, speed, ruling, lag, off, inner, answer)
