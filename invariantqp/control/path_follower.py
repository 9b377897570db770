"""A tool that stays on its path: where limits bind it is late, not off.

    s = P'(sigma) v + gain e_across,     v <= what the joints can do here and can still brake from before what comes

The path's parameter sigma is measured in every tick: it is the place on the path nearest the tool, so feedback acts
across the path only, and a tool held up goes on from where it is. Look-ahead is a joint motion along the whole path,
found before the tool sets out (`joint_path`), and the speeds from which the rest can be driven (`path_speed`).
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, sqrt
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.asked import asked
from invariantqp.control.beside import look
from invariantqp.control.controller import Controller
from invariantqp.control.given_path import GivenPath, given_path
from invariantqp.control.joint_path import OFF_PATH, JointPath
from invariantqp.control.path_plan import PathPlan, plan_of
from invariantqp.control.path_rate import rate_inside
from invariantqp.control.path_solution import PathSolution
from invariantqp.control.time_law import Ramp
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.damping import PaperLambda
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.solution import VelocitySolution

# Largest speed override.
FASTEST = 1.5
# The tool is at the path's start within this, relative to the measure's length.
AT_START = 1e-5
# A tool this far off, relative, slows down, and at AWAY_STOP times that waits until feedback has brought it back.
AWAY, AWAY_STOP = 5e-3, 4.0
# The end is reached within this share of the path, by joints slower than this share of their limits; what blocks the
# path is reached within a larger one: at the edge of its reach an arm moves much for little.
ARRIVED, STOPPED, AT_REST = 1e-6, 2e-5, 1e-3
# A tick that drives less than this share of the path is at rest: a drive may turn.
STANDING = 1e-7
# Gain [1/s] towards the joint motion that was looked at, where the path leaves joints free.
JOINT_GAIN = 5.0
# Below this ratio of singular values the tool follows that motion also where the path leaves nothing free; above the
# second one it follows the path's own tangent, and so do joints that are farther than STRAYED [rad, length] from it.
SINGULAR, REGULAR = 1e-2, 3e-2
STRAYED = 1e-2
# Where limits would take the tool this far off its path in a tick, relative to the measure's length, the tick is solved
# again with the twist as exact rows, which slow down instead.
MISSED = 1e-6
# With a jerk but no acceleration, the path accelerates at this share of what the slowest joint could.
EASY_SHARE = 0.7


class PathFollower:
    """Drives the tool of a controller along a path; `step` is one tick.

    Attributes:
        controller: whose law, limits and exact demands hold.
        plan: what the look-ahead found, None before it is found.
    """

    def __init__(
        self,
        controller: Controller,
        path: Callable[[float], ArrayLike] | ArrayLike,
        *,
        end: float = 1.0,
        times: ArrayLike | None = None,
        rate: float | None = None,
        acceleration: float | None = None,
        jerk: float | None = None,
        blocked: Literal["stop", "leave"] = "stop",
    ) -> None:
        """Fit the path; the joint motion along it is found by `prepare`, or in the first ticks.

        Args:
            controller: a velocity controller.
            path: the tool's pose (4, 4) as a function of a parameter in [0, end], or (n, 4, 4) poses on the way.
            end: of a function's parameter.
            times: (n,) the parameter of poses; None is their number, from 0.
            rate: how fast the parameter is meant to go [1/s], 1 where it is time; None is as fast as limits allow.
            acceleration: of the speed along the path; its unit is that of the parameter over s^2, or with rate=None
                [length/s^2]; None is as much as the joints allow.
            jerk: likewise, over s^3; None is no limit of jerk.
            blocked: where the arm cannot reach the path: "stop" before it, or "leave" it by the least and rejoin it.

        Raises:
            BadInput: not a path, fewer than two poses, times that do not increase, a path that stands still.
        """
        if not isinstance(controller, Controller):
            raise BadInput("controller", excerpt(controller), "a Controller")
        if isinstance(controller.law.damping, PaperLambda):
            raise BadInput("controller", "one with PaperLambda", "another damping", "That one keeps no bounds.")
        self.controller = controller
        self.plan: PathPlan | None = None
        self._rate = None if rate is None else arrays.number(rate, "rate", "a rate in 1/s", positive=True)
        self._stops = arrays.choice(blocked, "blocked", ("stop", "leave")) == "stop"
        self._acceleration = inf
        if acceleration is not None:
            self._acceleration = arrays.number(acceleration, "acceleration", "an acceleration", positive=True)
        self._jerk = None if jerk is None else arrays.number(jerk, "jerk", "a jerk", positive=True)
        timed = self._rate is not None
        self._path: GivenPath = given_path(controller.robot, controller.measure, path, end, times, timed=timed)
        self._curve = self._path.curve
        self._limit: Array | None = None
        if controller.braking is not None:
            self._limit = controller.braking.acceleration
        speed = controller.robot.velocity_limit
        self._fastest: Array = np.where(np.isfinite(speed), speed, 1.0)
        self._search: JointPath | None = None
        self._paused = False
        self._wants_back = False
        m = len(controller.robot.names)
        self._state = _Drive(0.0, 0.0, 0.0, False, np.zeros(m), np.zeros(m), None, 0, 0.0)

    def pose(self, place: float) -> Array:
        """(4, 4) the path's pose at a place, as solutions tell it.

        Raises:
            BadInput: not a number.
        """
        return self._path.pose(arrays.number(place, "place", "the path's parameter"))

    def pause(self) -> None:
        """Come to rest on the path, and stay."""
        self._paused = True

    def resume(self) -> None:
        """Go on after a pause."""
        self._paused = False

    def reverse(self) -> None:
        """Come to rest and drive the path in the other direction."""
        self._wants_back = not self._wants_back

    def prepare(self, q: ArrayLike) -> None:
        """Find the joint motion along the path now, from joint positions near its start.

        It takes about a tenth of a second. Without it the first ticks find it, a little in each, while the arm waits.

        Args:
            q: (m,) joint positions [rad, length].

        Raises:
            BadInput: NaN or a wrong shape.
        """
        positions = arrays.vector(q, len(self.controller.robot.names), "q")
        search = self._new_search(positions, 0.0)
        while not search.done:
            search.extend()
        self._adopt(search)

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
        m = len(self.controller.robot.names)
        positions = arrays.vector(q, m, "q")
        before = self._state.velocity if velocity is None else arrays.vector(velocity, m, "velocity")
        part = arrays.not_negative(override, "override", "a share of the speed, 0 to 1.5")
        if part > FASTEST:
            raise BadInput("override", f"{part:g}", f"a share of the speed, 0 to {FASTEST:g}")
        if self.plan is None:
            return self._set_out(positions, before)
        return self._drive(self.plan, positions, before, part)

    def _set_out(self, q: Array, before: Array) -> PathSolution:
        """On the way to the path's start, and planning there."""
        controller = self.controller
        robot = controller.robot
        target = robot.target(self._curve.pose(0.0))
        sighting = robot.sight(q, target)
        off = _norm(asked(controller, sighting, controller.measure.root(robot, sighting, target)).dot(sighting.error))
        if self._search is None and off > AT_START * controller.measure.length:
            answer = controller.step(q, target, velocity=before)
            return self._waiting(answer, "on the way to the path's start", off)
        if self._search is None:
            self._search = self._new_search(q, 0.0)
        self._search.extend()
        if self._search.done:
            self._adopt(self._search)
        return self._waiting(controller.rest(q, "", before, sighting), "looking along the path", off)

    def _drive(self, plan: PathPlan, q: Array, before: Array, override: float) -> PathSolution:
        """A tick on the path."""
        controller, state, dt = self.controller, self._state, self.controller.dt
        here = look(controller, self._curve, plan, q, state.place, state.rate)
        place = min(max(state.place - here.shift, 0.0), plan.end)
        away = max(here.off / (AWAY * controller.measure.length), 1.0)
        share = max(0.0, (AWAY_STOP - away) / (AWAY_STOP - 1.0))
        speed, ruling = self._speed(plan, place, share, override)
        sign = -1.0 if state.back else 1.0
        joints, _ = plan.joints(place)
        _, slope = plan.joints(place + 0.5 * dt * sign * speed)
        rate = sign * speed
        if self._limit is not None:
            step = dt * self._limit
            rate = rate_inside(slope, rate, plan.speed(place, dt, back=state.back), state.along, step)
        rate = min(max(rate, (0.0 - place) / dt), (plan.end - place) / dt)
        # The joint twists in the middle of the tick, extrapolated.
        J = here.sighting.J if state.J is None else 1.5 * here.sighting.J - 0.5 * state.J
        sighting = here.sighting._replace(J=J)
        posture = rate * slope + JOINT_GAIN * (joints - q)
        # Near a singularity the twist of the joint motion that was looked at: no other asks as little of the joints.
        i = plan.piece(place)
        regular = (min(plan.ratio[i], plan.ratio[i + 1]) - SINGULAR) / (REGULAR - SINGULAR)
        own = min(max(regular, float(np.abs(joints - q).max()) / STRAYED, 0.0), 1.0)
        twist = rate * ((1.0 - own) * J.dot(slope) + own * here.tangent) + controller.gain * here.across
        answer = controller.follow(q, twist, before, None, sighting, None, posture)
        kept = answer.scale if controller.exact else 1.0
        if not controller.exact and self._limit is None and answer.active and rate != 0.0:
            missed = _norm(here.asked.dot(answer.residual))
            if missed * dt > MISSED * controller.measure.length:
                rows = ExactRows.of(J, here.asked, here.asked.dot(twist))
                slower = controller.follow(q, twist, before, rows, sighting, None, posture)
                if slower.status in ("ok", "scaled"):
                    answer, kept = slower, slower.scale
        rate *= kept
        back = state.back
        v = abs(rate)
        acceleration = (v - state.speed) / dt
        if v * dt <= STANDING * plan.end and self._wants_back != back:
            back = self._wants_back
            v = acceleration = 0.0
        ticks = state.ticks + 1
        self._state = _Drive(
            place + dt * rate, v, acceleration, back, rate * slope, answer.velocity, here.sighting.J, ticks, rate
        )
        return self._told(plan, answer, place, rate, ruling, here.off)

    def _speed(self, plan: PathPlan, place: float, share: float, override: float) -> tuple[float, str]:
        """The speed along the path that is asked for in this tick, and what rules it."""
        state, dt = self._state, self.controller.dt
        part = min(1.0, override) if self._rate is None else 1.0
        possible = plan.speed(place, dt, part, back=state.back)
        wanted, ruling = possible, plan.ruling[plan.nearest(place)]
        if self._rate is not None and self._rate * override <= wanted:
            wanted, ruling = self._rate * override, "the rate asked for"
        elif part < 1.0:
            ruling = "the override"
        if share < 1.0:
            wanted, ruling = share * wanted, "the tool is off its path"
        if self._paused or self._wants_back != state.back:
            wanted, ruling = 0.0, "a pause" if self._paused else "the turn"
        if self._jerk is None:
            most = state.speed + self._acceleration * dt
            least = max(state.speed - self._acceleration * dt, 0.0) if wanted < possible else 0.0
            speed = max(min(wanted, most), min(least, possible))
            return speed, ruling
        ramp = Ramp(min(self._acceleration, EASY_SHARE * plan.braking), self._jerk)
        sign = -1.0 if state.back else 1.0
        a = ramp.next(
            state.speed,
            state.acceleration,
            wanted,
            lambda ahead: part * plan.speeds(place + sign * ahead, back=state.back),
            dt,
        )
        return min(max(state.speed + a * dt, 0.0), possible), ruling

    def _told(
        self, plan: PathPlan, answer: VelocitySolution, place: float, rate: float, ruling: str, off: float
    ) -> PathSolution:
        """The solution, with what is to be told of it."""
        state = self._state
        at = self._path.place(state.place)
        was = self._path.place(place)
        elapsed = state.ticks * self.controller.dt
        lag = None if self._rate is None else elapsed - at / self._rate
        i = plan.nearest(place)
        left = plan.off[i] > OFF_PATH * self.controller.measure.length
        still = bool((np.abs(answer.velocity) <= AT_REST * self._fastest).all())
        near = (STOPPED if plan.blocked else ARRIVED) * self._curve.end
        arrived = still and plan.end - state.place <= near and not self._wants_back
        status, reason = "moving", answer.reason
        if arrived:
            status = "blocked" if plan.blocked else "done"
            reason = f"the path cannot be had from {at:.6g} on: {plan.blocked}" if plan.blocked else ""
            ruling = "the path's end" if not plan.blocked else ruling
        elif left:
            status, reason = "left", f"the arm is {plan.off[i]:.3g} off the path, which it cannot reach here"
        elif self._paused and abs(rate) * self.controller.dt <= STANDING * self._curve.end:
            status = "paused"
        elif ruling != "the rate asked for":
            status = "slowed"
        speed = (at - was) / self.controller.dt
        return PathSolution(answer.velocity, status, reason, at, speed, ruling, lag, off, answer)

    def _waiting(self, answer: VelocitySolution, reason: str, off: float) -> PathSolution:
        why = "; ".join(filter(None, (reason, answer.reason)))
        lag = None if self._rate is None else 0.0
        self._state = self._state._replace(velocity=answer.velocity)
        return PathSolution(answer.velocity, "waiting", why, 0.0, 0.0, "the start", lag, off, answer)

    def _new_search(self, q: Array, start: float) -> JointPath:
        return JointPath(self.controller, self._curve, q, start, rate=self._rate, stops=self._stops)

    def _adopt(self, search: JointPath) -> None:
        """Take the joint motion that was found for the plan."""
        fastest = inf if self._rate is None else FASTEST * self._rate
        self.plan, self._search = plan_of(search, fastest), None


class _Drive(NamedTuple):
    """The state between ticks."""

    place: float  # where the tool will be, by the curve's own parameter
    speed: float  # along the path, not negative
    acceleration: float
    back: bool  # whether the path is driven backward
    along: Array  # (m,) the joint velocity along the path in the tick before
    velocity: Array  # (m,) and all of it
    J: Array | None  # (6, m) joint twists in the tick before
    ticks: int
    rate: float  # the speed with its sign


def _norm(v: Array) -> float:
    return sqrt(float(v.dot(v)))
