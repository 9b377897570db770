"""How much of each direction is given up near a singularity: lambda, chosen from the spectrum |mu| of the Gram matrix.

    x = V diag(mu / (mu^2 + lambda^2)) V'g

The closed-loop gains mu^2 / (mu^2 + lambda^2) lie in [0, 1): never negative, never above one, whatever the signs of mu.
This is [DS]'s damped formula (6.4) with Lambda = lambda^2 G^-1; its Lambda = lambda I is not damping where mu < 0.

Proof. The map from a twist to the twist it gets is P = J V f(mu) V'J'Q, f(mu) = mu / (mu^2 + lambda^2). Its eigenvalues
other than zero are those of f(mu) V'(J'QJ)V = f(mu) diag(mu) = diag(mu^2 / (mu^2 + lambda^2)), since AB and BA share
theirs. That holds direction by direction, so a lambda of its own for each direction (`Selective`) changes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array

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


@dataclass(frozen=True)
class Selective:
    """Each direction damped by itself: near zero as `Adaptive`, and so that it contributes at most a given speed.

    lambda_i^2 = max(adaptive(|mu_i|)^2, |mu_i| (|v_i'g| / speed - |mu_i|)), hence |x_i| <= speed along every v_i:
    the invariant analogue of selectively damped least squares.

    Attributes:
        speed: what one direction of the spectrum may contribute [rad/s].
        threshold: as in `Adaptive`, for each direction.
        ceiling: likewise.

    Reference: Buss & Kim 2005 (SDLS).
    """

    speed: float = 1.0
    threshold: float = DEFAULT_THRESHOLD
    ceiling: float = DEFAULT_CEILING

    def __post_init__(self) -> None:
        for name in ("speed", "threshold", "ceiling"):
            object.__setattr__(self, name, arrays.number(getattr(self, name), name, positive=True))

    def __call__(self, smallest: float, largest: float) -> float:
        """What the direction of the smallest |mu| gets at least."""
        return Adaptive(self.threshold, self.ceiling)(smallest, largest)

    def squares(self, mu: Array, g: Array, largest: float) -> Array:
        """(n,) lambda_i^2 for eigenvalues mu (n,) and g in eigenvector coordinates (n,)."""
        size = np.abs(mu)
        share = np.minimum(size / (self.threshold * largest), 1.0)
        near_zero = (self.ceiling * largest * (1.0 - share * share)) ** 2
        return np.maximum(near_zero, size * (np.abs(g) / self.speed - size))


@dataclass(frozen=True, eq=False)
class PaperLambda:
    """[DS]'s own damping, x = (G + Lambda)^-1 g, kept to compare with. With Lambda = lambda I it is not damping.

    An eigenvalue of G in (-lambda, 0) gets the closed-loop gain mu / (mu + lambda) < 0 and mu = -lambda is a pole. The
    solution's status is "degraded" wherever a gain is negative or above one, and its reason lists them; bounds clip it,
    since G + Lambda is no Hessian.

    Attributes:
        matrix: (m, m) Lambda, symmetric; a (m,) vector is its diagonal, a number a multiple of I [unit of G].

    Reference: [DS] (6.4).
    """

    matrix: ArrayLike

    def __post_init__(self) -> None:
        Lambda = arrays.array(self.matrix, "matrix", "a symmetric (m, m) matrix, its diagonal, or a number")
        if not np.isfinite(Lambda).all():
            raise BadInput("matrix", "NaN or infinity", "finite numbers")
        if Lambda.ndim > 2 or (Lambda.ndim == 2 and not np.allclose(Lambda, Lambda.T, rtol=1e-9, atol=0.0)):
            raise BadInput("matrix", f"shape {Lambda.shape} or no symmetry", "a symmetric (m, m) matrix")
        object.__setattr__(self, "matrix", Lambda)

    def __call__(self, smallest: float, largest: float) -> float:  # noqa: ARG002 (a policy's signature)
        """No filter of ours: this one has its own path."""
        return 0.0

    def of_size(self, m: int) -> Array:
        """Lambda as an (m, m) matrix.

        Raises:
            BadInput: it was given for another number of joints.
        """
        Lambda = np.asarray(self.matrix)
        Lambda = Lambda * np.eye(m) if Lambda.ndim == 0 else np.diag(Lambda) if Lambda.ndim == 1 else Lambda
        if Lambda.shape != (m, m):
            raise BadInput("damping", f"Lambda of shape {Lambda.shape}", f"shape ({m}, {m}), one row a joint")
        return Lambda


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
