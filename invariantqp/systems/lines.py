"""Lines in involution: 2 to 6 axes and forces along them that need no joint torque; transversals; null planes.

    z in S meet S^{perp 0}:   W = Q_0 z = Q_0 J lambda is a wrench along the lines with J'W = 0: no joint needs a torque

Independent lines are in involution, det(J'Q_0 J) = 0, iff J has no 0-pseudoinverse; dependent lines are, by
J lambda = 0 and W = 0.

A transversal is a line reciprocal to all of the lines: it meets each or is parallel to it. A transversal at infinity
is a translation reciprocal to all: all lines are parallel to the plane across it. Both are null twists of the Klein
form on the reciprocal system R, and det(J'Q_0 J) = 0 iff det(R'Q_0 R) = 0. Of four independent lines R is a 2-system:

    R of type IA, pitches of one sign, or IIA of pitch p != 0     no real transversal             not in involution
    IA, pitches of opposite sign                                  two                             not
    IB                                                            one, and one at infinity        not
    IA, one pitch 0                                               one, which counts twice         in involution
    IIB, pitch p != 0                                             one at infinity, twice          in involution
    IIA or IIB, pitch 0                                           infinitely many                 in involution

R is of type IIB with p != 0 if the lines are parallel to one plane and their heights have the cross ratio of their
directions.
Five lines are in involution iff they have a transversal, finite or at infinity.

Planes of null screws are the 3-systems in which all screws have one pitch h and every two are h-reciprocal:

    alpha    all screws of pitch h whose axes pass through a point     (w; p x w + h w)                type IIA
             ... through a point at infinity: axes along u             (u; h u), slides across u       type IIC
    beta     all screws of pitch h whose axes lie in a plane           w across n, and the slide n     type IIB
             ... in the plane at infinity: all slides                  of pitch inf, in every q_h      type IID

They are the planes that lie wholly in the pitch hyperquadric q_h of projective 5-space, in two families; there are no
others. Such a system is its own h-reciprocal, S = S^{perp h}, so it has no h-pseudoinverse for its h; for any other
pitch a finite alpha-plane has one, and the other three kinds have none. At h = 0 a spherical wrist is an alpha-plane,
parallel hinges one at infinity, three hinges with axes in one plane a beta-plane, a gantry the one at infinity. As
wrenches Q_0 s, an alpha-plane is all forces through a point, and a beta-plane all forces in a plane.

Reference: [DS] Sect. 4, corrected (errata 6 and 10 in the guide); Sect. 2.2 (the two rulings), Table 2.
"""

from __future__ import annotations

from math import inf
from typing import Literal

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike, NDArray

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import ROUNDING, Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.geometry.linear import orthogonal
from invariantqp.geometry.screws import pitch
from invariantqp.geometry.se3 import norm
from invariantqp.systems.classification import classify
from invariantqp.systems.gram import gram_matrix
from invariantqp.systems.pseudoinverses import LARGEST_CONDITION, factors
from invariantqp.systems.subspaces import Subspace, as_system

# [DS] Table 2: the 3-systems that lie in one q_h, as planes.
_FAMILIES: dict[str, Literal["alpha", "beta"]] = {"IIA": "alpha", "IIC": "alpha", "IIB": "beta", "IID": "beta"}


@frozen(eq=False, repr=False, slots=False)
class Involution(Value):
    """Whether lines are in involution, and their transversals.

    Attributes:
        holds: whether forces along the lines, not all zero, need no torque of any joint.
        determinant: Sylvester's det(J'Q_0 J) of the columns as given; J A has det(A)^2 times it.
        rank: number of independent lines.
        transversals: (6, n) unit lines that meet (or are parallel to) all lines: all of them if finitely many, else
            lines among them that are a basis of their span.
        transversal_count: 0, 1, 2 or inf, without those at infinity.
        double: whether the only transversal, a line or at infinity, counts twice (the limit of two).
        at_infinity: (6, k) unit translations reciprocal to all lines, a basis: the transversals at infinity.
        joint_forces: (m,) lambda, unit, the forces along the lines that balance; None unless `holds`.
        equilibrium_wrench: (6,) their sum W = Q_0 J lambda: zero if the lines are dependent, else a force along a
            transversal, or a couple, that does no work on any joint; None unless `holds`.
    """

    holds: bool
    determinant: float
    rank: int
    transversals: Array = field(converter=own)
    transversal_count: float
    double: bool
    at_infinity: Array = field(converter=own)
    joint_forces: Array | None = field(converter=optional(own))
    equilibrium_wrench: Array | None = field(converter=optional(own))


def involution(lines: ArrayLike, tolerance: float = 1.0 / LARGEST_CONDITION) -> Involution:
    """Decide involution of 2..6 lines and find their transversals and equilibrium.

    Args:
        lines: (6, m) twists of pitch 0 as columns, of any length, 2 <= m <= 6.
        tolerance: relative error of the lines: they are in involution if lines within such an error are. By default
            that at which `has_pseudoinverse` is false.

    Reference: [DS] Sect. 4.
    """
    J = _lines(lines)
    limit = arrays.tolerance(tolerance)
    system = Subspace(J).exact
    factored = factors(system, 0.0)
    Q = pitch_form(0.0)  # the same matrix in every frame and unit of length
    dependent = system.dimension < J.shape[1]
    kernel = int(np.count_nonzero(factored.screw_conditions * limit > 1.0))
    forces: Array | None = None
    wrench: Array | None = None
    if dependent:
        forces = system.null_space[:, -1]
        wrench = np.zeros(6)
    elif kernel:
        forces = system.joint_velocities(factored.self_reciprocal[:, None])[:, 0]
        forces = np.asarray(forces / np.linalg.norm(forces))
        wrench = Q.dot(J.dot(forces))
    R = orthogonal(Q.dot(system.span.basis))
    finite, at_infinity, infinite, double = _transversals(R, Q, kernel, limit * system.joint_condition)
    return Involution(
        holds=dependent or kernel > 0,
        determinant=float(np.linalg.det(gram_matrix(system, 0.0))),
        rank=system.dimension,
        transversals=system.from_own.dot(finite),
        transversal_count=inf if infinite else float(finite.shape[1]),
        double=double,
        at_infinity=at_infinity,
        joint_forces=forces,
        equilibrium_wrench=wrench,
    )


def _lines(value: ArrayLike) -> Array:
    J = arrays.columns(value, "lines")
    expected = "2 to 6 columns (omega; v), each a line: omega not zero and omega.v = 0"
    if not 2 <= J.shape[1] <= 6:
        raise BadInput("lines", f"{J.shape[1]} columns", expected)
    for i, s in enumerate(J.T):
        h = pitch(s) if s.any() else inf
        w = norm(s[:3])
        if h == inf or abs(h) > arrays.NEGLIGIBLE * max(1.0, float(np.linalg.norm(s[3:])) / w):
            found = f"a column {i} of pitch {h:.4g}" if s.any() else f"a zero column {i}"
            raise BadInput("lines", found, expected, "Only revolute joints are lines; for others has_pseudoinverse.")
    return J


def _transversals(R: Array, Q: Array, kernel: int, tolerance: float) -> tuple[Array, Array, bool, bool]:
    """Lines and translations of the reciprocal system R (6, n); whether infinitely many; whether one is double.

    `kernel` is the dimension of S meet S^{perp 0}, the kernel of the Klein form on S and on R.
    """
    n = R.shape[1]
    mu, E = np.linalg.eigh(R.T.dot(Q).dot(R))
    zero = np.zeros(n, dtype=bool)
    zero[np.argsort(np.abs(mu))[:kernel]] = True
    up, down = np.flatnonzero(~zero & (mu > 0.0)), np.flatnonzero(~zero & (mu < 0.0))
    # Null are combinations of a positive and a negative direction, and the kernel.
    pairs = [
        np.sqrt(-mu[j]) * E[:, i] + sign * np.sqrt(mu[i]) * E[:, j] for i in up for j in down for sign in (1.0, -1.0)
    ]
    null = [*E[:, zero].T, *pairs]
    infinite = kernel > 1 or (n > 2 and bool(pairs))
    if infinite:  # sums with the kernel are null too: lines where a translation is not
        null += [a + b for i, a in enumerate(null[:kernel]) for b in null[i + 1 :]]
    unit, is_line = _unit_lines(R.dot(np.array(null).T.reshape(n, len(null))), tolerance)
    lines, at_infinity = unit[:, is_line], unit[:, ~is_line]
    if infinite:
        lines = lines[:, _independent(lines)]
        _, sigma, V = np.linalg.svd(R[:3])
        at_infinity = R.dot(V[np.count_nonzero(sigma > tolerance) :].T)
    at_infinity[:3] = 0.0
    return lines, at_infinity, infinite, n > 1 and kernel == 1 and not pairs


def _independent(columns: Array) -> list[int]:
    """Indices of the first columns that are independent of those before them."""
    chosen: list[int] = []
    for i in range(columns.shape[1]):
        sigma = np.linalg.svd(columns[:, [*chosen, i]], compute_uv=False)
        if len(chosen) < len(columns) and sigma[-1] > ROUNDING * sigma[0]:
            chosen.append(i)
    return chosen


def _unit_lines(null: Array, tolerance: float) -> tuple[Array, NDArray[np.bool_]]:
    """Null twists as unit lines, or unit translations if they have no angular part; and which of them are lines."""
    unit = null / np.sqrt((null * null).sum(axis=0))
    w = np.sqrt((unit[:3] * unit[:3]).sum(axis=0))
    is_line = w > tolerance
    return unit / np.where(is_line, w, 1.0), is_line


@frozen(eq=False, repr=False, slots=False)
class NullPlane(Value):
    """An alpha- or beta-plane; made by `alpha_plane`, `beta_plane` or `null_plane`.

    Attributes:
        family: "alpha" or "beta".
        h: pitch of its screws [length/rad]; inf for the beta-plane at infinity, whose screws are all slides.
        point: (3,) on all the axes (alpha), or in the plane (beta); None at infinity.
        direction: (3,) unit, of all the axes (alpha at infinity) or normal to the plane (beta); else None.
    """

    family: Literal["alpha", "beta"]
    h: float
    point: Array | None = field(converter=optional(own))
    direction: Array | None = field(converter=optional(own))

    @property
    def basis(self) -> Array:
        """(6, 3) screws that span the plane."""
        if self.direction is None:
            return np.eye(6)[:, 3:] if self.point is None else _screws(np.eye(3), self.point, self.h)
        u = self.direction
        across = orthogonal(u[:, None])
        if self.point is None:
            slides = np.vstack((np.zeros((3, 2)), across))
            return np.column_stack((_screws(u[:, None], np.zeros(3), self.h), slides))
        return np.column_stack((_screws(across, self.point, self.h), np.append(np.zeros(3), u)))


def alpha_plane(point: ArrayLike | None = None, h: float = 0.0, *, direction: ArrayLike | None = None) -> NullPlane:
    """All screws of pitch h through a point; or, for a point at infinity, along a direction, with the slides across it.

    Args:
        point: (3,) the point [length].
        h: finite pitch [length/rad].
        direction: (3,) instead of a point, the direction of all axes; any non-zero length.

    Reference: [DS] Sect. 2.2.
    """
    if (point is None) == (direction is None):
        raise BadInput("point", "neither" if point is None else "point and direction", "one of point and direction")
    p = None if point is None else arrays.vector(point, 3, "point")
    u = None if direction is None else arrays.direction(direction, "direction")
    return NullPlane("alpha", finite_pitch(h), p, u)


def beta_plane(point: ArrayLike, normal: ArrayLike, h: float = 0.0) -> NullPlane:
    """All screws of pitch h [length/rad] with axes in a plane, by a point (3,) of it and its normal; the slide across.

    Reference: [DS] Sect. 2.2.
    """
    return NullPlane("beta", finite_pitch(h), arrays.vector(point, 3, "point"), arrays.direction(normal, "normal"))


def null_plane(S: ArrayLike | Subspace) -> NullPlane | None:
    """The alpha- or beta-plane that (6, m) twists span, dependent or not; None if they span no such plane.

    Reference: [DS] Table 2, types IIA to IID.
    """
    kind = classify(as_system(S, "S"))
    if kind.dimension != 3 or kind.name not in _FAMILIES:
        return None
    axes, h = kind.motion[:3, :3], kind.moduli[0] if kind.moduli else inf
    origin = -axes.T.dot(kind.motion[:3, 3])
    point = origin if kind.name in {"IIA", "IIB"} else None
    direction = {"IIC": axes[0], "IIB": axes[2]}.get(kind.name)
    return NullPlane(_FAMILIES[kind.name], h, point, direction)


def _screws(directions: Array, point: Array, h: float) -> Array:
    """(6, k) screws of pitch h through a point along (3, k) directions."""
    return np.vstack((directions, np.cross(point, directions, axis=0) + h * directions))
