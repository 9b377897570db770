"""The normal form of each Gibson-Hunt type, and the frame in which a system takes its normal form.

    span(Ad(motion) J) = span(normal_form(class, moduli)),   motion = (R, -R p): axes R (rows), origin p

The axes of that frame are the principal directions (or the direction of a translation, where there is one). Its origin
is the point about which the moments vanish, those aside that translations of the system can cancel.

Reference: [DS] Tables 1 and 2; the 1-systems of Sect. 2.2; IID (all translations), absent from [DS] Table 3, is here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import across, cross

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

# What each modulus is called, in order: h_a <= h_b <= h_c pitches (IA2: the single one first), p = tan of an angle.
MODULUS_NAMES: dict[tuple[int, str], tuple[str, ...]] = {
    **dict.fromkeys([(1, "h"), (2, "IIA"), (2, "IIB"), (3, "IIA"), (3, "IIB"), (3, "IIC")], ("h",)),
    **dict.fromkeys([(2, "IA"), (3, "IA2"), (3, "IB3")], ("h_a", "h_b")),
    **dict.fromkeys([(2, "IB"), (3, "IC")], ("p",)),
    **dict.fromkeys([(1, "h=inf"), (2, "IIC"), (3, "IID")], ()),
    (3, "IA1"): ("h_a", "h_b", "h_c"),
    (3, "IB0"): ("h", "p"),
}


class Frame(NamedTuple):
    """The frame of a normal form: pitches [the caller's unit of v], ratios, axes (3, 3) as rows, origin (3,)."""

    pitches: tuple[float, ...]
    ratios: tuple[float, ...]
    axes: Array
    origin: Array


class Parts(NamedTuple):
    """A k-system, k <= 3, split into screws of finite pitch and translations.

    W (3, e) orthonormal directions and V (3, e) their moments; N (3, d) orthonormal translations. Where d = 0, or the
    translations are across the directions, W are principal directions and `pitches` (e,) ascend.
    """

    W: Array
    V: Array
    N: Array
    pitches: Array


def normal_form(dimension: int, name: str, moduli: tuple[float, ...]) -> Array:
    """The (6, k) columns of [DS] Tables 1 and 2 for a class (k <= 3) and its moduli."""
    return np.array(_TWISTS[dimension, name](*moduli), dtype=np.float64).T


def _pitch(s: Parts) -> float:
    return float(s.W[:, 0].dot(s.V[:, 0]))


def _axes(x: Array, y: Array | None = None) -> Array:
    """Axes as rows from the first and the second; some second one where the system has none."""
    y = across(x)[0] if y is None else y
    return np.array((x, y, cross(x, y)))


def _two_screws(s: Parts) -> Frame:
    R = _axes(s.W[:, 0], s.W[:, 1])
    m = R.dot(s.V)  # the axes of the principal screws meet at right angles in the origin
    return Frame(tuple(s.pitches.tolist()), (), R, R.T.dot((m[2, 1], -m[2, 0], 0.5 * (m[1, 0] - m[0, 1]))))


def _screw_and_translation(s: Parts) -> Frame:
    """IB: the translation cancels the pitch; IIB: it is across the axis and the pitch stays."""
    w, v, n = s.W[:, 0], s.V[:, 0], s.N[:, 0]
    along = float(w.dot(n))
    n = n if along >= 0.0 else -n
    left = n - abs(along) * w
    size = float(np.linalg.norm(left))
    R = _axes(w, left / size if size > 0.0 else None)
    return Frame((), (size / abs(along),), R, cross(w, v - n * (w.dot(v) / abs(along))))


def _screw_across_translation(s: Parts) -> Frame:
    w, v = s.W[:, 0], s.V[:, 0]
    y = s.N[:, 0] - w * w.dot(s.N[:, 0])
    return Frame((_pitch(s),), (), _axes(w, y / np.linalg.norm(y)), cross(w, v))


def _three_screws(s: Parts) -> Frame:
    R = s.W.T * np.array([[1.0], [1.0], [np.sign(np.linalg.det(s.W))]])
    M = s.V.dot(s.W.T)  # v = M omega: symmetric about the origin, so the skew part is where it lies
    a = 0.5 * np.array((M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]))
    return Frame(tuple(s.pitches.tolist()), (), R, a)


def _plane_and_translation(s: Parts) -> Frame:
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
    return Frame((h,), (n3 / n1,), R, R.T.dot((my[2] + b * n3, -mx[2] - a * n3, mx[1])))


def _plane_across_translation(s: Parts) -> Frame:
    R = _axes(s.W[:, 0], s.W[:, 1])
    m = R.dot(s.V)
    return Frame(tuple(s.pitches.tolist()), (), R, R[2] * (0.5 * (m[1, 0] - m[0, 1])))


def _screw_and_plane(s: Parts) -> Frame:
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
    return Frame((), (float(R[2].dot(n)) / along,), R, cross(w, v - n * (w.dot(v) / along)))


# Where translations move every axis, or there is none.
ANYWHERE = np.zeros(3)
FRAMES: dict[tuple[int, str], Callable[[Parts], Frame]] = {
    (1, "h"): lambda s: Frame((_pitch(s),), (), _axes(s.W[:, 0]), cross(s.W[:, 0], s.V[:, 0])),
    (1, "h=inf"): lambda s: Frame((), (), _axes(s.N[:, 0]), ANYWHERE),
    **dict.fromkeys([(2, "IA"), (2, "IIA")], _two_screws),
    (2, "IB"): _screw_and_translation,
    (2, "IIB"): _screw_across_translation,
    (2, "IIC"): lambda s: Frame((), (), _axes(s.N[:, 0], s.N[:, 1]), ANYWHERE),
    **dict.fromkeys([(3, "IA1"), (3, "IA2"), (3, "IIA")], _three_screws),
    (3, "IB0"): _plane_and_translation,
    **dict.fromkeys([(3, "IB3"), (3, "IIB")], _plane_across_translation),
    (3, "IC"): _screw_and_plane,
    (3, "IIC"): lambda s: Frame((_pitch(s),), (), _axes(s.W[:, 0]), ANYWHERE),
    (3, "IID"): lambda _: Frame((), (), np.eye(3), ANYWHERE),
}
