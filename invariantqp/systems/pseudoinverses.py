"""The h-pseudoinverse J^{+h}, the h-adjoint, the conditions that define J^{+h}, and those under which there is none.

    J = T C  (T a basis of the system, C of full row rank):   J^{+h} = M^-1 C'(C M^-1 C')^-1 (T'Q_h T)^-1 T'Q_h
    (hP1) J X J = J     (hP2) X J X = X     (hP3) (J X)^{*h} = J X     (hP4) (X J)* = X J

It measures twists by Q_h and so depends on no choice of frame. There is one iff rank(T'Q_h T) = rank(J); in floating
point it is given where at least three digits of it are correct. J is factored before a Gram matrix is formed, because
(J'Q_h J)^-1 J'Q_h squares the condition number of J.

(hP3) says that Q_h J X is symmetric: J X projects twists on im J along its h-reciprocal. (hP4) says that M X J is
symmetric, with the joint metric M: X J projects joint velocities along the self-motions, at right angles in M.

Reference: [DS] Sect. 2.3 (2.12)-(2.15), (hP1)-(hP4), after Penrose 1955; Theorem 2.2; Theorem 3.1, Corollary 3.2.
"""

from __future__ import annotations

from math import inf, isfinite, pi
from typing import NamedTuple

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.engine import core
from invariantqp.errors import BadInput, BlindSystem, NoPseudoinverse
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import ROUNDING, Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.systems.gram import pitches_or_none, principal_screws
from invariantqp.systems.subspaces import Span, length_unit, lengths, orthogonal, reciprocal, screw_system, span

# Above this the relative error of 1e-15 that forward kinematics in float64 leaves of joint twists can change J^{+h} by
# more than a thousandth. Arms that are singular by structure (a SCARA at any h) have hundreds of times this number.
LARGEST_CONDITION = 1e12


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

    Q_h s is the wrench that pairs with twists as Q_h does, so J'Q_h s are the torques that it asks of the joints. The
    adjoint of Ad J, in another frame, is J^{*h} Ad^-1.

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
    """J^{+h} from its factors, and how far it can be trusted: how much a relative error of the twists can change it.

        J = T C,   T'Q_h T = diag(mu),   X = J^{+h} = C^+ diag(1/mu) T'Q_h,   G^+ = C^+ diag(1/mu) C^+'
        dX = -X dJ X + G^+ dJ'Q_h(I - JX) + (I - XJ) dJ'X'X + ...

    The condition number is a bound on the sum of these terms, over |X|, for columns of J with relative errors of size
    one. Two choices keep digits: independent columns are scaled to unit size, which cancels; and where |h| is longer
    than the arm, lengths are measured in |h|, since h times the rounding of a rotation would hide the translations.

    Reference: [DS] Theorem 2.2; the condition number is ours, after Wedin's for the Moore-Penrose inverse.
    """

    inverse: Array  # (m, 6) J^{+h}; meaningless where `exists` is false
    condition: float  # ratio of the relative error of J^{+h} to that of the twists, at worst
    spread: float  # the same ratio for the joint velocities that make a twist of the system; the form has no part in it
    screws: Array  # (6, r) basis of the system, mutually h-reciprocal
    shares: Array  # (r,) condition number of the part of J^{+h} that belongs to each screw

    @property
    def exists(self) -> bool:
        """Whether at least three digits of J^{+h} are correct."""
        return self.condition <= LARGEST_CONDITION

    @property
    def rank(self) -> int:
        """Rank of J."""
        return len(self.shares)

    @property
    def gram_rank(self) -> int:
        """Numerical rank of J'Q_h J."""
        return int(np.count_nonzero(self.shares <= LARGEST_CONDITION))

    @property
    def dependent(self) -> bool:
        """Whether near-dependence of the twists, rather than the form, makes the condition number large."""
        return self.spread * self.spread >= self.condition

    @property
    def lost(self) -> Array:
        """(6,) the unit screw of the system that is nearest to being h-reciprocal to all of it."""
        z = self.screws[:, int(self.shares.argmax())]
        return np.asarray(z / np.linalg.norm(z))


def factors(twists: Array, h: float, metric: Array | None = None) -> Factors:
    """J^{+h} with its condition number, for checked (6, m) twists, a finite h and a joint metric (m, m)."""
    system = span(twists)
    m, r = twists.shape[1], system.rank
    if r == 0:
        return Factors(np.zeros((m, 6)), 1.0, 1.0, np.empty((6, 0)), np.empty(0))
    units, magnified = _joint_units(system.scaled(twists), r, metric)
    U, sigma, Vt = np.linalg.svd(system.scaled(twists.dot(units)), full_matrices=False)
    U, velocities = U[:, :r], Vt[:r].T / sigma[:r]
    errors = np.full(m, sigma[0] * magnified)  # of the columns
    far = max(1.0, abs(h) / system.unit)
    length = far * system.unit
    # Sorted by angular part, so that rotations and translations stay apart when the unit of length is changed.
    sorting = np.linalg.svd(U[:3])[2].T
    T = U.dot(sorting)
    T[3:] /= far
    longest = np.linalg.norm(T, axis=0)
    Q = pitch_form(h / length)
    T, velocities = T / longest, velocities.dot(sorting / longest)
    mu, E = np.linalg.eigh(T.T.dot(Q).dot(T))
    T, velocities = T.dot(E), velocities.dot(E)
    images = Q.dot(T)
    with np.errstate(all="ignore"):  # where some mu is zero the condition number comes out infinite
        inverse = (velocities / mu).dot(images.T)
        gram_inverse = (velocities / mu).dot(velocities.T)
        beyond = Q - (images / mu).dot(images.T)
        size = np.linalg.norm(inverse)
        rows = np.linalg.norm(inverse, axis=1) + np.linalg.norm(gram_inverse, axis=1) * np.linalg.norm(beyond) / size
        condition = float(errors.dot(rows) + (errors.sum() * size if r < m else 0.0))
        # For each screw z the first two terms are alike: z'Q_h dJ C^+ / mu, and the same seen from S^{perp h}.
        shares = 2.0 * errors.dot(np.abs(velocities)) * np.linalg.norm(images, axis=0) / np.abs(mu)
        inverse = units.dot(inverse)
    inverse[:, 3:] /= length
    T[3:] *= length
    return Factors(inverse, condition if isfinite(condition) else inf, system.spread, T, shares)


def _joint_units(columns: Array, rank: int, metric: Array | None) -> tuple[Array, float]:
    """A change (m, m) of joint coordinates, and the factor by which it magnifies errors.

    Independent columns get unit size; with dependent columns, the metric becomes the identity.
    """
    m = columns.shape[1]
    if rank == m:
        return np.diag(1.0 / np.linalg.norm(columns, axis=0)), 1.0
    if metric is None:
        return np.eye(m), 1.0
    lower = np.linalg.cholesky(metric)
    magnified = np.linalg.cond(lower / np.linalg.norm(lower, axis=1)[:, None])
    return np.linalg.inv(lower).T, float(magnified)


def has_pseudoinverse(J: ArrayLike, h: float) -> bool:
    """Whether (6, m) twists have an h-pseudoinverse that can be computed to three digits: rank(J'Q_h J) = rank(J).

    Reference: [DS] Theorem 2.2.
    """
    return factors(arrays.columns(J), finite_pitch(h)).exists


def pseudoinverse(J: ArrayLike, h: float, *, joint_metric: ArrayLike | None = None) -> Array:
    """J^{+h}, the h-pseudoinverse of (6, m) twists of any rank, correct to three digits or more.

    For rank 6 it is the same for every h, and with `joint_metric=None` it is the Moore-Penrose pseudoinverse.

    Args:
        J: (6, m) joint twists as columns, (omega; v).
        h: finite pitch [length/rad].
        joint_metric: (m, m) or (m,) positive definite, the metric M on joint velocities; None is the identity. It
            matters only where joints are dependent.

    Returns:
        (m, 6) matrix; x = J^{+h} s is the joint velocity for the twist s.

    Raises:
        NoPseudoinverse: h is a principal pitch of the system, or too near one for three correct digits; or no h works;
            or the joints are too nearly dependent. Carries the proof.

    Reference: [DS] Theorem 2.2, (3.1) for independent columns, (2.15) for rank 6.
    """
    if core is not None and joint_metric is None and type(J) is np.ndarray and type(h) is float:
        inverse: Array | None = core.pseudoinverse(J, h)  # where it is well conditioned
        if inverse is not None:
            return inverse
    twists = arrays.columns(J)
    pitch = finite_pitch(h)
    metric = None
    if joint_metric is not None:
        metric = arrays.positive_definite(joint_metric, twists.shape[1], "joint_metric")
    factored = factors(twists, pitch, metric)
    if factored.exists:
        return factored.inverse
    pitches = pitches_or_none(twists)
    z = screw_system(twists)[:, -1] if factored.dependent else factored.lost
    raise NoPseudoinverse(
        h=pitch,
        rank=factored.rank,
        gram_rank=factored.rank if factored.dependent else factored.gram_rank,
        self_reciprocal=z / np.linalg.norm(z),
        principal_pitches=pitches[np.argsort(np.abs(pitches - pitch), kind="stable")],
    )


@frozen(eq=False, repr=False, slots=False)
class PenroseConditions(Value):
    """How well X meets the four conditions.

    Attributes:
        residuals: (4,) of (hP1)-(hP4), each relative to the matrix it should equal: |J X J - J| over |J|, ...; lengths
            are measured in the arm's own unit, so no unit enters.
        magnification: |J||X|, by which rounding can be magnified in the products.
        tolerance: the residual that counts as zero where nothing is magnified.
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
    J: ArrayLike, X: ArrayLike, h: float, *, joint_metric: ArrayLike | None = None, tolerance: float = ROUNDING
) -> PenroseConditions:
    """Test (hP1)-(hP4): whether X (m, 6) is the h-pseudoinverse of J (6, m), and how well.

    Args:
        J: (6, m) joint twists as columns.
        X: (m, 6) matrix to test.
        h: finite pitch [length/rad].
        joint_metric: (m, m) or (m,) positive definite metric M on joint velocities; None is the identity.
        tolerance: relative residual that counts as zero, before it is multiplied by |J||X|.

    Reference: [DS] (hP1)-(hP4).
    """
    twists = arrays.columns(J)
    m, unit = twists.shape[1], length_unit(twists)
    inverse = arrays.matrix(X, (m, 6), "X")
    Q = pitch_form(finite_pitch(h) / unit)
    M = np.eye(m) if joint_metric is None else arrays.positive_definite(joint_metric, m, "joint_metric")
    limit = arrays.tolerance(tolerance)
    A, B = twists / lengths(unit), inverse * lengths(unit).T
    on_twists, on_joints = Q.dot(A).dot(B), M.dot(B).dot(A)
    wholes = (A, B, on_twists, on_joints)
    made = (A.dot(B).dot(A), B.dot(A).dot(B), on_twists.T, on_joints.T)
    sizes = [float(np.linalg.norm(whole)) or 1.0 for whole in wholes]
    off = [float(np.linalg.norm(one - whole)) / size for one, whole, size in zip(made, wholes, sizes, strict=True)]
    return PenroseConditions(np.array(off), float(np.linalg.norm(A) * np.linalg.norm(B)), limit)


@frozen(eq=False, repr=False, slots=False)
class Existence(Value):
    """The three conditions of Theorem 3.1 under which there is no J^{+h}, each computed by itself.

        (i) rank(J'Q_h J) < rank(J)     (ii) S meets S^{perp h}     (iii) S is tangent to q_h at a point z of S

    Each gives a number, which counts as zero if an error of the twists small enough to leave J^{+h} three correct
    digits could have made it zero.

    Attributes:
        h: the given pitch [length/rad].
        rank: rank of J.
        condition: condition number of J^{+h}, the ratio of its relative error to that of the twists, at worst.
        gram_rank: (i) numerical rank of J'Q_h J.
        gram_eigenvalue: (i) least |eigenvalue| of U'Q_h U over |Q_h|, U an orthonormal basis of S.
        angle: (ii) least angle between S and S^{perp h} [rad].
        pitch_distance: (iii) |h - h_i| to the nearest principal pitch, in units of |h| + the system's length; 0 where
            some translation is reciprocal to all of S, inf where every pitch works.
        degenerate: whether (i), (ii) and (iii) hold; they can differ only where their numbers are at the tolerance.
        certificate: (6,) z in S, h-reciprocal to all of S, which proves that there is no h-pseudoinverse; None where
            (i) does not hold.
    """

    h: float
    rank: int
    condition: float
    gram_rank: int
    gram_eigenvalue: float
    angle: float
    pitch_distance: float
    degenerate: tuple[bool, bool, bool]
    certificate: Array | None = field(converter=optional(own))

    @property
    def exists(self) -> bool:
        """Whether S has an h-pseudoinverse that can be computed to three digits; the same as `has_pseudoinverse`."""
        return self.condition <= LARGEST_CONDITION


def existence(J: ArrayLike, h: float) -> Existence:
    """Evaluate the three conditions of Theorem 3.1 for (6, m) twists and a finite pitch h [length/rad].

    The twists may be dependent: rank(J) takes the place of m in the theorem.

    Reference: [DS] Theorem 3.1; `certificate` is the z of its proof.
    """
    twists, pitch = arrays.columns(J), finite_pitch(h)
    factored = factors(twists, pitch)
    if factored.rank in (0, 6):
        never = (False, False, False)
        return Existence(pitch, factored.rank, factored.condition, factored.rank, 1.0, 0.5 * pi, inf, never, None)
    view = _view(twists, pitch, factored)
    angle, meets = _least_angle(view)
    distance, tangent = _pitch_distance(twists, pitch, view)
    singular = factored.gram_rank < factored.rank
    Q = pitch_form(pitch / view.system.unit)
    mu = np.linalg.eigvalsh(view.system.basis.T.dot(Q).dot(view.system.basis))
    return Existence(
        h=pitch,
        rank=factored.rank,
        condition=factored.condition,
        gram_rank=factored.gram_rank,
        gram_eigenvalue=float(np.abs(mu).min() / np.abs(Q).max()),
        angle=angle,
        pitch_distance=distance,
        degenerate=(singular, meets, tangent),
        certificate=factored.lost if singular else None,
    )


class _View(NamedTuple):
    """The system with lengths measured in its own unit, or in |h| where that is longer."""

    system: Span  # the span, in its own unit of length
    sizes: Array  # (m,) of the columns there
    basis: Array  # (6, r) orthonormal
    form: Array  # (6, 6) Q_h
    length: float  # the length that counts as 1 in `basis` and `form`

    def unit_twist(self, z: Array) -> Array:
        """The unit twist along z (6,), from the caller's unit of length."""
        result = z / lengths(self.length)[:, 0]
        return np.asarray(result / np.linalg.norm(result))

    def resolution(self, z: Array) -> float:
        """The error of a unit twist z of the system when J has the largest error that leaves J^{+h} three digits."""
        own = z * lengths(self.length / self.system.unit)[:, 0]
        velocity = self.system.right.dot(self.system.basis.T.dot(own) / self.system.singular)
        return float(self.sizes.dot(np.abs(velocity))) / LARGEST_CONDITION


def _view(twists: Array, h: float, factored: Factors) -> _View:
    system = span(twists)
    length = max(system.unit, abs(h))
    sizes = np.linalg.norm(system.scaled(twists), axis=0)
    return _View(system, sizes, np.linalg.qr(factored.screws / lengths(length))[0], pitch_form(h / length), length)


def _least_angle(view: _View) -> tuple[float, bool]:
    """The angle between S and S^{perp h}, 2 arcsin(sigma_min / sqrt 2) of both bases; whether it counts as zero."""
    r = view.basis.shape[1]
    other = orthogonal(view.form.dot(view.basis))
    _, sigma, Vt = np.linalg.svd(np.hstack((view.basis, other)))
    z = view.basis.dot(Vt[-1, :r])
    angle = float(2.0 * np.arcsin(min(1.0, sigma[-1] / np.sqrt(2.0))))
    # An error in S moves S^{perp h} by as much, so it counts twice.
    return angle, angle <= 2.0 * view.resolution(z / np.linalg.norm(z))


def _pitch_distance(twists: Array, h: float, view: _View) -> tuple[float, bool]:
    """The distance from h to the nearest principal pitch, and whether it counts as zero."""
    try:
        pitches, screws = principal_screws(twists)
    except BlindSystem:
        return 0.0, True
    if not len(pitches):
        return inf, False
    i = int(np.abs(pitches - h).argmin())
    z = view.unit_twist(screws[:, i])
    # |z'Q_h z| = 2 |h_i - h| |omega|^2, compared with the change that an error of z makes.
    value = 2.0 * abs(pitches[i] - h) / view.length * z[:3].dot(z[:3])
    tangent = value <= 2.0 * float(np.linalg.norm(view.form.dot(z))) * view.resolution(z)
    return float(abs(pitches[i] - h)) / (abs(h) + view.system.unit), bool(tangent)


def reciprocal_has_pseudoinverse(J: ArrayLike, h: float) -> bool:
    """Whether S^{perp h} has an h-pseudoinverse: by the paper's corollary, iff S has.

    S^{perp h} is computed from J, so its twists have larger errors than those of J; that is taken into account.

    Reference: [DS] Corollary 3.2.
    """
    twists, pitch = arrays.columns(J), finite_pitch(h)
    other = factors(reciprocal(twists, pitch), pitch)
    view = _view(twists, pitch, factors(twists, pitch))
    errors = [LARGEST_CONDITION * view.resolution(view.unit_twist(z)) for z in other.screws.T]
    return bool((other.shares * np.maximum(1.0, errors) <= LARGEST_CONDITION).all())
