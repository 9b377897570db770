"""Kinds of contact, each by its freedoms S (twists) and constraints W (wrenches) in its own frame, W'S = 0.

    point    S: 3 rotations, 2 slides      W: press                rolling: S: 3 rotations
    line     S: 2 rotations, 2 slides      W: press, 1 moment      rolling: S: rotation about the line
    face     S: 1 rotation, 2 slides       W: press, 2 moments     sticking: S: nothing, or the turn about the normal
    peg      S: rotation and slide along the axis                  hinge: S: one screw
    ball     S: 3 rotations                W: 3 forces

The origin of the frame is at the contact. **z points the way the tool presses**, against the outward normal of the
surface; x lies along a line contact. Wrenches are those that the tool exerts, so pressing is positive: a press of five
newtons on a table is 5 times the first constraint.

Reference: [DS] Sect. 6.3; Mason 1981; Lipkin & Duffy 1988.
"""

from __future__ import annotations

from functools import lru_cache
from math import isinf

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.screws import helical
from invariantqp.systems.span import span
from invariantqp.systems.subspaces import annihilator

# How far W'S may be from zero relative to |W||S|: wrenches given with six digits pass, wrong ones do not.
DUAL_TOLERANCE = 1e-6


@frozen(init=False, eq=False, repr=False, slots=False)
class ContactKind(Value):
    """A contact in its own frame.

    Attributes:
        name: "point", "line", ...
        freedoms: (6, k) independent twists S that the contact allows.
        constraints: (6, 6-k) wrenches W that the tool can exert on it.
        unilateral: whether the tool can press but not pull: the first constraint is the press, and contact is lost
            below zero.
        presses: how many of the first constraints are presses: 0 unless unilateral, 2 for two contacts at once.
        out: (6,) unit twist that leads out of the contact, or None where there is no way out.
        origin: (3,) the place of contact in this frame; zero unless the frame has been displaced.
    """

    name: str
    freedoms: Array = field(converter=own)
    constraints: Array = field(converter=own)
    unilateral: bool
    presses: int
    out: Array | None = field(converter=optional(own))
    origin: Array = field(converter=own)

    def __init__(
        self,
        name: str,
        freedoms: ArrayLike,
        constraints: ArrayLike | None = None,
        unilateral: bool = False,  # noqa: FBT002 (a field like the others)
        out: ArrayLike | None = None,
        origin: ArrayLike = (0.0, 0.0, 0.0),
        presses: int | None = None,
    ) -> None:
        """A kind of contact from what it allows.

        Args:
            name: any.
            freedoms: (6, k) independent twists; (6, 0) for none.
            constraints: (6, 6-k) wrenches; None is a basis of all that do no work on the freedoms.
            unilateral: whether the tool can press but not pull.
            out: (6,) unit twist that leads out of the contact, if there is one.
            origin: (3,) the place of contact.
            presses: how many of the first constraints the tool can press but not pull; None is 1 if unilateral.

        Raises:
            BadInput: NaN, shapes, dependent columns, wrenches that do work on the freedoms.
        """
        pressed = arrays.flag(unilateral, "unilateral")
        S = _independent(freedoms, "freedoms")
        if constraints is None:
            W = annihilator(S) if S.shape[1] else np.eye(6)
        else:
            W = _independent(constraints, "constraints")
        if S.shape[1] + W.shape[1] != 6:
            raise BadInput("constraints", f"{W.shape[1]} wrenches", f"{6 - S.shape[1]}, S has {S.shape[1]} twists")
        work = np.abs(W.T.dot(S))
        if (work > DUAL_TOLERANCE * _powers(W, S).max(initial=0.0)).any():
            raise BadInput("constraints", f"wrenches that do work on the freedoms (W'S up to {work.max():.3g})", "none")
        if pressed and not W.shape[1]:
            raise BadInput("unilateral", "True without constraints", "a contact that can be pressed")
        count = int(pressed) if presses is None else arrays.count(presses, "presses")
        if (count > 0) != pressed or count > W.shape[1]:
            raise BadInput("presses", f"{count}", f"1 to {W.shape[1]} if unilateral, else 0")
        way_out = None if out is None else arrays.twist(out, "out")
        self.__attrs_init__(name, S, W, pressed, count, way_out, arrays.vector(origin, 3, "origin"))

    def relabelled(self, offset: ArrayLike) -> ContactKind:
        """The same physical contact expressed in a frame displaced by a (4, 4) offset in the old one."""
        return _relabelled(self, arrays.pose(offset, "offset").tobytes())


@lru_cache(maxsize=64)  # a contact that is told in another frame is made in every tick, of the same kind
def _relabelled(kind: ContactKind, offset: bytes) -> ContactKind:
    back = se3.inverse(np.frombuffer(offset).reshape(4, 4), check=False)
    A, B = se3.adjoint(back, check=False), se3.coadjoint(back, check=False)
    out = None if kind.out is None else A.dot(kind.out)
    origin = back[:3, :3].dot(kind.origin) + back[:3, 3]
    S, W = A.dot(kind.freedoms), B.dot(kind.constraints)
    return ContactKind(kind.name, S, W, kind.unilateral, out, origin, kind.presses)


def _powers(W: Array, S: Array) -> Array:
    """(6-k, k) |m||w| + |f||v|: how large W'S could be."""
    m, f, w, v = (np.linalg.norm(part, axis=0) for part in (W[:3], W[3:], S[:3], S[3:]))
    powers: Array = np.outer(m, w) + np.outer(f, v)
    return powers


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
BALL = ContactKind("ball", np.eye(6)[:, :3], np.eye(6)[:, 3:])
PEG = ContactKind("peg", np.eye(6)[:, [2, 5]], np.eye(6)[:, [3, 4, 0, 1]], out=-np.eye(6)[5])


@lru_cache(maxsize=16)
def screw_kind(pitch: float) -> ContactKind:
    """One screw of the given pitch [length/rad] about z; inf is a slide."""
    E = np.eye(6)
    W = E[:, [3, 4, 0, 1, 5]].copy()
    W[2, 4] = -pitch  # m + pitch f = 0 along the axis
    if isinf(pitch):
        W[:, 4] = E[2]
    name = "slide" if isinf(pitch) else "screw" if pitch else "hinge"
    return ContactKind(name, helical([0.0, 0.0, 1.0], pitch=pitch), W)
