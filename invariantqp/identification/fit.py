"""Fit of a kind of contact to a recording: the frames A, B and the curvature or pitch.

    minimise  sum |xi_i|^2 in the noise of poses + |omega_i|^2 in the noise of wrenches
    with      c(A^-1 X_i exp(xi_i) B) = 0  and  the free moments of w_i + omega_i zero

and, with a low weight, the side forces across the slide of a unilateral contact, which Coulomb friction does not have:
they determine a normal that the motion leaves open. If an accuracy of the contact is given, poses also deflect with the
wrench, xi_i + E K u_i: K (6, 6) is an unknown compliance of unit variance, u the wrenches over their root mean square
and sqrt(6), E the accuracy.

Solved by Gauss-Newton steps that keep the corrections xi, omega (Gauss-Helmert model, total least squares). All
distances are relative to noise tensors, which transform as Ad N Ad': no choice of frame or unit enters.

Initial guesses are linear least squares on poses X = (R, t) and wrenches w = (m; f):

    a point of a plane    n.(R p + t) = d,  m = p x f      linear in p and d for each of many normals n
    an axis               R a = b: the largest singular value of the mean of R;  R p + t = q + slide, linear in p, q

Reference: E. M. Mikhail, Observations and Least Squares, 1976; R. Subramani et al., arXiv 2010.15916.
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
from invariantqp.identification.se3_batch import (
    adjoint,
    approximate_exp,
    coadjoint,
    frame_along,
    homogeneous,
    inverse,
    matvec,
    propagate,
    skew,
    unit,
)

# Most iterations of a fit; those that converge take three to ten.
MAX_ITERATIONS = 15
# Decrease of the sum of squares that ends a fit: a change of 1e-4 standard deviations.
CONVERGENCE = 1e-8
# Initial Marquardt damping, relative to the diagonal; its square is the least value, one over that the largest.
MARQUARDT = 1e-3
# Standard deviation of side force across the slide, relative to the force: so weak that motion decides if it can.
LATERAL_FRICTION = 0.3
# Standard deviations of noise beyond which something moved or was pushed.
SIGMAS = 3.0
# Standard deviation beyond which a quantity is undetermined, in radians or in sizes of the motion.
UNDETERMINED = 10.0
# Relative decrease of a large sum of squares below which a fit is given up.
MIN_PROGRESS = 0.1
# Normals tried over the half sphere: 16 degrees apart.
NORMAL_COUNT = 80
# Divisor in place of zero.
TINY = 1e-300
# Rotation of the tool [rad] below which it has no axis of rotation, and the slide is taken for it.
MIN_ROTATION = 1e-2

InitialGuess = tuple[Array, Array, Array]  # A, B, and curvature or pitch


class Samples(NamedTuple):
    """Samples of a recording: poses and wrenches in the tool frame, with the covariances of their noise."""

    indices: Array  # (n,) in the recording
    accumulated_rotation: Array  # (n, 3) sum of the rotation vectors from sample to sample, in the tool frame [rad]
    pose: Array  # (n, 4, 4)
    wrench: Array  # (n, 6) that the tool exerts, about the tool frame's origin
    pose_noise: Array  # (n, 6, 6) covariance of the twist from the true to the measured pose, in the tool frame
    wrench_noise: Array  # (n, 6, 6)
    compliance_jacobian: Array  # (n, 6, c) derivative of a pose by the entries of a compliance; c may be 0

    @property
    def size(self) -> float:
        """Root mean square distance of the tool from its mean position [length]."""
        return float(np.sqrt(self.pose[:, :3, 3].var(axis=0).sum()))

    @property
    def inverted(self) -> Samples:
        """The same with base and tool exchanged: poses X^-1, and the wrench that the base exerts, in the base frame."""
        A, B = adjoint(self.pose), coadjoint(self.pose)
        w = -matvec(B, self.wrench)
        noise = propagate(A, self.pose_noise)
        m, f = skew(w[:, :3]), skew(w[:, 3:])
        by_pose = -np.block([[m, f], [f, np.zeros_like(f)]])
        wrench_noise = propagate(B, self.wrench_noise) + propagate(by_pose, noise)
        return self._replace(
            pose=inverse(self.pose),
            wrench=w,
            pose_noise=noise,
            wrench_noise=wrench_noise,
            compliance_jacobian=-A @ self.compliance_jacobian,
        )

    def slides(self, tip: Array) -> tuple[NDArray[np.intp], Array, Array]:
        """Sliding of a (3,) point of the tool: (k,) samples, (k, 3) directions in the base frame, (k,) confidence.

        The confidence is 1/2 if the direction is known to 1/SIGMAS [rad] at SIGMAS standard deviations, 1 at best.
        """
        p = self.pose[:, :3, :3] @ tip + self.pose[:, :3, 3]
        step = np.diff(self.indices)
        usual = 2.0 * np.median(step)
        inner = 1 + np.flatnonzero((step[1:] <= usual) & (step[:-1] <= usual))
        v = p[inner + 1] - p[inner - 1]
        speed = np.linalg.norm(v, axis=1)
        at_tip = np.concatenate((-skew(tip), np.eye(3)), axis=1)
        noise = np.trace(propagate(at_tip, self.pose_noise[inner]), axis1=1, axis2=2) / 3.0
        confidence = speed * speed / (speed * speed + SIGMAS**4 * 2.0 * noise)
        return inner, v / np.maximum(speed, TINY)[:, None], confidence


class Fit(NamedTuple):
    """The best fit of a kind of contact."""

    model: Model
    base: Array  # (4, 4) A
    tool: Array  # (4, 4) B
    parameters: Array  # (e,) curvature or pitch
    information: Array  # (12 + e, 12 + e) inverse covariance of the twists of A and B in their own axes, and parameters
    pose_misfit: float  # root mean square of the pose residuals, in standard deviations of their noise
    wrench_misfit: float  # likewise of the free moments; 0 if the kind has none
    friction_misfit: float  # likewise of side forces across the slide, in LATERAL_FRICTION of the force; or 0
    residuals: Array  # (n,) root mean square pose residual of each sample
    inefficiency: float  # statistical inefficiency: samples per independent one; 1 for white noise

    @property
    def largest_misfit(self) -> float:
        """The largest of the three misfits."""
        return max(self.pose_misfit, self.wrench_misfit, self.friction_misfit)


class _State(NamedTuple):
    base: Array
    tool: Array
    parameters: Array
    compliance: Array  # (c,)
    rows: dict[str, tuple[Array, Array, Array, Array]]  # residuals, Jacobian, weights, gains, by what they are of


def _squared_norms(e: Array, V: Array) -> Array:
    return np.asarray((e * matvec(V, e)).sum(axis=1))


def fit(model: Model, samples: Samples, start: InitialGuess, tolerance: float = CONVERGENCE) -> Fit:
    """The local best fit from an initial guess, until a step would lower the sum of squares by less than tolerance."""
    zero = np.zeros_like(samples.wrench)
    friction = lateral_forces(samples, start[1][:3, 3]) if model.is_unilateral else None
    state = _state(model, samples, friction, *start, np.zeros(samples.compliance_jacobian.shape[-1]), zero, zero)
    damping, count, cost = MARQUARDT, sum(e.size for e, *_ in state.rows.values()), inf
    accepted, fine_damping = None, MARQUARDT**2  # the last state with corrected poses, and the damping there
    free = np.pad(gauge(model.kind, start[2]), ((0, samples.compliance_jacobian.shape[-1]), (0, 0)))
    for step in range(MAX_ITERATIONS):
        H, g, squares = _normal_equations(state)
        before, cost = cost, squares
        # Nearly linear: poses are corrected, and steps that make it worse are undone. Far from a solution to linearise
        # about corrected poses would diverge.
        if accepted is not None or squares < SIGMAS**2 * count:
            if accepted is None or squares < accepted[-1] * (1.0 + sqrt(CONVERGENCE)):  # new corrections may raise it
                accepted, fine_damping = (state, H, g, squares), max(0.1 * fine_damping, MARQUARDT**2)
            else:
                fine_damping = max(100.0 * fine_damping, MARQUARDT)
                state, H, g, squares = accepted
            delta = _step(H, g, fine_damping, free)
            if -float(delta.dot(g)) < tolerance + 1e-9 * squares or fine_damping > 1.0:
                break
            corrections = {name: -matvec(K, e + J @ delta) for name, (e, J, _, K) in state.rows.items()}
            xi, omega = corrections["poses"], corrections.get("moments", zero)
            state = _state(model, samples, friction, *_updated(state, delta), xi, omega)
            continue
        while damping * MARQUARDT**2 < 1.0:
            delta = _step(H, g, damping, free)
            trial = _state(model, samples, friction, *_updated(state, delta), zero, zero)
            pairs = zip(trial.rows.values(), state.rows.values(), strict=True)
            if sum(_squared_norms(e, V).sum() for (e, *_), (*_, V, _) in pairs) < cost:
                break
            damping *= 10.0
        else:
            break
        state, damping = trial, max(0.1 * damping, MARQUARDT**2)
        if cost > SIGMAS**4 * count and step > 2 and before - cost < MIN_PROGRESS * cost:
            break
    return _summary(model, state if accepted is None else accepted[0])


def _normal_equations(state: _State) -> tuple[Array, Array, float]:
    """J'VJ, J'Ve and e'Ve, summed over all rows."""
    parts = []
    for e, J, V, _ in state.rows.values():
        flat, weighted = J.reshape(-1, J.shape[-1]), (V @ J).reshape(-1, J.shape[-1])
        parts.append((flat.T @ weighted, weighted.T @ e.ravel(), _squared_norms(e, V).sum()))
    return tuple(sum(part) for part in zip(*parts, strict=True))


def _step(H: Array, g: Array, damping: float, free: Array) -> Array:
    """Marquardt's step in the complement of the free directions; it rotates a frame by at most half a radian or so.

    Each parameter is scaled by the change that adds one to the sum of squares, so that no unit enters.
    """
    D = np.diag(H)
    scale = 1.0 / np.sqrt(D + ROUNDING * D.max())
    basis = np.linalg.qr(free / scale[:, None], mode="complete")[0][:, free.shape[1] :]
    hessian = basis.T @ (H * np.outer(scale, scale)) @ basis
    damped = hessian + np.diag(damping * np.diag(hessian) + ROUNDING)
    delta: Array = np.asarray(-scale * (basis @ np.linalg.solve(damped, basis.T @ (scale * g))))
    angle = max(float(np.abs(delta[:3]).max()), float(np.abs(delta[6:9]).max()))
    return delta * min(1.0, 0.5 / max(angle, ROUNDING))


def _updated(state: _State, delta: Array) -> tuple[Array, Array, Array, Array]:
    base, tool = (T @ se3.exp(d, check=False) for T, d in ((state.base, delta[:6]), (state.tool, delta[6:12])))
    n = 12 + len(state.parameters)
    return base, tool, state.parameters + delta[12:n], state.compliance + delta[n:]


def lateral_forces(samples: Samples, tip: Array) -> tuple[NDArray[np.intp], Array] | None:
    """Samples (k,) that slide, and slide x force (k, 3) in the base frame, relative to its standard deviation.

    Its part along the normal is zero for Coulomb friction. None if nothing slides.
    """
    which, along, confidence = samples.slides(tip)
    if confidence.max(initial=0.0) < 0.5:
        return None
    f = matvec(samples.pose[which, :3, :3], samples.wrench[which, 3:])
    noise = np.trace(samples.wrench_noise[which, 3:, 3:], axis1=1, axis2=2) / 3.0
    across = np.cross(along, f) * (confidence / np.sqrt(noise + LATERAL_FRICTION**2 * (f * f).sum(axis=1)))[:, None]
    return which, across


def _state(
    model: Model,
    samples: Samples,
    friction: tuple[NDArray[np.intp], Array] | None,
    base: Array,
    tool: Array,
    parameters: Array,
    compliance: Array,
    xi: Array,
    omega: Array,
) -> _State:
    """Rows at frames A and B, linearised at corrected poses and wrenches."""
    X = inverse(base) @ (samples.pose @ approximate_exp(xi + samples.compliance_jacobian @ compliance))
    C = X @ tool
    values, L, by_parameters = model.rows(C, parameters, samples.accumulated_rotation @ tool[:3, 2])
    by_pose = L @ adjoint(X)
    e = values - matvec(by_pose, xi)
    J = np.concatenate((-L, L @ adjoint(C), by_parameters, by_pose @ samples.compliance_jacobian), axis=-1)
    count, c = J.shape[-1], len(compliance)
    of_compliance = np.eye(count)[count - c :, None]
    rows = {
        "poses": _weighted(e, J, by_pose, samples.pose_noise),
        "compliance": (compliance[:, None], of_compliance, np.ones((c, 1, 1)), np.zeros((c, 6, 1))),
    }
    if model.free_moments:
        to_tool = coadjoint(inverse(tool))
        w = (samples.wrench + omega) @ to_tool.T
        n, taken = len(w), list(model.free_moments)
        by_wrench = np.broadcast_to(to_tool[taken], (n, len(taken), 6))
        e = w[:, taken] - matvec(by_wrench, omega)
        J = np.zeros((n, len(taken), count))
        J[:, :, 6:9], J[:, :, 9:12] = skew(w[:, :3])[:, taken], skew(w[:, 3:])[:, taken]
        rows["moments"] = _weighted(e, J, by_wrench, samples.wrench_noise)
    if friction is not None:
        rows["friction"] = _lateral_rows(friction, C, base, parameters, count)
    return _State(base, tool, parameters, compliance, rows)


def _lateral_rows(
    friction: tuple[NDArray[np.intp], Array], C: Array, base: Array, parameters: Array, count: int
) -> tuple[Array, Array, Array, Array]:
    """Rows n.g with the normal n = z + k p in the contact's base frame, and their derivatives by A, B and k."""
    which, across = friction
    u, p, R = across @ base[:3, :3], C[which, :3, 3], C[which, :3, :3]
    k = float(parameters[0]) if len(parameters) else 0.0
    n = k * p
    n[:, 2] += 1.0
    e = (n * u).sum(axis=1)
    J = np.zeros((len(e), 1, count))
    J[:, 0, :3], J[:, 0, 3:6] = -k * np.cross(p, u) - np.cross(u, n), -k * u
    J[:, 0, 9:12] = k * (u[:, None, :] @ R)[:, 0]
    if len(parameters):
        J[:, 0, 12] = (p * u).sum(axis=1)
    return e[:, None], J, np.ones((len(e), 1, 1)), np.zeros((len(e), 6, 1))


def _weighted(e: Array, J: Array, by_noise: Array, noise: Array) -> tuple[Array, Array, Array, Array]:
    """Residuals, Jacobian, weights, and the gain from residuals to the least correction."""
    cross_covariance = noise @ np.swapaxes(by_noise, -1, -2)
    V: Array = np.asarray(np.linalg.inv(by_noise @ cross_covariance))
    return e, J, V, cross_covariance @ V


def _summary(model: Model, state: _State) -> Fit:
    e, _, V, _ = state.rows["poses"]
    squares = {name: _squared_norms(e, V) for name, (e, _, V, _) in state.rows.items()}
    H, n = _normal_equations(state)[0], 12 + len(state.parameters)
    H = H[:n, :n] - H[:n, n:] @ np.linalg.solve(H[n:, n:], H[n:, :n])  # marginal over the compliance
    determined = n - gauge(model.kind, state.parameters).shape[1]
    wrench, friction = (
        sqrt(float(squares[name].sum()) / state.rows[name][0].size) if name in squares else 0.0
        for name in ("moments", "friction")
    )
    motion = sqrt(float(squares["poses"].sum()) / max(1, e.size - determined))
    residuals = np.sqrt(squares["poses"] / e.shape[1])
    inefficiency = _inefficiency(matvec(np.asarray(np.linalg.cholesky(V)).swapaxes(-1, -2), e))
    return Fit(model, state.base, state.tool, state.parameters, H, motion, wrench, friction, residuals, inefficiency)


def _inefficiency(w: Array) -> float:
    """1 + 2 sum of the autocorrelations of white residuals (n, r) up to the first that is not positive."""
    square, total = float((w * w).sum()), 1.0
    for k in range(1, len(w)):
        correlation = float((w[k:] * w[:-k]).sum()) / max(square, TINY)
        if correlation <= 0.0:
            break
        total += 2.0 * correlation
    return total


def covariance(fit: Fit, size: float) -> Array:
    """Inverse of the information, with a large variance for what is undetermined; `size` of the motion [length].

    For independent errors it is the Cramer-Rao bound; correlated errors count by the statistical inefficiency.
    """
    scale = np.array(
        ([1.0] * 3 + [size] * 3) * 2 + [1.0 / size if fit.model.kind == "sphere" else size] * len(fit.parameters)
    )
    H = fit.information / fit.inefficiency * np.outer(scale, scale)
    values, vectors = np.linalg.eigh(H)
    free = np.linalg.qr(gauge(fit.model.kind, fit.parameters) / scale[:, None])[0]
    determined = np.eye(len(H)) - free @ free.T  # changes that leave the contact the same have no variance
    least = (1e-2 / UNDETERMINED) ** 2
    covariance = (vectors / np.maximum(values, least)) @ vectors.T
    covariance = determined @ covariance @ determined
    return np.asarray(covariance * np.outer(scale, scale))


def initial_guesses(model: Model, samples: Samples) -> list[InitialGuess]:
    """Initial guesses of the frames and parameters, the most likely first."""
    X, w = samples.pose, samples.wrench
    R, t = X[:, :3, :3], X[:, :3, 3]
    if model.is_unilateral and model.kind != "face":
        return _plane_guesses(model, samples, R, t, w)
    away = t - t.mean(axis=0)
    travel = np.linalg.svd(away, full_matrices=False)[2]
    U, s, Vt = np.linalg.svd(R.mean(axis=0))
    has_turned = s[1] < 1.0 - 0.5 * MIN_ROTATION**2
    middle = X[len(X) // 2]
    if model.kind == "ball":
        p, q = _fixed_points(R, t, np.eye(3))
        return [(homogeneous(np.eye(3), q), homogeneous(np.eye(3), p), np.zeros(0))]
    if model.kind == "slide":
        base = frame_along(travel[0], t.mean(axis=0))
        mean = Rotation.from_matrix(R).mean().as_matrix()  # A^-1 X B does not turn
        return [(base, homogeneous(mean.T @ base[:3, :3], np.zeros(3)), np.zeros(0))]
    axes = [(Vt[0], U[:, 0] * np.sign(U[:, 0] @ (middle[:3, :3] @ Vt[0])))] if has_turned else []
    if model.kind == "face":
        pushed = matvec(R, w[:, 3:]).mean(axis=0)
        across = pushed - travel[0] * (travel[0] @ pushed)
        normals = [travel[2]] if has_turned else [across, travel[2]]
        axes += [(middle[:3, :3].T @ unit(n), unit(n)) for n in normals if np.linalg.norm(n) > 0.0]
        return [(frame_along(b, t.mean(axis=0)), frame_along(a, np.zeros(3)), np.zeros(0)) for a, b in axes]
    if not has_turned:
        axes.append((middle[:3, :3].T @ travel[0], travel[0]))
    return [_axis_guess(model, samples, R, t, a, b) for a, b in axes]


def _axis_guess(model: Model, samples: Samples, R: Array, t: Array, a: Array, b: Array) -> InitialGuess:
    """A joint whose axis is along a in the tool and along b in the base."""
    across = np.eye(3) if model.kind == "hinge" else np.eye(3) - np.outer(b, b)
    p, q = _fixed_points(R, t, across)
    base, tool = frame_along(b, q), frame_along(a, p)
    if model.kind != "screw":
        return base, tool, np.zeros(0)
    tool[:3, :3] = samples.pose[len(R) // 2, :3, :3].T @ base[:3, :3]
    C = inverse(base) @ samples.pose @ tool
    angle = angles(C, samples.accumulated_rotation @ tool[:3, 2])
    pitch, offset = np.linalg.lstsq(np.stack((angle, np.ones_like(angle)), axis=1), C[:, 2, 3], rcond=None)[0]
    base[:3, 3] += offset * base[:3, 2]
    return base, tool, np.array([pitch])


def _fixed_points(R: Array, t: Array, across: Array) -> tuple[Array, Array]:
    """p in the tool and q in the base that minimise |across (R p + t - q)|."""
    A = np.concatenate((across @ R, np.broadcast_to(-across, R.shape)), axis=-1).reshape(-1, 6)
    found: Array = np.asarray(np.linalg.lstsq(A, -(t @ across.T).reshape(-1), rcond=1e-2)[0])
    return found[:3], found[3:]


def _plane_guesses(model: Model, samples: Samples, R: Array, t: Array, w: Array) -> list[InitialGuess]:
    """Tips on planes: linear least squares for each of many normals, the best four of them."""
    m, f = w[:, :3], w[:, 3:]
    pushes = matvec(R, f)
    pushed = unit(pushes.mean(axis=0) + 1e-12)
    # Normals are spread about the principal axes of the forces, so that the choice of the base frame does not matter.
    axes = np.linalg.svd(pushes, full_matrices=False)[2]
    axes[((pushes @ axes.T) ** 3).sum(axis=0) < 0.0] *= -1.0
    weight_f = 1.0 / np.trace(samples.wrench_noise[:, :3, :3], axis1=1, axis2=2).mean()
    weight_t = 1.0 / np.trace(samples.pose_noise[:, 3:, 3:], axis1=1, axis2=2).mean()
    F = skew(f)
    H_w = weight_f * np.einsum("nij,nik->jk", F, F)  # of |m + f x p|^2
    g_w = -weight_f * np.einsum("nij,ni->j", F, m)
    # The moments of an edge are not all zero: a low weight.
    share_w = 1e-3 if model.kind == "line" else 1.0
    travel = np.linalg.svd(t - t.mean(axis=0), full_matrices=False)[2][0]
    i = np.arange(NORMAL_COUNT) + 0.5
    z, azimuth = 1.0 - i / NORMAL_COUNT, np.pi * (1.0 + 5.0**0.5) * i
    r = np.sqrt(1.0 - z * z)
    half_sphere = np.stack((r * np.cos(azimuth), r * np.sin(azimuth), z), axis=-1)
    normals = np.stack((pushed, unit(pushed - travel * travel.dot(pushed) + 1e-12), *(half_sphere @ axes)))
    G = np.einsum("nji,kj->kni", R, normals)  # R' n
    G = np.concatenate((G, np.full((*G.shape[:2], 1), -1.0)), axis=-1)
    y = -np.einsum("ni,ki->kn", t, normals)
    H = weight_t * np.einsum("kni,knj->kij", G, G)
    g = weight_t * np.einsum("kni,kn->ki", G, y)
    H[:, :3, :3] += share_w * H_w
    g[:, :3] += share_w * g_w
    # Regularised where neither motion nor wrench determines the tip.
    H += 1e-9 * np.trace(H, axis1=1, axis2=2)[:, None, None] * np.eye(4)
    found = np.linalg.solve(H, g[..., None])[..., 0]
    cost = weight_t * ((np.einsum("kni,ki->kn", G, found) - y) ** 2).sum(axis=1)
    cost += share_w * weight_f * ((m[None] + np.einsum("nij,kj->kni", F, found[:, :3])) ** 2).sum(axis=(1, 2))
    if model.kind == "line":
        spread = np.linalg.eigvalsh(np.einsum("kni,knj->kij", G[..., :3], G[..., :3]))[:, 0]
        cost += weight_t * (t - t.mean(axis=0)).var() * spread
    friction = lateral_forces(samples, found[0, :3])
    if friction is not None:
        cost = cost + ((normals @ friction[1].T) ** 2).sum(axis=1)
    order = [0, 1, *(2 + np.argsort(cost[2:])[:2]).tolist()]
    order.sort(key=lambda k: cost[k])
    return [guess for k in order for guess in _plane_guess(model, R, t, normals[k], found[k])]


def _plane_guess(model: Model, R: Array, t: Array, n: Array, found: Array) -> list[InitialGuess]:
    """Initial guesses for a normal, with `found`, a tip (3,) and a height."""
    p = found[:3]
    x = R @ p + t
    middle = x.mean(axis=0)
    base = frame_along(n, middle + n * (found[3] - n @ middle))
    if model.kind == "line":
        u = np.einsum("nji,j->ni", R, n)
        spread, directions = np.linalg.eigh(u.T @ u / len(u))
        edge, z = directions[:, 0], u.mean(axis=0)
        if spread[1] > MIN_ROTATION**2:
            return [(base, frame_along(z - edge * (edge @ z), p, edge), np.zeros(0))]
        # The tool never tilts: directions of the edge in its plane, 30 degrees apart.
        other, headings = np.cross(z, edge), np.arange(6) * np.pi / 6.0
        return [(base, frame_along(z, p, np.cos(a) * edge + np.sin(a) * other), np.zeros(0)) for a in headings]
    if model.kind == "point":
        return [(base, homogeneous(np.eye(3), p), np.zeros(0))]
    y = (x - base[:3, 3]) @ base[:3, :3]  # z + k |p|^2 / 2 = 0 through them
    A = np.stack((0.5 * (y * y).sum(axis=1), np.ones(len(y))), axis=1)
    return [(base, homogeneous(np.eye(3), p), np.linalg.lstsq(A, -y[:, 2], rcond=None)[0][:1])]
