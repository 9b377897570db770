"""Random ticks of the velocity law, for differential tests without an end; every number comes from one generator.

How often each occurs in `random_tick`:

    joints          1 to 12; 13 to 64 in 3 %; the arm's own number where the Jacobian is a real arm's
    bodies          1 in 90 %, 2 or 3 else
    Jacobian        random 35 %, of a real arm 25 %, of a geometric kind (planar, SCARA, concurrent, ...) 15 %, singular
                    values scaled by 10^-k with k up to 12 15 %, dependent, repeated or zero columns 10 %
    units           joint twists and velocities scaled by 1e-3 or 1e3 each in 20 %
    twist           random 60 %, one that joints can do 25 %, zero 5 %, all of it error 30 %, all of it feedforward 30 %
    limits          none 15 %, wide 30 %, tight 35 %, mixed 20 %: each joint then free, free on one side, without
                    width, away from zero, or tight; position limits coincide with them in 30 % of these
    rows            40 %: 1 to 8, 9 to 256 in 3 % of these; the first two exclude each other in a quarter, the last is
                    a joint's, often beyond its limit, in a quarter
    tool speed      20 %, a third of these very slow
    exact rows      30 %: 1 to 5 parts of the twist, joints, or both; dependent in a fifth
    metric          20 %; posture 50 %, with full speeds in 60 % of these
    memory          65 %: velocity and residual of the tick before; the rest are single calls, damped in half
    forms           25 % of the ticks with one body: pitch 60 %; complement 25 %, where joints leave something out, most
                    often of the right dimension; else definite; damped and guarded in half each

The definition answers 96 %; in 1 % a form has no pseudoinverse.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

import invariantqp as iq
from invariantqp.geometry.arrays import Array
from invariantqp.robots import Chain
from invariantqp.velocity.definition import Rows, Tick
from invariantqp.velocity.forms import Form
from invariantqp.velocity.measure import root_at
from support import arms
from support.recorded_ticks import UserForm

ARMS = ("panda", "ur5e", "ur5", "xarm7", "iiwa14", "so101", "lite6", "gen3")
JACOBIANS = ("random", "arm", "geometric", "near singular", "dependent")
LIMITS = ("none", "wide", "tight", "mixed")
SIDES = ("free", "below", "above", "no width", "away from zero", "tight")
SCALES = (1e-3, 1e3)


@cache
def robot(name: str) -> Chain:
    """The robot of this name."""
    return iq.load_robot(name)


def random_tick(rng: np.random.Generator) -> Tick:
    """A tick of any kind."""
    bodies = 1 if rng.random() < 0.9 else int(rng.integers(2, 4))
    m = int(rng.integers(1, 13)) if rng.random() < 0.97 else int(rng.integers(13, 65))
    J = random_jacobian(rng, m, bodies, rng.choice(JACOBIANS, p=(0.35, 0.25, 0.15, 0.15, 0.1)))
    if rng.random() < 0.2:
        J = J * rng.choice(SCALES)
    speed = 10.0 ** rng.uniform(-1.0, 0.5) * (rng.choice(SCALES) if rng.random() < 0.2 else 1.0)
    tick = unlimited(rng, J, random_twist(rng, J, speed))
    tick = with_limits(rng, tick, speed, rng.choice(LIMITS, p=(0.15, 0.3, 0.35, 0.2)))
    if rng.random() < 0.4:
        tick = with_rows(rng, tick, int(rng.integers(1, 9)) if rng.random() < 0.97 else int(rng.integers(9, 257)))
    if rng.random() < 0.2:
        tick = with_tool_speed(rng, tick)
    if rng.random() < 0.3:
        tick = with_exact_rows(rng, tick)
    if rng.random() < 0.65:
        tick = with_memory(rng, tick)
    elif rng.random() < 0.5:
        tick = replace(tick, damping=float(np.linalg.norm(J) * 10.0 ** rng.uniform(-4.0, 0.0)))
    if rng.random() < 0.5:
        tick = with_posture(rng, tick, velocity_limit=rng.random() < 0.6)
    if rng.random() < 0.2:
        tick = replace(tick, metric=random_metric(rng, J.shape[1]))
    return with_form(rng, tick) if bodies == 1 and rng.random() < 0.25 else tick


def random_jacobian(rng: np.random.Generator, m: int, bodies: int, kind: str) -> Array:
    """(6 n, m) joint twists; of a real arm m is its own number of joints."""
    if kind == "arm":
        return arm_jacobian(rng, bodies)
    if kind == "geometric":
        return np.vstack([arms.arm(rng, rng.choice(arms.KINDS), m).J for _ in range(bodies)])
    J = rng.normal(size=(6 * bodies, m))
    if kind == "near singular":
        U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
        some = rng.random(len(sigma)) < rng.choice((0.2, 0.6))
        return (U * sigma * np.where(some, 10.0 ** -rng.uniform(0.0, 12.0, len(sigma)), 1.0)) @ Vt
    for _ in range(int(rng.integers(1, 3)) if kind == "dependent" else 0):
        i, j = rng.integers(m, size=2)
        J[:, i] = (0.0 * J[:, i], J[:, j], -2.0 * J[:, j], J[:, j] + J[:, (j + 1) % m])[rng.integers(4)]
    return J


def arm_jacobian(rng: np.random.Generator, bodies: int) -> Array:
    """Joint twists of a real arm at random joint positions, often at zero; more bodies are links before its tool."""
    chain = robot(str(rng.choice(ARMS)))
    low, high = np.maximum(chain.position_lower, -np.pi), np.minimum(chain.position_upper, np.pi)
    q = rng.uniform(low, high)
    q = np.where(rng.random(len(q)) < rng.choice((0.0, 0.3)), np.clip(0.0, low, high), q)
    J = chain.jacobian(q)
    moved = [np.arange(len(q)) < rng.integers(1, len(q) + 1) for _ in range(bodies - 1)]
    return np.vstack([J, *(J * some for some in moved)])


def random_twist(rng: np.random.Generator, J: Array, speed: float) -> Array:
    """(6 n,) a twist for which joints are about this fast."""
    n, m = J.shape
    kind = rng.random()
    if kind < 0.05:
        return np.zeros(n)
    if kind < 0.3:
        return speed * J.dot(rng.normal(size=m))
    return speed * float(np.linalg.norm(J)) / np.sqrt(n) * rng.normal(size=n)


def unlimited(rng: np.random.Generator, J: Array, s: Array) -> Tick:
    """A single call without limits, measured at a random point."""
    m, bodies = J.shape[1], len(J) // 6
    root = np.zeros((6 * bodies, 6 * bodies))
    for i in range(bodies):
        at = slice(6 * i, 6 * i + 6)
        weight = 1.0 if bodies == 1 else float(rng.uniform(0.3, 2.0))
        root[at, at] = weight * root_at(0.5 * rng.normal(size=3), float(rng.uniform(0.3, 1.2)))
    part = float(rng.choice((0.0, 1.0, rng.random()), p=(0.3, 0.3, 0.4)))
    free = np.full(m, np.inf)
    return Tick(J, root, part * s, (1.0 - part) * s, -free, free, -free, free)


def with_limits(rng: np.random.Generator, tick: Tick, speed: float, kind: str) -> Tick:
    """With velocity and position limits."""
    m = tick.J.shape[1]
    if kind == "none":
        return tick
    wide = speed * 10.0 ** (rng.uniform(0.0, 1.5, (2, m)) if kind == "wide" else rng.uniform(-2.0, 0.2, (2, m)))
    lower, upper = -wide[0], wide[1]
    for i in range(m) if kind == "mixed" else ():
        side = rng.choice(SIDES)
        if side in {"free", "below"}:
            upper[i] = np.inf
        if side in {"free", "above"}:
            lower[i] = -np.inf
        if side == "no width":
            lower[i] = upper[i] = rng.choice((0.0, 0.3)) * upper[i]
        if side == "away from zero":
            lower[i], upper[i] = (0.3 * upper[i], upper[i]) if rng.random() < 0.5 else (lower[i], 0.3 * lower[i])
    away = np.where(rng.random((2, m)) < 0.3, np.inf, rng.uniform(0.0, 2.0, (2, m)) * speed)
    away = np.zeros((2, m)) if rng.random() < 0.3 else away
    return replace(tick, lower=lower, upper=upper, position_lower=lower - away[0], position_upper=upper + away[1])


def with_rows(rng: np.random.Generator, tick: Tick, k: int) -> Tick:
    """With k rows; some cross each other, or contradict the limits."""
    m = tick.J.shape[1]
    C = rng.normal(size=(k, m)) * 10.0 ** rng.uniform(-1.0, 1.0)
    size = np.linalg.norm(C, axis=1) * typical(tick)
    lower, upper = -size * 10.0 ** rng.uniform(-2.0, 0.5, k), size * 10.0 ** rng.uniform(-2.0, 0.5, k)
    side = rng.integers(6, size=k)
    lower, upper = np.where(side == 0, -np.inf, lower), np.where(side == 1, np.inf, upper)
    lower = np.where((side == 2) & (rng.random() < 0.5), 0.5 * np.minimum(upper, size), lower)
    if k > 1 and rng.random() < 0.25:  # two parallel rows, the second beyond the first
        C[1], upper[0] = C[0], min(upper[0], size[0])
        lower[1], upper[1] = upper[0] + size[0] * rng.choice((0.0, 1e-3, 0.3)), np.inf
        lower[0] = -np.inf
    if rng.random() < 0.25:
        C[-1] = np.eye(m)[rng.integers(m)]
        lower[-1], upper[-1] = typical(tick) * 10.0 ** rng.uniform(-1.0, 1.0), np.inf
    return replace(
        tick, rows=Rows(C, lower, upper, tuple(f"limit {i}" for i in range(k)) if rng.random() < 0.3 else ())
    )


def with_tool_speed(rng: np.random.Generator, tick: Tick) -> Tick:
    """With a speed limit of a point of the tool."""
    m = tick.J.shape[1]
    point = 0.5 * rng.normal(size=3)
    P = tick.J[3:6] + np.cross(tick.J[:3].T, point).T
    speed = float(np.linalg.norm(P)) * typical(tick) * 10.0 ** (rng.uniform(-2.0, 0.5) - 2.0 * (rng.random() < 0.33))
    rows = Rows(np.zeros((0, m)), np.zeros(0), np.zeros(0)) if tick.rows is None else tick.rows
    return replace(tick, rows=rows._replace(P=P, speed=speed))


def with_exact_rows(rng: np.random.Generator, tick: Tick) -> Tick:
    """With exact rows: parts of the twist, joints, or both."""
    n, m = tick.J.shape
    k = int(rng.integers(1, min(m, 5) + 1))
    D = (rng.normal(size=(k, n)), np.eye(n)[rng.permutation(n)[:k]], np.eye(n)[3 : 3 + k])[rng.integers(3)]
    E, ahead, error = D @ tick.J, D @ tick.feedforward, D @ tick.error
    if rng.random() < 0.3:
        E = np.eye(m)[rng.permutation(m)[:k]] if rng.random() < 0.5 else rng.normal(size=(k, m))
        ahead = rng.choice((0.0, 1.0)) * typical(tick) * rng.normal(size=k)
        error = rng.choice((0.0, 1.0)) * typical(tick) * rng.normal(size=k)
    if k > 1 and rng.random() < 0.2:
        E[-1], ahead[-1], error[-1] = E[0], ahead[0], error[0]
    return replace(tick, exact=(E, ahead, error))


def with_memory(rng: np.random.Generator, tick: Tick) -> Tick:
    """With what a loop remembers of the tick before."""
    wanted = float(np.linalg.norm(tick.root.dot(tick.feedforward + tick.error)))
    before = typical(tick) * rng.normal(size=tick.J.shape[1]) * rng.choice((0.0, 0.3))
    missed = wanted * rng.choice((0.0, rng.random(), rng.random() ** 8))
    return replace(
        tick, last_velocity=before, last_residual=float(missed), hold_time=float(rng.choice((1e-3, 0.002, 0.01, 0.05)))
    )


def with_posture(rng: np.random.Generator, tick: Tick, *, velocity_limit: bool) -> Tick:
    """With a posture, which rests with the task if full speeds are given."""
    m = tick.J.shape[1]
    speeds = 10.0 ** rng.uniform(-1.0, 1.0, m) if velocity_limit else None
    return replace(
        tick, posture=typical(tick) * rng.normal(size=m) * 10.0 ** rng.uniform(-1.0, 1.0), velocity_limit=speeds
    )


def with_form(rng: np.random.Generator, tick: Tick) -> Tick:
    """With a form, and perhaps a damping and a guard."""
    length = float(np.linalg.norm(tick.J[3:]) / max(np.linalg.norm(tick.J[:3]), 1e-9))
    size = float(np.linalg.norm(tick.J[:3]) * np.linalg.norm(tick.J[3:]))
    damping = size * 10.0 ** rng.uniform(-4.0, 0.0) if rng.random() < 0.5 else 0.0
    guard = float(rng.choice((0.0, 0.5, 0.9))) if rng.random() < 0.5 else None
    return replace(tick, form=random_form(rng, tick.J, min(length, 1e3)), damping=damping, guard=guard)


def random_form(rng: np.random.Generator, J: Array, length: float) -> Form:
    """A pitch of about this length, a complement, most often of the right dimension, or a definite form."""
    kind = rng.random()
    if kind < 0.6:
        return iq.PitchForm(float(length * rng.normal() * 10.0 ** rng.uniform(-1.0, 1.0)))
    missing = 6 - int(np.linalg.matrix_rank(J))
    if kind < 0.85 and (missing > 0 or rng.random() < 0.1):
        return iq.Complement(rng.normal(size=(6, max(1, missing) if rng.random() < 0.9 else int(rng.integers(1, 6)))))
    M = rng.normal(size=(6, 6))
    return UserForm(M @ M.T + 0.1 * np.eye(6))


def random_metric(rng: np.random.Generator, m: int) -> Array:
    """(m, m) definite, diagonal or not."""
    sizes = 10.0 ** rng.uniform(-1.0, 1.0, m)
    Q = np.linalg.qr(rng.normal(size=(m, m)))[0] if rng.random() < 0.5 else np.eye(m)
    return np.asarray((Q * sizes) @ Q.T)


def typical(tick: Tick) -> float:
    """A joint speed that the twist asks for."""
    wanted = float(np.linalg.norm(tick.feedforward + tick.error))
    return wanted / max(float(np.linalg.norm(tick.J)), 1e-9) if wanted > 0.0 else 0.1
