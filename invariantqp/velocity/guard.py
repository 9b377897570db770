"""The descent guard: an indefinite form need not reduce an error it cannot remove, so a definite one watches.

    f(x) = 1/2 |s|_W^2 - 1/2 |s - Jx|_W^2,   W = diag(L^2 I, I) carried to the arm's own point
    keep x_h where f(x_h) >= eta f(x_W);   else x = (1 - t) x_h + t x_W, the smallest t that reaches eta f(x_W)

x_W is the least-squares velocity inside the same limits, damped near a singularity as the law is. The blend stays
inside them (they are convex), is continuous in the data, moves with every change of frame as x_h does, and is x_h
wherever x_h meets the twist.

Proof of descent, where x_W gains at all: along the segment f is a concave quadratic, f(x_h) < eta f(x_W) <= f(x_W) at
its ends, so it takes the value eta f(x_W) at a t in (0, 1]; hence f(x) >= eta f(x_W) > 0 for the velocity returned.
Where standing still is allowed and x_W is not damped, f(x_W) >= f(0) = 0: the guarded error never grows to first order.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isinf, sqrt

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.systems.centre import centre, measured

# Half of what least squares would gain: the h-law keeps its own way wherever it is at least half as good.
DEFAULT_FRACTION = 0.5


@dataclass(frozen=True, eq=False)
class Guard:
    """What the velocity law must at least achieve.

    Attributes:
        fraction: eta in [0, 1], the share of the least-squares decrease that is asked for.
        point: (3,) where W is carried to, in the frame of J; None is the arm's own point.
        length: L [length/rad], how much a radian counts; None is the arm's own length.
    """

    fraction: float = DEFAULT_FRACTION
    point: ArrayLike | None = None
    length: float | None = None

    def __post_init__(self) -> None:
        fraction = arrays.number(self.fraction, "fraction")
        if not 0.0 <= fraction <= 1.0:
            raise BadInput("fraction", f"{fraction:g}", "a number from 0 to 1")
        if self.point is not None:
            object.__setattr__(self, "point", arrays.vector(self.point, 3, "point"))
        if self.length is not None:
            object.__setattr__(self, "length", arrays.number(self.length, "length", positive=True))

    def scene(self, J: Array, s: Array, anchor: Array | None = None) -> Scene:
        """W^(1/2) applied to this tick's twists; `anchor` (3,) is where W is carried to if the guard has no point."""
        point, length = anchor if self.point is None else self.point, self.length
        if point is None or length is None:
            own = centre(J, s)
            point = own.point if point is None else np.asarray(point)
            length = own.length if length is None else length
        if isinf(length):  # no joint turns: what happens to the orientation is nobody's doing
            length = 0.0
        return Scene(measured(J, np.asarray(point), length), measured(s, np.asarray(point), length), self.fraction)


@dataclass(frozen=True, eq=False)
class Scene:
    """J and s measured in W: Euclidean from here on.

    Attributes:
        J: (6, m).
        s: (6,).
        fraction: eta.
        damping: mu, what a joint velocity costs [unit of J'WJ].
    """

    J: Array
    s: Array
    fraction: float
    damping: float = 0.0

    def missed(self, x: Array) -> float:
        """|s - Jx|_W."""
        r = self.s - self.J.dot(x)
        return sqrt(float(r.dot(r)))

    def met_share(self, missed: float) -> float:
        """How much of the twist is met, from 0 (none, or worse) to 1, where |s - Jx|_W = missed."""
        wanted = sqrt(float(self.s.dot(self.s)))
        return max(0.0, 1.0 - missed / wanted) if wanted > 0.0 else 0.0

    def decrease(self, x: Array) -> float:
        """f(x), the decrease of the squared error to first order in time, less 1/2 mu |x|^2."""
        r = self.s - self.J.dot(x)
        return 0.5 * float(self.s.dot(self.s) - r.dot(r) - self.damping * x.dot(x))

    def surely_enough(self, decrease: float) -> bool:
        """Whether no velocity whatever could ask for more: f <= 1/2 |s|_W^2 everywhere."""
        return decrease >= 0.5 * self.fraction * float(self.s.dot(self.s))

    def blend(self, x_h: Array, x_W: Array) -> float:
        """The smallest t in [0, 1] at which (1 - t) x_h + t x_W decreases the error enough."""
        best, have = self.decrease(x_W), self.decrease(x_h)
        # Where even the best loses (exact rows can ask for that), the allowance is measured from it downwards.
        wanted = self.fraction * best if best > 0.0 else (2.0 - self.fraction) * best
        missing = wanted - have
        if missing <= 0.0:
            return 0.0
        d = x_W - x_h
        step = self.J.dot(d)
        slope = float(step.dot(self.s - self.J.dot(x_h)) - self.damping * x_h.dot(d))
        curvature = float(step.dot(step) + self.damping * d.dot(d))
        discriminant = slope * slope - 2.0 * curvature * missing
        root = slope + sqrt(discriminant) if discriminant > 0.0 else slope
        t = 2.0 * missing / root if root > 0.0 else inf
        return min(t, 1.0)
