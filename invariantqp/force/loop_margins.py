"""Stability margins of the force law.

    L(s) = g (1 + 1/(Ti s)) / (1 + tau s) * (k + b s)/s * exp(-T s)

k and b are stiffness and damping of the contact, arm in series included; T is the delay of the whole loop: tick,
low-pass of the sensor, dead time, and lag of the joints.
"""

from __future__ import annotations

from math import degrees
from typing import NamedTuple

from invariantqp.engine import law
from invariantqp.geometry import arrays


class Margins(NamedTuple):
    """Margins of the force loop, and the gains of the law.

    Attributes:
        gain: factor by which the loop gain may grow until the loop is unstable.
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
    """The margins on a contact of stiffness k and damping b with a delay T.

    Args:
        k: true stiffness [N/length].
        b: true damping [N s/length].
        T: delay of the whole loop [s].
        k_bound: the stiffness that the law is designed for, an upper bound; None is k.
        b_bound: likewise; None is b.

    Raises:
        BadInput: numbers that are not positive.
    """
    stiffness, delay = arrays.number(k, "k", "N/m", positive=True), arrays.number(T, "T", "s", positive=True)
    damping = arrays.not_negative(b, "b", "N s/m")
    most = stiffness if k_bound is None else arrays.number(k_bound, "k_bound", "N/m", positive=True)
    damped = damping if b_bound is None else arrays.not_negative(b_bound, "b_bound", "N s/m")
    made = law.force_gains(most, damped, delay)
    gain, phase, sensitivity = law.force_margins(*made, stiffness, damping, delay)
    return Margins(gain, degrees(phase), sensitivity, *made)
