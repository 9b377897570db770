"""The normal of a surface, found from how the tool moves while it presses."""

from __future__ import annotations

from math import atan, exp, pi, sqrt, tan
from typing import NamedTuple

import numpy as np

from invariantqp.errors import written
from invariantqp.force.contact import TINY, HybridTask
from invariantqp.force.contact_kinds import Contact
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array

# A press within this share of the wanted one is reached. A piece of way, as a share of the contact's size: a millimetre
# of 50; for how many pieces they are remembered.
SHORT = 0.2
STEP = 0.02
MEMORY = 10.0


class NormalEstimate(NamedTuple):
    """The normal of a surface, found from how the tool moves while it presses.

        n . w = -(change of the press) / k          for every way w along a surface with normal n and stiffness k
        t = argmin sum (n0 . w + t . w + change / k)^2 + STEP^2/4 |t|^2,     t . n0 = 0,     n = (n0 + t) / |n0 + t|

    n0 is the normal as told. A tilt across the ways is not seen, and stays as told. The direction of the force is not
    used: friction turns it. Ways are cut into pieces, each a STEP along the surface, and the last MEMORY of them count,
    so that ticks at rest forget nothing. Everything is in the base frame: no frame of tool, sensor or contact matters.

    Reference: Yoshikawa & Sudou 1993, who estimate a constraint surface from positions likewise.

    Attributes:
        tilt: (3,) t, how the normal found differs from the told one; not longer than the bound allows.
        way: (3,) of this piece [length].
        press: at its start [force]; None before the first piece.
        squares: (3, 3) sum of w w'.
        rises: (3,) sum of w (n0 . w + change / k).
        held: the bound that holds t back [rad]; 0 where none does.
    """

    tilt: Array = np.zeros(3)
    way: Array = np.zeros(3)
    press: float | None = None
    squares: Array = np.zeros((3, 3))
    rises: Array = np.zeros(3)
    held: float = 0.0

    def applied(self, contact: Contact, normal: Array) -> Contact:
        """The told contact turned about its place, so that its (3,) normal becomes the one found."""
        axis = se3.cross(normal, self.tilt)
        sine = sqrt(axis.dot(axis))
        if sine < TINY:
            return contact
        turn = atan(sine) / sine * axis
        twist = np.concatenate((turn, se3.cross(contact.point, turn)))
        return contact.moved(se3.exp(twist))

    def after(
        self, normal: Array, way: Array, press: tuple[float, float], stiffness: float, size: float, bound: float
    ) -> NormalEstimate:
        """The estimate after one more tick in touch.

        Args:
            normal: (3,) as told, outwards.
            way: (3,) of the place of contact in the tick [length].
            press: felt and wanted [force].
            stiffness: k [force/length]: without it the rise of a touch would pass for a slope.
            size: of the contact [length].
            bound: the largest angle between the told normal and the one found [rad].
        """
        felt, wanted = press
        if self.press is None and abs(felt - wanted) > SHORT * wanted:
            return self  # while a touch rises by much, what the stiffness is off by would pass for a slope
        start = felt if self.press is None else self.press
        w, step = self.way + way, STEP * size
        rise = float(normal.dot(w))
        along = w - rise * normal
        if along.dot(along) < step * step:
            return self._replace(way=w, press=start)
        rise += (felt - start) / stiffness
        kept = exp(-1.0 / MEMORY)
        squares = kept * self.squares + np.outer(along, along)
        rises = kept * self.rises + rise * along
        # Where the told normal turns, older ways have a part along it: it is left out.
        across = np.eye(3) - np.outer(normal, normal)
        H = across.dot(squares).dot(across) + step * step / 4.0 * np.eye(3)
        t = -across.dot(np.linalg.solve(H, across.dot(rises)))
        length, most = sqrt(t.dot(t)), tan(bound)
        if length > most:
            return NormalEstimate(most / length * t, np.zeros(3), felt, squares, rises, bound)
        return NormalEstimate(t, np.zeros(3), felt, squares, rises)

    def found(
        self,
        task: HybridTask,
        normal: Array,
        way: Array,
        press: tuple[float, float] | None,
        stiffness: float | None,
        *,
        touching: bool,
    ) -> NormalEstimate:
        """As `after`, where the task asks for it and enough is known; in the air what was found is forgotten."""
        if task.normal_within is None or stiffness is None or press is None or not touching:
            return NormalEstimate()
        return self.after(normal, way, press, stiffness, task.size, task.normal_within)

    def trouble(self) -> str:
        """What is wrong, in words, "" for nothing."""
        if not self.held:
            return ""
        degrees = written(self.held * 180.0 / pi, 3)
        return f"the normal is {degrees} deg off the told one, the most that normal_within allows"
