"""The force part of a tick's twist.

touching        factor (I - P) C (I - P)' (e + integral)
in the air      along the wanted wrench, so slowly that the touch is gentle, whatever the noise says
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from invariantqp.errors import written
from invariantqp.force.hybrid_task import HybridTask
from invariantqp.force.level import Level
from invariantqp.force.place import speed_at, way_out
from invariantqp.force.regulation import USUAL, Regulation
from invariantqp.force.split import Split
from invariantqp.force.touch import Touch
from invariantqp.force.tremble import kept_of
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.systems.contacts import Contact
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.measure import root_at

# Few joints are told that they cannot follow a contact where more than this share of the motion presses on it, and the
# motion is faster than this share of the approach speed: slower ones are corrections.
PRESSED = 1e-3
SLOW_SHARE = 0.1
# The share of its speed at which an approach goes on while it is not decided whether there is contact, and whether
# readings that have certainly risen rise with the way.
IN_DOUBT = 0.3
RISEN = 0.15
# A path stands where less than this share of such a motion has been done for longer than this [s].
DONE = 0.1
STANDING = 1.0


class Gains(NamedTuple):
    """The force law's gains in a tick.

    Attributes:
        factor: on the compliance.
        rate: of the integral [1/s]; None without one.
        gentle: speed at which contact is looked for [length/s]; None where the force error says it.
        most: largest speed into the contact [length/s], beside what sliding asks for.
        kept: share of the factor that noise leaves.
        noise: share of the joints' acceleration that noise takes.
    """

    factor: float
    rate: float | None
    gentle: float | None
    most: float = inf
    kept: float = 1.0
    noise: float = 0.0


class Push(NamedTuple):
    """The force part: twist (6,) in the base frame, and whether the law acts in full, so that its integral may grow."""

    twist: Array
    free: bool


class Stand(NamedTuple):
    """For how long the motion along the contact has stood still, though it was asked for [s]."""

    long: float = 0.0

    def after(
        self, task: HybridTask, contact: Contact, motion: Array, twist: Array, dt: float, *, joints: int
    ) -> Stand:
        """The same after a tick of dt [s]: a motion (6,) was asked for, and the tool moved with a twist (6,).

        Fewer than six joints may have to leave out a turn: the place of contact alone is looked at.
        """
        root = root_at(contact.point, task.size)[3 if joints < 6 else 0 :]
        asked, moved = root.dot(motion), root.dot(twist)
        least = SLOW_SHARE * task.approach_speed
        stands = asked.dot(asked) > least * least and moved.dot(asked) < DONE * asked.dot(asked)
        return Stand(self.long + dt if stands else 0.0)

    def trouble(self) -> str:
        """What is wrong, in words, "" for nothing."""
        return f"the motion along the contact has stood for {written(self.long, 2)} s" if self.long > STANDING else ""


def gains_of(
    task: HybridTask,
    split: Split,
    regulation: Regulation,
    press: float | None,
    late: tuple[float, float, float],
    trembles: float,
    touch: Touch,
    level: Level,
) -> Gains:
    """The gains for what is known of the stiffness.

    Args:
        task: says them, or lets them follow the stiffness.
        split: of the contact.
        regulation: what is known.
        press: wanted [force]; None where the contact cannot be lost.
        late: sum of tick, delay and low-pass, the delay alone, and the one that was not told beside them [s].
        trembles: share of the joints' acceleration that noise takes for each unit of the factor.
        touch: whether there is contact.
        level: of the readings: where it has risen, it may stay there.
    """
    factor, gentle, most, kept = 1.0, None, inf, 1.0
    if task.adapts and split.compliance > 0.0:
        factor = regulation.factor(split.compliance, task.stiffness, late[0] + late[2])
        kept = kept_of(factor, trembles)
        factor *= kept
        if press is not None:
            gentle = min(task.approach_speed, regulation.approach_speed(press, task.stiffness, *late))
            if split.kind.presses == 1 and not touch.touching:
                clear = 0.0 if regulation.rise.doubtful else touch.clear
                gentle *= RISEN if level.shifted else max(IN_DOUBT, clear)
            most = task.approach_speed
            if not regulation.reached and regulation.known(task.stiffness) is None:
                most = min(most, gentle * max(1.0, USUAL / regulation.supposed))
    k = regulation.known(task.stiffness) if task.adapts else task.stiffness
    answer = regulation.shown(split.compliance, k)
    rate = factor * answer if answer > 0.0 and (press is None or touch.touching) else None
    return Gains(factor, rate, gentle, most, kept, factor * trembles)


def push(
    task: HybridTask,
    contact: Contact,
    split: Split,
    gains: Gains,
    exert: Array,
    error: Array,
    integral: Array,
    motion: Array,
    *,
    slow: bool,
    joints: int,
) -> Push:
    """The force part of the twist.

    Args:
        task: its approach speed and size.
        contact: in the base frame.
        split: of its kind.
        gains: of this tick.
        exert: (6,) W_d in the contact's frame.
        error: (6,) of the wrench, likewise.
        integral: (6,) likewise.
        motion: (6,) the other part of the twist, base frame: a slope may ask for as much speed inwards.
        slow: whether contact is looked for.
        joints: of the arm: too few cannot bring every error to zero, and its integral would only grow.
    """
    A = contact.adjoint
    twist = gains.factor * A.dot(split.admittance.dot(error + integral))
    speed = task.approach_speed
    if slow and gains.gentle is not None and split.kind.presses > 1:
        speed = gains.gentle  # one of them may be felt already: only what is missing
    elif slow and gains.gentle is not None:
        ahead = A.dot(split.admittance.dot(split.projectors.force.dot(exert)))
        return Push(gains.gentle / speed_at(contact, ahead, task.size) * ahead, False)
    inwards = velocity_at(twist, contact.point).dot(way_out(contact)) < 0.0
    most = speed if slow else gains.most + speed_at(contact, motion, task.size) if inwards else inf
    share = min(1.0, most / speed_at(contact, twist, task.size))
    free = not slow and share == 1.0 and can_yield(contact, joints)
    return Push(np.asarray(share * twist), free)


def retreat(task: HybridTask, contact: Contact, left: float, dt: float) -> Array:
    """(6,) the way out, base frame, after `left` [length] of it."""
    speed = min(task.retreat_speed, (task.retreat_distance - left) / dt)
    return np.asarray(speed * contact.adjoint.dot(np.asarray(contact.kind.out)))


def can_yield(contact: Contact, joints: int) -> bool:
    """Whether so many joints can move against every constraint, and still in two ways more if they are under six."""
    return bool(joints >= 6 or len(contact.constraints.T) <= joints - 2)


def force_rows(contact: Contact, J: Array, twist: Array) -> ExactRows | None:
    """W'J x = W'twist where that leaves the arm at least two degrees of freedom, else None."""
    D = contact.constraints.T
    if not (len(D) and can_yield(contact, J.shape[1])):
        return None
    return ExactRows.of(J, D, D.dot(twist), check=False)


def pressed_by(task: HybridTask, split: Split, contact: Contact, tool: Array, J: Array, motion: Array) -> str:
    """What fewer than six joints make of a motion along the contact, in words, "" where they can do it.

    Args:
        task: its grip and size.
        split: of the contact.
        contact: in the base frame.
        tool: (4, 4) pose.
        J: (6, m) joint twists.
        motion: (6,) twist along S.
    """
    if can_yield(contact, J.shape[1]):
        return ""
    root = root_at(tool[:3, :3].dot(task.grip) + tool[:3, 3], task.size)
    asked = root.dot(motion)
    speed = sqrt(asked.dot(asked))
    if speed < SLOW_SHARE * task.approach_speed:
        return ""
    R = root.dot(J)
    off = J.dot(np.linalg.lstsq(R, asked, rcond=None)[0]) - motion
    A, B = contact.adjoint, contact.coadjoint
    rest = root.dot(off - A.dot(split.projectors.motion.dot(B.T.dot(off))))
    share = sqrt(rest.dot(rest)) / speed
    if share < PRESSED:
        return ""
    part = f"{written(100.0 * share, 2)} % of the motion presses"
    return f"{J.shape[1]} joints cannot move the tool along this contact ({contact.name}): {part}"
