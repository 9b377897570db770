"""The h-pseudoinverse J^{+h}, the h-adjoint, the conditions that define J^{+h}, and those under which there is none.

    J = T C  (T a basis of the system, C of full row rank):   J^{+h} = M^-1 C'(C M^-1 C')^-1 (T'Q_h T)^-1 T'Q_h
    (hP1) J X J = J     (hP2) X J X = X     (hP3) (J X)^{*h} = J X     (hP4) (X J)* = X J

It measures twists by Q_h and so depends on no choice of frame. It exists iff rank(T'Q_h T) = rank(J); in floating point
it is returned if at least three digits of it are correct. J is factored before a Gram matrix is formed, because
(J'Q_h J)^-1 J'Q_h squares the condition number of J.

(hP3) says that Q_h J X is symmetric: J X projects twists on im J along its h-reciprocal. (hP4) says that M X J is
symmetric, with the joint metric M: X J projects joint velocities along the self-motions, at right angles in M.

Reference: [DS] Sect. 2.3 (2.12)-(2.15), (hP1)-(hP4), after Penrose 1955; Theorem 2.2; Theorem 3.1, Corollary 3.2.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, isfinite, nan, pi
from typing import Any, Literal, NamedTuple, overload

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.engine import law
from invariantqp.errors import BadInput, NoPseudoinverse
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import ROUNDING, Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.geometry.sizes import LENGTH_LIMIT
from invariantqp.systems.gram import gram_matrix, pencil
from invariantqp.systems.subspaces import LEAST_INDEPENDENCE, Subspace, as_system

# Above this, a relative error of 1e-15 of the joint twists, as of forward kinematics in float64, can change J^{+h} by
# more than a thousandth. Arms that are singular by structure (a SCARA at any h) have hundreds of times this number.
LARGEST_CONDITION = 1e12
# Columns whose sizes differ by more are scaled to unit size first: else a few would decide the own point and length.
LARGEST_SIZE_RATIO = 1e2


def form_adjoint(A: ArrayLike, domain: ArrayLike, codomain: ArrayLike) -> Array:
    """A* = M^-1 A'N (m, n), the adjoint of a map A (n, m) from a space with the form M to one with the form N.

    (A*)* = A, and (A B)* = B* A* where the forms between A and B are the same. The forms are symmetric and need not be
    definite.

    Raises:
        BadInput: M is singular.

    Reference: [DS] (2.12), (2.13).
    """
    a = arrays.array(A, "A", "a matrix")
    if a.ndim != 2:
        raise BadInput("A", f"shape {a.shape}", "shape (n, m)")
    n, m = a.shape
    M, N = arrays.symmetric(domain, m, "domain"), arrays.symmetric(codomain, n, "codomain")
    if not np.linalg.cond(M) <= LARGEST_CONDITION:
        raise BadInput("domain", "a singular form", "one that pairs no vector to zero with all others")
    return np.asarray(np.linalg.solve(M, arrays.matrix(a, (n, m), "A").T.dot(N)))


def h_adjoint(J: ArrayLike, h: float, *, joint_metric: ArrayLike | None = None) -> Array:
    """J^{*h} = M^-1 J'Q_h (m, 6), the adjoint of a Jacobian: x'M (J^{*h} s) = (J x)'Q_h s.

    J'Q_h s are the joint torques of the wrench Q_h s. The adjoint of Ad J, in another frame, is J^{*h} Ad^-1.

    Args:
        J: (6, m) joint twists as columns.
        h: pitch [length/rad], or inf for half the Killing form.
        joint_metric: (m, m) or (m,) positive definite metric M on joint velocities; None is the identity.

    Reference: [DS] (2.14).
    """
    twists = arrays.columns(J)
    images: Array = twists.T.dot(pitch_form(h))
    if joint_metric is None:
        return images
    M = arrays.positive_definite(joint_metric, twists.shape[1], "joint_metric")
    return np.asarray(np.linalg.solve(M, images))


class Factors(NamedTuple):
    """J^{+h} from its factors, with its condition number with respect to the twists.

        J = T C,   T'Q_h T = diag(mu),   X = J^{+h} = C^+ diag(1/mu) T'Q_h,   G^+ = C^+ diag(1/mu) C^+'
        dX = -X dJ X + G^+ dJ'Q_h(I - JX) + (I - XJ) dJ'X'X + ...

    The condition number is a bound on the sum of these terms, over |X|, for columns of J with relative errors of one.
    Two choices keep digits: independent columns are scaled to unit size, which cancels; and if |h| exceeds the own
    length, it is the unit of length, since h times the rounding of a rotation would hide the translations.

    Reference: [DS] Theorem 2.2; the condition number is ours, after Wedin's for the Moore-Penrose inverse.
    """

    inverse: Array  # (m, 6) J^{+h}; undefined unless `exists`
    condition: float  # largest ratio of the relative error of J^{+h} to that of the twists
    joint_condition: float  # `Subspace.joint_condition`, which does not depend on the form
    screws: Array  # (6, r) basis of the system, mutually h-reciprocal
    screw_conditions: Array  # (r,) condition number of the part of J^{+h} along each screw

    @property
    def exists(self) -> bool:
        """Whether at least three digits of J^{+h} are correct."""
        return self.condition <= LARGEST_CONDITION

    @property
    def rank(self) -> int:
        """Rank of J."""
        return len(self.screw_conditions)

    @property
    def gram_rank(self) -> int:
        """Numerical rank of J'Q_h J."""
        return int(np.count_nonzero(self.screw_conditions <= LARGEST_CONDITION))

    @property
    def dependent(self) -> bool:
        """Whether near-dependence of the twists, rather than the form, makes the condition number large."""
        return self.joint_condition * self.joint_condition >= self.condition

    @property
    def self_reciprocal(self) -> Array:
        """(6,) the unit screw of the system that is nearest to being h-reciprocal to all of it."""
        z = self.screws[:, int(self.screw_conditions.argmax())]
        return np.asarray(z / np.linalg.norm(z))


def factors(system: Subspace, h: float, metric: Array | None = None) -> Factors:
    """J^{+h} of a system's twists with its condition number, for a finite h and a checked joint metric (m, m)."""
    system = system.exact
    r, m = system.dimension, system.twists.shape[1]
    sizes = _column_sizes(system.twists)
    hidden = False  # whether some columns are within the rounding of the others
    if sizes.all() and sizes.max(initial=0.0) > LARGEST_SIZE_RATIO * sizes.min(initial=inf):
        unit = Subspace(system.twists / sizes).exact
        if unit.dimension == m:
            scaled = factors(unit, h)
            return scaled._replace(inverse=scaled.inverse / sizes[:, None])
        hidden = unit.dimension > r
    if r == 0:
        return Factors(np.zeros((m, 6)), 1.0, 1.0, np.empty((6, 0)), np.empty(0))
    U, velocities, units, errors = _full_rank_factors(system, metric)
    # Sorted by angular part, so that rotations and translations stay apart when the unit of length is changed.
    scale = max(1.0, abs(h) / system.length)
    order = np.linalg.svd(U[:3])[2].T
    T = U.dot(order)
    T[3:] /= scale
    lengths = np.linalg.norm(T, axis=0)
    Q = pitch_form(h / (scale * system.length))
    T, velocities = T / lengths, velocities.dot(order / lengths)
    mu, E = np.linalg.eigh(T.T.dot(Q).dot(T))
    T, velocities = T.dot(E), velocities.dot(E)
    images = Q.dot(T)
    with np.errstate(all="ignore"):  # if some mu is zero, the condition number is infinite
        inverse = (velocities / mu).dot(images.T)
        gram_inverse = (velocities / mu).dot(velocities.T)
        rest = Q - (images / mu).dot(images.T)
        size = np.linalg.norm(inverse)
        rows = np.linalg.norm(inverse, axis=1) + np.linalg.norm(gram_inverse, axis=1) * np.linalg.norm(rest) / size
        condition = float(errors.dot(rows) + (errors.sum() * size if r < m else 0.0))
        # The first two terms of dX along a screw z have one size: z'Q_h dJ C^+ / mu, on S and on S^{perp h}.
        conditions = 2.0 * errors.dot(np.abs(velocities)) * np.linalg.norm(images, axis=0) / np.abs(mu)
        inverse[:, 3:] /= scale
        inverse = units.dot(inverse).dot(system.to_own)
    T[3:] *= scale
    if hidden or not isfinite(condition):
        condition = inf
    joint_condition = inf if hidden else system.joint_condition
    return Factors(inverse, condition, joint_condition, system.from_own.dot(T), conditions)


def _column_sizes(J: Array) -> Array:
    """(m,) norms of twists, lengths over the median distance of the rotation axes."""
    w, v = np.linalg.norm(J[:3], axis=0), np.linalg.norm(J[3:], axis=0)
    rotates = w * LENGTH_LIMIT > v
    length = float(np.median(v[rotates] / w[rotates])) if rotates.any() else 1.0
    return np.asarray(np.hypot(w, v / (length or 1.0)))


def _full_rank_factors(system: Subspace, metric: Array | None) -> tuple[Array, Array, Array, Array]:
    """U (6, r) orthonormal, joint velocities (m, r) for its columns, their units (m, m), errors of the columns (m,).

    Independent columns have unit size; with dependent ones the units make the joint metric the identity.
    """
    T, r, m = system.coordinates, system.dimension, system.twists.shape[1]
    units, magnified = np.eye(m), 1.0
    if r == m:
        units = np.diag(1.0 / np.linalg.norm(T, axis=0))
    elif metric is not None:
        lower = np.linalg.cholesky(metric)
        magnified = float(np.linalg.cond(lower / np.linalg.norm(lower, axis=1)[:, None]))
        units = np.linalg.inv(lower).T
    U, sigma, Vt = np.linalg.svd(T.dot(units), full_matrices=False)
    return U[:, :r], Vt[:r].T / sigma[:r], units, sigma[0] * magnified * system.error_factors


def has_pseudoinverse(J: ArrayLike | Subspace, h: float) -> bool:
    """Whether (6, m) twists have an h-pseudoinverse that can be computed to three digits: rank(J'Q_h J) = rank(J).

    Reference: [DS] Theorem 2.2.
    """
    return factors(as_system(J), finite_pitch(h)).exists


@overload
def pseudoinverse(
    J: ArrayLike | Subspace, h: float, *, joint_metric: ArrayLike | None = ..., return_condition: Literal[False] = ...
) -> Array: ...


@overload
def pseudoinverse(
    J: ArrayLike | Subspace, h: float, *, joint_metric: ArrayLike | None = ..., return_condition: Literal[True]
) -> tuple[Array, float]: ...


def pseudoinverse(
    J: ArrayLike | Subspace, h: float, *, joint_metric: ArrayLike | None = None, return_condition: bool = False
) -> Array | tuple[Array, float]:
    """J^{+h}, the h-pseudoinverse of (6, m) twists of any rank, correct to three digits or more.

    For rank 6 it is the same for every h, and with `joint_metric=None` it is the Moore-Penrose pseudoinverse.

    Args:
        J: (6, m) joint twists as columns, (omega; v), or a `ScrewSystem`.
        h: finite pitch [length/rad].
        joint_metric: (m, m) or (m,) positive definite, the metric M on joint velocities; None is the identity. It
            matters only for dependent joints.
        return_condition: whether to return the condition number too: the largest ratio of the relative error of J^{+h}
            to that of the twists. It goes to infinity towards a principal pitch.

    Returns:
        (m, 6) matrix; x = J^{+h} s is the joint velocity for the twist s. With `return_condition`, (matrix, condition).

    Raises:
        NoPseudoinverse: h is a principal pitch of the system, or too near one for three correct digits; or no h works;
            or the joints are too nearly dependent. Carries the proof.

    Reference: [DS] Theorem 2.2, (3.1) for independent columns, (2.15) for rank 6.
    """
    if joint_metric is None and return_condition is False and type(h) is float and not isinstance(J, Subspace):
        inverse = by_engine(law.pseudoinverse, J, h)
        if inverse is not None:
            return np.asarray(inverse)
    factored = invert(as_system(J), h, joint_metric)
    both = arrays.flag(return_condition, "return_condition")
    return (factored.inverse, factored.condition) if both else factored.inverse


def by_engine(function: Callable[..., Any], *arguments: Any) -> Any | None:
    """The result of the engine; None if it is not well conditioned, or arguments are refused."""
    try:
        return function(*arguments)
    except (ValueError, TypeError):
        return None


def invert(system: Subspace, h: float, joint_metric: ArrayLike | None = None) -> Factors:
    """The factors of J^{+h}.

    Raises:
        NoPseudoinverse: there is none at this h.
    """
    pitch, m = finite_pitch(h), system.twists.shape[1]
    metric = None if joint_metric is None else arrays.positive_definite(joint_metric, m, "joint_metric")
    factored = factors(system, pitch, metric)
    if factored.exists:
        return factored
    raise no_pseudoinverse(system, pitch, factored)


def no_pseudoinverse(system: Subspace, pitch: float, factored: Factors) -> NoPseudoinverse:
    """The error that says why there is no J^{+h}, or none that can be computed."""
    pitches = pitches_or_none(system)
    z = system.exact.basis[:, -1] if factored.dependent else factored.self_reciprocal
    return NoPseudoinverse(
        h=pitch,
        rank=factored.rank,
        gram_rank=factored.rank if factored.dependent else factored.gram_rank,
        self_reciprocal=z / np.linalg.norm(z),
        principal_pitches=pitches[np.argsort(np.abs(pitches - pitch), kind="stable")],
    )


def inverse_along(system: Subspace, projector: Array, joint_metric: ArrayLike | None) -> Array:
    """J^+ P (m, 6) for a projector P (6, 6) on the system, J^+ of least norm in the joint metric."""
    system = system.exact
    m = system.twists.shape[1]
    metric = None if joint_metric is None else arrays.positive_definite(joint_metric, m, "joint_metric")
    U, velocities, units, _ = _full_rank_factors(system, metric)
    return np.asarray(units.dot(velocities).dot(U.T).dot(system.to_own).dot(projector))


def pitches_or_none(system: Subspace) -> Array:
    """The principal pitches for a message; empty if no h works, or rounding hides them."""
    try:
        return pencil(system).values
    except BadInput:
        return np.empty(0)


def damped_pseudoinverse(
    J: ArrayLike | Subspace, h: float, damping: float, *, joint_metric: ArrayLike | None = None
) -> Array:
    """The damped h-pseudoinverse X = V diag(mu / (mu^2 + damping^2)) V'J'Q_h (m, 6) of (6, m) twists, for any h.

    J'Q_h J V = M V diag(mu), V'M V = I. It tends to J^{+h} as the damping tends to 0, if that exists, and is bounded
    and continuous in J and h through every principal pitch: |X s| <= |V'J'Q_h s| / (2 damping) in the metric M. The
    gain along each J v is mu^2 / (mu^2 + damping^2), from 0 at a principal pitch to 1. A change of frame takes X to
    X Ad^-1. It is [DS]'s damped formula with Lambda = damping^2 M (J'Q_h J)^-1 M.

    Args:
        J: (6, m) joint twists as columns, or a `ScrewSystem`.
        h: finite pitch [length/rad].
        damping: above zero, in the unit of mu: a length, if M has no unit; 0 is `pseudoinverse`.
        joint_metric: (m, m) or (m,) positive definite metric M on joint velocities; None is the identity. Give one for
            revolute and prismatic joints together: without it the result depends on the unit of length.

    Reference: after [DS] Sect. 6.2; the choice of Lambda and its bounds are ours, proved by the formula.
    """
    system, size = as_system(J), arrays.not_negative(damping, "damping", "a damping")
    if size == 0.0:
        return invert(system, h, joint_metric).inverse
    mu, V = spectrum(system, finite_pitch(h), joint_metric)
    images = system.length * system.coordinates.dot(V).T.dot(system.form(h))
    with np.errstate(under="ignore"):
        gains = 1.0 / np.hypot(mu, size)
        gains = gains * (mu * gains)
    return np.asarray((V * gains).dot(images).dot(system.to_own))


def spectrum(system: Subspace, h: float, joint_metric: ArrayLike | None) -> tuple[Array, Array]:
    """mu (m,) and V (m, m) with J'Q_h J V = M V diag(mu), V'M V = I, |mu| descending."""
    m = system.twists.shape[1]
    G = gram_matrix(system, h)
    whiten = np.eye(m)
    if joint_metric is not None:
        M = arrays.positive_definite(joint_metric, m, "joint_metric")
        whiten = np.linalg.inv(np.linalg.cholesky(M)).T
    mu, V = np.linalg.eigh(whiten.T.dot(G).dot(whiten))
    order = np.argsort(-np.abs(mu), kind="stable")
    return mu[order], whiten.dot(V[:, order])


@frozen(eq=False, repr=False, slots=False)
class PenroseConditions(Value):
    """The residuals of the four conditions.

    Attributes:
        residuals: (4,) of (hP1)-(hP4), each relative to the matrix it should equal: |J X J - J| over |J|, ...; lengths
            are measured in the own length.
        magnification: |J||X|, by which rounding can be magnified in the products.
        tolerance: the residual that counts as zero, times the magnification.
    """

    residuals: Array = field(converter=own)
    magnification: float
    tolerance: float

    @property
    def met(self) -> tuple[bool, bool, bool, bool]:
        """Which of the four conditions X meets, up to rounding."""
        limit = self.tolerance * max(1.0, self.magnification)
        first, second, third, fourth = (self.residuals <= limit).tolist()
        return first, second, third, fourth


def penrose_conditions(
    J: ArrayLike | Subspace,
    X: ArrayLike,
    h: float,
    *,
    joint_metric: ArrayLike | None = None,
    tolerance: float = ROUNDING,
) -> PenroseConditions:
    """Test (hP1)-(hP4): whether X (m, 6) is the h-pseudoinverse of J (6, m).

    Args:
        J: (6, m) joint twists as columns, or a `ScrewSystem`.
        X: (m, 6) matrix to test.
        h: finite pitch [length/rad].
        joint_metric: (m, m) or (m,) positive definite metric M on joint velocities; None is the identity.
        tolerance: relative residual that counts as zero, before it is multiplied by |J||X|.

    Reference: [DS] (hP1)-(hP4).
    """
    system = as_system(J)
    m = system.twists.shape[1]
    Q = system.form(finite_pitch(h))
    M = np.eye(m) if joint_metric is None else arrays.positive_definite(joint_metric, m, "joint_metric")
    limit = arrays.tolerance(tolerance)
    A, B = system.coordinates, arrays.matrix(X, (m, 6), "X").dot(system.from_own)
    on_twists, on_joints = Q.dot(A).dot(B), M.dot(B).dot(A)
    expected = (A, B, on_twists, on_joints)
    products = (A.dot(B).dot(A), B.dot(A).dot(B), on_twists.T, on_joints.T)
    sizes = [float(np.linalg.norm(matrix)) or 1.0 for matrix in expected]
    residuals = [float(np.linalg.norm(a - b)) / size for a, b, size in zip(products, expected, sizes, strict=True)]
    return PenroseConditions(np.array(residuals), float(np.linalg.norm(A) * np.linalg.norm(B)), limit)


@frozen(eq=False, repr=False, slots=False)
class Existence(Value):
    """The three conditions of Theorem 3.1 for which there is no J^{+h}, each as a number that is then zero.

        (i) rank(J'Q_h J) < rank(J)     (ii) S meets S^{perp h}     (iii) S is tangent to q_h at a point z of S

    Attributes:
        h: the given pitch [length/rad].
        rank: rank of J.
        condition: condition number of J^{+h}, the largest ratio of its relative error to that of the twists.
        gram_rank: (i) numerical rank of J'Q_h J.
        gram_eigenvalue: (i) least |eigenvalue| of U'Q_h U over |Q_h|, U an orthonormal basis of S.
        angle: (ii) least angle between S and S^{perp h} [rad].
        pitch_distance: (iii) |h - h_i| to the nearest principal pitch, in units of |h| + the own length; 0 if some
            translation is reciprocal to all of S, inf if every pitch works, NaN if rounding hides them.
        certificate: (6,) z in S, h-reciprocal to all of S, which proves that there is no h-pseudoinverse; None if
            there is one.
    """

    h: float
    rank: int
    condition: float
    gram_rank: int
    gram_eigenvalue: float
    angle: float
    pitch_distance: float
    certificate: Array | None = field(converter=optional(own))

    @property
    def exists(self) -> bool:
        """Whether S has an h-pseudoinverse that can be computed to three digits; the same as `has_pseudoinverse`."""
        return self.condition <= LARGEST_CONDITION


def existence(J: ArrayLike | Subspace, h: float) -> Existence:
    """Evaluate the three conditions of Theorem 3.1 for (6, m) twists and a finite pitch h [length/rad].

    The twists may be dependent: rank(J) takes the place of m in the theorem.

    Reference: [DS] Theorem 3.1; `certificate` is the z of its proof.
    """
    system, pitch = as_system(J).exact, finite_pitch(h)
    factored = factors(system, pitch)
    if factored.rank in (0, 6):
        return Existence(pitch, factored.rank, factored.condition, factored.rank, 1.0, 0.5 * pi, inf, None)
    if system.concurrent and pitch:  # axes that meet have no own length: the pitch is the unit
        system = type(system)(system.twists, tolerance=system.tolerance, length=abs(pitch))
    U, Q = system.span.basis, system.form(pitch)
    mu = np.linalg.eigvalsh(U.T.dot(Q).dot(U))
    images = np.linalg.qr(Q.dot(U))[0]  # an orthonormal basis of the orthogonal complement of S^{perp h}
    sine = float(np.linalg.svd(images.T.dot(U), compute_uv=False)[-1])
    try:
        principal = pencil(system.with_tolerance(LEAST_INDEPENDENCE * float(system.error_factors.max())))
        gaps = np.abs(principal.values - pitch) / (abs(pitch) + system.length)
        distance = 0.0 if principal.blind.shape[1] else float(gaps.min(initial=inf))
    except BadInput:
        distance = nan
    return Existence(
        h=pitch,
        rank=factored.rank,
        condition=factored.condition,
        gram_rank=factored.gram_rank,
        gram_eigenvalue=float(np.abs(mu).min() / np.abs(Q).max()),
        angle=float(np.arcsin(min(1.0, sine))),
        pitch_distance=distance,
        certificate=None if factored.exists else factored.self_reciprocal,
    )
