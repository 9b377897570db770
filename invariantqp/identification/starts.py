"""Where fits begin: linear least squares on poses X = (R, t) and wrenches w = (m; f), for each kind of contact.

a point of a plane    n.(R p + t) = d,  m = p x f      linear in p and d for each of many normals n
an axis               R a = b: the largest singular value of the mean of R;  R p + t = q + slide, linear in p, q
"""

from __future__ import annotations

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.identification.fit import Samples, Start, across_the_slide
from invariantqp.identification.models import Model, angles
from invariantqp.identification.motions import applied, framed, inverse, nearest_rotation, poses, skew, unit

# Normals tried over the half sphere: 16 degrees apart.
NORMALS = 80
# A tool that turns by less than this [rad] has no axis of its own: the axis is taken along its slide.
STRAIGHT = 1e-2
NONE = np.zeros(0)
# Directions of an edge in its plane, where the tool never tilts: 30 degrees apart.
_DIRECTIONS = [(np.cos(t), np.sin(t)) for t in np.arange(6) * np.pi / 6.0]


def starts(model: Model, samples: Samples) -> list[Start]:
    """Frames to begin with, most likely first."""
    X, w = samples.pose, samples.wrench
    R, t = X[:, :3, :3], X[:, :3, 3]
    if model.pressed and model.kind != "face":
        return _tips(model, samples, R, t, w)
    away = t - t.mean(axis=0)
    travel = np.linalg.svd(away, full_matrices=False)[2]
    U, s, Vt = np.linalg.svd(R.mean(axis=0))
    turns = s[1] < 1.0 - 0.5 * STRAIGHT**2
    middle = X[len(X) // 2]
    if model.kind == "ball":
        p, q = _held(R, t, np.eye(3))
        return [(poses(np.eye(3), q), poses(np.eye(3), p), NONE)]
    if model.kind == "slide":
        base = framed(travel[0], t.mean(axis=0))
        return [(base, _facing(nearest_rotation(R.mean(axis=0)), base), NONE)]
    axes = [(Vt[0], U[:, 0] * np.sign(U[:, 0] @ (middle[:3, :3] @ Vt[0])))] if turns else []
    if model.kind == "face":
        pushed = applied(R, w[:, 3:]).mean(axis=0)
        across = pushed - travel[0] * (travel[0] @ pushed)
        ends = [travel[2]] if turns else [across, travel[2]]
        axes += [(middle[:3, :3].T @ unit(n), unit(n)) for n in ends if np.linalg.norm(n) > 0.0]
        return [(framed(b, t.mean(axis=0)), framed(a, np.zeros(3)), NONE) for a, b in axes]
    if not turns:
        axes.append((middle[:3, :3].T @ travel[0], travel[0]))
    return [_about(model, samples, R, t, a, b) for a, b in axes]


def _about(model: Model, samples: Samples, R: Array, t: Array, a: Array, b: Array) -> Start:
    """An axis along a in the tool and b in the base."""
    across = np.eye(3) if model.kind == "hinge" else np.eye(3) - np.outer(b, b)
    p, q = _held(R, t, across)
    base, tool = framed(b, q), framed(a, p)
    if model.kind != "screw":
        return base, tool, NONE
    tool[:3, :3] = samples.pose[len(R) // 2, :3, :3].T @ base[:3, :3]
    C = inverse(base) @ samples.pose @ tool
    turned = angles(C, samples.turned @ tool[:3, 2])
    pitch, rest = np.linalg.lstsq(np.stack((turned, np.ones_like(turned)), axis=1), C[:, 2, 3], rcond=None)[0]
    base[:3, 3] += rest * base[:3, 2]
    return base, tool, np.array([pitch])


def _facing(R: Array, base: Array) -> Array:
    """B with which A^-1 X B does not turn, where R is the mean of X."""
    return poses(R.T @ base[:3, :3], np.zeros(3))


def _held(R: Array, t: Array, across: Array) -> tuple[Array, Array]:
    """p in the tool, q in the base with across (R p + t - q) least."""
    A = np.concatenate((across @ R, np.broadcast_to(-across, R.shape)), axis=-1).reshape(-1, 6)
    found: Array = np.asarray(np.linalg.lstsq(A, -(t @ across.T).reshape(-1), rcond=1e-2)[0])
    return found[:3], found[3:]


def _tips(model: Model, samples: Samples, R: Array, t: Array, w: Array) -> list[Start]:
    """A tip on a plane for each of many normals, and the best of them."""
    m, f = w[:, :3], w[:, 3:]
    pushes = applied(R, f)
    pushed = unit(pushes.mean(axis=0) + 1e-12)
    # Normals are spread about the forces' own axes: in another base frame the same ones are tried.
    axes = np.linalg.svd(pushes, full_matrices=False)[2]
    axes[((pushes @ axes.T) ** 3).sum(axis=0) < 0.0] *= -1.0
    weight_f = 1.0 / np.trace(samples.wrench_noise[:, :3, :3], axis1=1, axis2=2).mean()
    weight_t = 1.0 / np.trace(samples.pose_noise[:, 3:, 3:], axis1=1, axis2=2).mean()
    F = skew(f)
    H_w = weight_f * np.einsum("nij,nik->jk", F, F)  # of |m + f x p|^2
    g_w = -weight_f * np.einsum("nij,ni->j", F, m)
    if model.kind == "line":
        H_w, g_w = (
            1e-3 * H_w,
            1e-3 * g_w,
        )  # an edge's moments are not all zero; they only place it where nothing else does
    travel = np.linalg.svd(t - t.mean(axis=0), full_matrices=False)[2][0]
    normals = np.stack((pushed, unit(pushed - travel * travel.dot(pushed) + 1e-12), *(_half_sphere() @ axes)))
    G = np.einsum("nji,kj->kni", R, normals)  # R' n
    G = np.concatenate((G, np.full((*G.shape[:2], 1), -1.0)), axis=-1)
    y = -np.einsum("ni,ki->kn", t, normals)
    H = weight_t * np.einsum("kni,knj->kij", G, G)
    g = weight_t * np.einsum("kni,kn->ki", G, y)
    H[:, :3, :3] += H_w
    g[:, :3] += g_w
    # Where neither motion nor wrench say anything, stay where one is.
    H += 1e-9 * np.trace(H, axis1=1, axis2=2)[:, None, None] * np.eye(4)
    found = np.linalg.solve(H, g[..., None])[..., 0]
    left = weight_t * ((np.einsum("kni,ki->kn", G, found) - y) ** 2).sum(axis=1)
    left += (
        weight_f
        * ((m[None] + np.einsum("nij,kj->kni", F, found[:, :3])) ** 2).sum(axis=(1, 2))
        * (1e-3 if model.kind == "line" else 1.0)
    )
    if model.kind == "line":
        u = G[..., :3]
        left = (
            left
            + weight_t
            * (t - t.mean(axis=0)).var()
            * len(t)
            * np.linalg.eigvalsh(np.einsum("kni,knj->kij", u, u) / len(t))[:, 0]
        )
    friction = across_the_slide(samples, found[0, :3])
    if friction is not None:
        left = left + ((normals @ friction[1].T) ** 2).sum(axis=1)
    order = [0, 1, *(2 + np.argsort(left[2:])[:2]).tolist()]
    order.sort(key=lambda k: left[k])
    return [start for k in order for start in _tip(model, R, t, normals[k], found[k])]


def _tip(model: Model, R: Array, t: Array, n: Array, found: Array) -> list[Start]:
    """A start from a normal, and a tip and a height."""
    p = found[:3]
    x = R @ p + t
    middle = x.mean(axis=0)
    base = framed(n, middle + n * (found[3] - n @ middle))
    if model.kind == "line":
        u = np.einsum("nji,j->ni", R, n)
        spread, directions = np.linalg.eigh(u.T @ u / len(u))
        edge, z = directions[:, 0], u.mean(axis=0)
        if spread[1] > STRAIGHT**2:
            return [(base, framed(z - edge * (edge @ z), p, edge), NONE)]
        return [(base, framed(z, p, c * edge + s * np.cross(z, edge)), NONE) for c, s in _DIRECTIONS]
    tool = poses(np.eye(3), p)
    return [(base, tool, NONE if model.kind == "point" else np.array([_ball_under(x, base)]))]


def _ball_under(x: Array, base: Array) -> float:
    """The curvature k of z + k |p|^2 / 2 = 0 through points x in the base frame."""
    y = (x - base[:3, 3]) @ base[:3, :3]
    A = np.stack((0.5 * (y * y).sum(axis=1), np.ones(len(y))), axis=1)
    return float(np.linalg.lstsq(A, -y[:, 2], rcond=None)[0][0])


def _half_sphere() -> Array:
    i = np.arange(NORMALS) + 0.5
    z, turn = 1.0 - i / NORMALS, np.pi * (1.0 + 5.0**0.5) * i
    r = np.sqrt(1.0 - z * z)
    return np.stack((r * np.cos(turn), r * np.sin(turn), z), axis=-1)
