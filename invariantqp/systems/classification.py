"""The Gibson-Hunt type of a screw system, with its moduli, its normal form, and how near it is to another type.

Type I or II: S lies in no, or in one, pitch hyperquadric q_h. A, B, C, D: S has 0, 1, 2, 3 independent screws of
infinite pitch. The index of IA and IB tells how S meets the pencil of the q_h. A 4- or 5-system is named by its
reciprocal.

A type is defined by equations, which data with rounding never satisfy exactly. Each decision therefore compares a
number (a sine, a difference of pitches), computed in own coordinates, with the effect of an error of `tolerance` in the
twists. The result lists these numbers; `margin` is the factor by which the tolerance would have to change for another
name.

    span(Ad(motion) J) = span(normal form of (class, moduli)),   motion = (R, -R p): axes R (rows), origin p

The axes of the frame of a normal form are the principal directions, or the direction of a translation. Its origin is
the point about which the moments vanish, except those that translations of the system can cancel.

Reference: [DS] Sect. 3, Tables 1 and 2, Table 3 with its missing IID (no three translations have a pseudoinverse); the
1-systems of Sect. 2.2.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import NamedTuple

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.se3 import cross, norm, perpendicular_axes
from invariantqp.systems.gram import Border, Parts, check_rounding, split
from invariantqp.systems.subspaces import TOLERANCE, Subspace

# [DS] Tables 1 and 2: the columns of each class from its moduli. h, a, b, c are pitches [length/rad], p a ratio.
_TWISTS: dict[tuple[int, str], Callable[..., list[tuple[float, ...]]]] = {
    (1, "h"): lambda h: [(1, 0, 0, h, 0, 0)],
    (1, "h=inf"): lambda: [(0, 0, 0, 1, 0, 0)],
    (2, "IA"): lambda a, b: [(1, 0, 0, a, 0, 0), (0, 1, 0, 0, b, 0)],
    (2, "IIA"): lambda h: [(1, 0, 0, h, 0, 0), (0, 1, 0, 0, h, 0)],
    (2, "IB"): lambda p: [(1, 0, 0, 0, 0, 0), (0, 0, 0, 1, p, 0)],
    (2, "IIB"): lambda h: [(1, 0, 0, h, 0, 0), (0, 0, 0, 0, 1, 0)],
    (2, "IIC"): lambda: [(0, 0, 0, 1, 0, 0), (0, 0, 0, 0, 1, 0)],
    (3, "IA1"): lambda a, b, c: [(1, 0, 0, a, 0, 0), (0, 1, 0, 0, b, 0), (0, 0, 1, 0, 0, c)],
    (3, "IA2"): lambda a, b: [(1, 0, 0, a, 0, 0), (0, 1, 0, 0, b, 0), (0, 0, 1, 0, 0, b)],
    (3, "IIA"): lambda h: [(1, 0, 0, h, 0, 0), (0, 1, 0, 0, h, 0), (0, 0, 1, 0, 0, h)],
    (3, "IB0"): lambda h, p: [(1, 0, 0, h, 0, 0), (0, 1, 0, 0, h, 0), (0, 0, 0, 1, 0, p)],
    (3, "IB3"): lambda a, b: [(1, 0, 0, a, 0, 0), (0, 1, 0, 0, b, 0), (0, 0, 0, 0, 0, 1)],
    (3, "IIB"): lambda h: [(1, 0, 0, h, 0, 0), (0, 1, 0, 0, h, 0), (0, 0, 0, 0, 0, 1)],
    (3, "IC"): lambda p: [(1, 0, 0, 0, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 1, 0, p)],
    (3, "IIC"): lambda h: [(1, 0, 0, h, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 0, 0, 1)],
    (3, "IID"): lambda: [(0, 0, 0, 1, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 0, 0, 1)],
}

# Names of the zero to three pitches of a class, ascending (IA2: the single one first).
_PITCH_NAMES: tuple[tuple[str, ...], ...] = ((), ("h",), ("h_a", "h_b"), ("h_a", "h_b", "h_c"))
# Reports mention the next type below this margin.
NEAR_BORDER = 10.0
# `next` is the type at a tolerance this share past the nearest border. Borders closer together count as one: a small
# angular part is also a small difference of pitches, and no system nearby is of the type between the two.
PAST_BORDER = 1e-2
# No h exists for these ([DS] Table 3 and its missing IID); 4- and 5-systems follow their reciprocal (Corollary 3.2).
_NO_PSEUDOINVERSE = {(1, "h=inf"), (2, "IIB"), (2, "IIC")} | {(3, n) for n in ("IB3", "IC", "IIB", "IIC", "IID")}


class _Frame(NamedTuple):
    """The frame of a normal form: pitches, ratios, axes (3, 3) as rows, origin (3,), lengths in the own length."""

    pitches: tuple[float, ...]
    ratios: tuple[float, ...]
    axes: Array
    origin: Array


def normal_form(dimension: int, name: str, moduli: tuple[float, ...]) -> Array:
    """The (6, k) columns of [DS] Tables 1 and 2 for a class (k <= 3) and its moduli."""
    return np.array(_TWISTS[dimension, name](*moduli), dtype=np.float64).T


def _pitch(s: Parts) -> float:
    return float(s.W[:, 0].dot(s.V[:, 0]))


def _axes(x: Array, y: Array | None = None) -> Array:
    """Axes as rows from the first and the second; any second one if None."""
    y = perpendicular_axes(x)[0] if y is None else y
    return np.array((x, y, cross(x, y)))


def _two_screws(s: Parts) -> _Frame:
    R = _axes(s.W[:, 0], s.W[:, 1])
    m = R.dot(s.V)  # the axes of the principal screws meet at right angles in the origin
    return _Frame(tuple(s.pitches.tolist()), (), R, R.T.dot((m[2, 1], -m[2, 0], 0.5 * (m[1, 0] - m[0, 1]))))


def _screw_and_translation(s: Parts) -> _Frame:
    """IB: the translation cancels the pitch."""
    w, v, n = s.W[:, 0], s.V[:, 0], s.N[:, 0]
    along = float(w.dot(n))
    n = n if along >= 0.0 else -n
    normal = n - abs(along) * w
    size = norm(normal)
    R = _axes(w)
    if size > NEGLIGIBLE:
        y = normal / size
        y = y - w * w.dot(y)  # once more: `normal` may be small
        R = _axes(w, y / norm(y))
    return _Frame((), (size / abs(along),), R, cross(w, v - n * (w.dot(v) / abs(along))))


def _screw_across_translation(s: Parts) -> _Frame:
    """IIB: the translation is across the axis, and the pitch stays."""
    w, v = s.W[:, 0], s.V[:, 0]
    y = s.N[:, 0] - w * w.dot(s.N[:, 0])
    return _Frame((_pitch(s),), (), _axes(w, y / np.linalg.norm(y)), cross(w, v))


def _three_screws(s: Parts) -> _Frame:
    R = s.W.T * np.array([[1.0], [1.0], [np.sign(np.linalg.det(s.W))]])
    M = s.V.dot(s.W.T)  # v = M omega: symmetric about the origin, so the skew part is where it lies
    a = 0.5 * np.array((M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]))
    return _Frame(tuple(s.pitches.tolist()), (), R, a)


def _plane_and_translation(s: Parts) -> _Frame:
    """IB0: the translation leaves the plane of directions at an angle; both pitches can be made the same."""
    W, n = s.W, s.N[:, 0]
    c = W.T.dot(n)
    x = W.dot(c) / np.linalg.norm(c)
    z = cross(W[:, 0], W[:, 1])
    z = z if z.dot(n) >= 0.0 else -z
    R = np.array((x, cross(z, x), z))
    n1, n3 = float(x.dot(n)), float(z.dot(n))
    mx, my = (R.dot(s.V.dot(W.T.dot(axis))) for axis in R[:2])
    h = float(my[1])
    a, b = (h - mx[0]) / n1, -(my[0] + mx[1]) / n1
    return _Frame((h,), (n3 / n1,), R, R.T.dot((my[2] + b * n3, -mx[2] - a * n3, mx[1])))


def _plane_across_translation(s: Parts) -> _Frame:
    R = _axes(s.W[:, 0], s.W[:, 1])
    m = R.dot(s.V)
    return _Frame(tuple(s.pitches.tolist()), (), R, R[2] * (0.5 * (m[1, 0] - m[0, 1])))


def _screw_and_plane(s: Parts) -> _Frame:
    """IC: the axis meets the plane of translations at an angle."""
    w, v = s.W[:, 0], s.V[:, 0]
    normal = cross(s.N[:, 0], s.N[:, 1])
    y = cross(normal, w)
    y = y / np.linalg.norm(y)
    n = cross(y, normal)
    n = n if n.dot(w) >= 0.0 else -n
    if cross(w, y).dot(n) < 0.0:
        y = -y
    R = _axes(w, y)
    along = float(w.dot(n))
    return _Frame((), (float(R[2].dot(n)) / along,), R, cross(w, v - n * (w.dot(v) / along)))


_FRAMES: dict[tuple[int, str], Callable[[Parts], _Frame]] = {
    (1, "h"): lambda s: _Frame((_pitch(s),), (), _axes(s.W[:, 0]), cross(s.W[:, 0], s.V[:, 0])),
    (1, "h=inf"): lambda s: _Frame((), (), _axes(s.N[:, 0]), np.zeros(3)),
    **dict.fromkeys([(2, "IA"), (2, "IIA")], _two_screws),
    (2, "IB"): _screw_and_translation,
    (2, "IIB"): _screw_across_translation,
    (2, "IIC"): lambda s: _Frame((), (), _axes(s.N[:, 0], s.N[:, 1]), np.zeros(3)),
    **dict.fromkeys([(3, "IA1"), (3, "IA2"), (3, "IIA")], _three_screws),
    (3, "IB0"): _plane_and_translation,
    **dict.fromkeys([(3, "IB3"), (3, "IIB")], _plane_across_translation),
    (3, "IC"): _screw_and_plane,
    (3, "IIC"): lambda s: _Frame((_pitch(s),), (), _axes(s.W[:, 0]), np.zeros(3)),
    (3, "IID"): lambda _: _Frame((), (), np.eye(3), np.zeros(3)),
}


@frozen(eq=False, repr=False, slots=False)
class GibsonHunt(Value):
    """The type of a k-system; `str()` is the name in [DS] Tables 1 and 2.

    Attributes:
        name: the class; of the reciprocal system where `reciprocal` is true.
        dimension: k.
        reciprocal: whether `name` is that of the reciprocal 2- or 1-system (k = 4, 5).
        admits_pseudoinverse: whether some h has an h-pseudoinverse.
        moduli: the invariants of the named system, in the order of `modulus_names`.
        modulus_names: "h..." are pitches [length/rad], ascending (IA2: the single one first), "p" is a ratio.
        normal_form: (6, n) columns of [DS]'s normal form of the named system, n = k or 6 - k.
        motion: (4, 4) rigid motion with span(Ad(motion) S) = span(normal_form), for the named system S.
        borders: all decisions, the one nearest to its border first.
        next: the name at a tolerance 1 % past the nearest border; "" if all borders are within rounding.
    """

    name: str
    dimension: int
    reciprocal: bool
    admits_pseudoinverse: bool
    moduli: tuple[float, ...]
    modulus_names: tuple[str, ...]
    normal_form: Array = field(converter=own)
    motion: Array = field(converter=own)
    borders: tuple[Border, ...]
    next: str

    def __str__(self) -> str:
        return self.name

    @property
    def margin(self) -> float:
        """The factor by which the tolerance would have to change for another name."""
        return self.borders[0].margin

    @property
    def near_border(self) -> bool:
        """Whether the margin is small: `next` may be the right name."""
        return self.margin < NEAR_BORDER


class _Decision(NamedTuple):
    dimension: int
    name: str
    parts: Parts | None
    borders: tuple[Border, ...]


def gibson_hunt(J: ArrayLike, tolerance: float = TOLERANCE, *, length: float | None = None) -> GibsonHunt:
    """Classify the system that (6, m) twists span.

    Args:
        J: (6, m) twists as columns, dependent or not.
        tolerance: relative error of the twists: if twists within it have a more special type, or a lower dimension,
            that is the answer.
        length: reference length for deciding which pitches and distances are zero; by default the system's own.

    Returns:
        GibsonHunt; near a border `.margin` is near 1 and `.next` names the type on the other side.

    Raises:
        BadInput: only zero twists, or twists so far from the origin that rounding decides.

    Reference: [DS] Sect. 3, Tables 1 and 2; 4- and 5-systems by their reciprocals.
    """
    return classify(Subspace(J, tolerance=tolerance, length=length))


def classify(system: Subspace) -> GibsonHunt:
    """The type of a system; the zero system has none."""
    if not system.dimension:
        raise BadInput("J", "only zero twists", "at least one non-zero twist", "The zero system has no type.")
    k, name, parts, borders = _decide(system)
    check_rounding(system, borders)
    borders = tuple(sorted(borders, key=lambda b: b.margin))
    following = ""
    if borders[0].margin < inf:
        past = borders[0].value * (1.0 - PAST_BORDER if borders[0].vanishes else 1.0 + PAST_BORDER)
        if past > system.rounding:
            other = _decide(system.with_tolerance(past))
            following = other.name if other.dimension == k else f"{other.name} ({other.dimension}-system)"
    n = min(k, 6 - k)
    moduli: tuple[float, ...] = ()
    names: tuple[str, ...] = ()
    form, motion = np.empty((6, 0)), np.eye(4)
    if parts is not None:
        frame = _FRAMES[n, name](parts)
        moduli = (*(h * system.length for h in frame.pitches), *frame.ratios)
        names = (*_PITCH_NAMES[len(frame.pitches)], *("p" for _ in frame.ratios))
        motion[:3, :3] = frame.axes
        motion[:3, 3] = -frame.axes.dot(system.point + frame.origin * system.length)
        form = normal_form(n, name, moduli)
    return GibsonHunt(
        name=name,
        dimension=k,
        reciprocal=3 < k < 6,
        admits_pseudoinverse=(n, name) not in _NO_PSEUDOINVERSE,
        moduli=moduli,
        modulus_names=names,
        normal_form=form,
        motion=motion,
        borders=borders,
        next=following,
    )


def _decide(system: Subspace) -> _Decision:
    """The dimension and the type, the parts of the system, and the numbers that decide."""
    span, tolerance, k = system.span, system.tolerance, system.dimension
    size = np.concatenate((span.singular, span.cut)) / span.singular[0]
    borders = tuple(Border("dimension", float(s), tolerance) for s in size[max(k - 1, 1) : k + 1])
    borders += (Border("angular to linear ratio", system.angular_share, tolerance),)
    if k == 6:
        return _Decision(6, "SE3", None, borders)
    parts = split(system)
    borders += parts.borders
    e, n = parts.W.shape[1], parts.W.shape[1] + parts.N.shape[1]
    if n == 1:
        return _Decision(k, "h" if e else "h=inf", parts, borders)
    letter = "ABCD"[n - e]
    if parts.coupled:
        return _Decision(k, "IB0" if (n, e) == (3, 2) else f"I{letter}", parts, borders)
    if e < 2:
        return _Decision(k, f"II{letter}", parts, borders)
    parts, gaps = _principal(parts, tolerance / system.independence)
    borders += tuple(Border("pitch difference", g * system.independence, tolerance) for g in gaps)
    if len(parts.pitches) == 1:
        return _Decision(k, f"II{letter}", parts, borders)
    name = "IA" if n == 2 else "IB3" if e == 2 else "IA2" if len(parts.pitches) == 2 else "IA1"
    return _Decision(k, name, parts, borders)


def _principal(s: Parts, tolerance: float) -> tuple[Parts, list[float]]:
    """The parts with principal directions, their moments and the distinct pitches; the gaps between the pitches."""
    A = s.W.T.dot(s.V)
    pitches, X = np.linalg.eigh(0.5 * (A + A.T))
    # An error in the basis is magnified in the pitch h_i = x'A x by |x / angular|^2.
    reduced = 1.0 / ((X / s.angular[:, None]) ** 2).sum(axis=0)
    gaps = ((pitches[1:] - pitches[:-1]) * np.minimum(reduced[1:], reduced[:-1])).tolist()
    equal = [g <= tolerance for g in gaps]
    if all(equal):
        pitches = pitches.mean(keepdims=True)
    elif any(equal):  # the single one first
        if equal[0]:
            X, pitches = X[:, [2, 0, 1]], pitches[[2, 0, 1]]
        pitches = np.array((pitches[0], 0.5 * (pitches[1] + pitches[2])))
    return s._replace(W=s.W.dot(X), V=s.V.dot(X), pitches=pitches), gaps
