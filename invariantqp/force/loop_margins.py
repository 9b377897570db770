"""Stability margins of the force law.

    L(s) = g (1 + 1/(Ti s)) / (1 + tau s) * (k + b s)/s * exp(-T s)

k and b are stiffness and damping of the contact, arm in series included; T is the delay of the whole loop: tick,
low-pass of the sensor, dead time, and lag of the joints.
"""

from __future__ import annotations

from math import inf, pi
from typing import NamedTuple

import numpy as np

from invariantqp.engine import law
from invariantqp.geometry import arrays

# Frequencies in units of 1/T.
FREQUENCIES = np.geomspace(1e-4, 1e3, 20_000)


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
    g, tau, Ti = law.force_gains(most, damped, delay)
    w = FREQUENCIES / delay
    size = g * np.hypot(1.0, 1.0 / (w * Ti)) / np.hypot(1.0, w * tau) * np.hypot(stiffness, damping * w) / w
    # The phase is written out: the angle of L would leave out whole turns of the delay.
    phase = -pi - w * delay + np.arctan(w * Ti) - np.arctan(w * tau) + np.arctan2(damping * w, stiffness)
    crossing = -pi + 2.0 * pi * (np.ceil((phase[:-1] + pi) / (2.0 * pi)) - 1.0)  # the next one below
    i = np.flatnonzero((phase[1:] < crossing) & (phase[:-1] > crossing))
    share = (phase[i] - crossing[i]) / (phase[i] - phase[i + 1])
    gain = 1.0 / (size[i] * (size[i + 1] / size[i]) ** share)
    j = np.flatnonzero((size[1:] - 1.0) * (size[:-1] - 1.0) <= 0.0)
    at_one = phase[j] + np.log(size[j]) / np.log(size[j] / size[j + 1]) * (phase[j + 1] - phase[j])
    margin = np.degrees(np.abs((at_one + 2.0 * pi) % (2.0 * pi) - pi))
    sensitivity = float((1.0 / np.abs(1.0 + size * np.exp(1j * phase))).max())
    return Margins(float(gain.min(initial=inf)), float(margin.min(initial=inf)), sensitivity, g, tau, Ti)
