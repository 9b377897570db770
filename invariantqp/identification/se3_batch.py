"""Vectorised SE(3): rigid motions (..., 4, 4), twists and wrenches with leading axes; no argument is checked."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from invariantqp.geometry.arrays import Array


def skew(a: Array) -> Array:
    """(..., 3, 3) cross-product matrices of vectors (..., 3)."""
    K = np.zeros((*a.shape, 3))
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    K[..., 2, 1], K[..., 0, 2], K[..., 1, 0] = x, y, z
    K[..., 1, 2], K[..., 2, 0], K[..., 0, 1] = -x, -y, -z
    return K


def homogeneous(R: Array, p: Array) -> Array:
    """(..., 4, 4) poses of rotations (..., 3, 3) and translations (..., 3)."""
    T = np.zeros((*np.broadcast_shapes(R.shape[:-2], p.shape[:-1]), 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, p, 1.0
    return T


def inverse(T: Array) -> Array:
    """(..., 4, 4) inverses of poses."""
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    return homogeneous(Rt, -(Rt @ T[..., :3, 3:])[..., 0])


def rotation_vectors(R: Array) -> Array:
    """(..., 3) rotation vectors, at most pi long, of rotations (..., 3, 3)."""
    return np.asarray(Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(R.shape[:-1]))


def approximate_exp(twists: Array) -> Array:
    """(n, 4, 4) exponentials of small twists (n, 6), to second order."""
    w, v = twists[:, :3], twists[:, 3:]
    K = skew(w)
    return homogeneous(np.eye(3) + K + 0.5 * (K @ K), v + 0.5 * np.cross(w, v))


def approximate_log(T: Array) -> Array:
    """(n, 6) logarithms of poses (n, 4, 4): the rotation is exact, the translation to second order in it."""
    w, p = rotation_vectors(T[..., :3, :3]), T[..., :3, 3]
    return np.concatenate((w, p - 0.5 * np.cross(w, p)), axis=-1)


def adjoint(T: Array) -> Array:
    """(..., 6, 6) adjoints [[R, 0], [p^ R, R]] of poses."""
    R = T[..., :3, :3]
    A = np.zeros((*T.shape[:-2], 6, 6))
    A[..., :3, :3] = A[..., 3:, 3:] = R
    A[..., 3:, :3] = skew(T[..., :3, 3]) @ R
    return A


def coadjoint(T: Array) -> Array:
    """(..., 6, 6) coadjoints [[R, p^ R], [0, R]] of poses."""
    R = T[..., :3, :3]
    A = np.zeros((*T.shape[:-2], 6, 6))
    A[..., :3, :3] = A[..., 3:, 3:] = R
    A[..., :3, 3:] = skew(T[..., :3, 3]) @ R
    return A


def matvec(M: Array, v: Array) -> Array:
    """(..., m) products of matrices (..., m, n) and vectors (..., n)."""
    return np.asarray((M @ v[..., None])[..., 0])


def propagate(M: Array, covariance: Array) -> Array:
    """(..., m, m) covariance M C M' of M x, where x has the covariance C."""
    return np.asarray(M @ covariance @ np.swapaxes(M, -1, -2))


def unit(a: Array) -> Array:
    """(3,) the unit vector along a."""
    return np.asarray(a / np.linalg.norm(a))


def frame_along(z: Array, point: Array, x: Array | None = None) -> Array:
    """(4, 4) frame at a point with its z axis along z; its x axis is near x, if given."""
    z = unit(z)
    near = np.eye(3)[int(np.abs(z).argmin())] if x is None else x
    x = unit(near - z * z.dot(near))
    return homogeneous(np.column_stack((x, np.cross(z, x), z)), point)
