"""Forms: what is attempted of a twist that the joints cannot do.

    A = U diag(sigma) V' measured joint twists, b the measured twist, r = b - U U'b what least squares leaves of it:
    U'M (U y - r) = 0,   attempt U (U'b + y),   M the form on measured twists

    PitchForm(h)             Q = Q_h, indefinite, the same in every frame: P_h s ([DS] Sect. 6.2)
    Complement(Z)            Q = KK', K'Z = 0: s projected along Z, what may be given up
    CarriedMetric(W, pose)   definite: measures twists itself, in place of diag(L^2 I, I) at a point

Where the joints can do the whole twist, no form changes anything; else, in exact arithmetic, A x = P b, P the form's
projector. Where a form has no projector (a principal pitch, a planar arm) or |P| is large, small eigenvalues of U'MU
are filtered, and each direction counts only as far as damping leaves it: the attempt goes over to least squares (y = 0)
without a jump. So the law works for every type of arm, and rounding never decides between two laws.

Descent: |b - A x|^2 = |r|^2 + |y|^2 where the attempt is met. At least the share eta of the least-squares decrease is
kept if |y|^2 <= (1 - eta) |U U'b|^2; a longer y is shortened to that.
"""

from __future__ import annotations

from math import sqrt
from numbers import Real
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike
from scipy.linalg import lapack

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.geometry.linear import rank_of
from invariantqp.velocity.damping import Damping
from invariantqp.velocity.exact import ROW_TOLERANCE
from invariantqp.velocity.objective import Spectrum

# Eigenvalues of U'MU below this share of |MU| are filtered. Their inverses are the gains of P: those above three cost
# accuracy when the arm passes a principal pitch, smaller ones do not.
FORM_THRESHOLD = 0.3
# Least size of a direction in |MU|, relative to |M|: its inverse is by how much rounding may be enlarged.
UNSEEN = 1e-7
# A direction of a smaller size is one that M leaves to itself, but for rounding; it fades in, so that there is no jump.
UNTOUCHED = 1e-11


@runtime_checkable
class Form(Protocol):
    """A symmetric form on twists: what is attempted of a twist beyond the joints. Implement it to bring one."""

    def matrix(self, inverse_root: Array) -> Array:
        """(6, 6) the form on measured twists t = root s: t'Mt = s'Qs, M = inverse_root' Q inverse_root."""
        ...

    def describe(self) -> str:
        """One phrase for reports."""
        ...


@frozen(init=False, eq=False, repr=False, slots=False)
class PitchForm(Value):
    """The invariant form Q_h of pitch h [length/rad]: s'Q_h s = 2 (omega.v - h omega.omega).

    What is attempted is P_h s: the rest of s is h-reciprocal to all twists that the joints can do. Large |h| puts
    orientation first; no h puts position first (use exact rows for that).

    Reference: [DS] (2.6), without its factor 1/2, and Sect. 6.2.
    """

    h: float
    convexified: bool

    def __init__(self, h: float, *, convexified: bool = False) -> None:
        """A form.

        Args:
            h: pitch [length/rad], finite.
            convexified: True for [DS]'s own problem made convex: limits and singularities are then measured by
                |J'Q_h J| instead of a metric at a point, in all of `solve_velocity`. Kept to compare with; near
                singularities and at limits it is far less accurate.

        Raises:
            BadInput: an h that is no finite number, a convexified that is neither True nor False.
        """
        if not isinstance(convexified, bool):
            raise BadInput("convexified", excerpt(convexified), "True or False")
        self.__attrs_init__(finite_pitch(h), convexified)

    def matrix(self, inverse_root: Array) -> Array:
        """(6, 6) Q_h on measured twists."""
        Q: Array = inverse_root.T.dot(pitch_form(self.h)).dot(inverse_root)
        return Q

    def describe(self) -> str:
        """One phrase for reports."""
        return f"pitch form h = {self.h:.4g}"


@frozen(init=False, eq=False, repr=False, slots=False)
class Complement(Value):
    """Twists projected along a space Z of twists that may be given up: the arm does s plus some twist of Z.

    Where the arm can do one of those, Jx = P s, P = J(K'J)^-1 K', K'Z = 0.

    Reference: [DS] Sect. 6.2, P = J(K'J)^-1 K'.
    """

    Z: Array = field(converter=own)

    def __init__(self, Z: ArrayLike) -> None:
        """A form.

        Args:
            Z: (6, c) twists in the frame of J, independent; c + rank(J) = 6 makes the projector unique.

        Raises:
            BadInput: dependent columns, NaN.
        """
        twists = arrays.columns(Z, "Z")
        sigma = np.linalg.svd(twists, compute_uv=False)
        rank = rank_of(sigma, ROW_TOLERANCE)
        if rank < twists.shape[1]:
            raise BadInput(
                "Z", f"{twists.shape[1]} columns of rank {rank}", "independent twists", "Drop the dependent ones."
            )
        self.__attrs_init__(twists)

    def matrix(self, inverse_root: Array) -> Array:
        """(6, 6) the projector on what is not given up, KK' with K orthonormal in the measure."""
        measured = np.linalg.solve(inverse_root, self.Z)
        basis = np.linalg.qr(measured)[0]
        M: Array = np.eye(6) - basis.dot(basis.T)
        return M

    def describe(self) -> str:
        """One phrase for reports."""
        return f"projection along the given complement of dimension {self.Z.shape[1]}"


@frozen(init=False, eq=False, repr=False, slots=False)
class CarriedMetric(Value):
    """A positive-definite metric on twists carried by a body: s'Ws, with W given in the body's own frame.

    It replaces diag(L^2 I, I) at a point: what the joints cannot do is missed by least squares in this metric.
    """

    matrix: Array = field(converter=own)
    pose: Array | None = field(converter=optional(own))
    _root: Array = field(converter=own, eq=False, repr=False)  # of W, in the body's frame

    def __init__(self, matrix: ArrayLike, pose: ArrayLike | Literal["tool"] = "tool") -> None:
        """A metric.

        Args:
            matrix: (6, 6) symmetric positive definite, in the body's frame; a (6,) vector is its diagonal. The body's
                inertia or a contact's stiffness, for instance.
            pose: (4, 4) pose of the body's frame in the frame of J, or "tool" to have a controller put it at the tool
                in every tick.

        Raises:
            BadInput: a matrix that is not positive definite, no pose.
        """
        W = arrays.positive_definite(matrix, 6, "matrix")
        if isinstance(pose, str) and pose != "tool":
            raise BadInput("pose", repr(pose), 'a (4, 4) pose or "tool"')
        where = None if isinstance(pose, str) else arrays.pose(pose)
        self.__attrs_init__(W, where, np.asarray(np.linalg.cholesky(W).T, dtype=np.float64))

    @property
    def follows_tool(self) -> bool:
        """Whether a controller is to put it at the tool in every tick."""
        return self.pose is None

    def root(self, tool: Array | None = None) -> Array:
        """(6, 6) with |root s|^2 = s'Ws for twists in the frame of J; `tool` (4, 4) is its pose if it follows the tool.

        Raises:
            BadInput: it follows the tool, and no pose of the tool is given.
        """
        pose = tool if self.follows_tool else self.pose
        if pose is None:
            raise BadInput("form", 'CarriedMetric(..., "tool")', "a CarriedMetric with a (4, 4) pose")
        root: Array = self._root.dot(se3.adjoint(se3.inverse(pose, check=False), check=False))
        return root

    @property
    def carried(self) -> Array:
        """(6, 6) the metric in the frame of J.

        Raises:
            BadInput: it follows the tool.
        """
        root = self.root()
        return np.asarray(root.T.dot(root))

    def describe(self) -> str:
        """One phrase for reports."""
        return f"metric carried by the body at {'the tool' if self.follows_tool else 'the given pose'}"


def form_of(form: Form | CarriedMetric | float | None) -> Form | CarriedMetric | None:
    """The form for an argument: a number is a PitchForm; None is no form, and least squares in the measure decides.

    Raises:
        BadInput: neither a number nor a form.
    """
    if form is None or isinstance(form, (CarriedMetric, Form)):
        return form
    if isinstance(form, bool) or not isinstance(form, Real):
        expected = "a pitch h, PitchForm(h), CarriedMetric(matrix, pose), Complement(Z), or None"
        raise BadInput("form", excerpt(form), expected)
    return PitchForm(finite_pitch(form, "form"))


def attempted(
    form: Form, inverse_root: Array, spectrum: Spectrum, b: Array, damping: Damping, fraction: float | None
) -> Array:
    """(6,) the measured twist to attempt.

    Args:
        form: decides on the part that the joints cannot do.
        inverse_root: (6, 6) of the measure's root.
        spectrum: of the measured joint twists A (6, n).
        b: (6,) measured twist wanted.
        damping: the policy near singularities.
        fraction: eta, the share of the least-squares decrease that is kept; None is no such bound.
    """
    sigma, largest = spectrum.sigma, spectrum.largest
    if largest == 0.0:
        return b
    U = spectrum.U[:, : len(sigma)]
    wanted = b.dot(U)
    squares = damping.squares(sigma, wanted, largest)
    share = sigma * sigma / (sigma * sigma + squares + np.finfo(float).tiny)
    done = U.dot(share * wanted)
    r = b - done
    M = form.matrix(inverse_root)
    V = U * np.sqrt(share)
    norm = float(np.linalg.norm(M)) or 1.0
    seen, sizes, own, _ = lapack.dgesdd(M.dot(V), full_matrices=0)  # |MV| = own' sizes own
    counts = np.clip(sizes / (UNTOUCHED * norm) - 1.0, 0.0, 1.0)
    V, MV = V.dot(own.T), seen * (counts * sizes)
    # A direction that is damped, or untouched, gets a large size, hence an eigenvalue near zero, and is filtered.
    size = np.diag(sizes + (UNSEEN + 1.0 - counts) * norm) + (own * (1.0 - share)).dot(own.T) * norm
    mu, axes, _ = lapack.dsygv(counts[:, None] * V.T.dot(MV), size)
    pull = r.dot(MV).dot(axes)
    left = np.maximum(0.0, 1.0 - (mu / FORM_THRESHOLD) ** 2)
    divisor = mu * mu + (FORM_THRESHOLD * left) ** 2
    y = V.dot(axes.dot(np.divide(mu * pull, divisor, out=np.zeros(len(mu)), where=divisor > 0.0)))
    if fraction is not None:
        most, length = sqrt((1.0 - fraction) * float(done.dot(done))), sqrt(float(y.dot(y)))
        y *= most / max(most, length) if length > 0.0 else 1.0
    attempt: Array = U.dot(wanted) + y
    return attempt
