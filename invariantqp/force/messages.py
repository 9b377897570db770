"""What the engine found in a press, in words: a reason with numbers, and doubts."""

from __future__ import annotations

from math import degrees, inf
from typing import TYPE_CHECKING, Any

from invariantqp.errors import written
from invariantqp.velocity.solution import Status

if TYPE_CHECKING:
    from invariantqp.force.contact import HybridTask

# Actions, reasons and doubts of core/force.hpp, in its order.
FOLLOW, APPROACH, HOLD, RETREAT = range(4)
NONE, OVERLOAD, DEAD, PULLS, NO_RESPONSE, HELD_BACK, NOT_FOLLOWING, LOST, NO_CONTACT_WAY, NO_CONTACT_TIME = range(10)
SWINGS, NOT_REACHED, NOISY, UNEXPLAINED, UNLOADING, TARING, NOT_TARED = (1 << k for k in range(7))
LOST_REASONS = (NOT_FOLLOWING, LOST, NO_CONTACT_WAY, NO_CONTACT_TIME)

# What a user may have declared wrong of a sensor.
DECLARED = "reads=, order=, mass= or bias="
AT_ONCE = f", out of the air: the sensor's {DECLARED} is wrong, or something is in the way"
NO_ANSWER = (
    "the readings do not answer the motion: a sensor that is stuck, drifts, is not tared or declared wrong "
    f"({DECLARED}), a robot that stands still, or a surface that moves (yields=)"
)
GONE = "which has moved or stepped down by more than yields=, or the sensor reads too little"
STANDS, LEAVES = ": standing still until reset", ": retreating"


def stopped(reason: int, state: Any, wanted: float, at_once: bool) -> str:
    """Why the tool stands still or retreats until reset.

    Args:
        reason: of the engine.
        state: of the press.
        wanted: press [force].
        at_once: whether it was found out of the air.
    """
    a, b, c, d = state.numbers
    force = f"{written(a)} N of {written(b)}" if a > b else ""
    moment = f"{written(c)} N m of {written(d)}" if c > d else ""
    came = f"told to come {written(a, 2)} nearer, the tool came {written(b, 2)}"
    held = f"{written(b, 3)} of {written(c or wanted, 3)} N are"
    answer = f"let go by {written(a, 2)}, {held} still read" if a else f"back where contact was felt, {held} read"
    return {
        OVERLOAD: " and ".join(filter(None, (force, moment))) + (AT_ONCE if at_once else ""),
        DEAD: f"the reading has not changed for {written(a)} s: a dead sensor (one without noise: noise=0)",
        PULLS: f"the reading says that the contact pulls with {written(a)} N: the sensor's {DECLARED} is wrong",
        NO_RESPONSE: f"{answer}: {NO_ANSWER}",
        HELD_BACK: f"{came}, and nothing is felt: something holds it, or the sensor is stuck",
        NOT_FOLLOWING: f"{came}: the robot does not follow commands",
        LOST: f"no contact for {written(a)} s",
        NO_CONTACT_WAY: f"no contact within {written(a)} of approach",
        NO_CONTACT_TIME: f"no contact within {written(a)} s of approach",
    }[reason]


def status_of(reason: int) -> Status:
    """The status that goes with a reason."""
    if reason in LOST_REASONS:
        return Status.LOST
    return Status.OVERLOAD if reason == OVERLOAD else Status.FAULT


def lost(state: Any, task: HybridTask, action: int) -> str:
    """What is said while there is no contact."""
    airborne = state.airborne
    if airborne == inf:
        return "no contact yet: approaching"
    what = {APPROACH: ": approaching", HOLD: ": standing still"}.get(action, "")
    if action == HOLD and task.on_loss == "approach":
        what += f" where it was felt last, {GONE}"
    return f"no contact for {written(airborne)} s{what if task.on_loss != 'continue' else ''}"


def doubts_of(doubts: int, state: Any, declared_noise: float, drift: float, late: float, *, presses: bool) -> list[str]:
    """What is in doubt of a press, in words.

    Args:
        doubts: flags.
        state: of the press.
        declared_noise: of a force component [force].
        drift: of the sensor, as declared [force/s].
        late: everything late [s].
        presses: whether contact can be lost.
    """
    said, s = [], state
    if doubts & NOISY:
        said.append(f"readings have {written(s.noise, 2)} N of noise, {written(declared_noise, 2)} are told (noise=)")
    if doubts & SWINGS:
        said.append(
            f"the press swings about {written(s.wanted, 3)} N with {written(1e3 * late, 2)} ms late in all; the force "
            f"gain is lowered to {written(s.eased, 2)}"
        )
    if doubts & NOT_REACHED:
        long, mean = f"for {written(s.missed, 2)} s", s.mean
        if presses:
            said.append(f"the force is not reached: {written(mean, 3)} of {written(s.wanted, 3)} N {long}")
        else:
            said.append(f"force or moment is not reached: {written(100.0 * mean, 2)} % of an overload off {long}")
    if doubts & UNLOADING:
        said.append("the readings do not say what the way does: unloading to see whether they fall")
    elif doubts & UNEXPLAINED:
        said.append(f"the force does not answer the motion: it may be off by {written(s.unexplained, 2)} N")
    if doubts & TARING:
        said.append("the sensor reads a press from the start: unloading to tell a contact from a bias")
    if doubts & NOT_TARED:
        off = drift * s.age
        said.append(f"not tared for {written(s.age, 2)} s: the press may be off by {written(off, 2)} N (drift=)")
    return said


def late(later: float, gain: float, asked: float) -> str:
    """Of commands that act so much later than declared [s], for which the motion's gain is lowered [1/s]."""
    return (
        f"commands act {written(1e3 * later, 3)} ms later than declared: give delay=, the motion's gain is "
        f"{written(gain, 3)} instead of {written(asked, 3)} 1/s"
    )


def lowered(gain_scale: float, noise: float) -> str:
    """Of a force gain that is lowered to a share of itself for noise [force]."""
    return (
        f"{written(noise, 2)} N of noise would take the joints' acceleration: {written(gain_scale, 2)} of the force "
        "gain is left; give the sensor a lower cutoff="
    )


def unreachable(share: float, joints: int, contact: str) -> str:
    """Of a share of the motion along a contact that so few joints turn into a press."""
    part = f"{written(100.0 * share, 2)} % of the motion presses"
    return f"{joints} joints cannot move the tool along this contact ({contact}): {part}"


def normal_bound(bound: float) -> str:
    """Of an estimated normal that the bound [rad] holds back."""
    return f"the normal is {written(degrees(bound), 3)} deg off the declared one, the most that normal_within allows"
