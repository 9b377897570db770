"""How a kind of contact splits twists and wrenches: projectors, admittance, and the parts in its constraints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.errors import BadInput
from invariantqp.geometry.arrays import Array
from invariantqp.systems.contact_kinds import ContactKind
from invariantqp.systems.projectors import DualProjectors


class Split(NamedTuple):
    """What a task needs of one kind of contact, in the contact's own frame.

    Attributes:
        kind: of contact.
        projectors: P and P*.
        admittance: (6, 6) (I - P) C (I - P)', from a wrench error to the twist that reduces it.
        intensities: (6-k, 6), from a wrench to its parts in the constraints.
        compliance: of the press, the first constraint: W_1'C W_1 [length/s/force]; 0 without constraints.
        load: force and moment about the place of contact of the task's own wanted wrench [force, force length].
    """

    kind: ContactKind
    projectors: DualProjectors
    admittance: Array
    intensities: Array
    compliance: float
    load: tuple[float, float] = (0.0, 0.0)

    def wanted(self, wrench: Array, argument: str = "wrench") -> Array:
        """(6,) W_d in S*, from parts in the constraints or from a wrench.

        Raises:
            BadInput: neither as many numbers as constraints, nor six.
        """
        W = np.asarray(self.kind.constraints)
        n, found = W.shape[1], len(wrench)
        if found == 6:
            whole: Array = self.projectors.force.dot(wrench)
            return whole
        if found != n:
            expected = f"{n}, one a constraint of a {self.kind.name}, or a (6,) wrench"
            raise BadInput(argument, f"{found} number{'s' if found != 1 else ''}", expected)
        press = min(wrench[: self.kind.presses].tolist(), default=0.0)
        if press < 0.0:
            expected = "zero or more: the contact's z is the way the tool presses"
            raise BadInput(argument, f"a press of {press:g}", expected, "A contact that pulls is not unilateral.")
        parts: Array = W.dot(wrench)
        return parts
