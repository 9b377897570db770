"""What a tick tells of the contact, raw: not smoothed; and what of it would be an overload."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.force.agreement import Answer
from invariantqp.force.hybrid_task import HybridTask
from invariantqp.force.place import load_at, moved_between, weakest
from invariantqp.force.split import Split
from invariantqp.geometry.arrays import Array
from invariantqp.systems.contacts import Contact

# The overload without another word: a multiple of the wanted force, or this force where none is wanted [N].
OVERLOAD = 2.0
NO_FORCE = 20.0
# Readings of a force stay within so many standard deviations of a component.
ABOVE_NOISE = 8.0


class Felt(NamedTuple):
    """A tick of one contact.

    Attributes:
        reading: (6,) as it came.
        press: felt and wanted [force]; None where the contact cannot be lost.
        force, moment: about the place of contact.
        missing: from the wanted wrench, smoothed, its force or its moment, as a share of an overload.
        most: force and moment that are an overload of what is wanted now.
        noise: standard deviation of a force component [force].
        way: (4,) of the last motion whose effect is felt, along the press and across it (3) [length].
        answer: what the press owes for a way in.
        came: how far the place of contact has come nearer since the last tick, by the joints [length].
    """

    reading: Array
    press: tuple[float, float] | None
    force: float
    moment: float
    missing: float
    most: tuple[float, float]
    noise: float
    way: Array
    answer: Answer
    came: float = 0.0

    @property
    def wanted(self) -> float | None:
        """The press that is wanted [force]; None where the contact cannot be lost."""
        return None if self.press is None else self.press[1]


def felt_of(
    task: HybridTask,
    contact: Contact,
    split: Split,
    readings: tuple[Array, Array],
    wanted: tuple[Array, Array],
    tools: tuple[Array | None, Array],
    ways: tuple[Array, Array],
    *,
    noise: float,
    answer: Answer,
) -> Felt:
    """What a reading tells.

    Args:
        task: what is to be exerted, and what is too much.
        contact: in the base frame.
        split: of it.
        readings: (6,) as it came, and as the wrench that the tool exerts, base frame.
        wanted: (6,) W_d and what is missing of it, base frame.
        tools: (4, 4) the tool's poses in the last tick and now.
        ways: (3,) the way out, and the last motion of the place of contact whose effect is felt [length].
        noise: standard deviation of a force component [force].
        answer: what the press owes for a way in.
    """
    (reading, raw), (exert, missing), (before, tool), (out, way) = readings, wanted, tools, ways
    press = weakest(split.intensities[: contact.kind.presses].dot(contact.adjoint.T), raw, exert)
    force, moment = map(max, split.load, load_at(exert, contact.point))
    most = overload_of(task, force, moment, noise)
    grip = tool[:3, :3].dot(task.grip) + tool[:3, 3]
    along, came = -out.dot(way), -float(out.dot(moved_between(before, tool, contact.point)))
    moved, load = np.array((along, *(way + along * out).tolist())), load_at(raw, contact.point, grip)
    lacks = max(size / most for size, most in zip(load_at(missing, contact.point, grip), most, strict=True))
    return Felt(reading, press, *load, lacks, most, noise, moved, answer, came)


def overload_of(task: HybridTask, force: float, moment: float, noise: float) -> tuple[float, float]:
    """The force and the moment that are an overload, for the size of the wanted ones.

    Args:
        task: says them, or leaves them to what is wanted.
        force: wanted [N].
        moment: wanted, about the place of contact [N length].
        noise: standard deviation of a force component [N]: readings of the wanted force stay below the limit.
    """
    most, turning = task.max_force, task.max_moment
    if most is None:
        most = max(OVERLOAD * force, force + ABOVE_NOISE * noise) if force > 0.0 else NO_FORCE
    if turning is None:
        turning = max(OVERLOAD * moment, moment + task.size * most)
    return most, turning
