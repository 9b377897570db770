"""The descent guard of a form: where limits are active, a form need not reduce the error; least squares is blended in.

    f(x) = 1/2 |b|^2 - 1/2 |b - A x|^2 - 1/2 mu |x|^2
    keep x_f where f(x_f) >= eta f(x_W);   else x = (1 - t) x_f + t x_W, the smallest t that reaches eta f(x_W)

x_W is the least-squares velocity inside the same limits. The blend stays inside them (they are convex), is continuous
in the data, is as independent of the frame as x_f, and is x_f wherever that meets the twist. Without a form
x_f is x_W and there is no guard.

Proof of descent, where x_W gains at all: along the segment f is a concave quadratic, f(x_f) < eta f(x_W) <= f(x_W) at
its ends, so it takes the value eta f(x_W) at a t in (0, 1]; hence f(x) >= eta f(x_W) > 0 for the velocity returned.
Where standing still is allowed f(x_W) >= f(0) = 0: the error never grows to first order.
"""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
from attrs import frozen

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value
from invariantqp.geometry.se3 import norm

# Half of the decrease by least squares: the form's velocity is unchanged wherever it is at least half as good.
DEFAULT_FRACTION = 0.5
# A missing decrease below this share of |r| max(|r|, |A| |x|), |r| the larger of |b| and |A x|, is rounding of x.
ROUNDING = 1e-13


@frozen(init=False, eq=False, repr=False, slots=False)
class Guard(Value):
    """The decrease of the error that a form must at least achieve, measured at the point.

    Attributes:
        fraction: eta in [0, 1], the share of the least-squares decrease that is asked for.
    """

    fraction: float

    def __init__(self, fraction: float = DEFAULT_FRACTION) -> None:
        """A guard.

        Args:
            fraction: eta in [0, 1]; 1 is least squares.

        Raises:
            BadInput: a fraction out of range.
        """
        share = arrays.number(fraction, "fraction")
        if not 0.0 <= share <= 1.0:
            raise BadInput("fraction", f"{share:g}", "a number from 0 to 1")
        self.__attrs_init__(share)


def blend(A: Array, b: Array, mu: float, x_f: Array, x_W: Array, fraction: float) -> float:
    """The smallest t in [0, 1] at which (1 - t) x_f + t x_W decreases the error enough; eta is the fraction.

    A (6, m) and b (6,) are the joint twists and the wanted twist in the measure, mu is from `calm`.
    """
    best, have = _decrease(A, b, mu, x_W), _decrease(A, b, mu, x_f)
    # With exact rows even x_W may increase the error; it may then be exceeded by (1 - eta) of that increase.
    missing = (fraction * best if best > 0.0 else (2.0 - fraction) * best) - have
    achieved = A.dot(x_f)
    size, terms = max(norm(b), norm(achieved)), sqrt(float(np.vdot(A, A))) * norm(x_f)
    if missing <= ROUNDING * size * max(size, terms):
        return 0.0
    d = x_W - x_f
    step = A.dot(d)
    slope = float(step.dot(b - achieved) - mu * x_f.dot(d))
    curvature = float(step.dot(step) + mu * d.dot(d))
    discriminant = slope * slope - 2.0 * curvature * missing
    root = slope + sqrt(discriminant) if discriminant > 0.0 else slope
    return min(2.0 * missing / root if root > 0.0 else inf, 1.0)


def _decrease(A: Array, b: Array, mu: float, x: Array) -> float:
    r = b - A.dot(x)
    return 0.5 * float(b.dot(b) - r.dot(r) - mu * x.dot(x))
