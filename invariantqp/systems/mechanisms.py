"""Constraint wrenches of limbs, and freedoms and mobility of parallel mechanisms.

    constraints of a limb = wrenches that do no work on its joint twists
    freedoms of the platform = meet of the limbs' systems
    mobility = dim(meet) + sum of the limbs' self-motions,   overconstraints = sum of constraints - (6 - dim(meet))

All of it is instantaneous: a mechanism may lose or gain a freedom as it moves.

Reference: K. H. Hunt, Kinematic Geometry of Mechanisms, 1978; X. Kong and C. Gosselin, Type Synthesis of Parallel
Mechanisms, 2007 (wrench systems of limbs); Z. Huang, Q. Li and H. Ding, Theory of Parallel Mechanisms, 2013.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from math import inf
from typing import Literal

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, listed, written
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.screws import screw_of
from invariantqp.geometry.se3 import SWAPPED, adjoint, inverse
from invariantqp.systems.classification import classify
from invariantqp.systems.subspaces import TOLERANCE, Subspace

_NAMES = {"twist": ("rotation", "screw", "translation"), "wrench": ("force", "wrench", "couple")}


@frozen(eq=False, repr=False, slots=False)
class NamedScrew(Value):
    """A freedom or a constraint, classified by its pitch; `str()` describes it in words.

    Attributes:
        kind: "rotation", "screw" or "translation" of a twist; "force", "wrench" or "couple" of a wrench.
        screw: (6,) the unit twist (omega; v) or wrench (m; f).
        pitch: 0 for a rotation and a force, inf for a translation and a couple [length/rad; length].
        direction: (3,) unit.
        point: (3,) of the axis, the nearest to the origin; None for a translation and a couple.
    """

    kind: str
    screw: Array = field(converter=own)
    pitch: float
    direction: Array = field(converter=own)
    point: Array | None = field(converter=optional(own))

    def __str__(self) -> str:
        along = f"({listed(self.direction)})"
        if self.point is None:
            return f"{self.kind} {'along' if self.kind == 'translation' else 'about'} {along}"
        pitch = f" of pitch {written(self.pitch)}" if self.pitch else ""
        preposition = "about" if self.kind == "rotation" else "along"
        return f"{self.kind}{pitch} {preposition} {along} through ({listed(self.point)})"


@frozen(eq=False, repr=False, slots=False)
class Mobility(Value):
    """Freedoms, constraints and mobility of a parallel mechanism in one position.

    Attributes:
        freedoms: independent motions of the platform.
        constraints: for each limb its independent constraint wrenches on the platform.
        degrees_of_freedom: of the whole mechanism, self-motions of limbs included.
        overconstraints: number of redundant constraints.
        twists: (6, k) a basis of the platform's motions.
    """

    freedoms: tuple[NamedScrew, ...]
    constraints: tuple[tuple[NamedScrew, ...], ...]
    degrees_of_freedom: int
    overconstraints: int
    twists: Array = field(converter=own)

    def __str__(self) -> str:
        head = f"{self.degrees_of_freedom} degrees of freedom, {self.overconstraints} redundant constraints"
        limbs = (f"limb {i}: {', '.join(map(str, limb)) or 'none'}" for i, limb in enumerate(self.constraints))
        return "\n".join((head, f"platform: {', '.join(map(str, self.freedoms)) or 'held'}", *limbs))


def limb_constraints(J: ArrayLike, tolerance: float = TOLERANCE) -> tuple[NamedScrew, ...]:
    """A basis of the constraint wrenches of a limb on the platform at its end.

    Args:
        J: (6, n) joint twists of the limb in its present position, one frame for all limbs; (6, 0) is a rigid limb.
        tolerance: relative error of the twists, within which pitches and angles count as zero.
    """
    return _constraints(Subspace(J, tolerance=tolerance))


def mobility(limbs: Sequence[ArrayLike], tolerance: float = TOLERANCE) -> Mobility:
    """Freedoms, constraints and mobility of a platform on limbs, each given as `limb_constraints` takes it."""
    given = arrays.sequence(limbs, "limbs", "a list of (6, n) joint twists, one a limb")
    if not given:
        raise BadInput("limbs", "no limbs", "at least one")
    systems = [Subspace(J, tolerance=tolerance, argument=f"limbs[{i}]") for i, J in enumerate(given)]
    platform = reduce(Subspace.meet, systems)
    self_motions = sum(s.twists.shape[1] - s.dimension for s in systems)
    constraints = sum(6 - s.dimension for s in systems)
    return Mobility(
        freedoms=_named(Subspace(platform.basis, tolerance=tolerance), "twist"),
        constraints=tuple(_constraints(limb) for limb in systems),
        degrees_of_freedom=platform.dimension + self_motions,
        overconstraints=constraints - (6 - platform.dimension),
        twists=platform.basis,
    )


def _constraints(limb: Subspace) -> tuple[NamedScrew, ...]:
    return _named(Subspace(limb.annihilator()[SWAPPED], tolerance=limb.tolerance, length=limb.length), "wrench")


def _named(system: Subspace, sort: Literal["twist", "wrench"]) -> tuple[NamedScrew, ...]:
    """A basis of a system along the axes of its normal form, or its reciprocal's; wrenches as twists Q_0 w."""
    k = system.dimension
    if k == 0:
        return ()
    if k == 6:
        pose, basis = np.eye(4), np.eye(6)
        pose[:3, 3] = system.point
    else:
        kind = classify(system)
        pose, basis = inverse(kind.motion), kind.normal_form
        if kind.reciprocal:
            basis = _reciprocal_of_normal_form(basis)
    smallest = system.tolerance * system.length
    return tuple(_name(pose, s, smallest, sort) for s in basis.T)


def _name(pose: Array, local: Array, smallest: float, sort: Literal["twist", "wrench"]) -> NamedScrew:
    """The named screw of a twist in a frame; pitches up to `smallest` are zero."""
    h = local[:3].dot(local[3:]) / local[:3].dot(local[:3]) if local[:3].any() else inf
    if abs(h) <= smallest:
        local, h = np.concatenate((local[:3], local[3:] - h * local[:3])), 0.0
    s = adjoint(pose, check=False).dot(local)
    direction = s[:3] if h < inf else s[3:]
    s /= np.linalg.norm(direction) * np.sign(direction[np.abs(direction).argmax()])
    found = screw_of(s)
    kind = _NAMES[sort][0 if h == 0.0 else 2 if h == inf else 1]
    return NamedScrew(kind, s[SWAPPED] if sort == "wrench" else s, float(h), found.direction, found.point)


def _reciprocal_of_normal_form(R: Array) -> Array:
    """Sparse basis (6, 6-n) of the reciprocal system of a normal form of one or two columns.

    Each column gives one equation for (v; omega); its first unknown follows from the others.
    """
    equations = R.T  # R'Q_0 t = 0 with the unknowns in the order v, omega
    solved = [int(np.flatnonzero(row)[0]) for row in equations]
    free = [i for i in range(6) if i not in solved]
    basis = np.zeros((6, len(free)))
    for column, i in zip(basis.T, free, strict=True):
        column[i] = 1.0
        for row, at in zip(equations, solved, strict=True):
            column[at] = -row[i] / row[at]
    return np.asarray(basis[SWAPPED])
