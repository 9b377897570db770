"""A report on the joint twists of an arm, in numbers and words: rank, type, principal pitches, blind directions.

Reference: [DS] Sect. 3, 5.
"""

from __future__ import annotations

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import listed, written
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.systems.classification import GibsonHunt, classify
from invariantqp.systems.gram import pencil
from invariantqp.systems.subspaces import Subspace, as_system


@frozen(eq=False, repr=False, slots=False)
class SystemReport(Value):
    """Rank, type, principal pitches and blind directions of (6, m) joint twists.

    Attributes:
        joints: m.
        rank: dimension of the span, at the tolerance of the type.
        type: the Gibson-Hunt type, with moduli, normal form and margin.
        principal_pitches: (k',) ascending pitches without a pseudoinverse [length/rad]; empty if every pitch works, or
            none does.
        principal_screws: (6, k') their screws.
        blind_directions: (6, b) unit translations that are reciprocal to the whole system, as close to the axes of the
            frame as possible; b > 0 iff no h works.
        singularity_distance: smallest over largest singular value of the twists in own coordinates, so the same in
            every frame and unit; 0 in a singularity.
    """

    joints: int
    rank: int
    type: GibsonHunt
    principal_pitches: Array = field(converter=own)
    principal_screws: Array = field(converter=own)
    blind_directions: Array = field(converter=own)
    singularity_distance: float

    @property
    def singular(self) -> bool:
        """Whether the rank is lower than the number of joints, or than 6 with more joints."""
        return self.rank < min(6, self.joints)

    def __str__(self) -> str:
        return "\n".join(self.sentences())

    def sentences(self) -> tuple[str, ...]:
        """The report in words, one result a sentence."""
        t = self.type
        lost = f"singular, {min(6, self.joints) - self.rank} direction(s) of motion lost"
        away = f"regular, {self.singularity_distance:.3g} away from a singularity (0 singular, 1 isotropic)"
        joints = f"{self.joints} joint{'s' if self.joints != 1 else ''}, rank {self.rank}"
        moduli = ", ".join(f"{n} = {written(x, 6)}" for n, x in zip(t.modulus_names, t.moduli, strict=True))
        whose = f"the reciprocal of a {6 - t.dimension}-system of" if t.reciprocal else "of"
        kind = f"A {t.dimension}-system, {whose} type {t.name}{f' ({moduli})' if moduli else ''}."
        if t.dimension == 6:
            kind = "The joints move the tool in every direction; such a system has no type."
        use = "Every pitch h works."
        if self.blind_directions.shape[1]:
            along = "; ".join(f"({listed(v)})" for v in self.blind_directions[3:].T)
            use = (
                f"No pitch h works: every pitch form is blind to translation along {along}. "
                "Use Complement(Z), Z the twists that may be given up, or CarriedMetric, a metric carried by a body."
            )
        elif len(self.principal_pitches):
            pitches = listed(self.principal_pitches, 6)
            use = f"Stay away from the principal pitches h = {pitches} (length/rad): there no pseudoinverse exists."
        sentences = (f"{joints}: {lost if self.singular else away}.", kind, use)
        if not t.near_border:
            return sentences
        b = t.borders[0]
        size = f"the {b.quantity} has size {b.value:.3g}, a factor {t.margin:.3g} from {b.tolerance:.3g}"
        return (*sentences, f"Close to type {t.next}: {size}.")


def describe(J: ArrayLike | Subspace) -> SystemReport:
    """Report on (6, m) joint twists."""
    system = as_system(J)
    kind, principal = classify(system), pencil(system)
    joints = system.twists.shape[1]
    return SystemReport(
        joints=joints,
        rank=kind.dimension,
        type=kind,
        principal_pitches=principal.values,
        principal_screws=principal.screws,
        blind_directions=along_axes(principal.blind),
        singularity_distance=0.0 if kind.dimension < min(6, joints) else system.independence,
    )


def along_axes(blind: Array) -> Array:
    """An orthonormal basis of the same (6, b) translations, as close to the axes of the frame as possible."""
    projector = blind[3:].dot(blind[3:].T)
    basis = np.zeros_like(blind)
    for i in range(blind.shape[1]):
        nearest = projector[:, int(np.diag(projector).argmax())]
        basis[3:, i] = nearest / np.linalg.norm(nearest)
        projector = projector - np.outer(basis[3:, i], basis[3:, i])
    return basis
