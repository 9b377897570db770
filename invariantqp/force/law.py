"""The force law: from what is missing of a force to a speed, for each constraint of a contact by itself.

    M v' + D v = e,     D = k T / G,     M = b T / G,     rate = v + slope,     slope' = e G r / (4 T D)

e is what is missing of the wanted force, T all that is late in the loop (tick, low-pass, delay, and what nobody knows
of it), k and b upper bounds of stiffness and damping (`estimate`), G = 1/4 as for a motion's gain (`DELAY_SHARE`). With
the true k and b its poles on a contact f = k x + b x' are G/T and k/b, both real: it does not swing, whatever the
damper. `slope` is the speed of a surface that comes or goes while the tool slides along it, and is bounded by what a
surface can do: the declared slope times the speed along it; r is how much of k is known to be there. A tool at rest on
a surface at rest has no integral that could lead it away.

    approach    f_d / (k_a T_a + b_a)         so that a touch presses by no more than is wanted; T_a is what is late
                                              and cannot be taken back
    fixed       rate = c (e + integral)       where a compliance c is given

All of it is for unit parts and unit rates (`contact.Split`).
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from invariantqp.control.tracking import DELAY_SHARE
from invariantqp.errors import written
from invariantqp.force.contact import HybridTask, speed_at
from invariantqp.force.contact_kinds import Contact
from invariantqp.force.estimate import DAMPED, STIFF, Setting, Stiffness, Touch
from invariantqp.geometry.arrays import Array
from invariantqp.legacy.loop import LegacyLoop
from invariantqp.velocity.measure import root_at

# The integral's time constant, in those of the law: four is critical damping.
INTEGRAL = 4.0
# Where less than this share of the bound is known to be there the integral is slower, so that a softer contact does not
# swing.
UNSURE = 0.25
# Share by share: the damping ratio of law and integral is then above 1 / sqrt(2).
SURE = 2.0
# What an approach reckons with: as stiff as half of where an estimate begins.
APPROACHED = 0.5
# Where joints have no acceleration limits motion along a contact is taken up within this time [s]: at its speed by
# default 1 m/s^2, as arms are usually moved.
TAKES_UP = 0.1
# What a surface is known to move it may move within this time [s].
MOVES_IN = 0.3
# With a fixed compliance on a declared stiffness k: c k times the time constant of the integral.
OVERDAMPED = 5.0
# Until a press was reached once, an error above this share of it counts as this much in the integral.
INTEGRATED = 0.1

# Changes of a noisy force are reckoned with up to so many standard deviations; the most of the joints' acceleration
# that they may take; a gain lowered for that below this share of itself is told; joints without a limit have this
# multiple of the largest; below this ratio of singular values joints are not asked for a motion.
ABOVE, MOST, LOWERED, FREE, SINGULAR = 1.5, 0.5, 0.5, 10.0, 1e-2


class Drive(NamedTuple):
    """What the law of one constraint remembers: speed and slope, unit rates [length/s]."""

    speed: float = 0.0
    slope: float = 0.0

    @property
    def rate(self) -> float:
        """The unit rate to ask for."""
        return self.speed + self.slope


def mass_and_damper(known: Stiffness, setting: Setting, eased: float) -> tuple[float, float]:
    """M and D of the law: M s^2 + (D + b) s + k has a damping ratio of 1/sqrt(2) at least for any b in its bounds.

    Args:
        known: bounds of k and b.
        setting: of this tick.
        eased: share of the gain that noise and swings leave.
    """
    late, (most, least) = setting.late / (DELAY_SHARE * eased), known.damping
    M = late * most
    return M, max(late * known.bound + known.behind / (DELAY_SHARE * eased), sqrt(2.0 * known.bound * M) - least)


def pressed(
    drive: Drive,
    error: float,
    wanted: float,
    known: Stiffness,
    setting: Setting,
    most: tuple[float, float],
    eased: float,
    *,
    grows: bool,
    beside: Stiffness | None = None,
) -> Drive:
    """The law's speed and slope in a tick.

    Args:
        drive: of the last tick.
        error: e, of a unit part [force].
        wanted: unit part of the press [force]; 0 where it is not one.
        known: of this constraint.
        setting: of this tick.
        most: speed inwards and outwards at most [length/s].
        eased: share of the gain that noise and swings leave.
        grows: whether the slope may change: limits and a touch hold it.
        beside: of the press beside which this is a moment, which is levelled no faster than that presses.
    """
    M, D = mass_and_damper(known, setting, eased)
    if beside is not None:
        M, D = map(max, (M, D), mass_and_damper(beside, setting, eased))
    before, slope = (min(drive.speed, 0.0), min(drive.slope, 0.0)) if known.rose else drive
    per_tick, bound = M / setting.dt, setting.slope_speed
    rises = wanted > 0.0 and not known.reached
    if grows:
        sure = min(max(SURE * known.sure, UNSURE), 1.0) if wanted > 0.0 else 1.0
        counts = INTEGRATED * wanted if rises else inf
        slope += setting.dt * sure * min(max(error, -counts), counts) * known.bound / (INTEGRAL * D * D)
    slope = min(max(slope, -bound), min(bound, most[0]) if rises else bound)
    fastest = most[0] - max(slope, 0.0) if rises else most[0]
    return Drive(min(max((per_tick * before + error) / (per_tick + D), -most[1]), fastest), slope)


def struck(
    drive: Drive, coming: float, error: float, known: Stiffness, setting: Setting, most: float, eased: float
) -> Drive:
    """The law in a touch, outwards alone: what was commanded inwards and a lagging arm has not done is taken back.

    But for what is missing of the press: that way it is wanted, on a contact as stiff as the touch can have shown.

    Args:
        drive: of the last tick.
        coming: unit way that was commanded and does not show yet [length].
        error: e, of a unit part [force].
        known: of this constraint.
        setting: of this tick.
        most: speed outwards at most [length/s].
        eased: share of the gain that noise and swings leave.
    """
    law = pressed(Drive(0.0, drive.slope), error, 0.0, known, setting, (0.0, most), eased, grows=False)
    wanted = max(error, 0.0) / max(known.bound, known.stiff or 0.0)
    return law._replace(speed=max(min(law.speed, (wanted - coming) / setting.dt), -most))


def surface_speed(task: HybridTask, along: float, moves: float) -> float:
    """How fast a surface may come or go: by the slope that the tool slides along at a speed, and by what it moves."""
    return task.slope * along + min(moves / MOVES_IN, task.approach_speed)


def sought(drive: Drive, gentle: float, leaves: float, setting: Setting, touch: Touch, task: HybridTask) -> Drive:
    """The law in the air: as fast as is gentle, and as fast as a surface leaves, as declared or as was just seen.

    That it may leave faster is no reason to run after it: where it did not, the tool would strike it. Where a contact
    is lost for moments only, the surface leaves at the mean speed of the tool: the slope learns it; and the approach
    begins from rest, or a step of its speed, which compliant servos turn into a force, would be the touch.
    """
    if touch.airborne == inf:
        return Drive(gentle)
    bound, slope = max(leaves, drive.slope), 0.0
    part = min(1.0, touch.airborne / task.lost_after) if task.lost_after else 1.0
    rate = min((gentle + bound) * part, task.approach_speed)
    if touch.airborne < task.lost_after:
        grown = drive.slope + setting.dt * UNSURE * DELAY_SHARE / (INTEGRAL * setting.late) * (rate - drive.slope)
        slope = min(max(grown, -setting.slope_speed), bound)
    return Drive(rate - slope, slope)


def fixed(drive: Drive, error: float, gain: float, stiffness: float, dt: float, most: float, *, grows: bool) -> Drive:
    """The same with a given compliance, `gain` c; the `stiffness` k is 0 where none is declared."""
    slope = drive.slope if stiffness > 0.0 else 0.0
    if grows and stiffness > 0.0:
        slope += dt * gain * gain * stiffness / OVERDAMPED * error
    return Drive(min(gain * error, max(most - slope, 0.0)), slope)


def touch_speed(task: HybridTask, press: float, most: float, late: float) -> float:
    """The speed at which a contact is struck that may be as stiff as a table, after what is late [s]; [length/s].

    A softer one that is declared is struck with the press, and a table that may stand there, or behind it, with no more
    than `most`: what is declared makes an approach faster, never slower, and its error costs no overload.

    Args:
        task: declares a stiffness, or does not.
        press: what a contact as declared may press by [force].
        most: what a table may press by [force].
        late: what is late [s].
    """
    table = APPROACHED * STIFF
    speed = max(press, 0.0) / min(task.stiffness or table, table)
    return min(task.approach_speed, min(speed, max(most, 0.0) / table) / (late + DAMPED))


def slid(task: HybridTask, contact: Contact, error: Array, ahead: Array) -> Array:
    """(6,) the motion along S, its part for the target's error no faster than `slide_speed`.

    Args:
        task: says it.
        contact: in the base frame.
        error: (6,) part for the target's error.
        ahead: (6,) part of the feedforward.
    """
    return ahead + min(1.0, task.slide_speed / speed_at(contact, error, task.size)) * error


def taken_up(task: HybridTask, contact: Contact, before: Array, motion: Array, dt: float) -> Array:
    """(6,) the motion along S, from that of the last tick on: what a step of it takes of an arm, the press would feel.

    Args:
        task: says how fast the tool slides.
        contact: in the base frame.
        before: (6,) motion of the last tick, along S.
        motion: (6,) that is wanted.
        dt: tick [s].
    """
    change, size = motion - before, task.size
    fast = max(task.slide_speed, speed_at(contact, before, size), speed_at(contact, motion, size))
    return before + min(1.0, fast * dt / TAKES_UP / speed_at(contact, change, size)) * change


def retreat(task: HybridTask, contact: Contact, left: float, dt: float) -> Array:
    """(6,) the way out, base frame, after `left` [length] of it."""
    speed = min(task.retreat_speed, (task.retreat_distance - left) / dt)
    return np.asarray(speed * contact.adjoint.dot(np.asarray(contact.kind.out)))


def trembling(
    loop: LegacyLoop, J: Array, admittance: Array, place: Array, size: float, noise: float, passed: float
) -> float:
    """The share of the joints' acceleration that noise takes through the force law, for each unit of its gain.

        share = max over joints j of   ABOVE factor sigma |x_j| / (a_j dt)        J x = A (I - P) C (I - P)' for a force

    sigma is that of the change of a smoothed force component from tick to tick. The motion along the contact, a path's
    above all, has what is left: where both ask for more than there is, the force is exact and the tool leaves its path.

    Args:
        loop: whose acceleration limits hold.
        J: (6, m) joint twists.
        admittance: (6, 6) from a wrench in the contact's frame to a twist in the base frame.
        place: (3,) of contact, base frame.
        size: of the contact [length].
        noise: standard deviation of a force component [force].
        passed: share of a step that the low-pass passes on in a tick.
    """
    if loop.braking is None or noise == 0.0 or not (finite := np.isfinite(loop.braking.acceleration)).any():
        return 0.0
    a, root = loop.braking.acceleration, root_at(place, size)
    most = np.where(finite, a, FREE * a[finite].max())
    shares = np.linalg.lstsq(root.dot(J) * most, root.dot(admittance[:, 3:]), rcond=SINGULAR)[0]
    change = noise * passed * sqrt(2.0 / (2.0 - passed))
    return ABOVE * change / loop.dt * sqrt(float((shares * shares).sum(axis=1).max()))


def kept_of(gain: float, share: float) -> float:
    """The share of a gain at which noise takes MOST of the joints' acceleration, at most 1."""
    return MOST / (gain * share) if gain * share > MOST else 1.0


def lowered(kept: float, noise: float) -> str:
    """What is wrong where a gain is lowered to this share of itself for noise [force], in words, "" for nothing."""
    if kept >= LOWERED:
        return ""
    said = f"{written(noise, 2)} N of noise would take the joints' acceleration: {written(kept, 2)} of the force gain"
    return f"{said} is left; give the sensor a lower cutoff="
