"""The motion along a contact, and the way out of it; how much of the joints' acceleration noise may take."""

from __future__ import annotations

from math import sqrt

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.errors import written
from invariantqp.force.contact import HybridTask, speed_at
from invariantqp.force.contact_kinds import Contact
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.measure import root_at

# Where joints have no acceleration limits motion along a contact is taken up within this time [s]: at its speed by
# default 1 m/s^2, as arms are usually moved.
TAKES_UP = 0.1
# Changes of a noisy force are reckoned with up to so many standard deviations; the most of the joints' acceleration
# that they may take; a gain lowered for that below this share of itself is told; joints without a limit have this
# multiple of the largest; below this ratio of singular values joints are not asked for a motion.
ABOVE, MOST, LOWERED, FREE, SINGULAR = 1.5, 0.5, 0.5, 10.0, 1e-2


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
    loop: Controller, J: Array, admittance: Array, place: Array, size: float, noise: float, passed: float
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
    if loop.acceleration_limit is None or noise == 0.0 or not (finite := np.isfinite(loop.acceleration_limit)).any():
        return 0.0
    a, root = loop.acceleration_limit, root_at(place, size)
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
