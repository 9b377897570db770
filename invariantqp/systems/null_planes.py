"""alpha- and beta-planes: the 3-systems in which all screws have one pitch h and every two are h-reciprocal.

    alpha    all screws of pitch h whose axes pass through a point     (w; p x w + h w)                type IIA
             ... through a point at infinity: axes along u             (u; h u), slides across u       type IIC
    beta     all screws of pitch h whose axes lie in a plane           w across n, and the slide n     type IIB
             ... in the plane at infinity: all slides                  of pitch inf, in every q_h      type IID

They are the planes that lie wholly in the pitch hyperquadric q_h of projective 5-space, in two families, as a
hyperboloid has two families of lines; there are no others. Two planes of one family and one h are equal or share one
screw. An alpha- and a beta-plane share a pencil of screws if the point lies in the plane, and nothing otherwise.

Such a system S is its own h-reciprocal, S = S^{perp h}, so it has no h-pseudoinverse for its h. For any other pitch a
finite alpha-plane has one, and the other three kinds have none.

In machines, at h = 0: a spherical wrist is an alpha-plane; parallel hinges (a planar arm, a flat face on a table) are
an alpha-plane at infinity; three hinges with axes in one plane are a beta-plane; a gantry is the beta-plane at
infinity. As wrenches Q_0 s, an alpha-plane is all forces through a point, and a beta-plane all forces in a plane.

Reference: [DS] Sect. 2.2 (the two rulings), Sect. 4 (bundles and planes of lines).
"""

from __future__ import annotations

from math import inf
from typing import Literal

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.systems.classification import CLASS_TOLERANCE, gibson_hunt
from invariantqp.systems.span import orthogonal

# A screw lies in a plane if its h-products with the plane's screws are below this fraction of the sum of their terms:
# model files have nine digits at best.
MEMBER_TOLERANCE = 1e-9

# [DS] Table 2: the 3-systems that lie in one q_h, as planes.
_FAMILIES: dict[str, Literal["alpha", "beta"]] = {"IIA": "alpha", "IIC": "alpha", "IIB": "beta", "IID": "beta"}


@frozen(eq=False, repr=False, slots=False)
class NullPlane(Value):
    """An alpha- or beta-plane; made by `alpha_plane`, `beta_plane` or `null_plane`.

    Attributes:
        family: "alpha" or "beta".
        h: pitch of its screws [length/rad]; inf for the beta-plane at infinity, whose screws are all slides.
        point: (3,) on all the axes (alpha), or in the plane (beta); None at infinity.
        direction: (3,) unit, of all the axes (alpha at infinity) or normal to the plane (beta); else None.
    """

    family: Literal["alpha", "beta"]
    h: float
    point: Array | None = field(converter=optional(own))
    direction: Array | None = field(converter=optional(own))

    @property
    def at_infinity(self) -> bool:
        """Whether the point, or the plane, is at infinity."""
        return self.point is None

    @property
    def basis(self) -> Array:
        """(6, 3) screws that span it."""
        if self.direction is None:
            return np.eye(6)[:, 3:] if self.point is None else _screws(np.eye(3), self.point, self.h)
        u = self.direction
        across = orthogonal(u[:, None])
        if self.point is None:
            slides = np.vstack((np.zeros((3, 2)), across))
            return np.column_stack((_screws(u[:, None], np.zeros(3), self.h), slides))
        return np.column_stack((_screws(across, self.point, self.h), np.append(np.zeros(3), u)))

    def contains(self, twist: ArrayLike, tolerance: float = MEMBER_TOLERANCE) -> bool:
        """Whether a (6,) twist lies in it: whether it is h-reciprocal to all of it.

        Args:
            twist: (6,), not zero.
            tolerance: relative error of the twist that must not change the answer.

        Raises:
            BadInput: not six finite numbers, the zero twist, or a tolerance that is not between 0 and 1.
        """
        s, limit = arrays.twist(twist), arrays.tolerance(tolerance)
        if not s.any():
            raise BadInput("twist", "the zero twist", "a non-zero twist", "Zero lies in every system.")
        form, screws = pitch_form(0.0 if self.h == inf else self.h), self.basis
        terms = np.abs(screws.T).dot(np.abs(form)).dot(np.abs(s))
        return bool((np.abs(screws.T.dot(form).dot(s)) <= limit * terms).all())


def alpha_plane(point: ArrayLike | None = None, h: float = 0.0, *, direction: ArrayLike | None = None) -> NullPlane:
    """All screws of pitch h through a point; or, for a point at infinity, along a direction, with the slides across it.

    Args:
        point: (3,) the point [length].
        h: finite pitch [length/rad].
        direction: (3,) instead of a point, the direction of all axes; any non-zero length.

    Raises:
        BadInput: not one of point and direction, NaN, infinite h, a zero direction.

    Reference: [DS] Sect. 2.2.
    """
    if (point is None) == (direction is None):
        raise BadInput("point", "neither" if point is None else "point and direction", "one of point and direction")
    p = None if point is None else arrays.vector(point, 3, "point")
    u = None if direction is None else arrays.direction(direction, "direction")
    return NullPlane("alpha", finite_pitch(h), p, u)


def beta_plane(point: ArrayLike, normal: ArrayLike, h: float = 0.0) -> NullPlane:
    """All screws of pitch h with axes in a plane, and the slide across it.

    Args:
        point: (3,) any point of the plane [length].
        normal: (3,) any non-zero length.
        h: finite pitch [length/rad].

    Raises:
        BadInput: NaN, infinite h, a zero normal.

    Reference: [DS] Sect. 2.2.
    """
    return NullPlane("beta", finite_pitch(h), arrays.vector(point, 3, "point"), arrays.direction(normal, "normal"))


def null_plane(S: ArrayLike, tolerance: float = CLASS_TOLERANCE) -> NullPlane | None:
    """The alpha- or beta-plane that (6, m) twists span; None where they span no such plane.

    Args:
        S: (6, m) spanning twists, dependent or not.
        tolerance: relative error of the twists that must not change the answer.

    Raises:
        BadInput: S is not finite (6, m), all zero, or a tolerance that is not between 0 and 1.

    Reference: [DS] Table 2, types IIA to IID.
    """
    kind = gibson_hunt(arrays.columns(S, "S"), tolerance)
    if kind.dimension != 3 or kind.name not in _FAMILIES:
        return None
    axes, h = kind.motion[:3, :3], kind.moduli[0] if kind.moduli else inf
    origin = -axes.T.dot(kind.motion[:3, 3])
    point = origin if kind.name in {"IIA", "IIB"} else None
    direction = {"IIC": axes[0], "IIB": axes[2]}.get(kind.name)
    return NullPlane(_FAMILIES[kind.name], h, point, direction)


def _screws(directions: Array, point: Array, h: float) -> Array:
    """(6, k) screws of pitch h through a point along (3, k) directions."""
    return np.vstack((directions, np.cross(point, directions, axis=0) + h * directions))
