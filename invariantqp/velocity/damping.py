"""How much of each direction is given up near a singularity: lambda, chosen from the spectrum |mu| of the Gram matrix.

    x = V diag(mu / (mu^2 + lambda^2)) V'g

The closed-loop gains mu^2 / (mu^2 + lambda^2) lie in [0, 1): never negative, never above one, whatever the signs of mu.
This is [DS]'s damped formula (6.4) with Lambda = lambda^2 G^-1; its Lambda = lambda I is not damping where mu < 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays

# |mu| ~ sigma(J)^2: the ratio 1e-4 is where the smallest singular value of J (in the arm's own length) is about two
# hundredths of the largest, the usual place for adaptive damping to set in; about 5 % of a Panda's states lie below.
DEFAULT_THRESHOLD = 1e-4
DEFAULT_CEILING = 1e-4

# Below this ratio mu is rounding and no closed form exists, whatever the policy says.
SINGULAR_RATIO = 1e-12
FLOOR_RATIO = 1e-8


class Damping(Protocol):
    """A policy: the damping lambda [unit of G] from the smallest and largest |mu|."""

    def __call__(self, smallest: float, largest: float) -> float:
        """Lambda >= 0."""
        ...


@dataclass(frozen=True)
class Fixed:
    """The same lambda everywhere [unit of the Gram matrix: length for a pitch form]; 0 is no damping at all.

    Undamped, a Gram matrix singular to rounding still gets lambda = 1e-8 max|mu|, and the solution says so.
    """

    value: float

    def __post_init__(self) -> None:
        value = arrays.number(self.value, "damping")
        if value < 0.0:
            raise BadInput("damping", f"{value:g}", "a number not below zero")
        object.__setattr__(self, "value", value)

    def __call__(self, smallest: float, largest: float) -> float:
        """The fixed value, or the floor where it is zero and G is singular."""
        if self.value == 0.0 and smallest <= SINGULAR_RATIO * largest:
            return FLOOR_RATIO * largest
        return self.value


@dataclass(frozen=True)
class Adaptive:
    """No damping while |mu|_min / |mu|_max >= threshold; below, it grows smoothly to ceiling |mu|_max at a singularity.

    lambda = ceiling |mu|_max (1 - (r / threshold)^2), r = |mu|_min / |mu|_max. Relative, so no unit enters.
    """

    threshold: float = DEFAULT_THRESHOLD
    ceiling: float = DEFAULT_CEILING

    def __post_init__(self) -> None:
        for name in ("threshold", "ceiling"):
            object.__setattr__(self, name, arrays.number(getattr(self, name), name, positive=True))

    def __call__(self, smallest: float, largest: float) -> float:
        """Zero away from singularities."""
        if smallest >= self.threshold * largest:
            return 0.0
        ratio = smallest / (largest * self.threshold)
        return self.ceiling * largest * (1.0 - ratio * ratio)


def damping_of(damping: Damping | float | None) -> Damping:
    """The policy meant: None is `Adaptive()`, a number is `Fixed`.

    Raises:
        BadInput: neither a number nor a policy.
    """
    if damping is None:
        return Adaptive()
    if callable(damping):
        return damping
    return Fixed(damping)
