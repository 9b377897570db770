"""Damping near a singularity: lambda_i for each direction, from the singular values sigma of A = root J.

    x = sum over i of  v_i (sigma_i u_i'b + lambda_i^2 v_i'x_p) / (sigma_i^2 + lambda_i^2)

which minimises |A x - b|^2 + sum of lambda_i^2 (v_i'(x - x_p))^2. The smaller sigma_i is beside lambda_i, the more that
direction follows the posture x_p; one with sigma_i = 0 follows it entirely. Each gain sigma^2 / (sigma^2 + lambda^2)
lies in [0, 1], 1 without damping. The default lambda is relative to the largest sigma, so no unit enters.

Damping takes as much of a weak direction's twist as it takes of its joint speed; so what a loop asks slowly of such a
direction is left whole. With w = U'(b - A x_p), r_i = sigma_i / sigma_max and `Adaptive` by default, a loop has

    lambda_i^2 W^2 / (W^2 + (EASY r_i |w|)^2),   W^2 = sum of (lambda_i / (ceiling sigma_max)) w_i^2

over the directions that joints move at all. W is what the twist asks of weak ones. All of lambda^2 is had where that
needs more than EASY times the joint speed that the whole twist would need of the strongest direction. Equal sigma have
equal factors, so the answer is as continuous as before.

A loop is damped, too, where its target is out of reach or near a singularity (`calm`): 1/2 mu |x|^2 is added, with

    mu = CALM / 2 dt (|b - A x| + max(0, 1/4 dt |A| |x|^2 - |b|)) |A|

A velocity x held for a tick dt changes A by up to about dt |A| |x|. This has two effects that a single tick ignores:
a residual |b - A x| asks for another velocity in the next tick, and the motion differs from dt A x by up to
1/2 dt^2 |A| |x|^2. Where either is large the loop overshoots and oscillates at full speed. The second one counts where
half of that difference, per unit of time, exceeds the twist itself. mu is zero where the twist is met at moderate joint
speeds, so such ticks are unchanged.

Where joints at full speed hardly bring the tool nearer to its target, mu is up to fifty thousand times that; they rest:

    kappa = max b'A x / (|b| sum of |A_i| v_i),  |x_i| <= v_i and inside the position limits
    mu / max(1 - (share / kappa)^2, LEAST_WORTH),   share = PROGRESS_SHARE

Reference: Sugihara 2011 (Levenberg-Marquardt, damping by the residual).
"""

from __future__ import annotations

from math import sqrt
from numbers import Real
from typing import Protocol, runtime_checkable

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.se3 import norm
from invariantqp.velocity.solution import SLOWEST

# Damping starts where a direction needs 1 / threshold times the joint speed of the strongest one, and lets none need
# more than 1 / (2 ceiling) times that. Measured (`examples/14_defaults.py`): the larger the ceiling, the less joints
# accelerate by singularities, at 3e-3 twentyfold less and more than at 3e-5 for hundredths of a millimetre; from 5e-3
# on everyday and difficult tasks lose accuracy. The threshold hardly counts.
DEFAULT_THRESHOLD = 1e-2
DEFAULT_CEILING = 2e-3
# A direction of a loop that needs less than this many times the joint speed that the whole twist would need of the
# strongest one is hardly damped. Measured on 150 random tasks of ten arms and on paths past singularities: with 3 the
# largest error is smaller by 6 % in the mean, of Kinova's and UR10's by half, and joints vary by 2 % more; with 1 and
# with 3 the largest acceleration at 100, 250 and 1000 Hz is 1.95, 2.04, 4.98 and 2.26, 2.04, 2.64 of the bar, with no
# such share 1.56, 2.04, 5.75.
EASY = 3.0
# Where some joint has no velocity limit, damping alone bounds its speed: 50 times that of the strongest direction.
UNLIMITED_CEILING = 1e-2
# Measured on the stability problems and random tasks (`examples/14_defaults.py`): with 1 loops come to rest but slowly;
# with 0.25 they come to rest too, and arrive as fast as without this damping.
CALM = 0.25
# Share of dt |A| |x|^2 that is compared with the twist. 0.5 is the largest possible deviation; measured: 0.25 loses no
# accuracy with long ticks, and loops come to rest as well.
DEVIATION_SHARE = 0.25
# A velocity that achieves less than this share of the twist makes no progress; and joints rest that bring the tool
# nearer by less than this share of what they move it: out of reach some would turn for minutes, for a hundredth of the
# error. Measured: with 3e-4 one arm of eighty no longer leaves a singularity, with 2e-4 all do; then one of 294 late
# loops creeps after 15 s, with 1e-4 five.
PROGRESS_SHARE = 2e-4
# The least that a motion is worth. Measured: with 2e-4 arms that should rest creep at some 1e-5 rad/s.
LEAST_WORTH = 2e-5


@runtime_checkable
class Damping(Protocol):
    """A policy; implement it to bring one."""

    def squares(self, sigma: Array, wanted: Array, largest: float) -> Array:
        """(n,) lambda_i^2 >= 0.

        Args:
            sigma: (n,) singular values, 0 for directions that move nothing.
            wanted: (n,) u_i'b, what is wanted of each direction, measured as sigma is.
            largest: the largest singular value.
        """
        ...


@frozen(init=False, eq=False, repr=False, slots=False)
class Fixed(Value):
    """The same lambda everywhere."""

    value: float

    def __init__(self, value: float) -> None:
        """A damping.

        Args:
            value: lambda >= 0 [length; unit of root J]; 0 is no damping at all.

        Raises:
            BadInput: not a number, or below zero.
        """
        self.__attrs_init__(arrays.not_negative(value, "value", "lambda"))

    def squares(self, sigma: Array, wanted: Array, largest: float) -> Array:  # noqa: ARG002 (a policy's signature)
        """The fixed value."""
        return np.full(len(sigma), self.value**2)


@frozen(init=False, eq=False, repr=False, slots=False)
class Adaptive(Value):
    """No damping of directions with sigma >= threshold sigma_max; below, it grows smoothly to ceiling sigma_max.

    lambda_i = ceiling sigma_max (1 - (r_i / threshold)^2), r_i = sigma_i / sigma_max.
    """

    threshold: float
    ceiling: float

    def __init__(self, threshold: float = DEFAULT_THRESHOLD, ceiling: float = DEFAULT_CEILING) -> None:
        """A policy.

        Args:
            threshold: share of the largest singular value, positive.
            ceiling: likewise.

        Raises:
            BadInput: one that is not positive.
        """
        self.__attrs_init__(
            arrays.number(threshold, "threshold", positive=True), arrays.number(ceiling, "ceiling", positive=True)
        )

    def squares(self, sigma: Array, wanted: Array, largest: float) -> Array:  # noqa: ARG002 (a policy's signature)
        """Zero away from singularities."""
        share = np.minimum(sigma / (self.threshold * largest), 1.0)
        left = self.ceiling * largest * (1.0 - share * share)
        return left * left


@frozen(init=False, eq=False, repr=False, slots=False)
class Selective(Value):
    """Each direction damped so that it contributes at most a given speed, and at least as much as `Adaptive` damps it.

    lambda_i^2 = max(adaptive_i^2, sigma_i (|u_i'b| / speed - sigma_i)), hence |v_i'x| <= speed along every v_i. Where
    singular values are equal, rounding chooses the directions, and the answer may jump.

    Reference: Buss & Kim 2005 (SDLS).
    """

    speed: float
    adaptive: Adaptive

    def __init__(self, speed: float = 1.0, adaptive: Adaptive | None = None) -> None:
        """A policy.

        Args:
            speed: what one direction may contribute [rad/s], positive.
            adaptive: what is damped at least; None is `Adaptive()`.

        Raises:
            BadInput: a speed that is not positive, something that is not `Adaptive`.
        """
        least = Adaptive() if adaptive is None else adaptive
        if not isinstance(least, Adaptive):
            raise BadInput("adaptive", excerpt(adaptive), "Adaptive(threshold, ceiling)")
        self.__attrs_init__(arrays.number(speed, "speed", positive=True), least)

    def squares(self, sigma: Array, wanted: Array, largest: float) -> Array:
        """The larger of both for each direction."""
        return np.maximum(self.adaptive.squares(sigma, wanted, largest), sigma * (np.abs(wanted) / self.speed - sigma))


@frozen(init=False, eq=False, repr=False, slots=False)
class PaperLambda(Value):
    """[DS]'s own damping, x = (G + Lambda)^-1 g, kept to compare with. With Lambda = lambda I it is not damping.

    An eigenvalue of G in (-lambda, 0) gets the closed-loop gain mu / (mu + lambda) < 0 and mu = -lambda is a pole. The
    solution's status is "degraded" wherever a gain is negative or above one, and its reason lists them; bounds clip it,
    since G + Lambda is no Hessian. It goes with a pitch form.

    Reference: [DS] Sect. 6.3, the damped formula.
    """

    matrix: Array = field(converter=own)

    def __init__(self, matrix: ArrayLike) -> None:
        """A damping.

        Args:
            matrix: (m, m) Lambda, symmetric; a (m,) vector is its diagonal, a number a multiple of I [unit of G].

        Raises:
            BadInput: NaN, another shape, no symmetry.
        """
        Lambda = arrays.array(matrix, "matrix", "a symmetric (m, m) matrix, its diagonal, or a number")
        if not np.isfinite(Lambda).all():
            raise BadInput("matrix", "NaN or infinity", "finite numbers")
        square = Lambda.ndim < 2 or Lambda.shape == Lambda.T.shape
        if Lambda.ndim > 2 or not square or not np.allclose(Lambda, Lambda.T, rtol=1e-9, atol=0.0):
            raise BadInput("matrix", f"shape {Lambda.shape} or no symmetry", "a symmetric (m, m) matrix")
        self.__attrs_init__(Lambda)

    def of_size(self, m: int) -> Array:
        """Lambda as an (m, m) matrix.

        Raises:
            BadInput: it was given for another number of joints.
        """
        Lambda = self.matrix
        Lambda = Lambda * np.eye(m) if Lambda.ndim == 0 else np.diag(Lambda) if Lambda.ndim == 1 else Lambda
        if Lambda.shape != (m, m):
            raise BadInput("damping", f"Lambda of shape {Lambda.shape}", f"shape ({m}, {m}), one row a joint")
        return Lambda


def damping_of(damping: Damping | PaperLambda | float | None, *, limited: bool) -> Damping | PaperLambda:
    """The policy for an argument: a number is `Fixed`; None is `Adaptive()`, stronger unless all joints are `limited`.

    Raises:
        BadInput: neither a number nor a policy.
    """
    if damping is None:
        return Adaptive() if limited else Adaptive(ceiling=UNLIMITED_CEILING)
    if isinstance(damping, (Damping, PaperLambda)):
        return damping
    if isinstance(damping, bool) or not isinstance(damping, Real):
        raise BadInput(
            "damping", excerpt(damping), "a number, Adaptive(), Fixed(...), Selective(...) or a policy of yours"
        )
    return Fixed(arrays.not_negative(damping, "damping", "lambda"))


def asked_share(damping: Adaptive, sigma: Array, needed: Array, largest: float) -> Array:
    """(n,) the share of each lambda_i^2 that a loop has, for `needed` (n,) w = U'(b - A x_p)."""
    weak = np.sqrt(damping.squares(sigma, needed, largest)) / (damping.ceiling * largest)
    asked = float(weak.dot(needed * needed)) + (SLOWEST * largest) ** 2
    easy = EASY * sigma / largest
    share: Array = asked / (asked + float(needed.dot(needed)) * easy * easy)
    return share


def calm(A: Array, wanted: Array, achieved: Array, speed: float, dt: float, factor: float = CALM) -> float:
    """mu >= 0 for measured joint twists A (6, n), the measured twist (6,) and A x (6,), in a tick of dt [s].

    `speed` is |x| without its part that moves nothing; `factor` stands in place of CALM.
    """
    size = sqrt(float(np.vdot(A, A)))
    deviation = max(0.0, DEVIATION_SHARE * dt * size * speed * speed - norm(wanted))
    error = norm(wanted - achieved) + deviation
    # What changes no digit that matters is subtracted, so that mu sets in without a jump.
    return max(0.0, 0.5 * factor * dt * error * size - NEGLIGIBLE * size * size)


def worth(A: Array, wanted: Array, lower: Array, upper: Array, fastest: Array) -> float:
    """1 - (share / kappa)^2, at least `LEAST_WORTH`: whether it is worth it to move the joints for a target, at most 1.

    Args:
        A: (6, m) measured joint twists.
        wanted: (6,) the measured twist.
        lower: (m,) joint velocities that the position limits allow.
        upper: (m,) likewise.
        fastest: (m,) v, the joints' full speeds.
    """
    pull, sizes = wanted.dot(A), np.sqrt((A * A).sum(axis=0))
    nearer = float(np.maximum(pull * np.maximum(lower, -fastest), pull * np.minimum(upper, fastest)).sum())
    least = PROGRESS_SHARE * norm(wanted) * float(sizes.dot(fastest))
    if nearer <= least:
        return LEAST_WORTH if least > 0.0 else 1.0
    return max(1.0 - (least / nearer) ** 2, LEAST_WORTH)
