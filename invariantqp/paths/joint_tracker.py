"""The joints of a follower: where the motion has them, their limits, and a tick in which they track it."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.engine import law
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.paths.joint_limits import AT_REST, JointLimits, speed_scale
from invariantqp.paths.reference import MIN_SPLICE_TICKS, PUSHED_JOINT, Reference
from invariantqp.paths.solution import Reason
from invariantqp.velocity.reasons import decoded, row_name
from invariantqp.velocity.solution import Status, VelocitySolution

# A splice takes the first [s], one to a hand or of joints that catch up the second: a hand is caught up with 0.06 s
# later with 0.3, and what takes longer overshoots.
SPLICE, SAMPLE_SPLICE = 0.3, 0.1
# The acceleration of a joint without an acceleration limit reverses its motion in a tick, at this speed where there is
# no speed limit [rad/s, length/s].
UNLIMITED_SPEED = 1e3


class RepeatedTick(NamedTuple):
    """What the engine tracks while no input comes and nothing is due."""

    reference: Reference
    tracked: Any  # as the engine takes it
    until: float  # by the follower's time [s]
    inputs: Any  # that decide on it
    plain_until: float  # up to this place of a path the engine's fields are the whole report


class JointTracker:
    """The state of the joints between ticks, and the engine's tick.

    Attributes:
        controller: whose arm it is.
        limits: of the joints.
        bounds: the same with the speeds that override and approach leave.
        state: of the joints, in the engine.
        reference: the tracked motion; None where it begins anew in the next tick.
        twist: (6,) tracked in place of the reference, or None.
        time: when the next tick begins [s].
        error: the largest joint tracking error in the last tick [rad, length].
        is_limited: whether rows or the tool's speed limited the last command.
        fault: reasons, as bytes, where joints do not do what they are commanded to; else None.
    """

    def __init__(self, controller: Controller, limits: JointLimits) -> None:
        """At rest."""
        self.controller, self.limits, self.bounds = controller, limits, limits
        self.state = law.FollowerState(len(limits.lower), controller.delay, controller.dt)
        self.reference: Reference | None = None
        self.twist: Array | None = None
        self.time, self.error, self.is_limited = 0.0, 0.0, False
        self._answer: VelocitySolution | None = None  # of the velocity law, or of the limits of a command
        self.fault: bytes | None = None
        self._engine = self._new_engine()

    def _new_engine(self) -> Any:
        return self.controller.in_engine.follower(float((self.limits.acceleration / self.limits.jerk).max()))

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_engine"}

    def __setstate__(self, fields: dict[str, Any]) -> None:
        vars(self).update(fields)
        self._engine = self._new_engine()

    @property
    def is_at_rest(self) -> bool:
        """Whether the commanded motion rests."""
        return bool((np.abs(self.state.velocity) <= AT_REST * speed_scale(self.limits.velocity)).all())

    @property
    def through_ticks(self) -> Array:
        """(3, m) position, velocity and acceleration of the motion through the ends of the last three ticks."""
        state = self.state
        return np.vstack(
            (state.position, state.velocity + 0.5 * self.limits.dt * state.acceleration, state.acceleration)
        )

    def motion(self, reference: Reference) -> Array:
        """(3, m) position, velocity and acceleration now: those of the reference where the joints are on it."""
        on_reference = not self.state.late and self.twist is None
        return reference.at(self.time)[:3] if on_reference else self.through_ticks

    @property
    def splice_time(self) -> float:
        """How long a splice takes that late joints look for [s], 0 where they look for none."""
        looks = self.state.late and self.twist is None
        return max(SAMPLE_SPLICE, MIN_SPLICE_TICKS * self.limits.dt) if looks else 0.0

    def observe(self, q: ArrayLike, velocity: ArrayLike | None) -> tuple[Array, Array, str]:
        """(m,) joint positions and velocity when a tick begins, and why positions are implausible, "" if they are not.

        Positions of continuous joints are by whole turns near those of the last tick; unresponsive joints are at rest.
        """
        state, m = self.state, len(self.limits.lower)
        q = arrays.vector(q, m, "q")
        before = state.command if velocity is None else arrays.vector(velocity, m, "velocity").copy()
        wrong = self.controller.limits.implausible(q)
        measured = self._engine.observe(state, q, velocity is not None)
        self.fault = self._engine.fault(state)
        before[list(state.unresponsive)] = 0.0
        return measured, before, str(wrong) if wrong else ""

    def is_pushed(self, measured: Array) -> bool:
        """Whether a joint is so far from where it was sent that it has been pushed."""
        self.error = float(np.abs(self.state.sent - measured).max())
        return self.error > PUSHED_JOINT

    def restart(self, measured: Array) -> Reference:
        """A new reference at measured positions (m,), at the commanded velocity."""
        state, limits = self.state, self.limits
        state.position = np.clip(measured, limits.lower, limits.upper)
        state.command = state.velocity = np.clip(state.command, -limits.velocity, limits.velocity)
        state.acceleration = state.change
        state.begin(measured)
        self.error = 0.0
        self.reference = Reference(limits, state.position, self.time)
        return self.reference

    def stop(self) -> Array:
        """(m,) the command that brakes the joints as fast as they may, wherever they are."""
        limit, before = self.controller.acceleration_limit, self.state.command
        step = np.full(len(before), np.inf) if limit is None else self.limits.dt * limit
        v: Array = np.sign(before) * np.maximum(np.abs(before) - step, 0.0)
        self.set_command(v)
        self.state.velocity = v
        return v

    def set_command(self, command: Array) -> None:
        """Another loop gave the command (m,) of this tick."""
        self.state.command, self.state.change = command, np.zeros(len(command))
        self.state.commanded(command)

    def tick(
        self, tracked: Any, goal: tuple[Any, ...], measured: Array, *, has_waited: bool = False
    ) -> tuple[Any, ...]:
        """The fields of a tick in the engine; without a command where a path has to wait and has not."""
        functions = self.controller.in_engine.begin_callbacks(measured)
        fields: tuple[Any, ...] = self._engine.drive(self.state, tracked, goal, measured, functions, has_waited)
        return fields

    def repeat(self, tick: RepeatedTick, goal: tuple[Any, ...], q: ArrayLike) -> tuple[tuple[Any, ...], Array] | None:
        """The fields of a tick, and (m,) measured positions; None, and nothing has changed, where Python decides."""
        in_engine = self.controller.in_engine
        functions = in_engine.begin_callbacks(q)
        try:
            found = self._engine.step(self.state, tick.tracked, goal, q, functions)
        except (ValueError, TypeError) as refusal:
            if in_engine.raised(refusal):
                raise
            return None  # q is no joint positions
        if found is None:
            return None
        fields, measured, self.error, self.fault = found
        self.finish(fields, tick.reference, goal[4])
        return fields, measured

    def finish(self, fields: tuple[Any, ...], reference: Reference, splice: float) -> None:
        """Keep what a tick returned beside its command."""
        residual, self.is_limited, answer = fields[3], fields[4], fields[6]
        self._answer = None if answer is None else self.controller.in_engine.solution(answer)
        if residual is not None:
            reference.set_splice(self.time, residual, splice)
        elif splice and self.time < reference.splice_end:
            reference.set_splice(self.time, np.zeros((6, len(self.limits.lower))), 0.0)

    def fault_status(self) -> tuple[Status, Reason] | None:
        """The status of joints that do not do what they are commanded to, None where all do."""
        if self.fault is None:
            return None
        names, reason = self.controller.robot.names, decoded(self.fault)[0]
        return Status.DEGRADED, str(reason._replace(names=tuple(names[j] for j in reason.joints)))

    def loop_status(self, is_motion: bool, is_twist: bool) -> tuple[Status, Reason] | None:
        """The status of the loop's velocity in the last tick, None where it adds nothing.

        A motion that rows or the tool's speed hold back is late, and has no status here.
        """
        answer = self._answer
        if answer is None:
            return None
        if answer.status in (Status.DEGRADED, Status.HELD):
            return answer.status, partial(getattr, answer, "reason")
        if is_motion:
            return None
        if row := self.limiting_row:
            return Status.LIMITED, row
        if not is_twist or answer.status is Status.OK:
            return None
        status = Status.SCALED if answer.status is Status.SCALED else Status.LIMITED
        return status, partial(getattr, answer, "reason")

    @property
    def limiting_row(self) -> Reason | None:
        """What limited the last command beside the joints' limits, None where nothing did."""
        return partial(_limiting_row, self._answer) if self.is_limited and self._answer is not None else None


def limits_of(controller: Controller, jerk: ArrayLike | None, rise: float) -> JointLimits:
    """The joint limits of a loop; without a jerk limit the acceleration rises to its own in a time [s].

    Raises:
        BadInput: no jerk limits.
    """
    box, m = controller.box, len(controller.robot.names)
    acceleration = 2.0 * np.minimum(box.velocity_limit, UNLIMITED_SPEED) / controller.dt
    if controller.acceleration_limit is not None:
        acceleration = np.minimum(controller.acceleration_limit, acceleration)
    limit = acceleration / rise
    if jerk is not None:
        given = arrays.array(jerk, "jerk", "numbers above zero")
        limit = np.full(m, float(given)) if given.ndim == 0 else given.copy()
        if limit.shape != (m,) or not (limit > 0.0).all():
            raise BadInput("jerk", excerpt(jerk), f"{m} limits above zero [rad/s^3, length/s^3], or one for all")
    return JointLimits(box.position_lower, box.position_upper, box.velocity_limit, acceleration, limit, controller.dt)


def _limiting_row(answer: VelocitySolution) -> str:
    """The row, or the tool's speed, that limits a command."""
    multipliers, name = answer.row_multipliers, "the tool's speed"
    if multipliers is not None and multipliers.any():
        name = row_name(int(np.abs(multipliers).argmax()), tuple(answer.row_names))
    return f"limited by {name}"
