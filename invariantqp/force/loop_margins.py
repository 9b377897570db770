"""The margins of the force law for a contact and a lateness of one's own.

    L(s) = g (1 + 1/(Ti s)) / (1 + tau s) * (k + b s)/s * exp(-T s)

k and b are the contact's stiffness and damping, arm in series included; T is everything late in the loop: tick,
low-pass of the sensor, dead time, and lag of the joints.
"""

from __future__ import annotations

from math import degrees
from typing import NamedTuple

from invariantqp.engine import law
from invariantqp.geometry import arrays


class Margins(NamedTuple):
    """Margins of the force loop, and the gains that have them.

    Attributes:
        gain: by which factor the loop gain may grow before the loop is unstable.
        phase: phase margin [deg].
        sensitivity: Ms, the largest |1/(1 + L)|.
        g, tau, Ti: of the law [length/s per N, s, s].
    """

    gain: float
    phase: float
    sensitivity: float
    g: float
    tau: float
    Ti: float


def margins(
    k: float, b: float = 0.0, T: float = 0.02, *, k_bound: float | None = None, b_bound: float | None = None
) -> Margins:
    """The margins on a contact of stiffness k and damping b, with T late.

    Args:
        k: true stiffness [N/length].
        b: true damping [N s/length].
        T: everything late [s].
        k_bound: the stiffness that the law is designed for, an upper bound; None is k.
        b_bound: likewise; None is b.

    Raises:
        BadInput: numbers that are not positive.
    """
    stiffness, late = arrays.number(k, "k", "N/m", positive=True), arrays.number(T, "T", "s", positive=True)
    damping = arrays.not_negative(b, "b", "N s/m")
    most = stiffness if k_bound is None else arrays.number(k_bound, "k_bound", "N/m", positive=True)
    damped = damping if b_bound is None else arrays.not_negative(b_bound, "b_bound", "N s/m")
    made = law.force_gains(most, damped, late)
    gain, phase, sensitivity = law.force_margins(*made, stiffness, damping, late)
    return Margins(gain, degrees(phase), sensitivity, *made)
