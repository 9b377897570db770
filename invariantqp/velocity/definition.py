"""The velocity law on a page: convex problems, solved by a library, with no shortcut and no warm start.

    A = R J, b = R s      joint twists and a twist as they are measured: |R s|^2 = L^2 |omega|^2 + |v at the point|^2
    f, e                  of b the target's own twist, and gain times the error, b = f + e; a twist by itself has e = 0

    F_p(x) = 1/2 |A x - f - p e|^2 + 1/2 mu |x|^2 + 1/2 nu |x - x_before|^2 + 1/2 w |P (x - x_p)|^2,   H = F_p''
    y(p)   = y_0 + p d,   d = c (y_1 - y_0),   y_p = argmin F_p inside the position limits
    c      = max(0, 1 - WORTH |e|^2 / e'A (y_1 - y_0)):   what closes less than a thousandth of the error is not gone
    p      = argmin over all limits, 0 <= p <= 1:   1/2 |x - y(p)|_K^2 + |f| |d|_K (1 - p) + 1/2 eps |d|_K^2 (1 - p)^2
    x      = argmin over all limits:   |x - y(p)|_H,            K = A'A + (mu + w) I

Limits slow the way of the tool to its target down (p) before they bend it; joints may go another way (K). |x| is in
the joint metric, P the projector on joint velocities that move nothing. mu = KAPPA held |A| r_before, r what joints can
do at all of |A x - f - p e|: an arm that cannot get nearer comes to rest. nu, w: shares of |A|^2.

(a) A call by itself remembers nothing: mu = nu = 0: a twist that limits allow is done. `damping`
    lambda^2 |x|^2 / 2 holds a singular one. A loop remembers x_before and r_before, at first (0, 0).
(b) A form replaces |A x - b|^2 by |x - x_h|_G^2, x_h what it makes of s and G its own size; the rest stays:
        pitch h       x_h = V diag(mu_i / (mu_i^2 + lambda^2)) V'J'Q_h s, which is J^{+h} s for lambda = 0
                      G = V diag(sqrt(mu_i^2 + lambda^2)) V',   J'Q_h J = V diag(mu_i) V'
        complement    x_h = J^+ P s, P the projector along it,   G = A'A
    So without memory and active limits x = x_h to rounding, whatever the point and the length in R. A guard, if asked
    for, shortens A x_h - A x_0 beside least squares x_0 to sqrt(1 - eta) |A x_0|: eta of what x_0 closes is kept.
(c) x_p = min(1, t / t_p)^2 times the posture's velocity: t and t_p are the largest shares of their full speed that
    joints need for the task and for the posture. A task at rest leaves the joints at rest.
(d) The approach to a target under acceleration limits, with two numbers more, is that of core/loop.cpp.

Exact rows E x = a (E_f + E_e) hold at the largest share a of their speed that limits allow, damped by r_before as
well. Where they decide the whole motion of an arm that stretches out, a becomes (a - WORTH) / (1 - WORTH): it stops
before it is singular and comes back with the same elbow. Twist and posture slow down with the rows; p and c are of the
rest. Where standing still is outside the limits, rows come as near to that as limits allow. Rows that contradict the
box, and a tool speed that contradicts both, give way by the least, by name.
Twists of several bodies are stacked, with sqrt(weight) R of each; `prioritised` keeps what the levels above achieve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.linear import TINY
from invariantqp.systems.system import ScrewSystem
from invariantqp.velocity.backends import Backend, BoxQP, Daqp, SolverFailure, answered
from invariantqp.velocity.forms import Complement, Form, PitchForm

# The numbers of the law, and what chose them: 87 tasks of `invariantqp compare`.
KAPPA = 0.5  # mu; .25 has 1.5 times the acceleration at singularities, 1 has .7 times and is later out of reach
NU = 3e-5  # nu / |A|^2; at 1e-3 singular paths are missed by 1.7 times as much, at 0 they have 4 times the acceleration
NULL = (
    5e-6  # w / |A|^2; at 1e-3 a posture drags the tool off by 2 mm at limits; at 1e-6 a rail goes the wrong way first
)
WORTH = 1e-3  # of d; at 0 and 1e-4 an xArm7 led out of reach still creeps at .1 rad/s after nine seconds
EPSILON = 1e-4  # keeps p unique; at 1e-3 turns swing by 1.6 times as much
ROUNDING = 1e-9  # below this share of the largest, singular values move nothing, and numbers are rounding
LEAST_POWER, MOST_POWER = -8.0, 6.0  # of ten: where the multiplier of a tool speed is looked for


class Rows(NamedTuple):
    """lower <= C x <= upper, and |P x| <= speed of a point of the tool."""

    C: Array  # (k, m)
    lower: Array  # (k,)
    upper: Array  # (k,)
    names: tuple[str, ...] = ()
    P: Array | None = None  # (3, m)
    speed: float = inf


@dataclass(frozen=True, eq=False)
class Tick:
    """The data of one tick: m joints and n twists (one, but for several bodies), SI units, everything in one frame."""

    J: Array  # (6 n, m) joint twists
    root: Array  # (6 n, 6 n) R, the measure
    ahead: Array  # (6 n,) the target's own twist, or all of a twist by itself
    error: Array  # (6 n,) gain times the error twist
    lower: Array  # (m,) velocity limits
    upper: Array  # (m,)
    position_lower: Array  # (m,) of these the ones from position limits, for the way to a target
    position_upper: Array  # (m,)
    rows: Rows | None = None
    exact: tuple[Array, Array, Array] | None = None  # E (k, m), E_f (k,), E_e (k,)
    parts: Array | None = None  # (k, 6) D where the exact rows are parts of a chain's twist, E = D J
    exact_rank: int = 0  # how many of these rows the joints can keep; next to where they lose one, a is small
    posture: Array | None = None  # (m,) x_p
    fastest: Array | None = None  # (m,) full speeds of the joints, for (c); None follows the posture as it is
    metric: Array | None = None  # (m, m) joint metric
    held: float = 0.0  # how long the velocity is held [s], with the delay
    before: Array | None = None  # (m,) x_before; None is a call by itself
    missed: float = 0.0  # r_before
    form: Form | None = None  # with one twist
    damping: float = 0.0  # lambda of a form, or of a call by itself [unit of J'Q_h J, of A]
    guard: float | None = None  # eta: at least this share of what least squares closes of s is kept; None does not ask


class Answer(NamedTuple):
    """The velocity of a tick and how it came about."""

    velocity: Array  # (m,)
    pace: float  # p
    share: float  # a
    missed: float  # r, to be remembered
    gave_way: tuple[tuple[str, float], ...]  # rows and tool speed that were relaxed, by how much
    guarded: float  # the share of the way from least squares to x_h that the guard leaves


class Problem(NamedTuple):
    """Minimise 1/2 y'H y - (f + p e)'y."""

    H: Array
    K: Array  # what p is decided by
    f: Array
    e: Array
    guarded: float = 1.0  # as in Answer


class Room(NamedTuple):
    """lower <= C y <= upper, the joints' box first, and |P y + start| <= speed."""

    C: Array
    lower: Array
    upper: Array
    P: Array | None = None
    start: Array | None = None
    speed: float = inf

    def on(self, origin: Array, basis: Array) -> Room:
        """The same for y = origin + basis z."""
        value = self.C.dot(origin)
        room = Room(self.C.dot(basis), self.lower - value, self.upper - value)
        if self.P is None or self.start is None:
            return room
        P = self.P.dot(basis)  # without directions that leave the point at rest, but for rounding
        P = P * (np.linalg.norm(P, axis=0) > ROUNDING * np.linalg.norm(self.P) * np.linalg.norm(basis, axis=0))
        return room._replace(P=P, start=self.start + self.P.dot(origin), speed=self.speed)

    def last_inside(self, start: Array, y: Array) -> Array:
        """The last point inside, but for rounding, on the way from one inside to y."""
        way, value, share = y - start, self.C.dot(y), 1.0
        over = np.maximum(value - self.upper, self.lower - value)
        over = over - ROUNDING * np.linalg.norm(self.C, axis=1) * np.linalg.norm(y)
        for i in np.flatnonzero(over > 0.0):
            share = min(share, 1.0 - float(over[i] / abs(self.C[i].dot(way))))
        most = self.speed * (1.0 + np.sqrt(ROUNDING))
        if self.P is not None and np.linalg.norm(self.P.dot(y)) > most:
            a, b = self.P.dot(start), self.P.dot(way)
            left = max(0.0, most**2 - float(a.dot(a)))
            share = min(share, float((np.sqrt(a.dot(b) ** 2 + b.dot(b) * left) - a.dot(b)) / b.dot(b)))
        return start + max(share, 0.0) * way if share < 1.0 else y

    def with_row(self, lower: float, upper: float) -> Room:
        """With bounds on the last of the variables."""
        last = np.eye(1, self.C.shape[1], self.C.shape[1] - 1)
        low, high = np.append(self.lower, lower), np.append(self.upper, upper)
        return self._replace(C=np.vstack((self.C, last)), lower=low, upper=high)


def velocity(tick: Tick, backend: Backend | None = None) -> Answer:
    """The joint velocity of a tick. SolverFailure: none is found; NoPseudoinverse: the form has none, nor a damping."""
    solver = Daqp() if backend is None else backend
    T = np.eye(tick.J.shape[1]) if tick.metric is None else np.linalg.inv(np.linalg.cholesky(tick.metric)).T  # x = T y
    room, position, gave_way = rooms(tick, T, solver)
    origin, basis, share, inside = demanded(tick, T, room, solver)
    problem = objective(tick, T, share)
    y, pace = paced(problem, origin, basis, room, position, tick, T, solver)
    A, x = tick.root.dot(tick.J), T.dot(y if inside is None else room.last_inside(inside, y))
    left = A.dot(x) - tick.root.dot(tick.ahead + pace * tick.error)
    U, sigma, _ = np.linalg.svd(A, full_matrices=False)
    left = U[:, sigma > ROUNDING * sigma[0]].T.dot(left)
    return Answer(x, pace, share, float(np.linalg.norm(left)), gave_way, problem.guarded)


def prioritised(levels: Sequence[Tick], backend: Backend | None = None) -> Answer:
    """The answer of the first of several levels, with the velocity of all: none disturbs what those above achieve."""
    first = answer = velocity(levels[0], backend)
    rows = [] if levels[0].exact is None else [levels[0].exact[0]]
    for above, tick in pairwise(levels):
        E = np.vstack(rows := [*rows, above.J])
        kept, a = (E, E.dot(answer.velocity), np.zeros(len(E))), first.share
        answer = velocity(replace(tick, ahead=a * tick.ahead, error=a * tick.error, exact=kept), backend)
    return first._replace(velocity=answer.velocity)


def rooms(tick: Tick, T: Array, solver: Backend) -> tuple[Room, Room, tuple[tuple[str, float], ...]]:
    """All limits, and those of positions alone, on y; what contradicts the box is relaxed by the least."""
    m, position = len(T), Room(T, tick.position_lower, tick.position_upper)
    if tick.rows is None:
        return Room(T, tick.lower, tick.upper), position, ()
    C, lower, upper, names, P, speed = tick.rows
    k, gave_way = len(C), []
    if k:  # slack t of the rows, in units of their lengths: least |t|, then least |y|
        lengths = np.linalg.norm(C.dot(T), axis=1) + TINY
        stacked = np.block([[T, np.zeros((m, k))], [C.dot(T) / lengths[:, None], np.eye(k)]])
        low, high = np.append(tick.lower, lower / lengths), np.append(tick.upper, upper / lengths)
        H = np.diag(np.append(np.full(m, ROUNDING), np.ones(k)))
        t = lengths * minimise(H, np.zeros(m + k), Room(stacked, low, high), solver)[m:]
        margin = np.sqrt(ROUNDING) * (np.minimum(np.abs(lower), np.abs(upper)) + lengths)
        t = t * (1.0 + np.sqrt(ROUNDING))
        lower, upper = lower - np.maximum(t, 0.0), upper - np.minimum(t, 0.0)
        gave_way = [(names[i] if names else f"row {i}", float(abs(t[i]))) for i in np.flatnonzero(np.abs(t) > margin)]
    room = Room(np.vstack((T, C.dot(T))), np.append(tick.lower, lower), np.append(tick.upper, upper))
    if P is not None:
        P = P.dot(T)
        slowest = minimise(P.T.dot(P) + ROUNDING * np.vdot(P, P) * np.eye(m), np.zeros(m), room, solver)
        least = float(np.linalg.norm(P.dot(slowest)))
        if least > speed:
            gave_way.append(("the tool's speed", least - speed))
            speed = least * (1.0 + np.sqrt(ROUNDING))
        room = room._replace(P=P, start=np.zeros(3), speed=speed)
    return room, position, tuple(gave_way)


def demanded(tick: Tick, T: Array, room: Room, solver: Backend) -> tuple[Array, Array, float, Array | None]:
    """The velocities that meet the exact rows, y = origin + basis z, their share a, and one inside."""
    if tick.exact is None or not len(tick.exact[0]):
        return np.zeros(len(T)), np.eye(len(T)), 1.0, None
    E, demand = np.asarray(tick.exact[0]), np.asarray(tick.exact[1]) + np.asarray(tick.exact[2])
    U, sigma, Vt = np.linalg.svd(E.dot(T))
    m, k = len(T), int(np.count_nonzero(sigma > ROUNDING * sigma[0]))
    k = max(k, min(tick.exact_rank, len(sigma)))  # a direction next to lost: a leaves next to nothing of it
    within, basis = Vt[:k].T, Vt[k:].T
    full = (within / np.maximum(sigma[:k], ROUNDING * sigma[0])).dot(U[:, :k].T.dot(demand))
    size = max(float(np.linalg.norm(full)), np.sqrt(ROUNDING))
    b, A = float(np.linalg.norm(tick.root.dot(tick.ahead + tick.error))), tick.root.dot(tick.J)
    mu = KAPPA * tick.held * float(np.linalg.norm(A)) * tick.missed / (b + TINY)
    slow = mu * float(full.dot(full)) / (float(np.linalg.norm(demand)) + TINY)
    n, left = m - k, room.on(np.zeros(m), np.column_stack((basis, full))).with_row(0.0, 1.0)
    H = np.diag(np.append(np.full(n, ROUNDING / size**2 + mu / (b + TINY)), 1.0 + slow))
    whole = k >= min(m, 6)  # no part of the tool's motion is left free
    lost = WORTH if whole and bends_away(tick, T.dot(full)) else 0.0  # of a = 1 / (1 + slow)
    try:
        z = minimise(H, max(0.0, 1.0 - lost * (1.0 + slow)) / (1.0 - lost) * np.eye(n + 1)[n], left, solver)
    except SolverFailure:  # no share of the rows is inside the limits: as near as these allow
        K = np.column_stack((within.T, -within.T.dot(full)))
        H = K.T.dot(K) + ROUNDING * np.diag(np.append(np.ones(m), size**2))
        wide = room.on(np.zeros(m), np.eye(m, m + 1)).with_row(0.0, 1.0)
        found = minimise(H, ROUNDING * size**2 * np.eye(m + 1)[m], wide, solver)  # the largest share of several
        nearest, a = within.dot(within.T.dot(found[:m])), min(max(float(found[m]), 0.0), 1.0)
        return nearest, basis, a, found[:m]
    a, inside = float(z[n]), basis.dot(z[:n]) + z[n] * full
    a = 1.0 if a > 1.0 - 10.0 * ROUNDING else max(a, 0.0) * (1.0 - ROUNDING)
    return a * full, basis, a, inside


def bends_away(tick: Tick, x: Array) -> bool:
    """Whether joints that go on at x move the tool ever less along the exact demand, as those of a stretching arm do.

    The twist of a chain changes by the sum over j < i of x_j x_i [J_j, J_i].
    """
    if tick.exact is None or tick.parts is None or tick.before is None or len(tick.J) != 6:
        return False
    columns = tick.J * x
    before = np.cumsum(columns, axis=1) - columns
    turn, move, omega, v = before[:3].T, before[3:].T, columns[:3].T, columns[3:].T
    change = np.hstack((np.cross(turn, omega), np.cross(turn, v) + np.cross(move, omega))).sum(axis=0)
    return float((np.asarray(tick.exact[1]) + np.asarray(tick.exact[2])).dot(tick.parts.dot(change))) < 0.0


def objective(tick: Tick, T: Array, share: float) -> Problem:
    """F_p on y, for a twist at a share of its speed."""
    J, m = tick.J.dot(T), len(T)
    A = tick.root.dot(J)
    size = float(np.vdot(A, A)) or 1.0
    _, few, Vt = np.linalg.svd(A)
    sigma = np.append(few, np.zeros(m))[:m]
    P = Vt.T.dot(np.clip(2.0 - 2.0 * sigma / (ROUNDING * max(float(sigma[0]), TINY)), 0.0, 1.0)[:, None] * Vt)
    G, toward, guarded = of_form(tick, J, A)
    toward = toward - P.dot(toward)
    unit = size / max(float(np.trace(G)), TINY)  # a form has another unit than A'A
    mu, nu, w, c = 0.0 if tick.form else tick.damping**2, 0.0, NULL * size, np.asarray(np.zeros(m))
    if tick.before is not None:
        mu, nu = KAPPA * tick.held * np.sqrt(size) * tick.missed, NU * size
        c = np.asarray(nu * np.linalg.solve(T, tick.before))
    H = unit * G + (mu + nu) * np.eye(m) + w * P
    f, e = c + unit * share * toward.dot(tick.ahead), unit * share * toward.dot(tick.error)
    if tick.posture is not None:
        pull, follow = np.linalg.solve(T, tick.posture), 1.0
        if tick.fastest is not None and tick.posture.any():
            free = np.linalg.solve(H, np.column_stack((f, e)))
            task = np.abs(T.dot(free[:, 0] + worth(tick, A, free[:, 1]) * free[:, 1]) / tick.fastest).max()
            most = np.abs(tick.posture / tick.fastest).max()
            follow = min(1.0, float(task / most)) ** 2
        f = f + share * follow * w * P.dot(pull)
    return Problem(0.5 * (H + H.T), unit * G + (mu + w) * np.eye(m), f, e, guarded)


def worth(tick: Tick, A: Array, d: Array) -> float:
    """The share of d that is gone: a loop does not go a way that does less than WORTH of what the error asks for."""
    e = tick.root.dot(tick.error)
    if tick.before is None or not e.any():
        return 1.0
    return max(0.0, 1.0 - WORTH * float(e.dot(e)) / max(float(e.dot(A.dot(d))), TINY))


def of_form(tick: Tick, J: Array, A: Array) -> tuple[Array, Array, float]:
    """G (m, m), G x_h of a unit twist (m, 6 n), or A'A and A'R; and the share that the guard leaves of a form."""
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
    else:  # a definite form of the user's own
        X = system.pseudoinverse(metric=tick.form.matrix(np.eye(6)))
    if tick.guard is None:
        return G, G.dot(X), 1.0
    least, s = np.linalg.pinv(A, rcond=ROUNDING).dot(tick.root), tick.ahead + tick.error
    beside, most = (float(np.linalg.norm(A.dot(x))) for x in (X.dot(s) - least.dot(s), least.dot(s)))
    kept = min(1.0, float(np.sqrt(1.0 - tick.guard)) * most / max(beside, TINY))
    return G, G.dot(least + kept * (X - least)), kept


def paced(
    of: Problem, origin: Array, basis: Array, room: Room, position: Room, tick: Tick, T: Array, solver: Backend
) -> tuple[Array, float]:
    """y and p: the last lines of the law, for y = origin + basis z."""
    n = basis.shape[1]
    H, K = (basis.T.dot(matrix).dot(basis) for matrix in (of.H, of.K))
    f, e, left = basis.T.dot(of.f - of.H.dot(origin)), basis.T.dot(of.e), position.on(origin, basis)
    y_0, y_1 = (origin + basis.dot(minimise(H, right, left, solver)) for right in (f, f + e))
    d = worth(tick, tick.root.dot(tick.J).dot(T), y_1 - y_0) * (y_1 - y_0)
    length, size = (float(np.sqrt(max(0.0, y.dot(of.K).dot(y)))) for y in (d, y_1))
    if length <= ROUNDING * size:
        return y_0 + basis.dot(minimise(H, np.zeros(n), room.on(y_0, basis), solver)), 1.0
    most = float(np.linalg.norm(tick.root.dot(tick.ahead)))  # in u = basis'(x - y(p)) and p length
    left = room.on(y_0, np.column_stack((basis, d / length))).with_row(0.0, length)
    wide = np.block([[K, np.zeros((n, 1))], [np.zeros((1, n)), EPSILON]])
    u = minimise(wide, np.append(np.zeros(n), most + EPSILON * length), left, solver)
    p = float(np.clip(u[n] / length, 0.0, 1.0))
    try:
        z = minimise(H, np.zeros(n), room.on(y_0 + p * d, basis), solver)
    except SolverFailure:  # next to no room: rounding of p
        z = u[:n]
    return np.asarray(y_0 + p * d + basis.dot(z)), p


def minimise(H: Array, c: Array, room: Room, solver: Backend) -> Array:
    """argmin 1/2 y'Hy - c'y inside a room.

    A speed is kept by its multiplier: 1/2 k |start + P y|^2 is added, with the k at which the speed is the limit.
    """
    y = polytope_optimum(H, c, room, solver)
    P, start = room.P, room.start
    over = 0.0 if P is None or start is None else float(np.linalg.norm(start + P.dot(y))) - room.speed
    if P is None or start is None or over <= (0.0 if P.any() else np.sqrt(ROUNDING) * (2.0 * room.speed + over)):
        return y

    def at(power: float) -> Array:
        k = 10.0**power * float(np.trace(H)) / (float(np.vdot(P, P)) + TINY)
        return polytope_optimum(H + k * P.T.dot(P), c - k * P.T.dot(start), room, solver)

    def excess(power: float) -> float:
        return float(np.linalg.norm(start + P.dot(at(power)))) - room.speed

    if excess(MOST_POWER) > np.sqrt(ROUNDING) * (room.speed + np.linalg.norm(start + P.dot(y))):
        raise SolverFailure("definition", "no answer at the tool's speed limit", infeasible=True)
    if excess(MOST_POWER) > 0.0 or excess(LEAST_POWER) <= 0.0:
        return at(MOST_POWER if excess(LEAST_POWER) > 0.0 else LEAST_POWER)
    return at(float(brentq(excess, LEAST_POWER, MOST_POWER, xtol=1e-12)))


def polytope_optimum(H: Array, c: Array, room: Room, solver: Backend) -> Array:
    """argmin 1/2 y'Hy - c'y over lower <= C y <= upper, by a QP solver in units in which H is the identity.

    Solvers stop at tolerances of their own; what they find at a limit is solved once more, for the digits.
    """
    inverse = np.linalg.inv(np.linalg.cholesky(H)).T  # y = inverse (e + free)
    free, N = inverse.T.dot(c), room.C.dot(inverse)
    size = np.linalg.norm(N, axis=1)
    some = size > 1e-12 * np.linalg.norm(inverse)
    if np.maximum(room.lower[~some], -room.upper[~some]).max(initial=0.0) > np.sqrt(ROUNDING):
        raise SolverFailure("definition", "no solution found", infeasible=True)
    N = N[some] / size[some, None]
    low, high = room.lower[some] / size[some] - N.dot(free), room.upper[some] / size[some] - N.dot(free)
    scale = float(np.maximum(low, -high).max(initial=0.0))
    if scale == 0.0:
        return np.asarray(inverse.dot(free))
    qp = BoxQP.of(np.eye(len(c)), np.zeros(len(c)), low / scale, high / scale, N)
    e = scale * answered(solver, qp)
    at_high, at_low = (np.abs(N.dot(e) - side) < np.sqrt(ROUNDING) * 1e-2 * scale for side in (high, low))
    active = at_high | at_low
    exact = np.linalg.lstsq(N[active], np.where(at_high, high, low)[active], rcond=1e-12)[0]
    push = np.linalg.lstsq(N[active].T, exact, rcond=1e-12)[0] * np.where(at_high, -1.0, 1.0)[active]
    value, margin = N.dot(exact), ROUNDING * scale
    inside = bool(((value <= high + margin) & (value >= low - margin)).all()) and push.min(initial=0.0) >= -margin
    return np.asarray(inverse.dot(free + (exact if inside else e)))
