"""Contacts: kinds of contact, a contact as a kind at a pose in the base frame, and functions that make them.

    S = Ad(pose) S_kind,    W = Ad*(pose) W_kind,    W'S = 0 at every pose

A kind is given by its freedoms S (twists) and constraints W (wrenches) in its own frame:

    point    S: 3 rotations, 2 slides      W: press                rolling: S: 3 rotations
    line     S: 2 rotations, 2 slides      W: press, 1 moment      rolling: S: rotation about the line
    face     S: 1 rotation, 2 slides       W: press, 2 moments     sticking: S: nothing, or the turn about the normal
    peg      S: rotation and slide along the axis                  hinge: S: one screw
    ball     S: 3 rotations                W: 3 forces

The origin of the frame is at the contact. **z points along the press**, against the outward normal of the surface; x
lies along a line contact. Wrenches are those that the tool exerts: a press of 5 N is 5 times the first constraint.

Reference: [DS] Sect. 6.3; Mason 1981; Lipkin & Duffy 1988.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache
from math import inf, isinf

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.engine import law
from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.screws import helical
from invariantqp.geometry.sizes import LENGTH_LIMIT
from invariantqp.systems.subspaces import Subspace, annihilator

# Contacts are given with six digits: tolerance of W'S over |W||S|, of the angle of a tangent to the normal, and of
# the sum of two outward twists.
SIX_DIGITS = 1e-6
# Relative step of central differences, for which truncation and rounding errors are equal.
GRADIENT_STEP = float(np.cbrt(np.finfo(float).eps))


@frozen(init=False, eq=False, repr=False, slots=False)
class ContactKind(Value):
    """A contact in its own frame.

    Attributes:
        name: "point", "line", ...
        freedoms: (6, k) independent twists S that the contact allows.
        constraints: (6, 6-k) wrenches W that the tool can exert on it.
        presses: number of first constraints that are unilateral: the tool can press but not pull. 0 of a joint, 1 of a
            tool on a surface, 2 of two contacts.
        out: (6,) unit twist that leaves the contact, or None.
        origin: (3,) the place of contact in this frame; zero unless the frame was displaced.
    """

    name: str
    freedoms: Array = field(converter=own)
    constraints: Array = field(converter=own)
    presses: int
    out: Array | None = field(converter=optional(own))
    origin: Array = field(converter=own)

    def __init__(
        self,
        name: str,
        freedoms: ArrayLike,
        constraints: ArrayLike | None = None,
        presses: int = 0,
        out: ArrayLike | None = None,
        origin: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """A kind of contact from its freedoms; None for constraints is a basis of the wrenches that do no work on them.

        Raises:
            BadInput: dependent columns, wrenches that do work on the freedoms, more presses than constraints.
        """
        S = _independent(freedoms, "freedoms")
        W = annihilator(S) if constraints is None else _independent(constraints, "constraints")
        if S.shape[1] + W.shape[1] != 6:
            raise BadInput("constraints", f"{W.shape[1]} wrenches", f"{6 - S.shape[1]}, S has {S.shape[1]} twists")
        work = np.abs(W.T.dot(S))
        m, f, w, v = (np.linalg.norm(part, axis=0) for part in (W[:3], W[3:], S[:3], S[3:]))
        largest = (np.outer(m, w) + np.outer(f, v)).max(initial=0.0)
        if (work > SIX_DIGITS * largest).any():
            raise BadInput("constraints", f"wrenches that do work on the freedoms (W'S up to {work.max():.3g})", "none")
        count = arrays.count(presses, "presses", W.shape[1])
        way_out = None if out is None else arrays.twist(out, "out")
        self.__attrs_init__(name, S, W, count, way_out, arrays.vector(origin, 3, "origin"))

    def relabelled(self, offset: ArrayLike) -> ContactKind:
        """The same physical contact expressed in a frame displaced by a (4, 4) offset in the old one."""
        back = se3.inverse(arrays.pose(offset, "offset"), check=False)
        A, B = se3.adjoint(back, check=False), se3.coadjoint(back, check=False)
        out = None if self.out is None else A.dot(self.out)
        origin = back[:3, :3].dot(self.origin) + back[:3, 3]
        S, W = A.dot(self.freedoms), B.dot(self.constraints)
        return ContactKind(self.name, S, W, self.presses, out, origin)


def _independent(columns: ArrayLike, argument: str) -> Array:
    a = arrays.system(columns, argument)
    if Subspace(a).dimension < a.shape[1]:
        raise BadInput(argument, f"{a.shape[1]} columns of rank {Subspace(a).dimension}", "independent columns")
    return a


def _columns(names: str) -> Array:
    """(6, k) unit twists or wrenches of coordinates, named as for `_kind`."""
    coordinates = ("rx", "ry", "rz", "x", "y", "z")
    return np.eye(6)[:, [coordinates.index(name.replace("m", "r")) for name in names.split()]]


def _kind(name: str, freedoms: str, constraints: str) -> ContactKind:
    """A kind from coordinate names: rx for a turn about x, mx for a moment, x for a slide or a force.

    It has a press if the first constraint is along z; the outward twist is against z, if z is pressed or free.
    """
    S, W = _columns(freedoms), _columns(constraints)
    presses = int(constraints.startswith("z"))
    return ContactKind(name, S, W, presses, -_columns("z")[:, 0] if presses or "z" in freedoms.split() else None)


POINT = _kind("point", "rx ry rz x y", "z")
ROLLING_POINT = _kind("rolling point", "rx ry rz", "z x y")
LINE = _kind("line", "rx rz x y", "z my")
ROLLING_LINE = _kind("rolling line", "rx", "z my x y mz")
FACE = _kind("face", "rz x y", "z mx my")
PIVOTING_FACE = _kind("pivoting face", "rz", "z mx my x y")
STICKING_FACE = _kind("sticking face", "", "z mx my x y mz")
BALL = _kind("ball", "rx ry rz", "x y z")
PEG = _kind("peg", "rz z", "x y mx my")


@lru_cache
def screw_kind(pitch: float) -> ContactKind:
    """A screw of a pitch [length/rad] about z; inf is a slide."""
    W = _columns("x y mx my z")
    W[2, 4] = -pitch  # m + pitch f = 0 along the axis
    if isinf(pitch):
        W[:, -1:] = _columns("mz")
    name = "slide" if isinf(pitch) else "screw" if pitch else "hinge"
    return ContactKind(name, helical([0.0, 0.0, 1.0], pitch=pitch), W)


@frozen(init=False, eq=False, repr=False, slots=False)
class Contact(Value):
    """A kind of contact at a pose; freedoms and constraints are in the base frame.

    Attributes:
        kind: in its own frame.
        pose: (4, 4) of that frame.
        edge: distance of the surface's edge from the place of contact [length], negative beyond it; None is no edge.
    """

    kind: ContactKind
    pose: Array = field(converter=own)
    edge: float | None

    def __init__(self, kind: ContactKind, pose: ArrayLike, edge: float | None = None) -> None:
        """A kind of contact at a pose."""
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
        return np.asarray(self.adjoint.dot(self.kind.freedoms))

    @cached_property
    def constraints(self) -> Array:
        """(6, 6-k) wrenches that the tool can exert; none does work on any freedom."""
        return np.asarray(self.coadjoint.dot(self.kind.constraints))

    @cached_property
    def point(self) -> Array:
        """(3,) the place of contact."""
        return np.asarray(self.pose[:3, :3].dot(self.kind.origin) + self.pose[:3, 3])

    def moved(self, pose: ArrayLike) -> Contact:
        """The contact after a (4, 4) rigid motion."""
        return _at(self.kind, arrays.pose(pose).dot(self.pose), self.edge)

    def relabelled(self, offset: ArrayLike) -> Contact:
        """The same physical contact, its own frame displaced by a (4, 4) offset in that frame."""
        X = arrays.pose(offset, "offset")
        return Contact(self.kind.relabelled(X), self.pose.dot(X), self.edge)


def point_contact(
    point: ArrayLike, normal: ArrayLike, *, slip: bool = True, tangent: ArrayLike | None = None
) -> Contact:
    """A point of the tool on a surface, which slides and turns, or with slip=False only turns.

    Args:
        point: (3,) place of contact, base frame [length].
        normal: (3,) outward normal of the surface, of any length.
        slip: whether it slides.
        tangent: (3,) direction of the contact's x; None chooses one.
    """
    return _at(POINT if arrays.flag(slip, "slip") else ROLLING_POINT, contact_frame(point, normal, tangent))


def line_contact(point: ArrayLike, direction: ArrayLike, normal: ArrayLike, *, slip: bool = True) -> Contact:
    """A straight edge on a surface, which slides and turns about itself and the normal; or only about itself.

    Args:
        point: (3,) a point of the edge, about which moments are taken, base frame [length].
        direction: (3,) of the edge; its part along the normal is ignored.
        normal: (3,) outward normal of the surface.
        slip: whether it slides.
    """
    return _at(
        LINE if arrays.flag(slip, "slip") else ROLLING_LINE, contact_frame(point, normal, direction, "direction")
    )


def face_contact(
    point: ArrayLike, normal: ArrayLike, *, slip: bool = True, twist: bool = False, tangent: ArrayLike | None = None
) -> Contact:
    """A flat face on a flat surface, which slides and turns about the normal; with slip=False it sticks.

    Args:
        point: (3,) a point of the face, about which moments are taken, base frame [length].
        normal: (3,) outward normal of the surface.
        slip: whether it slides.
        twist: whether a face that does not slide still turns about the normal through `point`.
        tangent: (3,) direction of the contact's x; None chooses one.
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
        point: (3,) place of contact, base frame [length].
        normal: function from a point to the outward normal (3,).
        implicit: or a function that is zero on the surface and grows outwards; its gradient is the normal.
        slip: whether the point slides.
        extent: function from a point to the distance of the surface's edge, negative beyond it [length].

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
        ahead = [[height(p + sign * step) for sign in (1.0, -1.0)] for step in steps]
        n = arrays.direction(
            np.subtract(*arrays.array(ahead, "implicit", "a function that gives a number").T), "implicit"
        )
    contact = point_contact(p, n, slip=slip)
    if extent is None:
        return contact
    edge = arrays.function(extent, "extent", "a function of a point (3,)")(p)
    return _at(contact.kind, contact.pose, arrays.number(edge, "extent", "a function that gives a length"))


def ball_joint(point: ArrayLike) -> Contact:
    """A ball in its socket, or a tool held at one point (3,): it turns, with every force constrained."""
    return _at(BALL, contact_frame(point, [0.0, 0.0, -1.0], None))


def peg_in_hole(point: ArrayLike, axis: ArrayLike) -> Contact:
    """A round peg in its hole, which turns about the axis and slides along it.

    Args:
        point: (3,) a point of the axis, about which moments are taken, base frame [length].
        axis: (3,) direction into the hole.
    """
    return _at(PEG, contact_frame(point, -arrays.direction(axis, "axis"), None))


def hinge(point: ArrayLike, axis: ArrayLike, pitch: float = 0.0) -> Contact:
    """A door on its hinge, a nut on its bolt, a drawer (pitch inf): one free screw.

    Args:
        point: (3,) a point of the axis, base frame [length].
        axis: (3,) direction of the axis.
        pitch: translation per radian [length/rad]; inf for a slide.
    """
    expected = "a pitch [length/rad], or inf for a slide"
    h = arrays.number(pitch, "pitch", expected, infinite=True)
    if LENGTH_LIMIT < abs(h) < inf:
        raise BadInput("pitch", f"{h:.4g}, beyond any machine", expected)
    return _at(screw_kind(h), contact_frame(point, -arrays.direction(axis, "axis"), None))


def contact_frame(point: ArrayLike, normal: ArrayLike, tangent: ArrayLike | None, argument: str = "tangent") -> Array:
    """(4, 4) z against the outward normal, x along the projection of the tangent on the surface."""
    try:
        frame: Array = law.contact_frame(point, normal, tangent)
    except ValueError:
        arrays.vector(point, 3, "point")
        arrays.direction(normal, "normal")
        if tangent is not None:
            arrays.direction(tangent, argument)
        raise BadInput(argument, "a direction parallel to the normal", "one along the surface") from None
    return frame


def _at(kind: ContactKind, pose: Array, edge: float | None = None) -> Contact:
    """A contact at a pose that needs no check: the constructor's checks would take a part of a tick."""
    contact = Contact.__new__(Contact)
    pose.setflags(write=False)
    vars(contact).update(kind=kind, pose=pose, edge=edge)
    return contact


def two_contacts(first: Contact, second: Contact) -> Contact:
    """Two contacts of one tool as one, in the frame of the first, with its place of contact; presses come first.

    Contact is lost when either is, and the nearer edge counts. In a loop make it once and move it with the tool: by
    `moved`, or with an edge, which `moved` does not change, by `Contact(both.kind, pose, edge)`.

    Raises:
        BadInput: dependent constraints.
    """
    for name, contact in (("first", first), ("second", second)):
        arrays.instance(contact, Contact, name, "a Contact")
    kind = first.kind
    other = second.kind.relabelled(se3.inverse(second.pose, check=False).dot(first.pose))
    n, k = kind.presses, other.presses
    U, V = np.asarray(kind.constraints), np.asarray(other.constraints)
    W = np.hstack((U[:, :n], V[:, :k], U[:, n:], V[:, k:]))
    rank = Subspace(W).dimension
    if rank < W.shape[1]:
        found = f"a {kind.name} and a {other.name} with {W.shape[1]} wrenches of rank {rank}"
        raise BadInput("second", found, "a contact that constrains what the first leaves free")
    out = None if kind.out is None or other.out is None else kind.out + other.out
    if out is not None:
        speed = float(np.linalg.norm(se3.velocity_at(out, kind.origin)))
        out = out / speed if speed > SIX_DIGITS else None
    both = ContactKind(f"{kind.name} and {other.name}", annihilator(W), W, n + k, out, kind.origin)
    edges = [contact.edge for contact in (first, second) if contact.edge is not None]
    return Contact(both, first.pose, min(edges, default=None))
