"""The Euclidean group SE(3): a change of frame acts on twists by Ad and on wrenches by its dual; power is invariant.

    Ad(R, p) (omega; v) = (R omega; R v + p x R omega),     Ad*(R, p) (m; f) = (R m + p x R f; R f)

Poses are 4x4 homogeneous, twists (omega; v), wrenches (m; f). `x_from_y` maps y-coordinates to x-coordinates.

Functions check a pose or a twist first; `check=False` skips that for float64 arrays that were checked before.

Reference: [DS] Sect. 2.1 (2.2)-(2.4).
"""

from __future__ import annotations

from math import atan2, copysign, hypot, inf, pi, sin, sqrt, tan
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array

# Below this angle [rad] the closed coefficients of exp and log lose digits to cancellation; three terms of their
# series are exact to rounding (the next term is below 1e-18).
SMALL_ANGLE = 1e-2
# Index that exchanges angular and linear parts, as of libraries with linear parts first; twists as wrenches Q_0 s.
SWAPPED = np.array([3, 4, 5, 0, 1, 2])


def cross_matrix(a: Array) -> Array:
    """The (3, 3) matrix of b -> a x b, for an a (3,) that is not checked."""
    x, y, z = a.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def norm(v: Array) -> float:
    """The Euclidean norm of a vector (n,), faster than NumPy's for small n."""
    return hypot(*v.tolist())


def cross(a: Array, b: Array) -> Array:
    """The vector product of two (3,) vectors; NumPy's takes 20 microseconds."""
    a0, a1, a2 = a.tolist()
    b0, b1, b2 = b.tolist()
    return np.array((a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0))


def transform(rotation: ArrayLike | None = None, translation: ArrayLike | None = None) -> Array:
    """The (4, 4) pose with the given (3, 3) rotation and (3,) translation, either the identity by default.

    A rotation may be an object with `.as_matrix()`, such as SciPy's. Raises `BadInput` for another shape (a
    quaternion's too), and for a matrix that is no rotation.
    """
    T = np.eye(4)
    if rotation is not None:
        T[:3, :3] = arrays.rotation(rotation, "rotation")
    if translation is not None:
        T[:3, 3] = arrays.vector(translation, 3, "translation")
    return arrays.pose(T, "rotation")


def pose_along_z(z: Array, point: Array) -> Array:
    """A (4, 4) pose at a point (3,) with its z axis along a vector (3,); neither is checked."""
    z = z / sqrt(z.dot(z))
    T = np.eye(4)
    T[:3] = np.column_stack((*perpendicular_axes(z), z, point))
    return T


def perpendicular_axes(z: Array) -> tuple[Array, Array]:
    """Two unit vectors perpendicular to z (3,), right-handed; the first is nearest to the x axis, or the y axis."""
    x = np.eye(3)[0 if abs(z[0]) <= max(abs(z[1]), abs(z[2])) else 1]
    x = x - z * z.dot(x)
    x /= sqrt(x.dot(x))
    return x, cross(z, x)


def inverse(pose: ArrayLike, *, check: bool = True) -> Array:
    """The inverse (4, 4) pose."""
    T: Any = pose if check is False else arrays.pose(pose)
    (a, b, c, x), (d, e, f, y), (g, h, i, z), _ = T.tolist()
    u, v, w = a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z
    return np.array((a, d, g, -u, b, e, h, -v, c, f, i, -w, 0.0, 0.0, 0.0, 1.0)).reshape(4, 4)


def adjoint(pose: ArrayLike, *, check: bool = True) -> Array:
    """Ad of a pose a_from_b: the (6, 6) matrix [[R, 0], [p^ R, R]] with s_a = Ad s_b, for twists.

    Reference: [DS] (2.2).
    """
    T: Any = pose if check is False else arrays.pose(pose)
    A = np.zeros((6, 6))
    A[:3, :3] = A[3:, 3:] = T[:3, :3]
    A[3:, :3] = cross_matrix(T[:3, 3]).dot(T[:3, :3])
    return A


def coadjoint(pose: ArrayLike, *, check: bool = True) -> Array:
    """Ad^-T of a pose a_from_b: the (6, 6) matrix [[R, p^ R], [0, R]] with W_a = Ad* W_b, for wrenches; W'.s' = W.s.

    Reference: [DS] Sect. 6.3.
    """
    return np.asarray(adjoint(pose, check=check)[SWAPPED][:, SWAPPED])


def bracket(first: ArrayLike, second: ArrayLike, *, check: bool = True) -> Array:
    """The Lie bracket [s1, s2] = (w1 x w2; w1 x v2 + v1 x w2) of two (6,) twists.

    Reference: [DS] (2.4).
    """
    a: Any = first if check is False else arrays.twist(first, "first")
    b: Any = second if check is False else arrays.twist(second, "second")
    # In floats, as `exp` and `log`: planning a path calls these thousands of times, and arrays take 1.4 times as long.
    w1, w2, w3, v1, v2, v3 = a.tolist()
    ww1, ww2, ww3, vv1, vv2, vv3 = b.tolist()  # ww and vv are w2 and v2 of the formula
    return np.array(
        (
            w2 * ww3 - w3 * ww2,
            w3 * ww1 - w1 * ww3,
            w1 * ww2 - w2 * ww1,
            w2 * vv3 - w3 * vv2 + v2 * ww3 - v3 * ww2,
            w3 * vv1 - w1 * vv3 + v3 * ww1 - v1 * ww3,
            w1 * vv2 - w2 * vv1 + v1 * ww2 - v2 * ww1,
        )
    )


def exp(twist: ArrayLike, *, check: bool = True) -> Array:
    """The (4, 4) rigid motion reached by moving with a (6,) twist, angular part [rad] first, for unit time."""
    s: Any = twist if check is False else arrays.twist(twist)
    x, y, z, u, v, w = s.tolist()
    xx, yy, zz = x * x, y * y, z * z
    if not xx + yy + zz + u * u + v * v + w * w < inf:
        raise BadInput("twist", "numbers beyond any scale", "a twist (omega; v) [rad; length]")
    theta = sqrt(xx + yy + zz)
    if theta < SMALL_ANGLE:
        t2 = theta * theta
        a = 1.0 - t2 / 6.0 * (1.0 - t2 / 20.0 * (1.0 - t2 / 42.0))  # sin t / t
        b = 0.5 * (1.0 - t2 / 12.0 * (1.0 - t2 / 30.0 * (1.0 - t2 / 56.0)))  # (1 - cos t) / t^2
        c = (1.0 - t2 / 20.0 * (1.0 - t2 / 42.0 * (1.0 - t2 / 72.0))) / 6.0  # (t - sin t) / t^3
    else:
        a = sin(theta) / theta
        half = sin(0.5 * theta) / theta
        b = 2.0 * half * half
        c = (1.0 - a) / (theta * theta)
    # R = 1 + a W + b W^2 and p = (1 + b W + c W^2) linear part, with W^2 = axis axis' - theta^2 1.
    along = c * (x * u + y * v + z * w)
    rest = 1.0 - c * (xx + yy + zz)
    xy, xz, yz = b * x * y, b * x * z, b * y * z
    return np.array(
        (
            (1.0 - b * (yy + zz), xy - a * z, xz + a * y, rest * u + b * (y * w - z * v) + along * x),
            (xy + a * z, 1.0 - b * (xx + zz), yz - a * x, rest * v + b * (z * u - x * w) + along * y),
            (xz - a * y, yz + a * x, 1.0 - b * (xx + yy), rest * w + b * (x * v - y * u) + along * z),
            (0.0, 0.0, 0.0, 1.0),
        )
    )


def log(pose: ArrayLike, *, check: bool = True) -> Array:
    """The (6,) twist whose unit-time motion is a (4, 4) pose, rotation angle in [0, pi].

    At exactly pi the axis is determined up to sign; either is a logarithm.
    """
    T: Any = pose if check is False else arrays.pose(pose)
    x, y, z = rotation_vector(T[:3, :3]).tolist()
    u, v, w = T[:3, 3].tolist()
    theta = sqrt(x * x + y * y + z * z)
    if theta < SMALL_ANGLE:
        t2 = theta * theta
        c = (1.0 + t2 / 60.0 * (1.0 + t2 / 42.0)) / 12.0  # (1 - t/2 cot(t/2)) / t^2
    else:
        c = (1.0 - 0.5 * theta / tan(0.5 * theta)) / (theta * theta)
    # p - W p / 2 + c W^2 p, where W p is the vector product of the rotation vector with p = (u, v, w).
    i, j, k = y * w - z * v, z * u - x * w, x * v - y * u
    p = u - 0.5 * i + c * (y * k - z * j), v - 0.5 * j + c * (z * i - x * k), w - 0.5 * k + c * (x * j - y * i)
    return np.array((x, y, z, *p))


def displacement(start: Array, end: Array) -> Array:
    """log(end start^-1), the (6,) twist whose unit-time motion takes one (4, 4) pose to another; neither is checked."""
    return log(end.dot(inverse(start, check=False)), check=False)


def rotation(vector: Array) -> Array:
    """The (3, 3) rotation about the axis and by the angle of a (3,) rotation vector."""
    return exp(np.concatenate((vector, np.zeros(3))), check=False)[:3, :3]


def shortest_turn(start: Array, end: Array) -> Array:
    """(3,) rotation vector of the shortest turn from a unit vector (3,) to another; of opposite ones the same."""
    turn = cross(start, end)
    sine, cosine = norm(turn), float(start.dot(end))
    if sine > arrays.ROUNDING:  # else they are parallel, or opposite
        return turn * (atan2(sine, cosine) / sine)
    return turn if cosine > 0.0 else pi * np.linalg.svd(start.reshape(1, 3))[2][1]


def rotation_vector(R: Array) -> Array:
    """The (3,) axis of a rotation matrix (3, 3) times its angle in [0, pi].

    By the largest component of the unit quaternion (Shepperd), which loses no digits; 40 times as fast as SciPy's.
    """
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    trace = a + e + i
    largest = max(a, e, i, trace)
    if largest == trace:
        w, x, y, z = 1.0 + trace, h - f, c - g, d - b
    elif largest == a:
        w, x, y, z = h - f, 1.0 + a - e - i, b + d, c + g
    elif largest == e:
        w, x, y, z = c - g, b + d, 1.0 - a + e - i, f + h
    else:
        w, x, y, z = d - b, c + g, f + h, 1.0 - a - e + i
    n = sqrt(x * x + y * y + z * z)
    # (w; v) and -(w; v) are the same rotation.
    share = copysign(2.0 * atan2(n, abs(w)) / n, w) if n > 0.0 else 0.0
    return np.array((share * x, share * y, share * z))


def velocity_at(twists: Array, point: Array) -> Array:
    """Velocity v + omega x p of the body point now at p (3,), for a (6,) twist or (6, k) columns."""
    if twists.ndim > 1:
        return np.asarray(twists[3:] - cross_matrix(point).dot(twists[:3]))
    a, b, c, u, v, w = twists.tolist()
    x, y, z = point.tolist()
    return np.array((u + b * z - c * y, v + c * x - a * z, w + a * y - b * x))
