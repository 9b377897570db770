"""The descent guard of a form: where limits bind, what it attempts need not reduce the error, so least squares watches.

    f(x) = 1/2 |b|^2 - 1/2 |b - A x|^2 - 1/2 mu |x|^2
    keep x_f where f(x_f) >= eta f(x_W);   else x = (1 - t) x_f + t x_W, the smallest t that reaches eta f(x_W)

x_W is the least-squares velocity inside the same limits. The blend stays inside them (they are convex), is continuous
in the data, moves with every change of frame as x_f does, and is x_f wherever that meets the twist. Without a form
x_f is x_W and nothing is watched.

Proof of descent, where x_W gains at all: along the segment f is a concave quadratic, f(x_f) < eta f(x_W) <= f(x_W) at
its ends, so it takes the value eta f(x_W) at a t in (0, 1]; hence f(x) >= eta f(x_W) > 0 for the velocity returned.
Where standing still is allowed f(x_W) >= f(0) = 0: the error never grows to first order.
"""

from __future__ import annotations

from math import inf, sqrt

from attrs import frozen

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value

# Half of what least squares would gain: a form keeps its own way wherever it is at least half as good.
DEFAULT_FRACTION = 0.5
# Less decrease than asked for by no more than this share of |b|^2 is rounding.
ROUNDING = 1e-13


@frozen(init=False, eq=False, repr=False, slots=False)
class Guard(Value):
    """What a form must at least achieve, measured at the point.

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
    """The smallest t in [0, 1] at which (1 - t) x_f + t x_W decreases the error enough.

    Args:
        A: (6, m) measured joint twists.
        b: (6,) measured twist wanted.
        mu: what a joint velocity costs.
        x_f: (m,) the form's velocity.
        x_W: (m,) least squares'.
        fraction: eta.
    """
    best, have = _decrease(A, b, mu, x_W), _decrease(A, b, mu, x_f)
    # Where even the best loses (exact rows can ask for that), the allowance is measured from it downwards.
    missing = (fraction * best if best > 0.0 else (2.0 - fraction) * best) - have
    if missing <= ROUNDING * float(b.dot(b)):
        return 0.0
    d = x_W - x_f
    step = A.dot(d)
    slope = float(step.dot(b - A.dot(x_f)) - mu * x_f.dot(d))
    curvature = float(step.dot(step) + mu * d.dot(d))
    discriminant = slope * slope - 2.0 * curvature * missing
    root = slope + sqrt(discriminant) if discriminant > 0.0 else slope
    return min(2.0 * missing / root if root > 0.0 else inf, 1.0)


def _decrease(A: Array, b: Array, mu: float, x: Array) -> float:
    r = b - A.dot(x)
    return 0.5 * float(b.dot(b) - r.dot(r) - mu * x.dot(x))
