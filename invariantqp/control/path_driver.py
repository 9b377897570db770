"""Driving along a path, whoever says where it goes: setting out, looking ahead, pushes, pauses.

    setting out    to a place on the path, and looking along it: a joint motion along all of it (`path_search`)
    driving        as fast as that allows (`path_drive`)

The path's parameter sigma is measured in every tick: it is the place on the path nearest the tool, so feedback acts
across the path only, and a tool held up goes on from where it is. A tool that is pushed far off comes back to the place
where it was and looks along the path again from there, with the joints as they are then.
"""

from __future__ import annotations

from copy import deepcopy
from math import inf, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.asked import way_to
from invariantqp.control.beside import Beside, look
from invariantqp.control.controller import Controller
from invariantqp.control.given_path import GivenPath
from invariantqp.control.path_compiled import Course, compiled_drive, course_of
from invariantqp.control.path_drive import AWAY, AWAY_STOP, drive
from invariantqp.control.path_orders import TURN, Pausable, override_of
from invariantqp.control.path_pace import Pace
from invariantqp.control.path_plan import PathPlan
from invariantqp.control.path_report import DISBELIEF, reported, stands
from invariantqp.control.path_search import PathSearch
from invariantqp.control.path_solution import PathSolution
from invariantqp.control.path_state import PathState, at_rest
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.damping import PaperLambda
from invariantqp.velocity.reasons import Why
from invariantqp.velocity.solution import Status, VelocitySolution

# Look-ahead steps for each second of ticks, at least one a tick: a step takes a third of a millisecond or so.
STEPS = 1500.0
# The tool is at a place, to look along the path from there or as its end, within this, relative to the measure.
AT_PLACE = 1e-5
# A tool farther off than this, relative, or joints farther from the joint motion along the path [rad, length], have
# been pushed: the motion is looked for again.
PUSHED, DISPLACED = AWAY * AWAY_STOP, 0.2
# A tool on its way to the path whose joints rest for this long [s], its distance falling at less than this share of
# the gain, does not get there.
PATIENCE, STUCK = 1.0, 0.1


class PathDriver(Pausable):
    """Drives the tool of a controller along a path; `step` is one tick.

    Attributes:
        controller: whose law, limits and exact demands hold.
        plan: what the look-ahead found, None before it is found.
    """

    def __init__(
        self,
        controller: Controller,
        *,
        rate: float | None,
        acceleration: float | None,
        jerk: float | None,
        stops: bool,
        tolerance: float | None,
    ) -> None:
        """A driver without a path.

        Args:
            controller: a velocity controller.
            rate: as in `PathFollower`, and so are the others.
            acceleration: along the path.
            jerk: along the path.
            stops: whether to stop before what the arm cannot reach, or to leave the path there.
            tolerance: how near its end the tool is "done".

        Raises:
            BadInput: not a controller, or a number that is not positive.
        """
        if not isinstance(controller, Controller):
            raise BadInput("controller", excerpt(controller), "a Controller")
        if isinstance(controller.law.damping, PaperLambda):
            raise BadInput("controller", "one with PaperLambda", "another damping", "That one keeps no bounds.")
        self.controller = controller
        self.plan: PathPlan | None = None
        self._pace = Pace.of(controller.dt, rate, acceleration, jerk)
        self._overrides = self._pace.overrides(1.0)  # for which the plan is
        self._stops = stops
        self._few = len(controller.robot.names) < 6 and not controller.exact
        self._tolerance = AT_PLACE * controller.measure.length
        if tolerance is not None:
            self._tolerance = arrays.number(tolerance, "tolerance", "a distance", positive=True)
        self._path: GivenPath | None = None
        self._search: PathSearch | None = None
        self._goal: Any = None
        self._trouble = ""
        # On the way to the path: how far off it is, and for how long it gets no nearer [s].
        self._off = 0.0
        self._stood = 0.0
        super().__init__()
        self._kept: Array = at_rest(0.0, np.zeros(len(controller.robot.names))).numbers

    def __setattr__(self, name: str, value: Any) -> None:
        if name in ("controller", "plan", "_path"):  # what a course is made from
            object.__setattr__(self, "_course", None)
        object.__setattr__(self, name, value)

    def __copy__(self) -> PathDriver:
        return deepcopy(self)  # with a state and a loop of its own

    @property
    def _state(self) -> PathState:
        return PathState.of(self._kept)

    @_state.setter
    def _state(self, state: PathState) -> None:
        self._kept[:] = state.numbers

    def step(self, q: ArrayLike, velocity: ArrayLike | None = None, override: float = 1.0) -> PathSolution:
        """One tick: the joint velocity to command until the next.

        Args:
            q: (m,) measured joint positions [rad, length].
            velocity: (m,) joint velocity now, for the acceleration limits; None is the one commanded last.
            override: share of the speed asked for, 0 to 1.5. Above 1 the rate grows where limits allow it; without a
                rate nothing is faster than the limits.

        Raises:
            BadInput: NaN, wrong shapes, an override out of its range; the follower is as it was.
        """
        answer = self._tick(q, velocity, override)
        return self._whole(answer, q) if self._few else answer

    def _whole(self, answer: PathSolution, q: ArrayLike) -> PathSolution:
        """The solution with the tool's whole distance from its path, for an arm of fewer than six joints.

        What its joints cannot do is not asked of it in a tick, and counts all the same.
        """
        path = self._path
        if path is None or not np.isfinite(answer.across):
            return answer
        controller, dt = self.controller, self.controller.dt
        target = path.pose(answer.place - dt * answer.speed)
        sighting = controller.robot.sight(np.asarray(q, dtype=np.float64), controller.robot.target(target))
        off = controller.measure.root_for(sighting.J, sighting.pose).dot(sighting.error)
        across = sqrt(float(off.dot(off)))
        if answer.status is not Status.DONE or across <= self._tolerance:
            return answer._replace(across=across)
        reason = f'it is out of reach, by {across:.3g} (exact="position" would turn the tool instead)'
        return answer._replace(across=across, status=Status.BLOCKED, reasons=reason)

    def _tick(self, q: ArrayLike, velocity: ArrayLike | None, override: float) -> PathSolution:
        """The tick; how far the tool is off counts in what is asked of the arm."""
        course = self._course or self._made_course()
        found = course and compiled_drive(course, q, velocity, override, self._paused, self._wants_back)
        if found is not None:
            answer, more = found
            return self._told(answer, q) if more else answer
        m = len(self.controller.robot.names)
        positions, state = arrays.vector(q, m, "q"), self._state
        before = state.velocity if velocity is None else arrays.vector(velocity, m, "velocity")
        part = override_of(override)
        if self.controller.wrong(positions):
            return self._halted(positions, before)
        if self.plan is not None and self._path is not None:
            if self._search is not None and self._search.done:
                self._drive_by(self._search, part)
            elif self._search is not None:  # the path has grown
                self._look_on(self._search, part)
            state = state._replace(velocity=before)
            tangent = self._path.curve.tangent(state.place) if state.tangent is None else state.tangent
            here = look(self.controller, self._path, self.plan, positions, state.place, tangent)
            if not self._pushed(here, positions):
                return self._drive(self._path, self.plan, state, here, positions, part)
            self._lose(here)
        return self._set_out(positions, before)

    def _made_course(self) -> Course | None:
        """What the core drives along; None where Python has to."""
        search, path, plan = self._search, self._path, self.plan
        if path is not None and plan is not None and (search is None or search.done):
            self._course = course_of(
                self.controller, path, plan, self._pace, self._overrides, self._tolerance, self._kept
            )
        return self._course

    def _told(self, answer: PathSolution, q: ArrayLike) -> PathSolution:
        """The solution of a tick that the core drove, its reason with the words that Python has for limits."""
        inner = self.controller.told(answer.velocity_solution, q)
        return answer._replace(reasons="" if answer.status is Status.DONE else inner.reasons, velocity_solution=inner)

    def _halted(self, q: Array, before: Array) -> PathSolution:
        """What is told of a tick whose joint positions cannot be true; place and time stay."""
        answer, state = self.controller.rest(q, "", before), self._state
        self._state = at_rest(state.place, answer.velocity.copy(), state.ticks, back=state.back)
        at = state.place if self._path is None else self._path.place(state.place)
        lag = None if self._pace.rate is None else state.ticks * self.controller.dt - at / self._pace.rate
        return PathSolution(answer.velocity, Status.HELD, answer.reasons, at, 0.0, DISBELIEF, lag, inf, answer)

    def _set_out(self, q: Array, before: Array) -> PathSolution:
        """On the way to the place where the path is to be driven from, and looking along it there."""
        controller, goal = self.controller, self._goal
        if goal is None:
            return self._waiting(controller.rest(q, "", before), "no pose yet", 0.0)
        way = way_to(controller, q, goal)
        off = way.off
        if self._search is None and off > AT_PLACE * controller.measure.length:
            answer = controller.step(q, goal, velocity=before)
            still = stands(controller, answer.velocity)
            if self._stops or not still:  # a path that may be left may start out of reach
                return self._on_the_way(answer, off, still=still)
        rest = controller.rest(q, "", before, way.sighting)
        if self._path is None:
            return self._waiting(rest, "no second pose yet", off)
        if self._search is None:
            self._search = self._search_from(self._path, q, self._state.place)
        self._look_on(self._search)
        return self._waiting(rest, "looking along the path", off)

    def _drive(
        self, path: GivenPath, plan: PathPlan, state: PathState, here: Beside, q: Array, override: float
    ) -> PathSolution:
        """A tick on the path."""
        back = self._wants_back
        stop = self._stop(back=state.back)
        driven = drive(
            self.controller, path.curve, plan, state, here, q, self._pace, override=override, stop=stop, back=back
        )
        self._state = driven.state
        stop = "" if stop == TURN and driven.state.back == back else stop
        return reported(self.controller, path, plan, driven, self._pace, tolerance=self._tolerance, stop=stop)

    def _pushed(self, here: Beside, q: Array) -> bool:
        """Whether the arm is so far from where it should be that it has to come back first."""
        if here.off > PUSHED * self.controller.measure.length:
            return True
        return not here.left and float(np.abs(here.joints - q).max()) > DISPLACED

    def _lose(self, here: Beside) -> None:
        """Give the joint motion up; the tool sets out again from the place where it was."""
        state = self._state
        self.plan, self._search = None, None
        self._stood = 0.0
        # A tool that was not at the path's start to begin with has not been pushed.
        self._goal, self._trouble = here.target, "pushed off the path, on the way back" if state.ticks else ""
        self._state = at_rest(state.place, state.velocity, state.ticks, back=state.back)

    def _on_the_way(self, answer: VelocitySolution, off: float, *, still: bool) -> PathSolution:
        """What is told of a tick towards the path; "blocked" where the tool has stopped for good before it is there."""
        dt, gain = self.controller.dt, self.controller.gain
        stuck = still and off > (1.0 - STUCK * gain * dt) * self._off
        self._off, self._stood = off, self._stood + dt if stuck else 0.0
        told = self._waiting(answer, self._trouble or "on the way to the path's start", off)
        if self._stood < PATIENCE:
            return told
        why: Why = (f"the arm comes no closer than {off:.3g} to the path", *told.reasons)
        return told._replace(status=Status.BLOCKED, reasons=why)

    def _waiting(self, answer: VelocitySolution, reason: str, off: float) -> PathSolution:
        """What is told on the way to the path."""
        why: Why = (reason, *answer.reasons)
        state = self._state
        ticks = state.ticks + 1 if self._trouble else 0  # time runs from when it first set out
        self._state = state._replace(velocity=answer.velocity.copy(), ticks=ticks)
        at = state.place if self._path is None else self._path.place(state.place)
        lag = None if self._pace.rate is None else max(ticks * self.controller.dt - at / self._pace.rate, 0.0)
        ruling = "a push" if self._trouble else "the start"
        return PathSolution(answer.velocity, Status.WAITING, why, at, 0.0, ruling, lag, off, answer)

    def _search_from(self, path: GivenPath, q: Array, place: float) -> PathSearch:
        return PathSearch(self.controller, path.curve, q, place, rate=self._pace.rate, stops=self._stops)

    def _look_on(self, search: PathSearch, override: float = 1.0) -> None:
        """Look a little farther; once enough is seen, drive by it."""
        for _ in range(max(round(STEPS * self.controller.dt), 1)):
            search.extend()
            if search.ready:
                self._search = search
                self._drive_by(search, override)
                return

    def _drive_by(self, search: PathSearch, override: float) -> None:
        """Drive by what was found; not faster than was asked for, which limits ahead could not undo."""
        plan = search.plan(self._pace.fastest(override), self._pace.smooth)
        if plan is not self.plan:
            self.plan, self._overrides = plan, self._pace.overrides(override)
