"""How stiff a contact is against all its constraints at once: how the wrench answers to what was moved against them.

    c k = sum b.a / sum a.a        a = L^-1 W'(twist dt) summed, b = L' w, each less its mean;   W'C W = L L'

w are the wrench's parts in the constraints W, b.a is work, and c k [1/s] is the force law's rate with the compliance C
as it is given, in any frame and any basis of W. The last readings count: the swing of a force law that is too fast is
the largest part of them. What else changes the wrench, noise or a hinge told wrong, is not in step with the motion. An
arm that was told to lag may lag less in a swing: a way is tried with several shares of that delay.
"""

from __future__ import annotations

from math import exp
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array

# For how long readings count, in what the loop is late.
MEMORY = 5.0
# The share of the wrench's variation that the motion explains, from which on it shows a stiffness, and the least number
# of readings for that. What is explained by chance is less, since each way is the sum of many readings' noise.
EXPLAINED = 0.5
FEWEST = 4.0


class ConstraintStiffness(NamedTuple):
    """Weighted sums over the last readings, for s delays and n constraints.

    Attributes:
        weight: of all of them.
        ways: (s, n) of a, counted from where the tool is now.
        wrenches: (n,) of b.
        products: (3, s) of a.a, b.a and b.b.
        most: the largest c k that readings have shown [1/s], 0 before any.
    """

    weight: float = 0.0
    ways: Array = np.zeros((0, 0))
    wrenches: Array = np.zeros(0)
    products: Array = np.zeros((3, 0))
    most: float = 0.0

    def after(self, wrench: Array, moved: Array, dt: float, late: float) -> ConstraintStiffness:
        """The same after one more reading.

        Args:
            wrench: (n,) b.
            moved: (s, n) by how much a has grown since the last reading, for each delay.
            dt: tick [s].
            late: sum of tick, delay and low-pass [s].
        """
        s, n = moved.shape
        before = self
        if self.ways.shape != (s, n):  # another contact
            before = ConstraintStiffness(0.0, np.zeros((s, n)), np.zeros(n), np.zeros((3, s)))
        kept = exp(-dt / (MEMORY * late))
        shift = before.weight * moved
        moments = np.array(
            [((shift - 2.0 * before.ways) * moved).sum(axis=1), -moved.dot(before.wrenches), np.zeros(s)]
        )
        products = kept * (before.products + moments)
        products[2] += wrench.dot(wrench)
        now = ConstraintStiffness(
            kept * before.weight + 1.0, kept * (before.ways - shift), kept * before.wrenches + wrench, products
        )
        return now._replace(most=max(before.most, now.shown()))

    def shown(self) -> float:
        """What the last readings show [1/s], 0 for nothing."""
        if self.weight < FEWEST:
            return 0.0
        b = np.full(self.products.shape[1], self.wrenches.dot(self.wrenches))
        means = np.array([(self.ways * self.ways).sum(axis=1), self.ways.dot(self.wrenches), b]) / self.weight
        rest = self.products - means
        aa, ab, bb = rest[:, (rest[0] > 0.0) & (rest[1] > 0.0)]
        k = ab / aa
        return float(k[k * ab > EXPLAINED * bb].max(initial=0.0))
