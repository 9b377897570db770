"""What a joint velocity is judged by: three ways to measure a twist, each giving (G, g) that no frame can change.

    PitchForm(h)             G = J'Q_h J,   g = J'Q_h s                   depends on a length alone
    CarriedMetric(W, pose)   G = J'WJ,      g = J'Ws,  W carried by Ad    tied to the body at `pose`
    Complement(Z)            G = J'KK'J,    g = J'KK's,  K'Z = 0          tied to what may be given up, Z

A law that reads only (G, g), the joint metric and the joint limits cannot depend on where a frame was put.

Reference: [DS] Sect. 6.2 (stationary points of Q_h, the projector along Z).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, isinf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.systems.centre import centre, measured, resting_point, settled
from invariantqp.systems.gram import blind_directions

# The pitch of an arm with fewer than six joints, in its own lengths. At one length the projector is oblique (|P| above
# 180 on an SO-101 in one state of twenty, above 48 at four) and more of a motion's speed is missed, 192 mm/s for 106;
# beyond four, conditioning falls for little. examples/11_which_pitch.py measures it on four arms.
FEW_JOINTS_PITCH = 4.0

# A singular value of Z below this fraction of the largest is a dependent twist.
COMPLEMENT_TOLERANCE = 1e-10


class GramData(NamedTuple):
    """G (m, m) and g (m,): all the law ever sees of twists.

    Attributes:
        G: (m, m).
        g: (m,).
        size: |J|^2 |Q|, what the rounding of G is relative to.
        rank: how many directions the form can tell apart at most.
    """

    G: Array
    g: Array
    size: float
    rank: int = 6


class Norms(NamedTuple):
    """Upper bounds on |Q| and |Q^-1|, the spectral norms of a form's matrix and of its inverse."""

    form: float
    inverse: float


def gram_data(J: Array, QJ: Array, s: Array, norm: float) -> GramData:
    """(J'QJ, J'Qs) from QJ, Q symmetric with |Q| <= norm."""
    return GramData(J.T.dot(QJ), s.dot(QJ), norm * float(np.vdot(J, J)))


def _set(frozen: object, **values: Any) -> None:
    """Store what a frozen dataclass derives from its arguments, once, while it is made."""
    for name, value in values.items():
        object.__setattr__(frozen, name, value)


@dataclass(frozen=True)
class PitchForm:
    """Twists measured by the invariant form Q_h of pitch h [length/rad]: s'Q_h s = 2 (omega.v - h omega.omega).

    Large |h| puts orientation first; no h puts position first (use exact rows for that).

    Reference: [DS] (2.6), without its factor 1/2.
    """

    h: float
    norms: Norms = field(init=False, repr=False, compare=False)
    _Q: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        _set(self, h=finite_pitch(self.h))
        size = 1.0 + 2.0 * abs(self.h)
        _set(self, _Q=pitch_form(self.h), norms=Norms(size, size))

    def gram_data(self, J: Array, s: Array) -> GramData:
        """(J'Q_h J, J'Q_h s)."""
        return gram_data(J, self._Q.dot(J), s, self.norms.form)

    def describe(self) -> str:
        """One phrase for reports."""
        return f"pitch form h = {self.h:.4g}"


@dataclass(frozen=True, eq=False)
class CarriedMetric:
    """A positive-definite metric on twists carried by a body: s'Ws, with W given in the body's own frame.

    Attributes:
        matrix: (6, 6) symmetric positive definite, in the body's frame; a (6,) vector is its diagonal. The body's
            inertia or a contact's stiffness, for instance.
        pose: (4, 4) pose of the body's frame in the frame of J, or "tool" to have a controller put it at the tool in
            every tick.
    """

    matrix: ArrayLike
    pose: ArrayLike | str = "tool"
    norms: Norms | None = field(init=False, repr=False)
    _W: Array | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        W = arrays.positive_definite(self.matrix, 6, "matrix")
        _set(self, matrix=W, norms=None, _W=None)
        if isinstance(self.pose, str):
            if self.pose != "tool":
                raise BadInput("pose", repr(self.pose), 'a (4, 4) pose or "tool"')
            return
        A, B = se3.coadjoint(self.pose), se3.adjoint(self.pose)
        carried = A.dot(W).dot(A.T)
        inverse = B.dot(np.linalg.inv(W)).dot(B.T)
        norms = Norms(float(np.linalg.norm(carried)), float(np.linalg.norm(inverse)))
        _set(self, pose=arrays.pose(self.pose), _W=carried, norms=norms)

    @property
    def follows_tool(self) -> bool:
        """Whether a controller is to put it at the tool in every tick."""
        return isinstance(self.pose, str)

    def at(self, pose: ArrayLike) -> CarriedMetric:
        """The same metric on the body at another (4, 4) pose."""
        return CarriedMetric(self.matrix, pose)

    @property
    def carried(self) -> Array:
        """(6, 6) W in the frame of J.

        Raises:
            BadInput: it follows the tool and has not been put anywhere.
        """
        if self._W is None:
            raise BadInput("form", 'CarriedMetric(..., "tool")', "a CarriedMetric with a (4, 4) pose", "Use .at(pose).")
        return self._W

    def gram_data(self, J: Array, s: Array) -> GramData:
        """(J'WJ, J'Ws), W carried to the frame of J."""
        return gram_data(J, self.carried.dot(J), s, self.norms.form)  # type: ignore[union-attr]

    def describe(self) -> str:
        """One phrase for reports."""
        return f"metric carried by the body at {'the tool' if self.follows_tool else 'the given pose'}"


@dataclass(frozen=True, eq=False)
class Complement:
    """Twists projected along a space Z of twists that may be given up: what is left of s + Z is what the arm can do.

    Where the arm can do all that is left, Jx = P s, P = J(K'J)^-1 K', K'Z = 0, and nothing but Z enters. Where it
    cannot (limits, or a motion that is nearly in Z), what is left is measured in diag(L^2 I, I) at the arm's own point,
    L its own length, and damped like every other form: K is orthonormal there.

    Attributes:
        Z: (6, c) twists in the frame of J, independent; c + rank(J) = 6 makes the projector unique.

    Reference: [DS] (6.5), P = J(K'J)^-1 K'.
    """

    Z: ArrayLike
    norms: None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        Z = arrays.columns(self.Z, "Z")
        sigma = np.linalg.svd(Z, compute_uv=False)
        rank = int(np.count_nonzero(sigma > COMPLEMENT_TOLERANCE * max(sigma[0], np.finfo(float).tiny)))
        if rank < Z.shape[1]:
            raise BadInput(
                "Z", f"{Z.shape[1]} columns of rank {rank}", "independent twists", "Drop the dependent ones."
            )
        _set(self, Z=Z)

    def gram_data(self, J: Array, s: Array) -> GramData:
        """(J'KK'J, J'KK's), K orthonormal in the arm's own length about its own point.

        Raises:
            BadInput: Z and J together cannot fill six dimensions, so that a frame would have to decide.
        """
        Z = np.asarray(self.Z)
        c, m = Z.shape[1], J.shape[1]
        if c + m < 6:
            found = f"{c} column{'s' if c != 1 else ''}"
            raise BadInput("Z", found, f"at least {6 - m} for {m} joints", "Say all that may be given up.")
        length = centre(J).length
        unit = length if 0.0 < length < inf else 1.0
        point = settled(resting_point(J), Z, unit)
        K = np.linalg.svd(measured(Z, point, unit))[0][:, c:]
        here = measured(J, point, unit)
        left = K.T.dot(here)
        return GramData(
            left.T.dot(left), K.T.dot(measured(s, point, unit)).dot(left), float(np.vdot(here, here)), 6 - c
        )

    def describe(self) -> str:
        """One phrase for reports."""
        return f"projection along the given complement of dimension {np.shape(self.Z)[1]}"


Form = PitchForm | CarriedMetric | Complement


def form_of(form: Form | float | None, J: Array, s: Array | None = None) -> Form:
    """The form meant: a pitch is a PitchForm; None is the arm's own length, four times that below six joints.

    Where that is blind (planar arms, SCARA, gantries) or no joint turns: the metric of diag(L^2 I, I) at the arm's own
    point.

    Raises:
        BadInput: neither a number nor one of the three forms.
    """
    if isinstance(form, (PitchForm, CarriedMetric, Complement)):
        return form
    if form is not None:
        if isinstance(form, bool) or not isinstance(form, (int, float, np.number)):
            expected = "a pitch h, PitchForm(h), CarriedMetric(matrix, pose) or Complement(Z)"
            raise BadInput("form", f"{form!r}", expected)
        return PitchForm(float(form))
    point, length = centre(J, s)
    if isinf(length) or (J.shape[1] < 6 and blind_directions(J).shape[1]):
        weight = length * length if 0.0 < length < inf else 1.0
        return CarriedMetric(np.repeat((weight, 1.0), 3), se3.transform(translation=point))
    # All axes through one point: rotations about it, which every h other than 0 measures alike.
    times = 1.0 if J.shape[1] >= 6 else FEW_JOINTS_PITCH
    return PitchForm(times * length if length > 0.0 else 1.0)
