"""Order, sign, weight and mount of a wrench sensor from readings without contact.

    forces    f_k = b_f + a g_k,         a = m for reactions, -m for actions,   g_k gravity in the sensor's frame
    moments   m_k = b_m + d x g_k,       d = a c

Both are linear in their unknowns.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from invariantqp.errors import written
from invariantqp.force.wrench import Order
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array

# A fit explains the readings if it leaves less than this share of their variation.
EXPLAINED = 0.1
# Tolerances of the declared values: an angle of the mount [rad], a share of the mass.
TURNED = 0.1
MASS_SHARE = 0.2
# Variations of a force below this are noise [N].
NO_FORCE = 1e-6
# Noise of a moment over that of a force [length]: ranges of wrist sensors have ratios of 0.05 to 0.1 m.
LEVER = 0.05


class FreeAir(NamedTuple):
    """A sensor that explains readings without contact, as `WrenchSensor` declares it."""

    order: Order
    reads: Literal["reaction", "action"]
    mass: float
    centre: Array
    bias: Array
    turn: float  # angle between the sensor's frame and the declared mount [rad]
    unexplained: tuple[float, float]  # shares of the variation of forces and moments

    def differences(self, order: str | None, reads: str, mass: float) -> list[str]:
        """The differences from the declared sensor, in words."""
        found = []
        if order is not None and self.order != order:
            found.append(f"its order is {self.order!r}, not {order!r}")
        if self.reads != reads:
            found.append(f"it reads the {self.reads}, not the {reads}")
        if self.turn > TURNED:
            found.append(f"its frame is turned by {written(np.degrees(self.turn), 3)} deg from mount")
        if abs(self.mass - mass) > MASS_SHARE * self.mass:
            found.append(f"{written(self.mass)} kg hang on it, not {written(mass)}")
        if self.unexplained[1] > EXPLAINED and not found:
            found.append("its moments fit no centre of mass")
        return found


def gravity_spread(gravity: Array) -> float:
    """The second largest singular value of the variation of gravity (n, 3) in the sensor's frame, relative."""
    sizes = np.linalg.svd(gravity - gravity.mean(axis=0), compute_uv=False)
    return float(sizes[1] / np.sqrt(len(gravity)) / np.linalg.norm(gravity[0])) if len(sizes) > 1 else 0.0


def identify_sensor(readings: Array, gravity: Array) -> FreeAir | None:
    """The sensor that explains readings (n, 6), gravity (n, 3) in its frame [length/s^2]; None if no order does."""
    first, last = readings[:, :3], readings[:, 3:]
    found = [_fit("moment first", first, last, gravity), _fit("force first", last, first, gravity)]
    best = min(found, key=lambda fit: fit.unexplained[0])
    return best if best.unexplained[0] < EXPLAINED else None


def _fit(order: Order, moments: Array, forces: Array, gravity: Array) -> FreeAir:
    n = len(gravity)
    f, g = forces - forces.mean(axis=0), gravity - gravity.mean(axis=0)
    scale = float(np.vdot(f, f))
    a = float(np.vdot(f, g) / np.vdot(g, g))
    left = float(np.vdot(f - a * g, f - a * g)) / scale if scale > n * NO_FORCE**2 else np.inf
    turn, mean, g_declared = 0.0, gravity.mean(axis=0), g
    if left >= EXPLAINED and np.isfinite(left):  # the mount may be declared wrong
        from scipy.spatial.transform import Rotation  # 0.1 s to import

        for sign in (1.0, -1.0):
            R, _ = Rotation.align_vectors(f, sign * g_declared)
            turned = g_declared.dot(R.as_matrix().T)
            b = float(np.vdot(f, turned) / np.vdot(g, g))
            rest = float(np.vdot(f - b * turned, f - b * turned)) / scale
            if rest < min(left, EXPLAINED):
                left, turn, a, g, mean = rest, float(R.magnitude()), b, turned, R.apply(gravity.mean(axis=0))
    # m_k - mean = d x g_k: linear in d.
    m = moments - moments.mean(axis=0)
    A = -np.concatenate([se3.cross_matrix(row) for row in g])
    d = np.linalg.lstsq(A, m.ravel(), rcond=None)[0]
    missed = m.ravel() - A.dot(d)
    moment_left = max(float(missed.dot(missed)) - LEVER * LEVER * left * scale, 0.0)
    size = float(np.vdot(m, m))
    bias_f = forces.mean(axis=0) - a * mean
    bias_m = moments.mean(axis=0) - se3.cross(d, mean)
    return FreeAir(
        order=order,
        reads="reaction" if a > 0.0 else "action",
        mass=abs(a),
        centre=d / a if a != 0.0 else np.zeros(3),
        bias=np.concatenate((bias_m, bias_f)),
        turn=turn,
        unexplained=(left, moment_left / size if size > 0.0 else 0.0),
    )
