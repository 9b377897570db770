"""How a kind of contact splits twists and wrenches: projectors, admittance, and the parts in its constraints."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.force.place import load_at
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.systems.contacts import ContactKind
from invariantqp.systems.projectors import DualProjectors, dual_projectors

# The compliance that is scaled where none is given [length/s/force]; only its ratios matter.
UNKNOWN = 1e-3
# What holds a thing, fingers and arm, yields to moments as over this many sizes of the contact: one gain is for both,
# and for what is stiffest. With one size a stiff hinge's moments slow down what yields to its forces.
HELD = 2.0
# A press below zero by less than this share of a wrench is none: a wrench may come from another frame.
ROUNDING = 1e-9


class Split(NamedTuple):
    """What a task needs of one kind of contact, in the contact's own frame.

    Attributes:
        kind: of contact.
        projectors: P and P*.
        admittance: (6, 6) (I - P) C (I - P)', from a wrench error to the twist that reduces it.
        intensities: (6-k, 6), from a wrench to its parts in the constraints.
        compliance: of the press, the first constraint: W_1'C W_1 [length/s/force]; 0 without constraints.
        load: force and moment about the place of contact of the task's own wanted wrench [force, force length].
        unit: (6-k, 6) twice, L'b of a wrench Wb and L^-1 W' of a twist, with W'C W = L L'.
    """

    kind: ContactKind
    projectors: DualProjectors
    admittance: Array
    intensities: Array
    compliance: float
    load: tuple[float, float] = (0.0, 0.0)
    unit: tuple[Array, Array] = (np.zeros((0, 6)), np.zeros((0, 6)))

    def wanted(self, wrench: Array, argument: str = "wrench") -> Array:
        """(6,) W_d in S*, from parts in the constraints or from a wrench.

        Raises:
            BadInput: neither as many numbers as constraints, nor six; a pull, where a contact only presses.
        """
        W = np.asarray(self.kind.constraints)
        n, found = W.shape[1], len(wrench)
        if found not in (n, 6):
            expected = f"{n}, one a constraint of a {self.kind.name}, or a (6,) wrench"
            raise BadInput(argument, f"{found} number{'s' if found != 1 else ''}", expected)
        parts = self.intensities.dot(wrench) if found == 6 else wrench
        press = min(parts[: self.kind.presses].tolist(), default=0.0)
        if press < -ROUNDING * sqrt(wrench.dot(wrench)):
            expected = "zero or more: the contact's z is the way the tool presses"
            raise BadInput(argument, f"a press of {press:g}", expected, "A contact that pulls is not unilateral.")
        exert: Array = W.dot(parts)
        return exert


def split_of(
    kind: ContactKind,
    wrench: Array,
    compliance: Array | None,
    grip: Array,
    size: float,
    rule: tuple[float | None, Array | None, Array | None],
) -> Split:
    """The split of a kind of contact, all in its own frame.

    Args:
        kind: of contact.
        wrench: what to exert, as `HybridTask` has it.
        compliance: (6, 6) C; None is the same in all directions about the grip, over HELD sizes without a press.
        grip: (3,) [length].
        size: over what length the contact spreads [length].
        rule: h, complement (6, 6-k) and metric (6, 6), one of them or none: Z = C W then.

    Raises:
        BadInput, NoProjectors: they do not fit this contact.
    """
    W, C = np.asarray(kind.constraints), compliance
    if C is None:
        place = se3.adjoint(se3.transform(None, grip), check=False)
        C = place.dot(compliance_of(UNKNOWN, size if kind.presses else HELD * size)).dot(place.T)
    h, complement, metric = rule
    if h is None and metric is None and complement is None:
        complement = C.dot(W)
    projectors = dual_projectors(np.asarray(kind.freedoms), h=h, complement=complement, metric=metric)
    Z, F = projectors.complement, projectors.force
    parts = np.linalg.solve(Z.T.dot(W), Z.T) if W.shape[1] else np.zeros((0, 6))
    press = float(W[:, 0].dot(C).dot(W[:, 0])) if W.shape[1] else 0.0
    if compliance is None and kind.presses == 0 and W.shape[1]:
        press = UNKNOWN  # of a force through the grip
    L: Array = np.linalg.cholesky(W.T.dot(C).dot(W))
    split = Split(
        kind, projectors, F.T.dot(C).dot(F), parts, press, unit=(L.T.dot(parts), np.asarray(np.linalg.solve(L, W.T)))
    )
    return split._replace(load=load_at(split.wanted(wrench), np.asarray(kind.origin)))


def compliance_of(value: ArrayLike, size: float) -> Array:
    """(6, 6) C from one number, six or a matrix.

    Raises:
        BadInput: something else.
    """
    c = arrays.array(value, "compliance", "a number, 6 numbers or a (6, 6) matrix")
    if c.ndim == 0:
        one = arrays.number(float(c), "compliance", "a speed per newton", positive=True)
        c = np.repeat((one / size**2, one), 3)
    return arrays.positive_definite(c, 6, "compliance")
