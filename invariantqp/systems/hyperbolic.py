"""Hyperbolic singular values: singular values of J that are the same in every frame.

    J'Q_h J v_i = mu_i M v_i,   v_i'M v_j = delta_ij,   sigma_i = sign(mu_i) sqrt|mu_i|,   t_i = J v_i

The mu_i depend on the joint positions, h and the joint metric M alone, where ordinary singular values change with the
origin of the frame; the twists t_i move with the arm. Q_h is indefinite, so mu_i and sigma_i can be negative. At rank 6
the product of the |sigma_i| is sqrt det(J M^-1 J'), for every h.

Reference: asked for in [DS] Sect. 7.
"""

from __future__ import annotations

from math import inf

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch
from invariantqp.systems.gram import gram_matrix
from invariantqp.systems.span import span


@frozen(eq=False, repr=False, slots=False)
class HyperbolicSpectrum(Value):
    """Generalised eigenvalues of (J'Q_h J, M) and their directions, |mu| descending.

    Attributes:
        h: the pitch [length/rad].
        rank: rank of J; the last m - rank values are zero because joints are dependent.
        values: (m,) mu_i [length, over the metric's unit].
        joint_directions: (m, m) v_i as columns, M-orthonormal.
        twists: (6, m) t_i = J v_i, mutually h-reciprocal.
    """

    h: float
    rank: int
    values: Array = field(converter=own)
    joint_directions: Array = field(converter=own)
    twists: Array = field(converter=own)

    @property
    def singular_values(self) -> Array:
        """(m,) sign(mu) sqrt|mu|."""
        return np.asarray(np.sign(self.values) * np.sqrt(np.abs(self.values)))

    @property
    def condition(self) -> float:
        """Largest over smallest |sigma_i| of the first `rank`; 1e8 or more where J^{+h} does not exist."""
        counted = np.abs(self.singular_values[: self.rank])
        if not self.rank:
            return 1.0
        return float(counted[0] / counted[-1]) if counted[-1] > 0.0 else inf

    @property
    def manipulability(self) -> float:
        """Product of the `rank` largest |sigma_i|: Yoshikawa's sqrt det(JJ') at rank 6, sqrt|det J'Q_h J| below."""
        return float(np.abs(self.singular_values[: self.rank]).prod())

    @property
    def signature(self) -> tuple[int, int, int]:
        """Numbers of positive, negative and zero values."""
        up, down = int(np.count_nonzero(self.values > 0.0)), int(np.count_nonzero(self.values < 0.0))
        return up, down, len(self.values) - up - down


def hyperbolic_singular_values(J: ArrayLike, h: float, *, joint_metric: ArrayLike | None = None) -> HyperbolicSpectrum:
    """The hyperbolic singular values of (6, m) twists, with principal joint directions and twists.

    Args:
        J: (6, m) joint twists.
        h: finite pitch [length/rad].
        joint_metric: (m, m) or (m,) positive definite metric M on joint velocities; None is the identity. Where joints
            turn and slide, give one: without it the answer depends on the unit of length.

    Raises:
        BadInput: shapes, NaN, a metric that is not positive definite.

    Reference: asked for in [DS] Sect. 7; J'Q_h J is the subject of Sect. 3.
    """
    twists = arrays.columns(J)
    pitch = finite_pitch(h)
    m = twists.shape[1]
    G = gram_matrix(twists, pitch)
    system = span(twists)
    if joint_metric is None:
        mu, V = np.linalg.eigh(G)
    else:
        whiten = np.linalg.inv(np.linalg.cholesky(arrays.positive_definite(joint_metric, m, "joint_metric"))).T
        mu, V = np.linalg.eigh(whiten.T.dot(G).dot(whiten))
        V = whiten.dot(V)
    order = np.argsort(-np.abs(mu), kind="stable")
    values, V = mu[order], V[:, order]
    values[system.rank :] = 0.0
    return HyperbolicSpectrum(pitch, system.rank, values, V, twists.dot(V))
