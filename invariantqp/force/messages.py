"""Messages of the force law and its monitor: faults with their numbers, and warnings."""

from __future__ import annotations

from math import degrees, inf
from typing import TYPE_CHECKING, Any, NamedTuple

from invariantqp.errors import in_percent, in_thousandths, written
from invariantqp.velocity.solution import Status

if TYPE_CHECKING:
    from invariantqp.control.controller import Controller
    from invariantqp.force.contact_kinds import Contact
    from invariantqp.force.sensor import WrenchSensor

# Actions, faults and warnings of core/force.hpp, in its order.
FOLLOW, APPROACH, HOLD, RETREAT = range(4)
NONE, OVERLOAD, STALE_SENSOR, TENSION, NO_RESPONSE, BLOCKED = range(6)
NOT_FOLLOWING, LOST, NO_CONTACT_DISTANCE, NO_CONTACT_TIME = range(6, 10)
OSCILLATES, NOT_REACHED, NOISY, UNRESPONSIVE, UNLOADING, TARING, TARE_IS_OLD = (1 << k for k in range(7))

DECLARED = "reads=, order=, mass= or bias="
NO_RESPONSE_CAUSES = (
    "the readings do not respond to the motion: a sensor that is stuck, drifts, is not tared or declared wrong "
    f"({DECLARED}), a robot that stands still, or a surface that moves (yields=)"
)


class Report(NamedTuple):
    """The report of the engine about a tick; by default without a fault and a warning."""

    action: int = FOLLOW
    fault: int = NONE
    is_lost: bool = False
    warnings: int = 0  # flags
    delay: float = 0.0  # of the whole loop [s]
    desired: float = 0.0  # first unit part of the desired wrench [force]
    gain_scale: float = 1.0  # of the force gain, below 1 for noise
    unreachable: float = 0.0  # share of the motion along the contact that presses
    motion_gain: float = 0.0  # [1/s]


def fault_message(report: Report, state: Any) -> str:
    """Why the tool stands still or retreats until reset, in the `HybridState` of a controller."""
    a, b, c, d = state.law.numbers
    force = f"{written(a)} N of {written(b)}" if a > b else ""
    moment = f"{written(c)} N m of {written(d)}" if c > d else ""
    air = f" in the air: the sensor's {DECLARED} is wrong, or something is in the way" if state.fault_in_air else ""
    approach = f"commanded {written(a, 2)} towards the contact, the tool moved {written(b, 2)}"
    reading = f"{written(b, 3)} of {written(c or report.desired, 3)} N are"
    response = f"unloaded by {written(a, 2)}, {reading} still read" if a else f"at the last contact {reading} read"
    message = {
        OVERLOAD: " and ".join(filter(None, (force, moment))) + air,
        STALE_SENSOR: f"the reading has not changed for {written(a)} s: a dead sensor (one without noise: noise=0)",
        TENSION: f"the reading says that the contact pulls with {written(a)} N: the sensor's {DECLARED} is wrong",
        NO_RESPONSE: f"{response}: {NO_RESPONSE_CAUSES}",
        BLOCKED: f"{approach} without contact: something blocks it, or the sensor is stuck",
        NOT_FOLLOWING: f"{approach}: the robot does not follow commands",
        LOST: f"no contact for {written(a)} s",
        NO_CONTACT_DISTANCE: f"no contact within {written(a)} of approach",
        NO_CONTACT_TIME: f"no contact within {written(a)} s of approach",
    }[report.fault]
    return message + (": retreating" if report.action == RETREAT else ": standing still until reset")


def status_of(fault: int) -> Status:
    """The status of a fault."""
    if fault >= NOT_FOLLOWING:
        return Status.LOST
    return Status.OVERLOAD if fault == OVERLOAD else Status.FAULT


def lost_message(report: Report, airborne: float, on_loss: str) -> str:
    """The message of a lost contact, in the air for a time [s]."""
    if airborne == inf:
        return "no contact yet: approaching"
    what = {APPROACH: ": approaching", HOLD: ": standing still"}.get(report.action, "")
    if report.action == HOLD and on_loss == "approach":
        what += (
            " at the last contact: the surface has moved or stepped down by more than yields=, or the sensor reads "
            "too little"
        )
    return f"no contact for {written(airborne)} s{what if on_loss != 'continue' else ''}"


def warnings_of(
    report: Report, whole: Any, loop: Controller, sensor: WrenchSensor | None, contact: Contact
) -> list[str]:
    """The messages of the warnings of a tick, from the whole `HybridState` of a controller."""
    return [
        *_press_warnings(report, whole.law, sensor, contact),
        *_motion_warnings(report, whole, loop, sensor, contact),
    ]


def _press_warnings(report: Report, state: Any, sensor: WrenchSensor | None, contact: Contact) -> list[str]:
    """Messages of the flags: the readings and how the force responds."""
    flags, found = report.warnings, list[str]()
    if not flags:
        return found
    noise, drift = (0.0, 0.0) if sensor is None else (sensor.noise, sensor.drift)
    off = f"for {written(state.time_off, 2)} s"
    if flags & NOISY:
        found.append(f"readings have {written(state.noise, 2)} N of noise, {written(noise, 2)} are declared (noise=)")
    if flags & OSCILLATES:
        found.append(
            f"the press oscillates about {written(state.desired, 3)} N with a delay of "
            f"{in_thousandths(report.delay, 2)} ms in all; the force gain is lowered to {written(state.gain_scale, 2)}"
        )
    if flags & NOT_REACHED:
        found.append(
            f"the force is not reached: {written(state.mean, 3)} of {written(state.desired, 3)} N {off}"
            if contact.kind.presses
            else f"force or moment is not reached: {in_percent(state.mean, 2)} % of an overload off {off}"
        )
    if flags & UNLOADING:
        found.append("the readings contradict the displacement: unloading to see whether they fall")
    if flags & UNRESPONSIVE and not flags & UNLOADING:
        found.append(
            f"the force does not respond to the motion: it may be off by {written(state.unexplained_force, 2)} N"
        )
    if flags & TARING:
        found.append("the sensor reads a press from the start: unloading to tell a contact from a bias")
    if flags & TARE_IS_OLD:
        found.append(
            f"not tared for {written(state.tare_age, 2)} s: the press may be off by "
            f"{written(drift * state.tare_age, 2)} N (drift=)"
        )
    return found


def _motion_warnings(
    report: Report, whole: Any, loop: Controller, sensor: WrenchSensor | None, contact: Contact
) -> list[str]:
    """Messages of what limits gains and motion."""
    found, noise = list[str](), 0.0 if sensor is None else sensor.noise
    if 0.0 < report.motion_gain < loop.gain:
        found.append(
            f"commands act {in_thousandths(whole.law.lag - loop.delay, 3)} ms later than declared: give delay=, the "
            f"motion's gain is {written(report.motion_gain, 3)} instead of {written(loop.gain, 3)} 1/s"
        )
    if report.gain_scale < 1.0:
        found.append(
            f"{written(max(noise, whole.law.noise), 2)} N of noise would take the joints' acceleration: "
            f"{written(report.gain_scale, 2)} of the force gain is left; give the sensor a lower cutoff="
        )
    if report.unreachable > 0.0:
        found.append(
            f"{len(loop.robot.names)} joints cannot move the tool along this contact ({contact.name}): "
            f"{in_percent(report.unreachable, 2)} % of the motion presses"
        )
    if whole.normal_bound > 0.0:
        found.append(
            f"the normal is {written(degrees(whole.normal_bound), 3)} deg off the declared one, the most that "
            "normal_within allows"
        )
    return found
