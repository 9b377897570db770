"""Many poses, twists and wrenches at once: rigid motions (..., 4, 4) with leading axes, none of them checked."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from invariantqp.geometry.arrays import Array


def skew(a: Array) -> Array:
    """(..., 3, 3) matrices of b -> a x b."""
    K = np.zeros((*a.shape, 3))
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    K[..., 2, 1], K[..., 0, 2], K[..., 1, 0] = x, y, z
    K[..., 1, 2], K[..., 2, 0], K[..., 0, 1] = -x, -y, -z
    return K


def cross(a: Array, b: Array) -> Array:
    """(n, 3) vector products of rows, sooner than NumPy's."""
    c = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        c[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return c


def poses(R: Array, p: Array) -> Array:
    """(..., 4, 4) from rotations (..., 3, 3) and places (..., 3)."""
    T = np.zeros((*np.broadcast_shapes(R.shape[:-2], p.shape[:-1]), 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, p, 1.0
    return T


def inverse(T: Array) -> Array:
    """(..., 4, 4) inverse motions."""
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    return poses(Rt, -(Rt @ T[..., :3, 3:])[..., 0])


def rotation_vectors(R: Array) -> Array:
    """(..., 3) axis times angle, up to pi, of rotations."""
    return np.asarray(Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(R.shape[:-1]))


def small_motions(twists: Array) -> Array:
    """(n, 4, 4) the motions by twists as small as noise: to second order."""
    w, v = twists[:, :3], twists[:, 3:]
    K = skew(w)
    return poses(np.eye(3) + K + 0.5 * (K @ K), v + 0.5 * cross(w, v))


def twists(T: Array) -> Array:
    """(n, 6) of motions: turns, and travel to second order in them."""
    w, p = rotation_vectors(T[..., :3, :3]), T[..., :3, 3]
    return np.concatenate((w, p - 0.5 * cross(w, p)), axis=-1)


def adjoint(T: Array) -> Array:
    """(..., 6, 6) Ad: [[R, 0], [p^ R, R]]."""
    R = T[..., :3, :3]
    A = np.zeros((*T.shape[:-2], 6, 6))
    A[..., :3, :3] = A[..., 3:, 3:] = R
    A[..., 3:, :3] = skew(T[..., :3, 3]) @ R
    return A


def coadjoint(T: Array) -> Array:
    """(..., 6, 6) Ad*: [[R, p^ R], [0, R]]."""
    R = T[..., :3, :3]
    A = np.zeros((*T.shape[:-2], 6, 6))
    A[..., :3, :3] = A[..., 3:, 3:] = R
    A[..., :3, 3:] = skew(T[..., :3, 3]) @ R
    return A


def applied(M: Array, v: Array) -> Array:
    """(..., m) matrices (..., m, n) times vectors (..., n)."""
    return np.asarray((M @ v[..., None])[..., 0])


def propagated(M: Array, covariance: Array) -> Array:
    """(..., m, m) covariance M C M' of M x."""
    return np.asarray(M @ covariance @ np.swapaxes(M, -1, -2))


def unit(a: Array) -> Array:
    """(3,) of length one."""
    return np.asarray(a / np.linalg.norm(a))


def frame_along(z: Array, point: Array, x: Array | None = None) -> Array:
    """(4, 4) a frame at a point with z along one direction and x near another."""
    z = unit(z)
    near = np.eye(3)[int(np.abs(z).argmin())] if x is None else x
    x = unit(near - z * z.dot(near))
    return poses(np.column_stack((x, np.cross(z, x), z)), point)
