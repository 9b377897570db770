"""Dual projectors: twists split along S and Z, wrenches along their annihilators, so that no power crosses over.

    P = S (K'S)^-1 K',   K = Z*       P on S along Z           P* = (I - P)' = W (Z'W)^-1 Z'   on W = S* along Z*

W'P = 0 for any complement Z. Three ways to say which Z:

    h          Z = S^{perp h}, the only one that no frame, no body and no unit enters; some systems have none
    metric     Z = {z : s'Mz = 0 for all s in S} = M^-1 W, M positive definite: a stiffness or an inertia; always there
    complement Z itself

With Z = S^{perp h}, P* is [DS]'s W (W'Q_h^-1 W)^-1 W'Q_h^-1.

Reference: [DS] Sect. 6.1 (6.5), Sect. 6.3; Lipkin & Duffy 1988; Selig & McAree 1996.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, BlindSystem, InvariantQPError, NoProjectors, written
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.systems.classification import gibson_hunt
from invariantqp.systems.existence import MEET_TOLERANCE
from invariantqp.systems.gram import principal_pitches
from invariantqp.systems.span import span
from invariantqp.systems.subspaces import annihilator, screw_system

# What every refusal offers where a pitch does not help.
CHOICES = "metric=M (a stiffness or an inertia at the contact) or complement=Z (what may be given up)"


@dataclass(frozen=True, eq=False)
class DualProjectors:
    """P on twists and P* = (I - P)' on wrenches, with the spaces they belong to.

    Attributes:
        motion: (6, 6) P, a twist to its part in S.
        force: (6, 6) P* = (I - P)', a wrench to its part in S*.
        freedoms: (6, k) basis of S.
        complement: (6, 6-k) basis of Z, the twists that P takes to zero.
        constraints: (6, 6-k) basis of S* = W, the wrenches that do no work on S.
        norm: |P|, one over the sine of the angle between S and Z in `unit`; 1 is as good as it gets, 0 where S is
            nothing.
        unit: the length that counts as 1 in `norm`.
    """

    motion: Array
    force: Array
    freedoms: Array
    complement: Array
    constraints: Array
    norm: float
    unit: float

    @property
    def power_leak(self) -> float:
        """The largest |W'Ps| over |W||P||s|, lengths in `unit`: rounding, whatever S and Z are."""
        if not self.freedoms.shape[1] or not self.constraints.shape[1]:
            return 0.0
        scale = _scale(self.unit)
        W, P = self.constraints * scale, self.motion / scale * scale.T
        size = np.linalg.norm(W, axis=0).reshape(-1, 1) * np.linalg.norm(P)
        return float((np.abs(W.T.dot(P)) / size).max())

    def moved(self, pose: ArrayLike) -> DualProjectors:
        """The projectors of the moved system: Ad P Ad^-1, and Ad* P* Ad*^-1 with the coadjoint.

        Args:
            pose: (4, 4) a_from_b; what was expressed in b is then expressed in a.
        """
        T = arrays.pose(pose)
        A, B = se3.adjoint(T, check=False), se3.coadjoint(T, check=False)
        return replace(
            self,
            motion=A.dot(self.motion).dot(B.T),
            force=B.dot(self.force).dot(A.T),
            freedoms=A.dot(self.freedoms),
            complement=A.dot(self.complement),
            constraints=B.dot(self.constraints),
        )


def dual_projectors(
    S: ArrayLike | None = None,
    *,
    wrenches: ArrayLike | None = None,
    h: float | None = None,
    complement: ArrayLike | None = None,
    metric: Any = None,
) -> DualProjectors:
    """The projectors on S along Z, for twists, and on S*, for wrenches.

    Args:
        S: (6, m) twists that span the freedoms; (6, 0) for none.
        wrenches: (6, m) constraint wrenches (m; f) instead of S, which then is all they do no work on.
        h: pitch [length/rad]: Z is the h-reciprocal system of S.
        complement: (6, n) twists that span Z.
        metric: (6, 6) positive definite or its (6,) diagonal: Z is orthogonal to S in it; or a `CarriedMetric` that has
            its pose.

    Returns:
        DualProjectors, in the frame of S.

    Raises:
        NoProjectors: S meets its h-reciprocal; names the type of S, and the pitches or choices that are left.
        BadInput: not one of S and wrenches, not one of the three rules, NaN, shapes, a complement that shares a twist
            with S or does not fill six dimensions with it, a metric that is not positive definite.

    Reference: [DS] Sect. 6.1, 6.3.
    """
    freedoms = _freedoms(S, wrenches)
    rules = {"h": h, "complement": complement, "metric": metric}
    given = [name for name, value in rules.items() if value is not None]
    if len(given) != 1:
        raise BadInput("h", " and ".join(given) or "no rule for the complement", "one of h, complement, metric")
    k = freedoms.shape[1]
    system = span(freedoms) if k else None
    U, unit = (np.empty((6, 0)), 1.0) if system is None else (system.basis, system.unit)
    scale = _scale(unit)
    if h is not None:
        Z = _orthogonal(pitch_form(finite_pitch(h) / unit).dot(U))
    elif metric is not None:
        M = arrays.positive_definite(getattr(metric, "carried", metric), 6, "metric")
        Z = _orthogonal((M * scale * scale.T).dot(U))
    else:
        Z = _given(complement, k, unit)
    W, K = _orthogonal(U), _orthogonal(Z)
    _, sines, Vt = np.linalg.svd(K.T.dot(U))
    sine = float(sines[-1]) if k else 1.0
    if sine <= MEET_TOLERANCE:
        shared = U.dot(Vt[-1]) * scale.ravel()
        rank = k - int(np.count_nonzero(sines <= MEET_TOLERANCE))
        raise _refusal(given[0], freedoms, shared / np.linalg.norm(shared), rank, h)
    P = U.dot(np.linalg.solve(K.T.dot(U), K.T)) if k else np.zeros((6, 6))
    F = W.dot(np.linalg.solve(Z.T.dot(W), Z.T)) if k < 6 else np.zeros((6, 6))
    return DualProjectors(
        motion=P * scale / scale.T,
        force=F / scale * scale.T,
        freedoms=U * scale,
        complement=Z * scale,
        constraints=W / scale,
        norm=1.0 / sine if k else 0.0,
        unit=unit,
    )


def _scale(unit: float) -> Array:
    """(6, 1): what takes twists measured in `unit` to the caller's."""
    return np.array([[1.0], [1.0], [1.0], [unit], [unit], [unit]])


def _orthogonal(columns: Array) -> Array:
    """An orthonormal basis of what is orthogonal to independent columns (6, k), 0 <= k <= 6."""
    if columns.shape[1] == 0:
        return np.eye(6)
    Q: Array = np.linalg.qr(columns, mode="complete")[0]
    return Q[:, columns.shape[1] :]


def _freedoms(S: ArrayLike | None, wrenches: ArrayLike | None) -> Array:
    """Independent twists that span S."""
    if (S is None) == (wrenches is None):
        found = "neither S nor wrenches" if S is None else "both S and wrenches"
        raise BadInput("S", found, "the freedoms S or the constraint wrenches")
    if wrenches is not None:
        return annihilator(arrays.columns(wrenches, "wrenches"))
    twists = arrays.system(S, "S")  # type: ignore[arg-type]
    return screw_system(twists) if twists.shape[1] else twists


def _given(complement: ArrayLike | None, k: int, unit: float) -> Array:
    """An orthonormal basis of the Z given, in `unit`."""
    twists = arrays.system(complement, "complement") / _scale(unit)  # type: ignore[arg-type]
    basis = span(twists, unit=1.0).basis if twists.shape[1] else twists
    if basis.shape[1] != 6 - k:
        expected = f"twists that span {6 - k} dimensions"
        raise BadInput("complement", f"rank {basis.shape[1]}", expected, f"S has {k}, and both must fill six.")
    return basis


def _refusal(rule: str, freedoms: Array, shared: Array, rank: int, h: float | None) -> InvariantQPError:
    """Why S and Z do not fill six dimensions, and what is left to choose."""
    k = freedoms.shape[1]
    if rule != "h":
        z = ", ".join(written(x) for x in shared)
        found = f"a Z that shares the twist ({z}) with S"
        return BadInput(rule, found, f"{6 - k} twists that with S span all six dimensions", "Turn Z away from S.")
    try:
        pitches = principal_pitches(freedoms)
    except BlindSystem:
        pitches = np.empty(0)
    kind = gibson_hunt(freedoms)
    system = f"a {k}-system {'whose reciprocal is ' if kind.reciprocal else ''}of type {kind}"
    return NoProjectors(float(h or 0.0), system, (k, rank), shared, pitches, CHOICES)
