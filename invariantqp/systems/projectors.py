"""Dual projectors: P splits twists along S and Z, P* splits wrenches along the annihilators of S and Z.

    P = S (K'S)^-1 K',   K = Z*       P on S along Z           P* = (I - P)' = W (Z'W)^-1 Z'   on W = S* along Z*

W'P = 0 for any complement Z: the wrenches in W do no work on the motions in S. Three ways to choose Z:

    h          Z = S^{perp h}: depends on no frame, body or unit; some systems have none
    metric     Z = {z : s'Mz = 0 for all s in S} = M^-1 W, M positive definite: a stiffness or an inertia; always exists
    complement Z as given

With Z = S^{perp h}, P* is [DS]'s W (W'Q_h^-1 W)^-1 W'Q_h^-1.

Reference: [DS] Sect. 6.1, Sect. 6.2 (6.5), Sect. 6.3; Lipkin & Duffy 1988; Selig & McAree 1996.
"""

from __future__ import annotations

from math import log2
from typing import Any

import numpy as np
from attrs import evolve, field, frozen
from numpy.typing import ArrayLike

from invariantqp.engine import law
from invariantqp.errors import BadInput, NoProjectors, listed
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch
from invariantqp.geometry.linear import orthogonal
from invariantqp.geometry.sizes import LENGTH_LIMIT
from invariantqp.systems.classification import classify
from invariantqp.systems.pseudoinverses import LARGEST_CONDITION, by_engine, factors, pitches_or_none
from invariantqp.systems.subspaces import Subspace, as_system

RULES = ("h", "complement", "metric")
# The alternatives to a pitch, in messages.
ALTERNATIVES = "metric=M (a stiffness or an inertia at the contact) or complement=Z (what may be given up)"


@frozen(eq=False, repr=False, slots=False)
class DualProjectors(Value):
    """P on twists and P* = (I - P)' on wrenches, with bases of their ranges and kernels.

    Attributes:
        motion: (6, 6) P, projects a twist on S.
        force: (6, 6) P* = (I - P)', projects a wrench on S*.
        freedoms: (6, k) basis of S.
        complement: (6, 6-k) basis of Z, the kernel of P.
        constraints: (6, 6-k) basis of S* = W, the wrenches that do no work on S.
        norm: |P|, one over the sine of the angle between S and Z, lengths in `unit`: at least 1; unbounded as S and Z
            come to share a twist; 0 for the zero system.
        unit: the unit of length of `norm`.
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
            pose: (4, 4) a_from_b, from frame b of these projectors to frame a of the result.
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
    S: ArrayLike | Subspace | None = None,
    *,
    wrenches: ArrayLike | None = None,
    h: float | None = None,
    complement: ArrayLike | None = None,
    metric: Any = None,
) -> DualProjectors:
    """The projectors on S along Z, for twists, and on S*, for wrenches.

    Args:
        S: (6, m) twists that span the freedoms, (6, 0) for none; or a `ScrewSystem`.
        wrenches: (6, m) constraint wrenches (m; f) instead of S; S is then all twists on which they do no work.
        h: pitch [length/rad]: Z is the h-reciprocal system of S.
        complement: (6, n) twists that span Z.
        metric: (6, 6) positive definite or its (6,) diagonal: Z is orthogonal to S in it; or a `CarriedMetric` that has
            its pose.

    Returns:
        DualProjectors, in the frame of S.

    Raises:
        NoProjectors: S meets its h-reciprocal, or is too near to it for three correct digits; names the type of S, its
            principal pitches and the alternatives.
        BadInput: not one of S and wrenches, not one of the three rules, NaN, shapes, nearly dependent columns, a
            complement that shares a twist with S or does not fill six dimensions with it, a metric that is not
            positive definite.

    Reference: [DS] Sect. 6.1 (P_h = J J^{+h}), (6.5), Sect. 6.3.
    """
    if (S is None) == (wrenches is None):
        found = "neither S nor wrenches" if S is None else "both S and wrenches"
        raise BadInput("S", found, "the freedoms S or the constraint wrenches")
    name, value = one_rule(h, complement, metric)
    if not isinstance(S, Subspace):
        fields = by_engine(law.projectors, S, wrenches, *(value if name == rule else None for rule in RULES))
        if fields is not None:
            return DualProjectors(*fields)
    if S is not None:
        return projectors_of(as_system(S, "S"), (name, value))
    given = Subspace(arrays.columns(wrenches, "wrenches"), argument="wrenches")  # type: ignore[arg-type]
    return projectors_of(Subspace(given.annihilator()), (name, value), given)


def one_rule(h: float | None, complement: Any, metric: Any) -> tuple[str, Any]:
    """The name and the value of the one given rule for the complement."""
    values = zip(RULES, (h, complement, getattr(metric, "carried", metric)), strict=True)
    given = [(name, value) for name, value in values if value is not None]
    if len(given) != 1:
        found = " and ".join(name for name, _ in given) or "no rule for the complement"
        raise BadInput("h", found, "one of h, complement, metric")
    return given[0]


def projectors_of(system: Subspace, rule: tuple[str, Any], wrenches: Subspace | None = None) -> DualProjectors:
    """The projectors on a system along the complement of a rule; `wrenches` are its constraints, if given instead."""
    name, value = rule
    system = system.exact
    U, k = system.span.basis, system.dimension
    if name == "metric":
        root = np.linalg.cholesky(arrays.positive_definite(value, 6, "metric")).T.dot(system.from_own)
        Q, triangle = np.linalg.qr(root.dot(U))  # least squares by QR, so that the metric's condition is not squared
        P = U.dot(np.linalg.solve(triangle, Q.T.dot(root)))
        Z = np.linalg.qr(np.linalg.solve(root, orthogonal(Q)))[0]
    else:
        if name == "h":
            pitch = finite_pitch(value)
            _check_pitch(system, pitch, wrenches)
            K = np.linalg.qr(system.form(pitch).dot(U))[0]
        else:
            K = _annihilator_of(value, system, (wrenches or system).joint_condition)
        P = U.dot(np.linalg.solve(K.T.dot(U), K.T)) if k else np.zeros((6, 6))
        Z = orthogonal(K)
    W = orthogonal(U)
    F = W.dot(W.T).dot(np.eye(6) - P.T)
    motion = system.from_own.dot(P).dot(system.to_own)
    unit = own_unit(system.twists)
    scale = np.repeat([1.0, unit], 3)
    return DualProjectors(
        motion=motion,
        force=system.to_own.T.dot(F).dot(system.from_own.T),
        freedoms=system.basis,
        complement=system.from_own.dot(Z),
        constraints=system.to_own.T.dot(W),
        norm=float(np.linalg.norm(motion / scale[:, None] * scale, 2)) if k else 0.0,
        unit=unit,
    )


def own_unit(J: Array) -> float:
    """The power of two nearest |J_v|_F / |J_omega|_F; 1 if either part vanishes, up to rounding."""
    w, v = float(np.linalg.norm(J[:3])), float(np.linalg.norm(J[3:]))
    if v >= LENGTH_LIMIT * w or w >= LENGTH_LIMIT * v:
        return 1.0
    return float(2.0 ** round(log2(v) - log2(w)))


def _annihilator_of(complement: ArrayLike, system: Subspace, condition: float) -> Array:
    """Orthonormal wrenches (6, k) that do no work on the given Z, in the system's own coordinates."""
    given = Subspace(complement, argument="complement")
    U, k = system.span.basis, system.dimension
    if given.dimension != 6 - k:
        expected = f"twists that span {6 - k} dimensions"
        raise BadInput("complement", f"rank {given.dimension}", expected, f"S has {k}, and both must fill six.")
    K = np.linalg.qr(system.from_own.T.dot(given.annihilator()))[0]
    _, sines, Vt = np.linalg.svd(K.T.dot(U))
    if k and max(condition, given.joint_condition) > LARGEST_CONDITION * sines[-1]:
        z = system.from_own.dot(U.dot(Vt[-1]))
        found = f"a Z that shares the twist ({listed(z / np.linalg.norm(z))}) with S"
        expected = f"{6 - k} twists that with S span all six dimensions"
        raise BadInput("complement", found, expected, "Turn Z away from S.")
    return np.asarray(K)


def _check_pitch(system: Subspace, h: float, wrenches: Subspace | None) -> None:
    """Raise unless S and its h-reciprocal fill six dimensions, with three correct digits of P."""
    # Wrenches W are the twists Q_0 W measured by -h: W'Q_h^-1 W = (Q_0 W)'Q_{-h}(Q_0 W).
    given, pitch = (system, h) if wrenches is None else (Subspace(wrenches.twists[se3.SWAPPED]), -h)
    factored = factors(given, pitch)
    if factored.exists:
        return
    if factored.dependent:
        condition = f"condition {factored.joint_condition:.1g}"
        found = f"columns so nearly dependent that rounding decides what they span ({condition})"
        argument = "S" if wrenches is None else "wrenches"
        raise BadInput(argument, found, "independent columns", "Leave out a column.")
    z = factored.self_reciprocal
    if wrenches is not None:
        z[3:] += 2.0 * h * z[:3]  # Q_h^-1 w for the wrench w = Q_0 z
        z = z / np.linalg.norm(z)
    k, kind = system.dimension, classify(system)
    name = f"a {k}-system {'whose reciprocal is ' if kind.reciprocal else ''}of type {kind}"
    ranks = (k, k - factored.rank + factored.gram_rank)
    raise NoProjectors(h, name, ranks, z, pitches_or_none(system), ALTERNATIVES)
