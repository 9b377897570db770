"""An arm's own point and length: the point p that the joints move least, and how fast they move it.

    p = argmin |J_v(p)|_F,   L = |J_v(p)|_F / |J_omega|_F,   J_v(p) = v_i + omega_i x p

Both are carried by every rigid change of frame and L scales with the unit of length, so a metric diag(L^2 I, I) at p
depends on nobody's choice of frame or unit.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at

# Directions along which moving p changes |J_v(p)| by less than this fraction are free: all axes are parallel to them.
PARALLEL_TOLERANCE = 1e-12
# det A over its trace cubed (at most 1/27): above this the adjugate loses less than four digits.
WELL_POSED = 1e-4
NOTHING_FREE = np.empty((3, 0))
# A point this many of the arm's lengths away (of the caller's units where it has none) is what rounding makes of a
# twist that does not turn across the axes; measured from there, every velocity nearby would count as nothing.
FAR = 1e6


class Centre(NamedTuple):
    """Point p (3,) [length] and length L [length/rad]; L is inf where no joint turns, 0 where all axes meet in p."""

    point: Array
    length: float


def _stationary_point(twists: Array) -> tuple[Array, Array]:
    """Least-norm minimiser of |v + omega x p|_F over p, and an orthonormal basis of the directions left free."""
    w, v = twists[:3], twists[3:]
    (_, xy, xz), (yx, _, yz), (zx, zy, _) = w.dot(v.T).tolist()
    b = (yz - zy, zx - xz, xy - yx)  # the sum of w x v
    spread = w.dot(w.T)
    (xx, s, t), (_, yy, r), (_, _, zz) = spread.tolist()
    # A p = b with A = |w|^2 I - w w', by its adjugate: a tick has no time for more where A is well away from singular.
    k, m, n = yy + zz, xx + zz, xx + yy
    cofactors = np.array(
        (
            (m * n - r * r, s * n + t * r, t * m + s * r),
            (s * n + t * r, k * n - t * t, r * k + s * t),
            (t * m + s * r, r * k + s * t, k * m - s * s),
        )
    )
    determinant = k * (m * n - r * r) - s * (s * n + t * r) - t * (t * m + s * r)
    if determinant > WELL_POSED * (k + m + n) ** 3:
        return cofactors.dot(b) / determinant, NOTHING_FREE
    spread, axes = np.linalg.eigh(spread)
    stiffness = spread.sum() - spread  # eigenvalues of |w|^2 I - w w', descending
    fixed = stiffness > PARALLEL_TOLERANCE * stiffness[0]
    along = axes[:, fixed]
    return along.dot(along.T.dot(b) / stiffness[fixed]), axes[:, ~fixed]


def centre(J: ArrayLike, twist: ArrayLike | None = None) -> Centre:
    """The arm's own point and length for (6, m) joint twists.

    Where all axes are parallel (a planar arm) the point is free along them; `twist` (6,), if given, settles it as the
    point of that line which the twist moves least, unless it is out of sight: a twist that does not turn across the
    axes moves all their points alike.

    Raises:
        BadInput: J is not finite (6, m).
    """
    twists = arrays.columns(J)
    p, free = _stationary_point(twists)
    turning = np.vdot(twists[:3], twists[:3])
    moving = velocity_at(twists, p)
    length = sqrt(np.vdot(moving, moving) / turning) if turning > 0.0 else inf
    if free.shape[1] and twist is not None:
        s = arrays.twist(twist)
        # Among the free points only the component of omega across them moves the point: w x (free t) = across t.
        across = np.cross(s[:3], free, axis=0)
        along = np.linalg.pinv(across).dot(velocity_at(s, p))
        if sqrt(along.dot(along)) <= FAR * (length if 0.0 < length < inf else 1.0):
            p = p - free.dot(along)
    return Centre(p, length)
