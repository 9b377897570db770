"""All limits of a tick as one polytope, lower <= A z <= upper, and the names of its limits in reasons."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from invariantqp.geometry.arrays import Array

# A limit this close, relative to its value (or 1), is at it.
ACTIVE_TOLERANCE = 1e-6
# A row shorter than this share of the longest is rounding: no z moves it.
ROW_TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False)
class Polytope:
    """lower <= A z <= upper; A = None is the identity."""

    A: Array | None  # (k, n) or None: the joints of the box first, then the rows
    lower: Array  # (k,), -inf where there is none
    upper: Array  # (k,), inf where there is none

    @cached_property
    def lengths(self) -> Array:
        """(k,) of the rows of A."""
        return np.ones(len(self.lower)) if self.A is None else np.sqrt((self.A * self.A).sum(axis=1))

    def value(self, z: Array) -> Array:
        """(k,) A z."""
        return z if self.A is None else self.A.dot(z)

    @cached_property
    def moving(self) -> NDArray[np.bool_]:
        """(k,) which limits some z moves."""
        return np.asarray(self.lengths > ROW_TOLERANCE * self.lengths.max())

    def at(self, z: Array) -> NDArray[np.bool_]:
        """(k,) which limits z is at."""
        value = self.value(z)
        margin = ACTIVE_TOLERANCE * np.maximum(1.0, np.abs(value))
        return np.asarray((value >= self.upper - margin) | (value <= self.lower + margin))

    def about(self, z: Array) -> tuple[Array, Array]:
        """(lower, upper), each (k,), on A d for the z + d."""
        value = self.value(z)
        return self.lower - value, self.upper - value

    def on(self, origin: Array, basis: Array) -> Polytope:
        """The same limits on z, x = origin + basis z."""
        return Polytope(basis if self.A is None else self.A.dot(basis), *self.about(origin))

    def rows(self) -> Array:
        """(k, n) A as a matrix."""
        return np.eye(len(self.lower)) if self.A is None else self.A


def named(indices: list[int], m: int) -> str:
    """Limits of a polytope on m joints in words: joints by number, then rows."""
    words = []
    for what, found in (("joint", [i for i in indices if i < m]), ("row", [i - m for i in indices if i >= m])):
        if found:
            words.append(f"{what}{'s' if len(found) > 1 else ''} {', '.join(map(str, found))}")
    return " and ".join(words)
