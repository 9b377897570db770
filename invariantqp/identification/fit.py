"""The frames A, B and the curvature or pitch with which a recording fits a kind of contact best.

    minimise  sum |xi_i|^2 in the noise of poses + |omega_i|^2 in the noise of wrenches
    with      c(A^-1 X_i exp(xi_i) B) = 0  and  the free moments of w_i + omega_i zero

and, of little weight, side forces across the slide of a pressed contact, which friction has none of: they find a normal
that the motion leaves open. Where a contact may be off beside noise, poses give way to the wrench, xi_i + E K u_i: what
bends is off alike where the load is alike. The compliance K (6, 6) is unknown, of unit variance; u are the wrenches in
their root mean square over sqrt(6), E is what is allowed.

Solved by Gauss-Newton steps with the corrections xi, omega kept (the Gauss-Helmert model, or total least squares).
Every distance is one in a noise tensor, which changes frames as Ad N Ad': no frame and no unit enters.

Fits begin where linear least squares on poses X = (R, t) and wrenches w = (m; f) put a kind:

    a point of a plane    n.(R p + t) = d,  m = p x f      linear in p and d for each of many normals n
    an axis               R a = b: the largest singular value of the mean of R;  R p + t = q + slide, linear in p, q

Reference: E. M. Mikhail, Observations and Least Squares, 1976; R. Subramani et al., arXiv 2010.15916, fit kinds of
constraint to poses and wrenches too.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from invariantqp.geometry import se3
from invariantqp.geometry.arrays import ROUNDING, Array
from invariantqp.identification.models import Model, angles, gauge
from invariantqp.identification.motions import (
    adjoint,
    applied,
    coadjoint,
    cross,
    frame_along,
    inverse,
    poses,
    propagated,
    skew,
    small_motions,
    unit,
)

# Steps until a fit is given up: those that converge take three to ten.
STEPS = 15
# A step that would lower the sum of squares by less than this changes no parameter by more than 1e-4 of its
# standard deviation.
CONVERGED = 1e-8
# Marquardt's damping, relative to the curvature of the sum of squares, at first; its square is the least, and beyond
# one over that it is given up.
DAMPING = 1e-3
# Side force across the slide, relative to the force, that irregular friction may have: so weak a row that motion,
# where it says anything about the normal, decides.
ACROSS = 0.3
# Beyond so many standard deviations of noise something moved, or was pushed.
SURELY = 3.0
# What is known no better than this many of the motion's own sizes, radians or lengths, is not known.
OPEN = 10.0
# A fit that is off by many times the noise after some steps, and improves by less than this share, is not that kind.
SLOW = 0.1
# Normals tried over the half sphere: 16 degrees apart.
NORMALS = 80
# A tool that turns by less than this [rad] has no axis of its own: the axis is taken along its slide.
STRAIGHT = 1e-2


Start = tuple[Array, Array, Array]  # A, B, and curvature or pitch


class Samples(NamedTuple):
    """Moments of a recording: poses and wrenches in the tool frame, with their noise."""

    at: Array  # (n,) which samples of the recording they are
    turned: Array  # (n, 3) the turns from sample to sample of the recording, in the tool frame, summed up [rad]
    pose: Array  # (n, 4, 4)
    wrench: Array  # (n, 6) that the tool exerts, about the tool frame's origin
    pose_noise: Array  # (n, 6, 6) covariance of the twist by which a pose is off, in the tool frame
    wrench_noise: Array  # (n, 6, 6)
    bending: Array  # (n, 6, c) twists by which a pose gives way, with each of the entries of a compliance; or c = 0

    @property
    def reversed(self) -> Samples:
        """The same with base and tool exchanged: poses X^-1, and the wrench that the base exerts, in the base frame."""
        A, B = adjoint(self.pose), coadjoint(self.pose)
        w = -applied(B, self.wrench)
        noise = propagated(A, self.pose_noise)
        m, f = skew(w[:, :3]), skew(w[:, 3:])
        by_pose = -np.concatenate((np.concatenate((m, f), -1), np.concatenate((f, np.zeros_like(f)), -1)), -2)
        wrench_noise = propagated(B, self.wrench_noise) + propagated(by_pose, noise)
        return Samples(self.at, self.turned, inverse(self.pose), w, noise, wrench_noise, -A @ self.bending)

    def slides(self, tip: Array) -> tuple[NDArray[np.intp], Array, Array]:
        """How a (3,) point of the tool slides: (k,) samples, (k, 3) directions in the base frame, (k,) how surely.

        The last is 1/2 where its direction is surely known to SURELY's inverse [rad], and nears 1 beyond.
        """
        p = self.pose[:, :3, :3] @ tip + self.pose[:, :3, 3]
        step = np.diff(self.at)
        usual = 2.0 * np.median(step)
        inner = 1 + np.flatnonzero((step[1:] <= usual) & (step[:-1] <= usual))
        v = p[inner + 1] - p[inner - 1]
        speed = np.linalg.norm(v, axis=1)
        at_tip = np.concatenate((-skew(tip), np.eye(3)), axis=1)
        noise = np.trace(propagated(at_tip, self.pose_noise[inner]), axis1=1, axis2=2) / 3.0
        sure = speed * speed / (speed * speed + SURELY**4 * 2.0 * noise)
        return inner, v / np.maximum(speed, 1e-300)[:, None], sure


class Fit(NamedTuple):
    """A kind of contact where it fits best."""

    model: Model
    base: Array  # (4, 4) A
    tool: Array  # (4, 4) B
    extra: Array  # (e,) curvature or pitch
    information: Array  # (12 + e, 12 + e) inverse covariance of the twists of A and B in themselves, and of `extra`
    motion: float  # root mean square of what poses are off, in their noise
    wrench: float  # likewise of wrenches; 0 where no row says anything
    friction: float  # likewise of side forces across the slide, in ACROSS of the force; 0 where nothing slides
    off: Array  # (n,) root mean square over the rows of each sample, poses alone
    inefficiency: float  # statistical: so many samples say as much as an independent one; 1 of white noise

    @property
    def worst(self) -> float:
        """The largest of the misses."""
        return max(self.motion, self.wrench, self.friction)


class _State(NamedTuple):
    base: Array
    tool: Array
    extra: Array
    compliance: Array  # (c,)
    rows: dict[str, tuple[Array, Array, Array, Array]]  # misses, by parameters, weights, gains


def _squares(e: Array, V: Array) -> Array:
    return np.asarray((e * applied(V, e)).sum(axis=1))


def fit(model: Model, samples: Samples, start: Start, enough: float = CONVERGED) -> Fit:
    """The best fit near a start, until a step would lower the sum of squares by less than enough."""
    zero = np.zeros_like(samples.wrench)
    friction = across_the_slide(samples, start[1][:3, 3]) if model.pressed else None
    state = _state(model, samples, friction, *start, np.zeros(samples.bending.shape[-1]), zero, zero)
    damping, count, cost = DAMPING, sum(e.size for e, *_ in state.rows.values()), inf
    accepted, near = None, DAMPING**2  # the last state with corrected poses, and the damping there
    free = np.pad(gauge(model.kind, start[2]), ((0, samples.bending.shape[-1]), (0, 0)))
    for step in range(STEPS):
        H, g, now = _normal_equations(state)
        before, cost = cost, now
        # Nearly linear: poses are corrected, and what is worse is taken back. Where rows are surely off, the model is
        # not near, and to linearise about corrected poses would lead away.
        if accepted is not None or now < SURELY**2 * count:
            if accepted is None or now < accepted[-1] * (1.0 + sqrt(CONVERGED)):  # corrections made anew may raise it
                accepted, near = (state, H, g, now), max(0.1 * near, DAMPING**2)
            else:
                near = max(100.0 * near, DAMPING)
                state, H, g, now = accepted
            delta = _step(H, g, near, free)
            if -float(delta.dot(g)) < enough + 1e-9 * now or near > 1.0:
                break
            corrections = {name: -applied(K, e + J @ delta) for name, (e, J, _, K) in state.rows.items()}
            xi, omega = corrections["poses"], corrections.get("moments", zero)
            state = _state(model, samples, friction, *_updated(state, delta), xi, omega)
            continue
        while damping * DAMPING**2 < 1.0:
            delta = _step(H, g, damping, free)
            trial = _state(model, samples, friction, *_updated(state, delta), zero, zero)
            pairs = zip(trial.rows.values(), state.rows.values(), strict=True)
            if sum(_squares(e, V).sum() for (e, *_), (*_, V, _) in pairs) < cost:
                break
            damping *= 10.0
        else:
            break
        state, damping = trial, max(0.1 * damping, DAMPING**2)
        if cost > SURELY**4 * count and step > 2 and before - cost < SLOW * cost:
            break
    return _finished(model, state if accepted is None else accepted[0])


def _normal_equations(state: _State) -> tuple[Array, Array, float]:
    """J'VJ, J'Ve and e'Ve, summed over all rows."""
    parts = []
    for e, J, V, _ in state.rows.values():
        flat, weighed = J.reshape(-1, J.shape[-1]), (V @ J).reshape(-1, J.shape[-1])
        parts.append((flat.T @ weighed, weighed.T @ e.ravel(), _squares(e, V).sum()))
    return tuple(sum(part) for part in zip(*parts, strict=True))


def _step(H: Array, g: Array, damping: float, free: Array) -> Array:
    """Marquardt's step across what changes nothing; none turns a frame by more than half a radian or so.

    Each parameter counts in the length at which it adds one to the sum of squares, so that no unit enters.
    """
    D = np.diag(H)
    scale = 1.0 / np.sqrt(D + ROUNDING * D.max())
    across = np.linalg.qr(free / scale[:, None], mode="complete")[0][:, free.shape[1] :]
    curved = across.T @ (H * np.outer(scale, scale)) @ across
    damped = curved + np.diag(damping * np.diag(curved) + ROUNDING)
    delta: Array = np.asarray(-scale * (across @ np.linalg.solve(damped, across.T @ (scale * g))))
    turn = max(float(np.abs(delta[:3]).max()), float(np.abs(delta[6:9]).max()))
    return delta * min(1.0, 0.5 / max(turn, ROUNDING))


def _updated(state: _State, delta: Array) -> tuple[Array, Array, Array, Array]:
    base, tool = (T @ se3.exp(d, check=False) for T, d in ((state.base, delta[:6]), (state.tool, delta[6:12])))
    n = 12 + len(state.extra)
    return base, tool, state.extra + delta[12:n], state.compliance + delta[n:]


def across_the_slide(samples: Samples, tip: Array) -> tuple[NDArray[np.intp], Array] | None:
    """Forces turned across the slide, (k, 3) in the base frame, whose part along the normal is none of friction's."""
    which, along, sure = samples.slides(tip)
    if sure.max(initial=0.0) < 0.5:
        return None
    f = applied(samples.pose[which, :3, :3], samples.wrench[which, 3:])
    noise = np.trace(samples.wrench_noise[which, 3:, 3:], axis1=1, axis2=2) / 3.0
    across = cross(along, f) * (sure / np.sqrt(noise + ACROSS**2 * (f * f).sum(axis=1)))[:, None]
    return which, across


def _state(
    model: Model,
    samples: Samples,
    friction: tuple[NDArray[np.intp], Array] | None,
    base: Array,
    tool: Array,
    extra: Array,
    compliance: Array,
    xi: Array,
    omega: Array,
) -> _State:
    """Rows at frames A and B, linearised at corrected poses and wrenches."""
    X = inverse(base) @ (samples.pose @ small_motions(xi + samples.bending @ compliance))
    C = X @ tool
    values, L, by_extra = model.rows(C, extra, samples.turned @ tool[:3, 2])
    by_pose = L @ adjoint(X)
    e = values - applied(by_pose, xi)
    J = np.concatenate((-L, L @ adjoint(C), by_extra, by_pose @ samples.bending), axis=-1)
    count, c = J.shape[-1], len(compliance)
    of_compliance = np.eye(count)[count - c :, None]
    rows = {
        "poses": _weighed(e, J, by_pose, samples.pose_noise),
        "compliance": (compliance[:, None], of_compliance, np.ones((c, 1, 1)), np.zeros((c, 6, 1))),
    }
    if model.free_moments:
        to_tool = coadjoint(inverse(tool))
        w = (samples.wrench + omega) @ to_tool.T
        n, taken = len(w), list(model.free_moments)
        by_wrench = np.broadcast_to(to_tool[taken], (n, len(taken), 6))
        e = w[:, taken] - applied(by_wrench, omega)
        J = np.zeros((n, len(taken), count))
        J[:, :, 6:9], J[:, :, 9:12] = skew(w[:, :3])[:, taken], skew(w[:, 3:])[:, taken]
        rows["moments"] = _weighed(e, J, by_wrench, samples.wrench_noise)
    if friction is not None:
        rows["friction"] = _across(friction, C, base, extra, count)
    return _State(base, tool, extra, compliance, rows)


def _across(
    friction: tuple[NDArray[np.intp], Array], C: Array, base: Array, extra: Array, count: int
) -> tuple[Array, Array, Array, Array]:
    """(n.g), n = z + k p the normal in the base frame of the contact, and how it changes with A, B and k."""
    which, across = friction
    u, p, R = across @ base[:3, :3], C[which, :3, 3], C[which, :3, :3]
    k = float(extra[0]) if len(extra) else 0.0
    n = k * p
    n[:, 2] += 1.0
    e = (n * u).sum(axis=1)
    J = np.zeros((len(e), 1, count))
    J[:, 0, :3], J[:, 0, 3:6] = -k * cross(p, u) - cross(u, n), -k * u
    J[:, 0, 9:12] = k * (u[:, None, :] @ R)[:, 0]
    if len(extra):
        J[:, 0, 12] = (p * u).sum(axis=1)
    return e[:, None], J, np.ones((len(e), 1, 1)), np.zeros((len(e), 6, 1))


def _weighed(e: Array, J: Array, by_noise: Array, noise: Array) -> tuple[Array, Array, Array, Array]:
    """Misses, their derivative, weights, and the gain from misses to the least correction."""
    spread = noise @ np.swapaxes(by_noise, -1, -2)
    V: Array = np.asarray(np.linalg.inv(by_noise @ spread))
    return e, J, V, spread @ V


def _finished(model: Model, state: _State) -> Fit:
    e, _, V, _ = state.rows["poses"]
    squares = {name: _squares(e, V) for name, (e, _, V, _) in state.rows.items()}
    H, n = _normal_equations(state)[0], 12 + len(state.extra)
    H = H[:n, :n] - H[:n, n:] @ np.linalg.solve(H[n:, n:], H[n:, :n])  # whatever the compliance is
    determined = n - gauge(model.kind, state.extra).shape[1]
    wrench, friction = (
        sqrt(float(squares[name].sum()) / state.rows[name][0].size) if name in squares else 0.0
        for name in ("moments", "friction")
    )
    motion = sqrt(float(squares["poses"].sum()) / max(1, e.size - determined))
    off, inefficiency = (
        np.sqrt(squares["poses"] / e.shape[1]),
        _inefficiency(np.asarray(np.linalg.cholesky(V)).swapaxes(-1, -2), e),
    )
    return Fit(model, state.base, state.tool, state.extra, H, motion, wrench, friction, off, inefficiency)


def _inefficiency(whitening: Array, e: Array) -> float:
    """1 + 2 sum of the correlations of misses (n, r) with those k samples later, up to the first that is none."""
    w = applied(whitening, e)
    square, total = float((w * w).sum()), 1.0
    for k in range(1, len(w)):
        correlation = float((w[k:] * w[:-k]).sum()) / max(square, 1e-300)
        if correlation <= 0.0:
            break
        total += 2.0 * correlation
    return total


def covariance(fit: Fit, size: float) -> Array:
    """The inverse of the information on what is determined, and a large variance, in the motion's sizes, of the rest.

    For independent errors it is the bound of Cramer and Rao, which no estimate is better than; what errors share from
    sample to sample is counted once.
    """
    scale = np.array(
        ([1.0] * 3 + [size] * 3) * 2 + [1.0 / size if fit.model.kind == "sphere" else size] * len(fit.extra)
    )
    H = fit.information / fit.inefficiency * np.outer(scale, scale)
    values, vectors = np.linalg.eigh(H)
    free = np.linalg.qr(gauge(fit.model.kind, fit.extra) / scale[:, None])[0]
    known = np.eye(len(H)) - free @ free.T  # a change that changes nothing about the contact has no variance
    least = (1e-2 / OPEN) ** 2
    covariance = (vectors / np.maximum(values, least)) @ vectors.T
    covariance = known @ covariance @ known
    return np.asarray(covariance * np.outer(scale, scale))


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
        return [(poses(np.eye(3), q), poses(np.eye(3), p), np.zeros(0))]
    if model.kind == "slide":
        base = frame_along(travel[0], t.mean(axis=0))
        tool = poses(Rotation.from_matrix(R).mean().as_matrix().T @ base[:3, :3], np.zeros(3))  # A^-1 X B does not turn
        return [(base, tool, np.zeros(0))]
    axes = [(Vt[0], U[:, 0] * np.sign(U[:, 0] @ (middle[:3, :3] @ Vt[0])))] if turns else []
    if model.kind == "face":
        pushed = applied(R, w[:, 3:]).mean(axis=0)
        across = pushed - travel[0] * (travel[0] @ pushed)
        ends = [travel[2]] if turns else [across, travel[2]]
        axes += [(middle[:3, :3].T @ unit(n), unit(n)) for n in ends if np.linalg.norm(n) > 0.0]
        return [(frame_along(b, t.mean(axis=0)), frame_along(a, np.zeros(3)), np.zeros(0)) for a, b in axes]
    if not turns:
        axes.append((middle[:3, :3].T @ travel[0], travel[0]))
    return [_about(model, samples, R, t, a, b) for a, b in axes]


def _about(model: Model, samples: Samples, R: Array, t: Array, a: Array, b: Array) -> Start:
    """An axis along a in the tool and b in the base."""
    across = np.eye(3) if model.kind == "hinge" else np.eye(3) - np.outer(b, b)
    p, q = _held(R, t, across)
    base, tool = frame_along(b, q), frame_along(a, p)
    if model.kind != "screw":
        return base, tool, np.zeros(0)
    tool[:3, :3] = samples.pose[len(R) // 2, :3, :3].T @ base[:3, :3]
    C = inverse(base) @ samples.pose @ tool
    turned = angles(C, samples.turned @ tool[:3, 2])
    pitch, rest = np.linalg.lstsq(np.stack((turned, np.ones_like(turned)), axis=1), C[:, 2, 3], rcond=None)[0]
    base[:3, 3] += rest * base[:3, 2]
    return base, tool, np.array([pitch])


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
    # An edge's moments are not all zero; they only place it where nothing else does.
    share_w = 1e-3 if model.kind == "line" else 1.0
    travel = np.linalg.svd(t - t.mean(axis=0), full_matrices=False)[2][0]
    i = np.arange(NORMALS) + 0.5
    z, turn = 1.0 - i / NORMALS, np.pi * (1.0 + 5.0**0.5) * i
    r = np.sqrt(1.0 - z * z)
    half_sphere = np.stack((r * np.cos(turn), r * np.sin(turn), z), axis=-1)
    normals = np.stack((pushed, unit(pushed - travel * travel.dot(pushed) + 1e-12), *(half_sphere @ axes)))
    G = np.einsum("nji,kj->kni", R, normals)  # R' n
    G = np.concatenate((G, np.full((*G.shape[:2], 1), -1.0)), axis=-1)
    y = -np.einsum("ni,ki->kn", t, normals)
    H = weight_t * np.einsum("kni,knj->kij", G, G)
    g = weight_t * np.einsum("kni,kn->ki", G, y)
    H[:, :3, :3] += share_w * H_w
    g[:, :3] += share_w * g_w
    # Where neither motion nor wrench say anything, stay where one is.
    H += 1e-9 * np.trace(H, axis1=1, axis2=2)[:, None, None] * np.eye(4)
    found = np.linalg.solve(H, g[..., None])[..., 0]
    left = weight_t * ((np.einsum("kni,ki->kn", G, found) - y) ** 2).sum(axis=1)
    left += share_w * weight_f * ((m[None] + np.einsum("nij,kj->kni", F, found[:, :3])) ** 2).sum(axis=(1, 2))
    if model.kind == "line":
        spread = np.linalg.eigvalsh(np.einsum("kni,knj->kij", G[..., :3], G[..., :3]))[:, 0]
        left += weight_t * (t - t.mean(axis=0)).var() * spread
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
    base = frame_along(n, middle + n * (found[3] - n @ middle))
    if model.kind == "line":
        u = np.einsum("nji,j->ni", R, n)
        spread, directions = np.linalg.eigh(u.T @ u / len(u))
        edge, z = directions[:, 0], u.mean(axis=0)
        if spread[1] > STRAIGHT**2:
            return [(base, frame_along(z - edge * (edge @ z), p, edge), np.zeros(0))]
        # The tool never tilts: directions of the edge in its plane, 30 degrees apart.
        other, turns = np.cross(z, edge), np.arange(6) * np.pi / 6.0
        return [(base, frame_along(z, p, np.cos(t) * edge + np.sin(t) * other), np.zeros(0)) for t in turns]
    if model.kind == "point":
        return [(base, poses(np.eye(3), p), np.zeros(0))]
    y = (x - base[:3, 3]) @ base[:3, :3]  # z + k |p|^2 / 2 = 0 through them
    A = np.stack((0.5 * (y * y).sum(axis=1), np.ones(len(y))), axis=1)
    return [(base, poses(np.eye(3), p), np.linalg.lstsq(A, -y[:, 2], rcond=None)[0][:1])]
