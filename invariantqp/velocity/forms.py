"""Forms: what is attempted of a twist that the joints cannot achieve.

    PitchForm(h)             Q = Q_h, indefinite, the same in every frame: P_h s ([DS] Sect. 6.2)
    Complement(Z)            Q = KK', K'Z = 0: s projected along Z, what may be given up
    CarriedMetric(W, pose)   definite: measures twists itself, in place of diag(L^2 I, I) at a point

A twist that the joints can achieve is the same with every form.
"""

from __future__ import annotations

from numbers import Real
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.geometry.linear import rank_of
from invariantqp.velocity.exact import ROW_TOLERANCE


@runtime_checkable
class Form(Protocol):
    """A symmetric form on twists; implement it for a form of your own."""

    def matrix(self, inverse_root: Array) -> Array:
        """(6, 6) the form on measured twists t = root s: t'Mt = s'Qs, M = inverse_root' Q inverse_root."""
        ...

    def describe(self) -> str:
        """One phrase for reports."""
        ...


@frozen(init=False, eq=False, repr=False, slots=False)
class PitchForm(Value):
    """The invariant form Q_h of pitch h [length/rad]: s'Q_h s = 2 (omega.v - h omega.omega).

    Attempted is P_h s; the rest of s is h-reciprocal to all twists of the joints. Large |h| favours orientation; no h
    favours position (use exact rows for that).

    Reference: [DS] (2.6), without its factor 1/2, and Sect. 6.2.
    """

    h: float

    def __init__(self, h: float) -> None:
        """A form.

        Args:
            h: pitch [length/rad], finite.

        Raises:
            BadInput: an h that is no finite number.
        """
        self.__attrs_init__(finite_pitch(h))

    def matrix(self, inverse_root: Array) -> Array:
        """(6, 6) Q_h on measured twists."""
        Q: Array = inverse_root.T.dot(pitch_form(self.h)).dot(inverse_root)
        return Q

    def describe(self) -> str:
        """One phrase for reports."""
        return f"pitch form h = {self.h:.4g}"


@frozen(init=False, eq=False, repr=False, slots=False)
class Complement(Value):
    """Twists projected along a space Z of twists that may be given up: J x = P s, P = J(K'J)^-1 K', K'Z = 0.

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

    It replaces diag(L^2 I, I) at a point in the least-squares error.
    """

    matrix: Array = field(converter=own)
    pose: Array | None = field(converter=optional(own))
    _root: Array = field(converter=own, eq=False, repr=False)  # of W, in the body's frame

    def __init__(self, matrix: ArrayLike, pose: ArrayLike | Literal["tool"] = "tool") -> None:
        """A metric.

        Args:
            matrix: (6, 6) symmetric positive definite, in the body's frame; a (6,) vector is its diagonal. The body's
                inertia or a contact's stiffness, for instance.
            pose: (4, 4) pose of the body's frame in the frame of J, or "tool" for a controller's tool in every tick.

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
        """Whether the body is the tool of a controller."""
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
    """The form of an argument: a number is a PitchForm, None is least squares.

    Raises:
        BadInput: neither a number nor a form.
    """
    if form is None or isinstance(form, (CarriedMetric, Form)):
        return form
    if isinstance(form, bool) or not isinstance(form, Real):
        expected = "a pitch h, PitchForm(h), CarriedMetric(matrix, pose), Complement(Z), or None"
        raise BadInput("form", excerpt(form), expected)
    return PitchForm(finite_pitch(form, "form"))
