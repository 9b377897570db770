"""Whether the readings have jumped and stay there while the tool moves on: a sensor that is stuck.

    step     press = a + s [from a reading on]        what a sensor that got stuck, or whose bias jumped, reads
    contact  press = a + k max(0, way - w)            what a surface answers from a place w on, however stiff it is;
                                                      way as commanded and felt now, or by the joints, or time

Both are fitted to the last readings. One is stuck where the step explains them so much better that noise seldom does.
No reading tells a sensor that got stuck in a touch from one whose bias jumped in the air: both are faults.

Reference: Basseville & Nikiforov 1993, Sect. 2.4 (likelihood ratio for unknown time and size of a change).
"""

from __future__ import annotations

from math import log, sqrt
from statistics import fmean
from typing import NamedTuple

import numpy as np

from invariantqp.errors import written
from invariantqp.force.place import TINY
from invariantqp.force.touch import CERTAIN
from invariantqp.geometry.arrays import Array

# So many readings are remembered, and so many of them at the least are before a step, and after it.
REMEMBERED = 64
BEFORE = 8
AFTER = 2
# Each row is a step, after one reading more than the row before.
STEPS = np.tri(REMEMBERED).T
# A step is at least this share of the wanted press, more than the quantum of many a sensor, and so many standard
# deviations.
LEAST_SHARE = 0.05
LEAST_NOISE = 2.5
# It is looked for where the last readings are above the first by this share of that.
SEEN = 0.5
# How much likelier a step has to be than none, in any tick of which each tries many, and than a contact, in any touch
# (logarithms).
STEPPED = CERTAIN + 6.0
STAYED = log(1e4)
# Share of a reading that is remembered no longer in the spread of the older ones: what swings slowly is no step.
OLDER = 1.0 / 128.0


class Level(NamedTuple):
    """The last readings, and what is in them.

    Attributes:
        presses: [force].
        ways: places of the tool at them, inwards, by commands and by the joints [length].
        unread: way since the last reading that was a new one, likewise [length].
        older: mean [force] and variance of those before.
        shifted: by how much the readings have jumped or risen soon, 0 for not at all [force].
        stuck: whether they have stayed there.
    """

    presses: tuple[float, ...] = ()
    ways: tuple[tuple[float, float], ...] = ()
    unread: tuple[float, float] = (0.0, 0.0)
    older: tuple[float, float] = (0.0, 0.0)
    shifted: float = 0.0
    stuck: bool = False

    def waiting(self, way: tuple[float, float]) -> Level:
        """The same after a tick whose reading is not a new one."""
        return self._replace(unread=(self.unread[0] + way[0], self.unread[1] + way[1]))

    def after(self, press: tuple[float, float], way: tuple[float, float], noise: float) -> Level:
        """What is remembered after one more reading.

        Args:
            press: felt and wanted [force].
            way: into the surface since the last reading at most, of the commands felt now and by the joints [length].
            noise: standard deviation of the press [force].
        """
        (felt, wanted), (told, came) = press, self.ways[-1] if self.ways else (0.0, 0.0)
        now = self._replace(
            presses=(*self.presses[1 - REMEMBERED :], felt),
            ways=(*self.ways[1 - REMEMBERED :], (told + way[0] + self.unread[0], came + way[1] + self.unread[1])),
            unread=(0.0, 0.0),
            older=self._older(),
            shifted=0.0,
            stuck=False,
        )
        n, variance = len(now.presses), max(noise * noise, now.older[1])
        least = max(LEAST_SHARE * wanted, LEAST_NOISE * sqrt(variance))
        if n < BEFORE + AFTER or fmean(now.presses[-AFTER:]) < fmean(now.presses[:BEFORE]) + SEEN * least:
            return now
        x, w, steps = np.array(now.presses), np.array(now.ways), STEPS[BEFORE : n + 1 - AFTER, :n]
        x -= x.mean()
        step, size = _explained(steps, x)
        best = int(step.argmax())
        variance = max(variance, _variance(x - size[best] * (steps[best] - steps[best].mean())))
        if size[best] < least or step[best] < 2.0 * variance * STEPPED:
            return now
        risen = (np.maximum(0.0, along - along[:-1, None]) for along in (*w.T, np.arange(n)))
        contact = max(_explained(shapes, x)[0].max() for shapes in risen)
        since = w[best + BEFORE - 1 :, 1]  # a tool that stands, or hardly moved since, does not show whether it answers
        moved = bool(since[-1] - since[1] > since[1] - since[0])
        stuck = moved and bool(step[best] - contact > 2.0 * variance * STAYED)
        return now._replace(shifted=float(size[best]), stuck=stuck)

    def _older(self) -> tuple[float, float]:
        """Mean and variance of the readings that are remembered no longer, once there is one more."""
        if len(self.presses) < REMEMBERED:
            return self.older
        mean, variance = self.older
        off = self.presses[0] - mean
        return mean + OLDER * off, (1.0 - OLDER) * (variance + OLDER * off * off)

    def trouble(self) -> str:
        """What is wrong, in words, "" for nothing."""
        if not self.stuck:
            return ""
        return (
            f"the press jumped by {written(self.shifted, 2)} N and stays there while the tool comes nearer: "
            "a sensor that is stuck, or whose bias jumped"
        )


def _explained(shapes: Array, x: Array) -> tuple[Array, Array]:
    """How much of the sum of squares of x (n,), whose mean is zero, each shape (m, n) explains, and by which multiple.

    A shape that would have to be turned round explains nothing.
    """
    shapes = shapes - shapes.mean(axis=1, keepdims=True)
    multiples = np.maximum(0.0, shapes.dot(x)) / np.maximum((shapes * shapes).sum(axis=1), TINY)
    return multiples * np.maximum(0.0, shapes.dot(x)), multiples


def _variance(rest: Array) -> float:
    """Of what is left (n,), as of readings that say as much and are white: what was smoothed or swings says less."""
    square = float(rest.dot(rest))
    alike = max(0.0, float(rest[1:].dot(rest[:-1])) / max(square, TINY))
    return square / len(rest) * (1.0 + alike) / (1.0 - alike)
