"""Contacts: a kind of contact at a pose in the base frame, and functions that make the usual ones.

    S = Ad(pose) S_kind,    W = Ad*(pose) W_kind,    W'S = 0 at every pose

Reference: [DS] Sect. 6.3.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from math import inf, sqrt

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.systems.contact_kinds import (
    BALL,
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
from invariantqp.systems.span import LENGTH_LIMIT

# A tangent at an angle to the normal below this [rad] counts as parallel to it.
ALONG = 1e-6
# Step of central differences, relative to the coordinates: the cube root of the rounding error, where truncation and
# rounding are of one size.
GRADIENT_STEP = 6e-6
NUMBER = "a function that gives a number"


@frozen(init=False, eq=False, repr=False, slots=False)
class Contact(Value):
    """A kind of contact at a pose; its freedoms and constraints are expressed in the frame of that pose, the base's.

    Attributes:
        kind: what it is in its own frame.
        pose: (4, 4) of its own frame.
        edge: how far the surface's edge is from the place of contact [length], negative beyond it; None is no edge.
    """

    kind: ContactKind
    pose: Array = field(converter=own)
    edge: float | None

    def __init__(self, kind: ContactKind, pose: ArrayLike, edge: float | None = None) -> None:
        """A kind of contact at a pose.

        Args:
            kind: what it is in its own frame.
            pose: (4, 4) of its own frame in the base frame.
            edge: how far the surface's edge is from the place of contact [length], negative beyond it.

        Raises:
            BadInput: not a finite rigid motion, an edge that is no number.
        """
        self.__attrs_init__(kind, arrays.pose(pose), None if edge is None else arrays.number(edge, "edge", "a length"))

    @property
    def name(self) -> str:
        """The kind's name."""
        return self.kind.name

    @cached_property
    def adjoint(self) -> Array:
        """(6, 6) from twists in the contact's own frame to twists in the base frame."""
        return se3.adjoint(self.pose, check=False)

    @cached_property
    def coadjoint(self) -> Array:
        """(6, 6) from wrenches in the contact's own frame to wrenches in the base frame."""
        return se3.coadjoint(self.pose, check=False)

    @cached_property
    def freedoms(self) -> Array:
        """(6, k) twists that the contact allows."""
        twists: Array = self.adjoint.dot(self.kind.freedoms)
        return twists

    @cached_property
    def constraints(self) -> Array:
        """(6, 6-k) wrenches that the tool can exert on the contact; none does work on any freedom."""
        wrenches: Array = self.coadjoint.dot(self.kind.constraints)
        return wrenches

    @cached_property
    def point(self) -> Array:
        """(3,) the place of contact."""
        place: Array = self.pose[:3, :3].dot(self.kind.origin) + self.pose[:3, 3]
        return place

    def moved(self, pose: ArrayLike) -> Contact:
        """The contact after a (4, 4) rigid motion: twists go by Ad, wrenches by the coadjoint."""
        return _at(self.kind, arrays.pose(pose).dot(self.pose), self.edge)

    def relabelled(self, offset: ArrayLike) -> Contact:
        """The same contact, not moved, with its own frame displaced by a (4, 4) offset in that frame."""
        X = arrays.pose(offset, "offset")
        return Contact(self.kind.relabelled(X), self.pose.dot(X), self.edge)


def point_contact(
    point: ArrayLike, normal: ArrayLike, *, slip: bool = True, tangent: ArrayLike | None = None
) -> Contact:
    """A point of the tool on a surface: it slides and turns, or, with slip=False, only turns (rolls).

    Args:
        point: (3,) where they touch, base frame [length].
        normal: (3,) outward normal of the surface, of any length.
        slip: whether it slides.
        tangent: (3,) direction of the contact's own x; None chooses one.

    Raises:
        BadInput: NaN, a zero normal, a tangent parallel to it.
    """
    return _at(POINT if arrays.flag(slip, "slip") else ROLLING_POINT, contact_frame(point, normal, tangent))


def line_contact(point: ArrayLike, direction: ArrayLike, normal: ArrayLike, *, slip: bool = True) -> Contact:
    """A straight edge on a surface: it slides and turns about itself and the normal; or it only turns about itself.

    Args:
        point: (3,) a point of the edge, about which moments are taken, base frame [length].
        direction: (3,) of the edge; its part along the normal is ignored.
        normal: (3,) outward normal of the surface.
        slip: whether it slides.

    Raises:
        BadInput: NaN, a zero normal, an edge parallel to it.
    """
    return _at(
        LINE if arrays.flag(slip, "slip") else ROLLING_LINE, contact_frame(point, normal, direction, "direction")
    )


def face_contact(
    point: ArrayLike, normal: ArrayLike, *, slip: bool = True, twist: bool = False, tangent: ArrayLike | None = None
) -> Contact:
    """A flat face on a flat surface: it slides and turns about the normal; with slip=False it sticks.

    Args:
        point: (3,) a point of the face, about which moments are taken, base frame [length].
        normal: (3,) outward normal of the surface.
        slip: whether it slides.
        twist: whether a face that does not slide still turns about the normal through `point`.
        tangent: (3,) direction of the contact's own x; None chooses one.

    Raises:
        BadInput: NaN, a zero normal, a tangent parallel to it.
    """
    turns = arrays.flag(twist, "twist")
    kind = FACE if arrays.flag(slip, "slip") else PIVOTING_FACE if turns else STICKING_FACE
    return _at(kind, contact_frame(point, normal, tangent))


def surface_contact(
    point: ArrayLike,
    *,
    normal: Callable[[Array], ArrayLike] | None = None,
    implicit: Callable[[Array], float] | None = None,
    slip: bool = True,
    extent: Callable[[Array], float] | None = None,
) -> Contact:
    """A point of the tool on a curved surface, with the normal at the point of contact.

    Args:
        point: (3,) where they touch, base frame [length].
        normal: function that gives the outward normal (3,) at a point.
        implicit: or a function that is zero on the surface and grows outwards; its gradient is the normal.
        slip: whether the point slides.
        extent: function that gives how far the surface's edge is from a point, negative beyond it [length].

    Raises:
        BadInput: not one of normal and implicit, NaN, a normal or a gradient that is zero.
    """
    p = arrays.vector(point, 3, "point")
    if (normal is None) == (implicit is None):
        raise BadInput("normal", "neither" if normal is None else "both", "one of normal and implicit")
    if normal is not None:
        n = arrays.direction(arrays.function(normal, "normal", "a function of a point (3,)")(p), "normal")
    else:
        height = arrays.function(implicit, "implicit", "a function of a point (3,)")  # type: ignore[arg-type]
        steps = GRADIENT_STEP * max(1.0, float(np.abs(p).max())) * np.eye(3)
        ahead = arrays.array([[height(p + sign * step) for sign in (1.0, -1.0)] for step in steps], "implicit", NUMBER)
        n = arrays.direction(np.subtract(*ahead.T), "implicit")
    contact = point_contact(p, n, slip=slip)
    if extent is None:
        return contact
    edge = arrays.function(extent, "extent", "a function of a point (3,)")(p)
    return _at(contact.kind, contact.pose, arrays.number(edge, "extent", "a function that gives a length"))


def ball_joint(point: ArrayLike) -> Contact:
    """A ball in its socket, or a tool held at one point: it turns, and is held against every force.

    Args:
        point: (3,) the centre, base frame [length].

    Raises:
        BadInput: NaN, shapes.
    """
    return _at(BALL, contact_frame(point, [0.0, 0.0, -1.0], None))


def peg_in_hole(point: ArrayLike, axis: ArrayLike) -> Contact:
    """A round peg in its hole: it turns about the axis and slides along it.

    Args:
        point: (3,) a point of the axis, about which moments are taken, base frame [length].
        axis: (3,) direction into the hole.

    Raises:
        BadInput: NaN, a zero axis.
    """
    return _at(PEG, contact_frame(point, -arrays.direction(axis, "axis"), None))


def hinge(point: ArrayLike, axis: ArrayLike, pitch: float = 0.0) -> Contact:
    """A door on its hinge, a nut on its bolt, a drawer (pitch inf): one screw is free, five wrenches are constrained.

    Args:
        point: (3,) a point of the axis, base frame [length].
        axis: (3,) direction of the axis.
        pitch: translation per radian [length/rad]; inf for a slide.

    Raises:
        BadInput: NaN, a zero axis, a pitch that is no number or beyond any machine.
    """
    expected = "a pitch [length/rad], or inf for a slide"
    h = arrays.number(pitch, "pitch", expected, infinite=True)
    if LENGTH_LIMIT < abs(h) < inf:
        raise BadInput("pitch", f"{h:.4g}, beyond any machine", expected)
    return _at(screw_kind(h), contact_frame(point, -arrays.direction(axis, "axis"), None))


def contact_frame(point: ArrayLike, normal: ArrayLike, tangent: ArrayLike | None, argument: str = "tangent") -> Array:
    """The contact's own frame: z against the outward normal, x along the projection of the tangent on the surface."""
    # In floats, which for so few numbers is faster than in arrays.
    u, v, w = (-arrays.direction(normal, "normal")).tolist()
    if tangent is None:
        least = min(abs(u), abs(v), abs(w))
        along = (1.0, 0.0, 0.0) if abs(u) == least else (0.0, 1.0, 0.0) if abs(v) == least else (0.0, 0.0, 1.0)
    else:
        along = arrays.direction(tangent, argument).tolist()
    a, b, c = along
    share = u * a + v * b + w * c
    a, b, c = a - share * u, b - share * v, c - share * w
    length = sqrt(a * a + b * b + c * c)
    if length < ALONG:
        raise BadInput(argument, "a direction parallel to the normal", "one along the surface")
    a, b, c = a / length, b / length, c / length
    x, y, z = arrays.vector(point, 3, "point").tolist()
    rows = (a, v * c - w * b, u, x), (b, w * a - u * c, v, y), (c, u * b - v * a, w, z), (0.0, 0.0, 0.0, 1.0)
    return np.array(rows)


def _at(kind: ContactKind, pose: Array, edge: float | None = None) -> Contact:
    """A contact at a pose that needs no check."""
    contact = Contact.__new__(Contact)
    contact.__attrs_init__(kind, pose, edge)
    return contact
