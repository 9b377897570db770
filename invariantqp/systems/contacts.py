"""What a contact allows: a kind (freedom twists S, constraint wrenches W, W'S = 0) at a pose, both moved together.

    point    S: 3 rotations, 2 slides      W: press           rolling: S: 3 rotations
    line     S: 2 rotations, 2 slides      W: press, 1 moment rolling: S: rotation about the line
    face     S: 1 rotation, 2 slides       W: press, 2 moments   sticking: S: nothing, or the twist about the normal
    peg      S: rotation and slide along the axis              hinge    S: one screw

The contact's own frame has its origin at the contact and **z the way the tool presses**, against the outward normal of
the surface; x lies along a line contact. Wrenches are those that the tool exerts, so pressing is positive: five newtons
on a table are 5 of the first constraint.

Reference: [DS] Sect. 6.3; Mason 1981; Lipkin & Duffy 1988.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import inf

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.screws import helical
from invariantqp.systems.span import span
from invariantqp.systems.subspaces import annihilator

# How far W'S may be from zero relative to |W||S|: wrenches typed with six digits pass, wrong ones do not.
DUAL_TOLERANCE = 1e-6
# Central differences of an implicit surface: cbrt of the rounding error, where truncation and rounding balance.
GRADIENT_STEP = 6e-6


@dataclass(frozen=True, eq=False)
class ContactKind:
    """A contact in its own frame.

    Attributes:
        name: "point", "line", ...
        freedoms: (6, k) independent twists S that the contact allows.
        constraints: (6, 6-k) wrenches W that the tool can exert on it; None is the annihilator of S.
        unilateral: whether it can only be pressed: the first constraint is the press, and loses its hold below zero.
        out: (6,) unit twist that leads out of the contact, or None where there is no way out.
        origin: (3,) the place of contact in this frame, zero unless the frame has been put elsewhere.

    Raises:
        BadInput: NaN, shapes, dependent columns, wrenches that do work on the freedoms.
    """

    name: str
    freedoms: ArrayLike
    constraints: ArrayLike | None = None
    unilateral: bool = False
    out: ArrayLike | None = None
    origin: ArrayLike = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        S = _independent(self.freedoms, "freedoms")
        whole = S.shape[1] == 0
        natural = np.eye(6) if whole else annihilator(S)
        W = natural if self.constraints is None else _independent(self.constraints, "constraints")
        if S.shape[1] + W.shape[1] != 6:
            raise BadInput("constraints", f"{W.shape[1]} wrenches", f"{6 - S.shape[1]}, S has {S.shape[1]} twists")
        work = np.abs(W.T.dot(S))
        if (work > DUAL_TOLERANCE * np.abs(W).T.dot(np.abs(S)).max(initial=0.0)).any():
            raise BadInput("constraints", f"wrenches that do work on the freedoms (W'S up to {work.max():.3g})", "none")
        object.__setattr__(self, "freedoms", S)
        object.__setattr__(self, "constraints", W)
        object.__setattr__(self, "out", None if self.out is None else arrays.twist(self.out, "out"))
        object.__setattr__(self, "origin", arrays.vector(self.origin, 3, "origin"))

    def relabelled(self, offset: ArrayLike) -> ContactKind:
        """The same physical contact told in a frame displaced by a (4, 4) offset in the old one."""
        back = se3.inverse(offset)
        A, B = se3.carried(back), se3.coadjoint(back)
        out = None if self.out is None else A.dot(np.asarray(self.out))
        origin = back[:3, :3].dot(np.asarray(self.origin)) + back[:3, 3]
        freedoms, constraints = A.dot(np.asarray(self.freedoms)), B.dot(np.asarray(self.constraints))
        return ContactKind(self.name, freedoms, constraints, self.unilateral, out, origin)


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
        twists: Array = se3.carried(self.pose).dot(np.asarray(self.kind.freedoms))
        return twists

    @cached_property
    def constraints(self) -> Array:
        """(6, 6-k) wrenches that the tool can exert on the contact; none does work on any freedom."""
        wrenches: Array = se3.carried_wrenches(self.pose).dot(np.asarray(self.kind.constraints))
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


def _independent(columns: ArrayLike, argument: str) -> Array:
    a = arrays.system(columns, argument)
    if a.shape[1] and span(a).rank < a.shape[1]:
        raise BadInput(argument, f"{a.shape[1]} columns of rank {span(a).rank}", "independent columns")
    return a


def _kind(name: str, freedoms: str, constraints: str) -> ContactKind:
    """A unilateral kind from coordinate names: rx for a turn about x, mx for a moment, x for a slide or a force."""
    names = {"rx": 0, "ry": 1, "rz": 2, "mx": 0, "my": 1, "mz": 2, "x": 3, "y": 4, "z": 5}
    E = np.eye(6)
    S, W = (E[:, [names[n] for n in text.split()]] for text in (freedoms, constraints))
    return ContactKind(name, S, W, unilateral=True, out=-E[5])


POINT = _kind("point", "rx ry rz x y", "z")
ROLLING_POINT = _kind("rolling point", "rx ry rz", "z x y")
LINE = _kind("line", "rx rz x y", "z my")
ROLLING_LINE = _kind("rolling line", "rx", "z my x y mz")
FACE = _kind("face", "rz x y", "z mx my")
PIVOTING_FACE = _kind("pivoting face", "rz", "z mx my x y")
STICKING_FACE = _kind("sticking face", "", "z mx my x y mz")
PEG = ContactKind("peg", np.eye(6)[:, [2, 5]], np.eye(6)[:, [3, 4, 0, 1]], out=-np.eye(6)[5])


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
    return Contact(_screw(float(pitch)), _frame(point, -arrays.direction(axis, "axis"), None))


@lru_cache(maxsize=16)
def _screw(pitch: float) -> ContactKind:
    E = np.eye(6)
    W = E[:, [3, 4, 0, 1, 5]].copy()
    W[2, 4] = -pitch  # m + pitch f = 0 along the axis
    if abs(pitch) == inf:
        W[:, 4] = E[2]
    return ContactKind("hinge", helical([0.0, 0.0, 1.0], pitch=pitch), W)


def _frame(point: ArrayLike, normal: ArrayLike, tangent: ArrayLike | None) -> Array:
    """The contact's own frame: z against the outward normal, x along the tangent as far as the surface allows."""
    z = -arrays.direction(normal, "normal")
    along = np.eye(3)[int(np.abs(z).argmin())] if tangent is None else arrays.direction(tangent, "tangent")
    x = along - z * z.dot(along)
    if x.dot(x) < DUAL_TOLERANCE**2:
        raise BadInput("tangent", "a direction along the normal", "one that lies in the surface")
    x = x / np.sqrt(x.dot(x))
    T = np.eye(4)
    T[:3, :3] = np.column_stack((x, np.cross(z, x), z))
    T[:3, 3] = arrays.vector(point, 3, "point")
    return T
