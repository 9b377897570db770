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
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.given_path import GivenPath, given_path
from invariantqp.control.path_drive import JOINT_GAIN, STANDING, STRAYED, possible_rate, share_near
from invariantqp.control.path_driver import DISPLACED, PUSHED
from invariantqp.control.path_orders import TURN, Reversible, override_of
from invariantqp.control.path_pace import ON_TIME, OVERRIDDEN, Pace
from invariantqp.control.path_plan import PathPlan
from invariantqp.control.path_report import ARRIVED, DISBELIEF, ENDED, SETTLING, STOPPED, on_the_path, stands
from invariantqp.control.path_search import PathSearch
from invariantqp.control.path_state import PathState, at_rest
from invariantqp.errors import BadInput, excerpt
from invariantqp.force.hybrid import HybridController
from invariantqp.force.kept_split import contact_now
from invariantqp.force.path_beside import look_along
from invariantqp.force.path_solution import HybridPathSolution
from invariantqp.force.path_stall import Stall
from invariantqp.force.reading import Wrench
from invariantqp.force.solution import HybridSolution
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.systems.contacts import Contact
from invariantqp.velocity.solution import Status

# The tool touches from this share of the wanted press on.
TOUCH = 0.5
# How near the end a tool is that is there, along S, relative to the measure's length.
AT_END = 1e-4
NO_TOUCH = "no contact"
NO_CONTACT = (Status.LOST, Status.OVERLOAD, Status.FAULT)


class HybridFollower(Reversible):
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
        super().__init__()
        self.hybrid = hybrid
        self.plan: PathPlan | None = None
        loop = hybrid.loop
        self._pace = Pace.of(loop.dt, rate, acceleration, jerk)
        self._path: GivenPath = given_path(loop.robot, loop.measure, path, end, times, timed=rate is not None)
        self._search: PathSearch | None = None
        self._touching = False
        self._stall = Stall()
        self._state: PathState = at_rest(0.0, np.zeros(len(loop.robot.names)))

    def prepare(self, q: ArrayLike) -> None:
        """Find the joint motion along the path now, as `PathFollower.prepare`.

        Args:
            q: (m,) joint positions near the path's start [rad, length].

        Raises:
            BadInput: NaN, a wrong shape, or positions that cannot be true.
        """
        positions = self.hybrid.loop.believed(q)
        while self.plan is None:
            self._look_on(positions)

    def step(
        self,
        q: ArrayLike,
        wrench: Any,
        velocity: ArrayLike | None = None,
        contact: Contact | None = None,
        wanted: ArrayLike | Wrench | None = None,
        override: float = 1.0,
    ) -> HybridPathSolution:
        """One tick: the joint velocity to command until the next.

        Args:
            q: (m,) measured joint positions [rad, length].
            wrench: as in `HybridController.step`, and so are the others.
            velocity: (m,) joint velocity now; None is the one commanded last.
            contact: the contact now; None takes the task's.
            wanted: what to exert in this tick; None takes the task's.
            override: share of the speed asked for, 0 to 1.5, as in `PathFollower.step`; the force does not change.

        Returns:
            HybridPathSolution: "waiting" until the tool touches, where contact is lost, and on the way back
                from a push.

        Raises:
            BadInput: NaN, wrong shapes, an override out of its range; the follower is as it was.
        """
        hybrid, curve = self.hybrid, self._path.curve
        loop, robot = hybrid.loop, hybrid.robot
        positions, part = arrays.vector(q, len(robot.names), "q"), override_of(override)
        if self.plan is not None and self._search is not None:
            self.plan = self._search.plan(self._pace.fastest(part), self._pace.smooth)
        state, plan = self._state, self.plan
        if loop.wrong(positions):
            answer = hybrid.step(positions, curve.pose(state.place), wrench, None, None, velocity, wanted)
            self._state = at_rest(state.place, answer.velocity, state.ticks, back=state.back)
            return self._told(answer, answer.status, answer.reason, 0.0, DISBELIEF, inf)
        before = state.velocity if velocity is None else velocity
        tool = robot.pose(positions)
        here = contact_now(hybrid.task, tool, contact)
        beside = look_along(hybrid, self._path, plan, positions, tool, here, state.place)
        far = beside.off > PUSHED * loop.measure.length or beside.strayed > DISPLACED
        again = far and state.place > 0.0
        if plan is None or again:
            answer = hybrid.step(positions, curve.pose(state.place), wrench, None, here, before, wanted)
            if again:
                self.plan, self._search = None, None
            return self._waiting(answer, positions, beside.off)
        place, off, strayed, astray = beside
        stop = self._stop(back=state.back) if self._touching else NO_TOUCH
        if stop and state.speed == 0.0:  # it stands there, pushed along or not
            place = state.place
        # Before what blocks the path, at the edge of its reach, a pressed tool never has the plan's joints: they rest.
        there = bool(plan.blocked) and not state.back and plan.end - place <= STOPPED * curve.end
        part = 0.0 if there else part
        near = share_near(off / loop.measure.length, strayed / STRAYED)
        speed, possible, ruling = self._pace.speed(
            plan, state, place, near=near, override=part, stop=stop, room=hybrid.room
        )
        rate = possible_rate(loop, plan, state, place, -speed if state.back else speed, possible, hybrid.room)
        middle = min(max(place + 0.5 * loop.dt * rate, plan.start), plan.end)
        slope = plan.slope(middle)
        posture = rate * slope + (0.0 if there else JOINT_GAIN) * astray
        ahead = rate * curve.tangent(middle)
        answer = hybrid.step(positions, curve.pose(place), wrench, ahead, here, before, wanted, posture)
        self._touching = self._touches(answer)
        self._state = state.after(
            place,
            rate,
            loop.dt,
            STANDING * plan.end,
            back=self._wants_back,
            along=rate * slope,
            velocity=answer.velocity,
        )
        if stop == TURN and self._state.back != state.back:
            stop = ""
        self._stall = self._stall.after(
            place, rate, loop.dt, curve.end, waits=bool(stop) or part == 0.0, asked=ruling in (ON_TIME, OVERRIDDEN)
        )
        return self._told_along(answer, plan, rate, ruling, off, stop=stop)

    def _waiting(self, answer: HybridSolution, q: Array, off: float) -> HybridPathSolution:
        """What is told of a tick without a plan: on the way back to the path, or looking along it."""
        state, pushed = self._state, self._state.place > 0.0
        self._touching = self._touches(answer)
        reason = "pushed off the path, on the way back"
        if self._search is not None or not pushed or off <= AT_END * self.hybrid.loop.measure.length:
            reason = "looking along the path"
            self._look_on(q)
        self._state = at_rest(state.place, answer.velocity, state.ticks + 1 if pushed else 0, back=state.back)
        return self._told(answer, Status.WAITING, reason, 0.0, "a push" if pushed else "the start", off)

    def _told_along(
        self, answer: HybridSolution, plan: PathPlan, rate: float, ruling: str, off: float, *, stop: str
    ) -> HybridPathSolution:
        """What is told of a tick along the path."""
        loop, after, end = self.hybrid.loop, self._state, self._path.curve.end
        if stop == NO_TOUCH:
            return self._told(answer, Status.WAITING, answer.reason or NO_TOUCH, rate, ruling, off)
        near = (STOPPED if plan.blocked else ARRIVED) * end
        still = not stop and stands(loop, answer.velocity)
        if still and plan.end - after.place <= near and off <= AT_END * loop.measure.length:
            if plan.blocked:
                return self._told(answer, Status.BLOCKED, plan.blocked, rate, SETTLING, off)
            return self._told(answer, Status.DONE, "", rate, ENDED, off)
        if self._stall.lasts:
            at = f"the tool comes no farther than {self._path.place(after.place - loop.dt * rate):.4g}"
            why = "; ".join(filter(None, (at, plan.blocked, answer.reason)))
            return self._told(answer, Status.BLOCKED, why, rate, ruling, off)
        standing = abs(rate) * loop.dt <= STANDING * end
        status, ruling = on_the_path(plan, after, ruling, near, stop=stop, stands=standing, still=still)
        return self._told(answer, status, answer.reason, rate, ruling, off)

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
            self.plan = self._search.plan(self._pace.fastest(1.0), self._pace.smooth)

    def _told(
        self, answer: HybridSolution, status: Status, reason: str, speed: float, ruling: str, off: float
    ) -> HybridPathSolution:
        state, rate = self._state, self._pace.rate
        at = self._path.place(state.place)
        lag = None if rate is None else state.ticks * self.hybrid.loop.dt - at / rate
        inner = answer.velocity_solution
        return HybridPathSolution(answer.velocity, status, reason, at, speed, ruling, lag, off, inner, answer)
