"""What a contact allows, as a value: a kind of contact at a pose in the base frame, and the ways to say which.

    S = Ad(pose) S_kind,    W = Ad*(pose) W_kind,    W'S = 0 wherever it is

Reference: [DS] Sect. 6.3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.systems.contact_kinds import (
    FACE,
    LINE,
    PEG,
    PIVOTING_FACE,
    POINT,
    ROLLING_LINE,
    ROLLING_POINT,
    STICKING_FACE,
    ContactKind,
    screw_kind,
)

# Below this sine a tangent lies along the normal.
ALONG = 1e-6
# Central differences of an implicit surface: cbrt of the rounding error, where truncation and rounding balance.
GRADIENT_STEP = 6e-6


@dataclass(frozen=True, eq=False)
class Contact:
    """A kind of contact at a pose; what it allows and resists is told in the frame of that pose, the base's.

    Attributes:
        kind: what it is in its own frame.
        pose: (4, 4) of its own frame.
    """

    kind: ContactKind
    pose: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", arrays.pose(self.pose))

    @property
    def name(self) -> str:
        """The kind's name."""
        return self.kind.name

    @cached_property
    def freedoms(self) -> Array:
        """(6, k) twists that the contact allows."""
        twists: Array = se3.adjoint(self.pose, check=False).dot(np.asarray(self.kind.freedoms))
        return twists

    @cached_property
    def constraints(self) -> Array:
        """(6, 6-k) wrenches that the tool can exert on the contact; none does work on any freedom."""
        wrenches: Array = se3.coadjoint(self.pose, check=False).dot(np.asarray(self.kind.constraints))
        return wrenches

    @property
    def point(self) -> Array:
        """(3,) the place of contact."""
        place: Array = self.pose[:3, :3].dot(np.asarray(self.kind.origin)) + self.pose[:3, 3]
        return place

    def moved(self, pose: ArrayLike) -> Contact:
        """The contact moved by a (4, 4) rigid motion: twists by Ad, wrenches by the coadjoint."""
        return Contact(self.kind, arrays.pose(pose).dot(self.pose))

    def relabelled(self, offset: ArrayLike) -> Contact:
        """The same contact where it is, its own frame displaced by a (4, 4) offset in itself."""
        X = arrays.pose(offset, "offset")
        return Contact(self.kind.relabelled(X), self.pose.dot(X))


def point_contact(
    point: ArrayLike, normal: ArrayLike, *, slip: bool = True, tangent: ArrayLike | None = None
) -> Contact:
    """A point of the tool on a surface: slides and turns freely, or only turns (slip=False: it rolls).

    Args:
        point: (3,) where they touch, base frame [length].
        normal: (3,) outward normal of the surface, of any length.
        slip: whether it slides.
        tangent: (3,) direction of the contact's own x; None is any.

    Raises:
        BadInput: NaN, a zero normal, a tangent along it.
    """
    return Contact(POINT if slip else ROLLING_POINT, _frame(point, normal, tangent))


def line_contact(point: ArrayLike, direction: ArrayLike, normal: ArrayLike, *, slip: bool = True) -> Contact:
    """A straight edge on a surface: slides, turns about itself and about the normal; or only rolls about itself.

    Args:
        point: (3,) a point of the edge, where a moment counts from, base frame [length].
        direction: (3,) of the edge; only its part along the surface counts.
        normal: (3,) outward normal of the surface.
        slip: whether it slides.

    Raises:
        BadInput: NaN, a zero normal, an edge along it.
    """
    return Contact(LINE if slip else ROLLING_LINE, _frame(point, normal, direction))


def face_contact(
    point: ArrayLike, normal: ArrayLike, *, slip: bool = True, twist: bool = False, tangent: ArrayLike | None = None
) -> Contact:
    """A flat face on a flat surface: slides, and turns about the normal; with slip=False it sticks.

    Args:
        point: (3,) a point of the face, where moments count from, base frame [length].
        normal: (3,) outward normal of the surface.
        slip: whether it slides.
        twist: whether a face that does not slide still turns about the normal through `point`.
        tangent: (3,) direction of the contact's own x; None is any.

    Raises:
        BadInput: NaN, a zero normal, a tangent along it.
    """
    kind = FACE if slip else PIVOTING_FACE if twist else STICKING_FACE
    return Contact(kind, _frame(point, normal, tangent))


def surface_contact(
    point: ArrayLike,
    *,
    normal: Callable[[Array], ArrayLike] | None = None,
    implicit: Callable[[Array], float] | None = None,
    slip: bool = True,
) -> Contact:
    """A point of the tool on a surface that is not flat, its normal taken where they touch.

    Args:
        point: (3,) where they touch, base frame [length].
        normal: the outward normal (3,) at a point.
        implicit: instead, a function that vanishes on the surface and grows outwards; its gradient is the normal.
        slip: whether the point slides.

    Raises:
        BadInput: not one of normal and implicit, NaN, no normal there.
    """
    p = arrays.vector(point, 3, "point")
    if (normal is None) == (implicit is None):
        raise BadInput("normal", "neither" if normal is None else "both", "one of normal and implicit")
    if normal is not None:
        n = arrays.direction(normal(p), "normal")
    else:
        steps = GRADIENT_STEP * max(1.0, float(np.abs(p).max())) * np.eye(3)
        ahead = [implicit(p + step) - implicit(p - step) for step in steps]  # type: ignore[misc]
        n = arrays.direction(ahead, "implicit")
    return point_contact(p, n, slip=slip)


def peg_in_hole(point: ArrayLike, axis: ArrayLike) -> Contact:
    """A round peg in its hole: turns about and slides along the axis, and nothing else.

    Args:
        point: (3,) a point of the axis, where moments count from, base frame [length].
        axis: (3,) the way in.

    Raises:
        BadInput: NaN, a zero axis.
    """
    return Contact(PEG, _frame(point, -arrays.direction(axis, "axis"), None))


def hinge(point: ArrayLike, axis: ArrayLike, pitch: float = 0.0) -> Contact:
    """A door on its hinge, a nut on its bolt, a drawer (pitch inf): one screw is free, five wrenches are carried.

    Args:
        point: (3,) a point of the axis, base frame [length].
        axis: (3,) direction of the axis.
        pitch: translation per radian [length/rad]; inf for a slide.

    Raises:
        BadInput: NaN, a zero axis, a pitch that is none.
    """
    return Contact(screw_kind(float(pitch)), _frame(point, -arrays.direction(axis, "axis"), None))


def _frame(point: ArrayLike, normal: ArrayLike, tangent: ArrayLike | None) -> Array:
    """The contact's own frame: z against the outward normal, x along the tangent as far as the surface allows."""
    z = -arrays.direction(normal, "normal")
    along = np.eye(3)[int(np.abs(z).argmin())] if tangent is None else arrays.direction(tangent, "tangent")
    x = along - z * z.dot(along)
    if x.dot(x) < ALONG**2:
        raise BadInput("tangent", "a direction along the normal", "one that lies in the surface")
    x = x / np.sqrt(x.dot(x))
    T = np.eye(4)
    T[:3, :3] = np.column_stack((x, se3.cross(z, x), z))
    T[:3, 3] = arrays.vector(point, 3, "point")
    return T
