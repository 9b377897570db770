"""The velocity law: the joint velocity of a tick as a sequence of convex problems, each solved by a library.

Symbols (all twists in one frame; m joints, n bodies):

    A = R J, b = R s      Jacobian and twist in the measure, |R s|^2 = L^2 |omega|^2 + |v at the point|^2
    f, e                  b = f + e: feedforward, and gain times the error; a single twist has e = 0
    |x|                   norm in the joint metric
    P                     projector on the null space of A
    x_before, r_before    velocity and residual of the last tick

Damped least squares, without and with the error; then the scale p at which the approach is feasible; then the feasible
velocity nearest to it:

    F_p(x) = 1/2 |A x - f - p e|^2 + 1/2 mu |x|^2 + 1/2 nu |x - x_before|^2 + 1/2 w |P (x - x_p)|^2
    y_p    = argmin F_p inside the position limits,  y(p) = y_0 + p d,   d = c (y_1 - y_0)
    p      = argmin over all limits, 0 <= p <= 1:  1/2 |x - y(p)|_K^2 + |f| |d|_K (1 - p) + 1/2 eps |d|_K^2 (1 - p)^2
    x      = argmin over all limits:               1/2 |x - y(p)|_H^2
    r      = |A x - f - p e|, its part in the range of A
    H      = F_p'' = A'A + (mu + nu) I + w P,   K = A'A + (mu + w) I
    mu     = RESIDUAL_DAMPING T |A| r_before,   nu = SMOOTHING |A|^2,   w = NULL_WEIGHT |A|^2,   T the hold time
    c      = max(0, 1 - MIN_PROGRESS |e|^2 / e'A (y_1 - y_0))

Limits reduce the speed of the approach (p) before they change its direction. The residual damps the next tick, so an
arm comes to rest at a target out of reach; c stops motion that reduces the error by less than a thousandth.

Single call     No memory: mu = nu = 0; `damping` lambda adds 1/2 lambda^2 |x|^2. A loop starts with (0, 0).
Posture         x_p = min(1, t / t_p)^2 times the posture velocity; t and t_p are the largest joint velocities of the
                task and of the posture, relative to the velocity limits. A task at rest leaves the joints at rest.
Exact rows      E x = a (E_f + E_e) with the largest feasible scale a <= 1, damped by r_before. Twist and posture are
                scaled by a; p and c refer to the remaining motion. If the rows determine the whole motion of an arm
                that stretches, a becomes (a - MIN_PROGRESS) / (1 - MIN_PROGRESS): it stops before the singularity.
Forms           replace |A x - b|^2 by |x - x_h|_G^2, so that x = x_h without memory and active limits:
                    pitch h       x_h = V diag(mu_i / (mu_i^2 + lambda^2)) V'J'Q_h s, which is J^{+h} s for lambda = 0
                                  G = V diag(sqrt(mu_i^2 + lambda^2)) V',   J'Q_h J = V diag(mu_i) V'
                    complement    x_h = J^+ P_Z s, P_Z the projector along the complement,   G = A'A
                A guard eta shortens A (x_h - x_LS) to sqrt(1 - eta) |A x_LS|, x_LS the least-squares velocity.
Infeasibility   Exact rows that are infeasible at every scale are approximated. Limit rows that conflict with the
                bounds, then the tool speed limit, are relaxed by the least and reported by name.
Several twists  are stacked, with sqrt(weight) R of each; `prioritised` keeps what higher levels achieve.

The braking before a target under acceleration limits, which scales e, is in core/loop.cpp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.linear import TINY
from invariantqp.systems.system import ScrewSystem
from invariantqp.velocity.backends import Backend, BoxQP, Daqp, SolverFailure, solve_checked
from invariantqp.velocity.forms import Complement, Form, PitchForm

# The weights of the law, and what chose them: 87 tasks of `invariantqp compare`.
RESIDUAL_DAMPING = 0.5  # 0.25 has 1.5 times the acceleration at singularities; 1 has 0.7 times, but returns more slowly
SMOOTHING = 3e-5  # 1e-3 misses singular paths by 1.7 times as much; 0 has 4 times the acceleration there
NULL_WEIGHT = 5e-6  # at 1e-3 a posture moves the tool by 2 mm at limits; at 1e-6 a rail starts in the wrong direction
MIN_PROGRESS = 1e-3  # at 0 and 1e-4 an xArm7 led out of reach still creeps at 0.1 rad/s after nine seconds
SCALE_WEIGHT = 1e-4  # eps, makes p unique; at 1e-3 orientations overshoot by 1.6 times as much
ROUNDING = arrays.NEGLIGIBLE  # relative, of solutions; smaller singular values count as zero
TERM_ROUNDING = arrays.ROUNDING  # of a sum, beside its largest term
LEAST_POWER, MOST_POWER = -8.0, 6.0  # of ten: bracket of the multiplier of the tool speed limit


class Rows(NamedTuple):
    """Limit rows and tool speed limit: lower <= C x <= upper, |P x| <= speed."""

    C: Array  # (k, m)
    lower: Array  # (k,)
    upper: Array  # (k,)
    names: tuple[str, ...] = ()
    P: Array | None = None  # (3, m)
    speed: float = inf


@dataclass(frozen=True, eq=False)
class Tick:
    """The data of one tick, SI units."""

    J: Array  # (6 n, m) joint twists
    root: Array  # (6 n, 6 n) R, the measure
    feedforward: Array  # (6 n,) twist of the target, or the whole twist of a single call
    error: Array  # (6 n,) gain times the error twist
    lower: Array  # (m,) velocity limits
    upper: Array  # (m,)
    position_lower: Array  # (m,) those of them that come from position limits
    position_upper: Array  # (m,)
    rows: Rows | None = None
    exact: tuple[Array, Array, Array] | None = None  # E (k, m), E_f (k,), E_e (k,)
    twist_rows: Array | None = None  # (k, 6) D where the exact rows are parts of a chain's twist, E = D J
    exact_rank: int = 0  # of E away from singularities; at a singularity a is small
    posture: Array | None = None  # (m,) posture velocity
    velocity_limit: Array | None = None  # (m,) of the robot; without it the posture is not scaled by t / t_p
    metric: Array | None = None  # (m, m) joint metric
    hold_time: float = 0.0  # T, how long the velocity is held, with the delay [s]
    last_velocity: Array | None = None  # (m,) x_before; None for a single call
    last_residual: float = 0.0  # r_before
    form: Form | None = None  # for one twist
    damping: float = 0.0  # lambda of a form [unit of J'Q_h J], or of a single call [unit of A]
    guard: float | None = None  # eta


class Answer(NamedTuple):
    """The velocity of a tick and how it was found."""

    velocity: Array  # (m,)
    approach_scale: float  # p
    scale: float  # a
    residual: float  # r
    relaxed: tuple[tuple[str, float], ...]  # relaxed rows and tool speed, and by how much
    form_share: float  # what the guard leaves of the step from least squares to x_h


class Objective(NamedTuple):
    """F_p on y: 1/2 y'H y - (f + p e)'y."""

    H: Array
    K: Array
    f: Array
    e: Array
    form_share: float = 1.0


class FeasibleSet(NamedTuple):
    """lower <= C y <= upper, the joints' bounds first, and |P y + start| <= speed."""

    C: Array
    lower: Array
    upper: Array
    P: Array | None = None
    start: Array | None = None
    speed: float = inf

    def in_coordinates(self, origin: Array, basis: Array) -> FeasibleSet:
        """The set of z with y = origin + basis z."""
        value = self.C.dot(origin)
        feasible = FeasibleSet(self.C.dot(basis), self.lower - value, self.upper - value)
        if self.P is None or self.start is None:
            return feasible
        P = self.P.dot(basis)
        moves = np.linalg.norm(P, axis=0) > ROUNDING * np.linalg.norm(self.P) * np.linalg.norm(basis, axis=0)
        return feasible._replace(P=P * moves, start=self.start + self.P.dot(origin), speed=self.speed)

    def last_feasible(self, start: Array, y: Array) -> Array:
        """y or, if it is outside by more than rounding, the last feasible point on the segment from `start` to y."""
        step, value, share = y - start, self.C.dot(y), 1.0
        over = np.maximum(value - self.upper, self.lower - value)
        over = over - ROUNDING * np.linalg.norm(self.C, axis=1) * np.linalg.norm(y)
        for i in np.flatnonzero(over > 0.0):
            share = min(share, 1.0 - float(over[i] / abs(self.C[i].dot(step))))
        most = self.speed * (1.0 + np.sqrt(ROUNDING))
        if self.P is not None and np.linalg.norm(self.P.dot(y)) > most:
            a, b = self.P.dot(start), self.P.dot(step)
            left = max(0.0, most**2 - float(a.dot(a)))
            share = min(share, float((np.sqrt(a.dot(b) ** 2 + b.dot(b) * left) - a.dot(b)) / b.dot(b)))
        return start + max(share, 0.0) * step if share < 1.0 else y

    def with_last_bounded(self, lower: float, upper: float) -> FeasibleSet:
        """With bounds on the last variable."""
        last = np.eye(1, self.C.shape[1], self.C.shape[1] - 1)
        low, high = np.append(self.lower, lower), np.append(self.upper, upper)
        return self._replace(C=np.vstack((self.C, last)), lower=low, upper=high)


def velocity(tick: Tick, backend: Backend | None = None) -> Answer:
    """The joint velocity of a tick.

    Raises:
        SolverFailure: a problem has no solution.
        NoPseudoinverse: the form has no projector, and no damping is given.
    """
    solver = Daqp() if backend is None else backend
    T = np.eye(tick.J.shape[1]) if tick.metric is None else np.linalg.inv(np.linalg.cholesky(tick.metric)).T  # x = T y
    feasible, positions, relaxed = feasible_sets(tick, T, solver)
    origin, basis, a, inside = exact_solutions(tick, T, feasible, solver)
    cost = objective(tick, T, a)
    y, p = scaled_approach(cost, origin, basis, feasible, positions, tick, T, solver)
    A, x = tick.root.dot(tick.J), T.dot(y if inside is None else feasible.last_feasible(inside, y))
    left = A.dot(x) - tick.root.dot(tick.feedforward + p * tick.error)
    U, sigma, _ = np.linalg.svd(A, full_matrices=False)
    left = U[:, sigma > ROUNDING * sigma[0]].T.dot(left)
    return Answer(x, p, a, float(np.linalg.norm(left)), relaxed, cost.form_share)


def prioritised(levels: Sequence[Tick], backend: Backend | None = None) -> Answer:
    """The answer of the highest level, with the velocity of all; each keeps what the levels above achieve."""
    first = answer = velocity(levels[0], backend)
    rows = [] if levels[0].exact is None else [levels[0].exact[0]]
    for above, tick in pairwise(levels):
        E = np.vstack(rows := [*rows, above.J])
        kept, a = (E, E.dot(answer.velocity), np.zeros(len(E))), first.scale
        answer = velocity(replace(tick, feedforward=a * tick.feedforward, error=a * tick.error, exact=kept), backend)
    return first._replace(velocity=answer.velocity)


def feasible_sets(
    tick: Tick, T: Array, solver: Backend
) -> tuple[FeasibleSet, FeasibleSet, tuple[tuple[str, float], ...]]:
    """All limits on y, relaxed where they conflict with the bounds; the position limits; what was relaxed."""
    m, positions = len(T), FeasibleSet(T, tick.position_lower, tick.position_upper)
    if tick.rows is None:
        return FeasibleSet(T, tick.lower, tick.upper), positions, ()
    C, lower, upper, names, P, speed = tick.rows
    k, relaxed = len(C), []
    if k:  # slack t of the rows, in units of their norms: least |t|, then least |y|
        lengths = np.linalg.norm(C.dot(T), axis=1) + TINY
        stacked = np.block([[T, np.zeros((m, k))], [C.dot(T) / lengths[:, None], np.eye(k)]])
        low, high = np.append(tick.lower, lower / lengths), np.append(tick.upper, upper / lengths)
        H = np.diag(np.append(np.full(m, ROUNDING), np.ones(k)))
        t = lengths * minimise(H, np.zeros(m + k), FeasibleSet(stacked, low, high), solver)[m:]
        margin = np.sqrt(ROUNDING) * (np.minimum(np.abs(lower), np.abs(upper)) + lengths)
        t = t * (1.0 + np.sqrt(ROUNDING))
        lower, upper = lower - np.maximum(t, 0.0), upper - np.minimum(t, 0.0)
        relaxed = [(names[i] if names else f"row {i}", float(abs(t[i]))) for i in np.flatnonzero(np.abs(t) > margin)]
    feasible = FeasibleSet(np.vstack((T, C.dot(T))), np.append(tick.lower, lower), np.append(tick.upper, upper))
    if P is not None:
        P = P.dot(T)
        slowest = minimise(P.T.dot(P) + ROUNDING * np.vdot(P, P) * np.eye(m), np.zeros(m), feasible, solver)
        least = float(np.linalg.norm(P.dot(slowest)))
        if least > speed:
            relaxed.append(("the tool's speed", least - speed))
            speed = least * (1.0 + np.sqrt(ROUNDING))
        feasible = feasible._replace(P=P, start=np.zeros(3), speed=speed)
    return feasible, positions, tuple(relaxed)


def exact_solutions(
    tick: Tick, T: Array, feasible: FeasibleSet, solver: Backend
) -> tuple[Array, Array, float, Array | None]:
    """The solutions of the exact rows, y = origin + basis z; a; and a feasible one, None without rows."""
    if tick.exact is None or not len(tick.exact[0]):
        return np.zeros(len(T)), np.eye(len(T)), 1.0, None
    E, demand = np.asarray(tick.exact[0]), np.asarray(tick.exact[1]) + np.asarray(tick.exact[2])
    U, sigma, Vt = np.linalg.svd(E.dot(T))
    m, k = len(T), int(np.count_nonzero(sigma > ROUNDING * sigma[0]))
    k = max(k, min(tick.exact_rank, len(sigma)))  # near a singularity a is small
    within, basis = Vt[:k].T, Vt[k:].T
    full = (within / np.maximum(sigma[:k], ROUNDING * sigma[0])).dot(U[:, :k].T.dot(demand))
    size = max(float(np.linalg.norm(full)), np.sqrt(ROUNDING))
    b, A = float(np.linalg.norm(tick.root.dot(tick.feedforward + tick.error))), tick.root.dot(tick.J)
    mu = RESIDUAL_DAMPING * tick.hold_time * float(np.linalg.norm(A)) * tick.last_residual / (b + TINY)
    damping = mu * float(full.dot(full)) / (float(np.linalg.norm(demand)) + TINY)
    n, left = m - k, feasible.in_coordinates(np.zeros(m), np.column_stack((basis, full))).with_last_bounded(0.0, 1.0)
    H = np.diag(np.append(np.full(n, ROUNDING / size**2 + mu / (b + TINY)), 1.0 + damping))
    whole = k >= min(m, 6)  # the rows determine the tool's whole motion
    lost = MIN_PROGRESS if whole and is_stretching(tick, T.dot(full)) else 0.0  # of a = 1 / (1 + damping)
    try:
        z = minimise(H, max(0.0, 1.0 - lost * (1.0 + damping)) / (1.0 - lost) * np.eye(n + 1)[n], left, solver)
    except SolverFailure:  # infeasible at every scale: the nearest feasible velocity
        K = np.column_stack((within.T, -within.T.dot(full)))
        H = K.T.dot(K) + ROUNDING * np.diag(np.append(np.ones(m), size**2))
        wide = feasible.in_coordinates(np.zeros(m), np.eye(m, m + 1)).with_last_bounded(0.0, 1.0)
        found = minimise(H, ROUNDING * size**2 * np.eye(m + 1)[m], wide, solver)  # of several, the largest scale
        nearest, a = within.dot(within.T.dot(found[:m])), min(max(float(found[m]), 0.0), 1.0)
        return nearest, basis, a, found[:m]
    a, inside = float(z[n]), basis.dot(z[:n]) + z[n] * full
    a = 1.0 if a > 1.0 - 10.0 * ROUNDING else max(a, 0.0) * (1.0 - ROUNDING)
    return a * full, basis, a, inside


def is_stretching(tick: Tick, x: Array) -> bool:
    """Whether the twist along the exact demand decreases at constant joint velocity x.

    The derivative of a chain's twist is the sum over j < i of x_j x_i [J_j, J_i].
    """
    if tick.exact is None or tick.twist_rows is None or tick.last_velocity is None or len(tick.J) != 6:
        return False
    columns = tick.J * x
    before = np.cumsum(columns, axis=1) - columns
    turn, move, omega, v = before[:3].T, before[3:].T, columns[:3].T, columns[3:].T
    change = np.hstack((np.cross(turn, omega), np.cross(turn, v) + np.cross(move, omega))).sum(axis=0)
    return float((np.asarray(tick.exact[1]) + np.asarray(tick.exact[2])).dot(tick.twist_rows.dot(change))) < 0.0


def objective(tick: Tick, T: Array, scale: float) -> Objective:
    """F_p on y, for the scaled twist."""
    J, m = tick.J.dot(T), len(T)
    A = tick.root.dot(J)
    size = float(np.vdot(A, A)) or 1.0
    _, few, Vt = np.linalg.svd(A)
    sigma = np.append(few, np.zeros(m))[:m]
    P = Vt.T.dot(np.clip(2.0 - 2.0 * sigma / (ROUNDING * max(float(sigma[0]), TINY)), 0.0, 1.0)[:, None] * Vt)
    G, gradient, form_share = form_cost(tick, J, A)
    gradient = gradient - P.dot(gradient)
    unit = size / max(float(np.trace(G)), TINY)  # G of a form and A'A have different units
    mu, nu, w, c = 0.0 if tick.form else tick.damping**2, 0.0, NULL_WEIGHT * size, np.asarray(np.zeros(m))
    if tick.last_velocity is not None:
        mu, nu = RESIDUAL_DAMPING * tick.hold_time * np.sqrt(size) * tick.last_residual, SMOOTHING * size
        c = np.asarray(nu * np.linalg.solve(T, tick.last_velocity))
    H = unit * G + (mu + nu) * np.eye(m) + w * P
    f, e = c + unit * scale * gradient.dot(tick.feedforward), unit * scale * gradient.dot(tick.error)
    if tick.posture is not None:
        speed_ratio = 1.0
        if tick.velocity_limit is not None and tick.posture.any():
            free = np.linalg.solve(H, np.column_stack((f, e)))
            task = T.dot(free[:, 0] + progress_ratio(tick, A, free[:, 1]) * free[:, 1])
            t, t_p = (np.abs(x / tick.velocity_limit).max() for x in (task, tick.posture))
            speed_ratio = min(1.0, float(t / t_p))
        f = f + scale * speed_ratio**2 * w * P.dot(np.linalg.solve(T, tick.posture))
    return Objective(0.5 * (H + H.T), unit * G + (mu + w) * np.eye(m), f, e, form_share)


def progress_ratio(tick: Tick, A: Array, d: Array) -> float:
    """c: 0 where a step d of a loop reduces the error by less than MIN_PROGRESS of the request, else nearly 1."""
    e = tick.root.dot(tick.error)
    if tick.last_velocity is None or not e.any():
        return 1.0
    return max(0.0, 1.0 - MIN_PROGRESS * float(e.dot(e)) / max(float(e.dot(A.dot(d))), TINY))


def form_cost(tick: Tick, J: Array, A: Array) -> tuple[Array, Array, float]:
    """G (m, m); G X (m, 6 n), x_h = X s, or A'R without a form; and the share that the guard leaves."""
    G = A.T.dot(A)
    if tick.form is None:
        return G, A.T.dot(tick.root), 1.0
    system = ScrewSystem(J)
    if isinstance(tick.form, PitchForm):
        X = system.damped_pseudoinverse(tick.form.h, tick.damping)
        mu, V = np.linalg.eigh(system.gram(tick.form.h))
        G = V.dot(np.hypot(mu, tick.damping)[:, None] * V.T)
    elif isinstance(tick.form, Complement):
        X = system.pseudoinverse(complement=np.asarray(tick.form.Z))
    else:  # a definite form of the user
        X = system.pseudoinverse(metric=tick.form.matrix(np.eye(6)))
    if tick.guard is None:
        return G, G.dot(X), 1.0
    least, s = np.linalg.pinv(A, rcond=ROUNDING).dot(tick.root), tick.feedforward + tick.error
    step, most = (float(np.linalg.norm(A.dot(x))) for x in (X.dot(s) - least.dot(s), least.dot(s)))
    kept = min(1.0, float(np.sqrt(1.0 - tick.guard)) * most / max(step, TINY))
    return G, G.dot(least + kept * (X - least)), kept


def scaled_approach(
    cost: Objective,
    origin: Array,
    basis: Array,
    feasible: FeasibleSet,
    positions: FeasibleSet,
    tick: Tick,
    T: Array,
    solver: Backend,
) -> tuple[Array, float]:
    """y and p, for y = origin + basis z."""
    n = basis.shape[1]
    H, K = (basis.T.dot(matrix).dot(basis) for matrix in (cost.H, cost.K))
    f, e = basis.T.dot(cost.f - cost.H.dot(origin)), basis.T.dot(cost.e)
    left = positions.in_coordinates(origin, basis)
    y_0, y_1 = (origin + basis.dot(minimise(H, right, left, solver)) for right in (f, f + e))
    d = progress_ratio(tick, tick.root.dot(tick.J).dot(T), y_1 - y_0) * (y_1 - y_0)
    length, size = (float(np.sqrt(max(0.0, y.dot(cost.K).dot(y)))) for y in (d, y_1))
    if length <= ROUNDING * size:
        return y_0 + basis.dot(minimise(H, np.zeros(n), feasible.in_coordinates(y_0, basis), solver)), 1.0
    most = float(np.linalg.norm(tick.root.dot(tick.feedforward)))
    left = feasible.in_coordinates(y_0, np.column_stack((basis, d / length))).with_last_bounded(0.0, length)
    wide = np.block([[K, np.zeros((n, 1))], [np.zeros((1, n)), SCALE_WEIGHT]])  # variables z - z(p) and p |d|_K
    u = minimise(wide, np.append(np.zeros(n), most + SCALE_WEIGHT * length), left, solver)
    p = float(np.clip(u[n] / length, 0.0, 1.0))
    try:
        z = minimise(H, np.zeros(n), feasible.in_coordinates(y_0 + p * d, basis), solver)
    except SolverFailure:  # by rounding of p
        z = u[:n]
    return np.asarray(y_0 + p * d + basis.dot(z)), p


def minimise(H: Array, c: Array, feasible: FeasibleSet, solver: Backend) -> Array:
    """argmin 1/2 y'Hy - c'y over a feasible set.

    The speed limit is enforced by its multiplier k: 1/2 k |start + P y|^2 is added, so that the speed is the limit.
    """
    y = polytope_optimum(H, c, feasible, solver)
    P, start = feasible.P, feasible.start
    over = 0.0 if P is None or start is None else float(np.linalg.norm(start + P.dot(y))) - feasible.speed
    if P is None or start is None or over <= (0.0 if P.any() else np.sqrt(ROUNDING) * (2.0 * feasible.speed + over)):
        return y

    def at(power: float) -> Array:
        k = 10.0**power * float(np.trace(H)) / (float(np.vdot(P, P)) + TINY)
        return polytope_optimum(H + k * P.T.dot(P), c - k * P.T.dot(start), feasible, solver)

    def excess(power: float) -> float:
        return float(np.linalg.norm(start + P.dot(at(power)))) - feasible.speed

    if excess(MOST_POWER) > np.sqrt(ROUNDING) * (feasible.speed + np.linalg.norm(start + P.dot(y))):
        raise SolverFailure("definition", "no answer at the tool's speed limit")
    if excess(MOST_POWER) > 0.0 or excess(LEAST_POWER) <= 0.0:
        return at(MOST_POWER if excess(LEAST_POWER) > 0.0 else LEAST_POWER)
    return at(float(brentq(excess, LEAST_POWER, MOST_POWER, xtol=TERM_ROUNDING)))


def polytope_optimum(H: Array, c: Array, feasible: FeasibleSet, solver: Backend) -> Array:
    """argmin 1/2 y'Hy - c'y over lower <= C y <= upper, by a QP solver in units in which H is the identity.

    The equations of the active limits are then solved once more: solvers stop at tolerances of their own.
    """
    inverse = np.linalg.inv(np.linalg.cholesky(H)).T  # y = inverse (e + free)
    free, N = inverse.T.dot(c), feasible.C.dot(inverse)
    size = np.linalg.norm(N, axis=1)
    some = size > TERM_ROUNDING * np.linalg.norm(inverse)
    if np.maximum(feasible.lower[~some], -feasible.upper[~some]).max(initial=0.0) > np.sqrt(ROUNDING):
        raise SolverFailure("definition", "no solution found")
    N = N[some] / size[some, None]
    low, high = feasible.lower[some] / size[some] - N.dot(free), feasible.upper[some] / size[some] - N.dot(free)
    scale = float(np.maximum(low, -high).max(initial=0.0))
    if scale == 0.0:
        return np.asarray(inverse.dot(free))
    qp = BoxQP.of(np.eye(len(c)), np.zeros(len(c)), low / scale, high / scale, N)
    e = scale * solve_checked(solver, qp)
    at_high, at_low = (np.abs(N.dot(e) - side) < np.sqrt(ROUNDING) * 1e-2 * scale for side in (high, low))
    active = at_high | at_low
    exact = np.linalg.lstsq(N[active], np.where(at_high, high, low)[active], rcond=TERM_ROUNDING)[0]
    push = np.linalg.lstsq(N[active].T, exact, rcond=TERM_ROUNDING)[0] * np.where(at_high, -1.0, 1.0)[active]
    value, margin = N.dot(exact), ROUNDING * scale
    inside = bool(((value <= high + margin) & (value >= low - margin)).all()) and push.min(initial=0.0) >= -margin
    return np.asarray(inverse.dot(free + (exact if inside else e)))
