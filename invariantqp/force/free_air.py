"""What readings in free air tell of a wrench sensor: the order of its numbers, its sign, the weight that hangs on it.

    forces    f_k = b_f + a g_k,         a = m for reactions, -m for actions,   g_k gravity in the sensor's frame
    moments   m_k = b_m + d x g_k,       d = a c, c the centre of mass

Both are linear in their unknowns. Moments read as forces do not fit a multiple of gravity, which tells the order.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from invariantqp.errors import written
from invariantqp.force.reading import Order
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array

# Directions of gravity count as different where their spread in two directions is at least this share of it.
SPREAD = 0.1
# A fit that leaves less than this share of the readings' variation explains them.
EXPLAINED = 0.1
# Found and said may differ by this: an angle of the mount [rad], a share of the mass.
TURNED = 0.1
MASS_SHARE = 0.2
# Variations of a force below this are noise [N].
NOTHING = 1e-6


class FreeAir(NamedTuple):
    """What readings in free air are explained by.

    Attributes:
        order: "moment first" or "force first".
        reads: "reaction" or "action".
        mass: of what hangs on the sensor [kg].
        centre: (3,) of it in the sensor's frame [length].
        bias: (6,) (m; f) of the unloaded sensor.
        turn: by how much the sensor's frame is turned from where it was said to be [rad].
        left: share of the readings' variation that stays unexplained, forces and moments.
    """

    order: Order
    reads: Literal["reaction", "action"]
    mass: float
    centre: Array
    bias: Array
    turn: float
    left: tuple[float, float]

    def differences(self, order: str | None, reads: str, mass: float) -> list[str]:
        """What differs from what the sensor is said to be, in words."""
        wrong = []
        if order is not None and self.order != order:
            wrong.append(f"its order is {self.order!r}, not {order!r}")
        if self.reads != reads:
            wrong.append(f"it reads the {self.reads}, not the {reads}")
        if self.turn > TURNED:
            wrong.append(f"its frame is turned by {written(np.degrees(self.turn), 3)} deg from mount")
        if abs(self.mass - mass) > MASS_SHARE * self.mass:
            wrong.append(f"{written(self.mass)} kg hang on it, not {written(mass)}")
        if self.left[1] > EXPLAINED and not wrong:
            wrong.append("its moments fit no centre of mass")
        return wrong


def spread(gravity: Array) -> float:
    """How much directions of gravity (n, 3) in the sensor's frame differ: the second largest spread, relative."""
    sizes = np.linalg.svd(gravity - gravity.mean(axis=0), compute_uv=False)
    return float(sizes[1] / np.sqrt(len(gravity)) / np.linalg.norm(gravity[0])) if len(sizes) > 1 else 0.0


def explained(readings: Array, gravity: Array) -> FreeAir | None:
    """The better of both orders; None where neither explains the readings.

    Args:
        readings: (n, 6) as the sensor gives them.
        gravity: (n, 3) in the sensor's frame [length/s^2].
    """
    first, last = readings[:, :3], readings[:, 3:]
    found = [_fit("moment first", first, last, gravity), _fit("force first", last, first, gravity)]
    best = min(found, key=lambda fit: fit.left[0])
    return best if best.left[0] < EXPLAINED else None


def _fit(order: Order, moments: Array, forces: Array, gravity: Array) -> FreeAir:
    n = len(gravity)
    f, g = forces - forces.mean(axis=0), gravity - gravity.mean(axis=0)
    scale = float(np.vdot(f, f))
    a = float(np.vdot(f, g) / np.vdot(g, g))
    left = float(np.vdot(f - a * g, f - a * g)) / scale if scale > n * NOTHING**2 else np.inf
    turn, mean = 0.0, gravity.mean(axis=0)
    if left >= EXPLAINED and np.isfinite(left):  # perhaps the sensor is not mounted as it was said
        from scipy.spatial.transform import Rotation  # a tenth of a second to import, for this alone

        for sign in (1.0, -1.0):
            R, _ = Rotation.align_vectors(f, sign * (gravity - gravity.mean(axis=0)))
            turned = (gravity - gravity.mean(axis=0)).dot(R.as_matrix().T)
            b = float(np.vdot(f, turned) / np.vdot(g, g))
            rest = float(np.vdot(f - b * turned, f - b * turned)) / scale
            if rest < min(left, EXPLAINED):
                left, turn, a, g, mean = rest, float(R.magnitude()), b, turned, R.apply(gravity.mean(axis=0))
    # m_k - mean = d x g_k: linear in d.
    m = moments - moments.mean(axis=0)
    A = -np.concatenate([se3.cross_matrix(row) for row in g])
    d = np.linalg.lstsq(A, m.ravel(), rcond=None)[0]
    missed = m.ravel() - A.dot(d)
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
        left=(left, float(missed.dot(missed)) / size if size > 0.0 else 0.0),
    )
