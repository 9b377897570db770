"""Dual projectors: they split twists along S and Z, and wrenches along the annihilators of the two.

    P = S (K'S)^-1 K',   K = Z*       P on S along Z           P* = (I - P)' = W (Z'W)^-1 Z'   on W = S* along Z*

W'P = 0 for any complement Z: the wrenches in W do no work on the motions in S. Three ways to choose Z:

    h          Z = S^{perp h}: depends on no frame, body or unit; some systems have none
    metric     Z = {z : s'Mz = 0 for all s in S} = M^-1 W, M positive definite: a stiffness or an inertia; always exists
    complement Z as given

With Z = S^{perp h}, P* is [DS]'s W (W'Q_h^-1 W)^-1 W'Q_h^-1.

Reference: [DS] Sect. 6.1, Sect. 6.2 (6.5), Sect. 6.3; Lipkin & Duffy 1988; Selig & McAree 1996.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from attrs import evolve, field, frozen
from numpy.typing import ArrayLike

from invariantqp.engine import core
from invariantqp.errors import BadInput, NoProjectors, listed
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.systems.classification import gibson_hunt
from invariantqp.systems.gram import pitches_or_none
from invariantqp.systems.pseudoinverses import LARGEST_CONDITION, factors
from invariantqp.systems.subspaces import annihilator, lengths, orthogonal, span

# What a refusal offers instead of a pitch.
CHOICES = "metric=M (a stiffness or an inertia at the contact) or complement=Z (what may be given up)"


@frozen(eq=False, repr=False, slots=False)
class DualProjectors(Value):
    """P on twists and P* = (I - P)' on wrenches, with the spaces they belong to.

    Attributes:
        motion: (6, 6) P, takes a twist to its part in S.
        force: (6, 6) P* = (I - P)', takes a wrench to its part in S*.
        freedoms: (6, k) basis of S.
        complement: (6, 6-k) basis of Z, the twists that P takes to zero.
        constraints: (6, 6-k) basis of S* = W, the wrenches that do no work on S.
        norm: |P|, one over the sine of the angle between S and Z, lengths in `unit`; 1 is the least, but for 0 where
            S is the zero system.
        unit: the length that counts as 1 in `norm`.
    """

    motion: Array = field(converter=own)
    force: Array = field(converter=own)
    freedoms: Array = field(converter=own)
    complement: Array = field(converter=own)
    constraints: Array = field(converter=own)
    norm: float
    unit: float

    def moved(self, pose: ArrayLike) -> DualProjectors:
        """The projectors of the moved system: Ad P Ad^-1, and Ad* P* Ad*^-1 with the coadjoint.

        Args:
            pose: (4, 4) a_from_b; what was expressed in b is then expressed in a.
        """
        T = arrays.pose(pose)
        A, B = se3.adjoint(T, check=False), se3.coadjoint(T, check=False)
        return evolve(
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
        wrenches: (6, m) constraint wrenches (m; f) instead of S; S is then all twists on which they do no work.
        h: pitch [length/rad]: Z is the h-reciprocal system of S.
        complement: (6, n) twists that span Z.
        metric: (6, 6) positive definite or its (6,) diagonal: Z is orthogonal to S in it; or a `CarriedMetric` that has
            its pose.

    Returns:
        DualProjectors, in the frame of S.

    Raises:
        NoProjectors: S meets its h-reciprocal, or is too near to it for three correct digits; names the type of S, and
            the pitches and choices that are left.
        BadInput: not one of S and wrenches, not one of the three rules, NaN, shapes, nearly dependent columns, a
            complement that shares a twist with S or does not fill six dimensions with it, a metric that is not
            positive definite.

    Reference: [DS] Sect. 6.1 (P_h = J J^{+h}), (6.5), Sect. 6.3.
    """
    if (S is None) == (wrenches is None):
        found = "neither S nor wrenches" if S is None else "both S and wrenches"
        raise BadInput("S", found, "the freedoms S or the constraint wrenches")
    rules = {"h": h, "complement": complement, "metric": getattr(metric, "carried", metric)}
    rule = [name for name, value in rules.items() if value is not None]
    if len(rule) != 1:
        raise BadInput("h", " and ".join(rule) or "no rule for the complement", "one of h, complement, metric")
    answer = None if core is None else core.projectors(S, wrenches, *rules.values())
    if answer is not None:  # where it is well conditioned
        return DualProjectors(*answer)
    given = arrays.columns(wrenches, "wrenches") if S is None else arrays.system(S, "S")  # type: ignore[arg-type]
    U, unit, spread = _freedoms(given, S is not None)
    k, scale = U.shape[1], lengths(unit)
    if h is not None:
        Z = orthogonal(pitch_form(finite_pitch(h) / unit).dot(U))
    elif metric is not None:
        M = arrays.positive_definite(rules["metric"], 6, "metric")
        Z = orthogonal((M * scale * scale.T).dot(U))
    else:
        Z, magnified = _given(complement, k, unit)
        spread = max(spread, magnified)
    W, K = orthogonal(U), orthogonal(Z)
    _, sines, Vt = np.linalg.svd(K.T.dot(U))
    sine = float(sines[-1]) if k else 1.0
    if h is not None:
        _refuse_pitch(given, finite_pitch(h), U * scale, S is not None)
    elif spread > LARGEST_CONDITION * sine:
        z = U.dot(Vt[-1]) * scale.ravel()
        found = f"a Z that shares the twist ({listed(z / np.linalg.norm(z))}) with S"
        raise BadInput(rule[0], found, f"{6 - k} twists that with S span all six dimensions", "Turn Z away from S.")
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


def _freedoms(given: Array, twists: bool) -> tuple[Array, float, float]:
    """Orthonormal basis of S, the length that counts as 1 in it, and how much it magnifies errors of its columns."""
    system = span(given)
    freedoms = system if twists else span(annihilator(given))
    return freedoms.basis, freedoms.unit, system.spread


def _given(complement: ArrayLike | None, k: int, unit: float) -> tuple[Array, float]:
    """Orthonormal basis of the given Z, lengths in `unit`, and how much it magnifies errors of the columns."""
    system = span(arrays.system(complement, "complement"), unit=unit)  # type: ignore[arg-type]
    if system.rank != 6 - k:
        expected = f"twists that span {6 - k} dimensions"
        raise BadInput("complement", f"rank {system.rank}", expected, f"S has {k}, and both must fill six.")
    return system.basis, system.spread


def _refuse_pitch(given: Array, h: float, freedoms: Array, twists: bool) -> None:
    """Raise unless S and its h-reciprocal fill six dimensions, by a margin that leaves three correct digits."""
    if not given.shape[1]:
        return
    # Wrenches W are the twists Q_0 W measured by -h: W'Q_h^-1 W = (Q_0 W)'Q_{-h}(Q_0 W).
    columns, pitch = (given, h) if twists else (given[se3.SWAPPED], -h)
    factored = factors(columns, pitch)
    if factored.exists:
        return
    if factored.dependent:
        found = f"columns so nearly dependent that rounding decides what they span (condition {factored.spread:.1g})"
        raise BadInput("S" if twists else "wrenches", found, "independent columns", "Leave out a column.")
    z = factored.lost
    if not twists:
        z[3:] += 2.0 * h * z[:3]  # Q_h^-1 w for the wrench w = Q_0 z
        z = z / np.linalg.norm(z)
    k = freedoms.shape[1]
    kind = gibson_hunt(freedoms)
    system = f"a {k}-system {'whose reciprocal is ' if kind.reciprocal else ''}of type {kind}"
    raise NoProjectors(h, system, (k, k - factored.rank + factored.gram_rank), z, pitches_or_none(freedoms), CHOICES)
