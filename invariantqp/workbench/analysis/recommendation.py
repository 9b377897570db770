"""The pitch that splits an arm's twists and wrenches best over its joint range.

A controller needs no pitch: without a form it misses by least squares what the arm cannot do. A pitch is for [DS]'s
reciprocal splitting: dual projectors, hybrid and shared control. With |h| far below L, the arm's reach to the tool,
projectors are oblique and large; with |h| far above L orientation comes first. Recommended is the smallest |h| of the
candidates +-(1, 1.5, 2, 3, 4) L whose projector P_h has a small norm:

    A = root J,  U an orthonormal basis of its range,  M the form on measured twists
    P_h = U (U'MU)^-1 U'M,    |s - P_h s| <= |P_h| |s - U U's|,    |P_h| = 1 / sin(angle between U and P_h's kernel)

Proof: (I - P_h) U = 0, so (I - P_h) s = (I - P_h)(s - U U's), and |I - P_h| = |P_h| for every projector but 0 and I.
|P_h| is infinite at a principal pitch and along a blind direction, and large near both. So no tolerance on the type of
a screw system is needed, and rounding in a URDF does not change the recommendation.

|P_h| is evaluated in states spread over the joint range and in states with the tool straight up or down, in which most
work is done. A random state is never such a state, and an SO-101, among others, has no pitch there at all.

Reference: [DS] Sect. 3, 5, and 6.1 for P_h; Szyld 2006 for |I - P| = |P|.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, inf, log10
from typing import Literal, NamedTuple

import numpy as np

from invariantqp import se3
from invariantqp.control.measure import tool_metric
from invariantqp.errors import listed, written
from invariantqp.geometry.arrays import ROUNDING, Array
from invariantqp.geometry.screws import angular_speeds
from invariantqp.robots.kinematics import Robot
from invariantqp.systems.report import along_axes
from invariantqp.velocity.forms import PitchForm

# The largest |P_h| of a useful pitch. Measured on SO-101, SO-100 and a three-joint arm with random twists: where |P_h|
# is between 3 and 4, P_h s is farther from s than standing still is in half of the cases, between 1.5 and 2 in a fifth.
MAX_NORM = 4.0
# The share of states in which |P_h| must stay below that: every arm has some near a singularity in which it does not.
MIN_SHARE = 0.9
# Candidate pitches over the reach.
MULTIPLES = (1.0, 1.5, 2.0, 3.0, 4.0)
# Starts of the search for upright states: 500 starts recommend the same for each of 20 arms.
UPRIGHT_STARTS = 32
# Tolerance of the rank: directions that need 500 times the joint speed of the strongest one are not counted.
RANK_TOLERANCE = 2e-3
# Tolerance of parallel axes, and of rotations in a translation.
PARALLEL_TOLERANCE = 1e-3
# Newton steps of that search, four to eight where the wrist can turn that far, and the longest in one joint [rad].
MAX_STEPS, MAX_STEP = 20, 0.5


@dataclass(frozen=True, eq=False)
class Recommendation:
    """Which pitch an arm's twists can be split by, if any.

    Attributes:
        form: "pitch" (`PitchForm(h)`) or "tool" (no form: least squares at the tool).
        h: pitch [length/rad]; None if no candidate serves.
        length: L, the arm's reach to the tool [length/rad].
        reason: why, in words.
        q: (m,) joint positions at which no candidate serves [rad, length]; None if there are none.
        blind_twists: (6, b) twists of the arm at q, at the tool, that no candidate detects.
    """

    form: Literal["pitch", "tool"]
    h: float | None
    length: float
    reason: str
    q: Array | None
    blind_twists: Array


class _Norms(NamedTuple):
    """|P_h| of p candidate pitches in n states."""

    states: Array  # (n, m)
    norms: Array  # (n, p)
    has_full_rank: Array  # (n,) whether the tool can move in all six directions

    def shares(self) -> Array:
        """(p,) the share of the states in which each pitch serves; 1 if there are no states."""
        return np.ones(self.norms.shape[1]) if not len(self.states) else (self.norms <= MAX_NORM).mean(axis=0)


def recommend(robot: Robot, q: Array) -> Recommendation:
    """Recommend a pitch for an arm from (n, m) states of its range."""
    length = float(np.sqrt(tool_metric(robot).matrix[0, 0]))
    pitches = candidate_pitches(length)
    spread = _norms_in(robot, length, q)
    up = _norms_in(robot, length, upright_states(robot, q[: min(UPRIGHT_STARTS, len(q) // 2 + 1)]))
    shares = np.minimum(spread.shares(), up.shares())
    serving = np.flatnonzero(shares >= MIN_SHARE)
    best = int(serving[0] if len(serving) else shares.argmax())
    states, least = np.vstack((spread.states, up.states)), np.vstack((spread.norms, up.norms)).min(axis=1)
    worst, blind, notes = None, np.empty((6, 0)), []
    if least.max() > MAX_NORM:
        worst = states[least.argmax()]
        U, inverse_root = achievable_at(robot, worst, length)
        blind = _blind_twists(U, inverse_root, pitches)
        notes = [_blind_note(worst, blind, measure_root(robot.pose(worst), length))]
    h = pitches[best] if len(serving) else None
    reason = _tool_reason(length, spread, up, best) if h is None else _pitch_reason(h, length, spread, up, best)
    return Recommendation("tool" if h is None else "pitch", h, length, " ".join([reason, *notes]), worst, blind)


def candidate_pitches(length: float) -> tuple[float, ...]:
    """The candidates for an arm with this reach [length/rad], smallest first."""
    return tuple(sign * _two_digits(multiple * length) for multiple in MULTIPLES for sign in (1.0, -1.0))


def smallest_norm(robot: Robot, q: Array, length: float) -> float:
    """The smallest |P_h| of the candidates in one state."""
    return float(projector_norms(*achievable_at(robot, q, length), candidate_pitches(length)).min())


def measure_root(pose: Array, length: float) -> Array:
    """(6, 6) root of the measure at the tool: |root s|^2 = L^2 |omega|^2 + |v + omega x p|^2."""
    return np.repeat((length, 1.0), 3)[:, None] * se3.adjoint(se3.transform(translation=-pose[:3, 3]))


def achievable_at(robot: Robot, q: Array, length: float) -> tuple[Array, Array]:
    """`achievable` twists at q (6, k), measured at the tool, and the inverse of the measure's root (6, 6)."""
    root = measure_root(robot.pose(q), length)
    return achievable(root.dot(robot.jacobian(q))), np.asarray(np.linalg.inv(root), dtype=np.float64)


def achievable(A: Array) -> Array:
    """(6, k) orthonormal basis of the twists that the measured joints A (6, m) achieve at attainable joint speeds."""
    U, sigma, _ = np.linalg.svd(A, full_matrices=False)
    return np.asarray(U[:, sigma >= max(RANK_TOLERANCE * sigma[0], np.finfo(float).tiny)])


def projector_norms(U: Array, inverse_root: Array, pitches: Sequence[float]) -> Array:
    """(p,) |P_h| in the measure: 1 if the joints achieve every twist, inf if h [length/rad] has no projector.

    U (6, k) is the basis of `achievable`, (6, 6) the inverse of the measure's root.
    """
    norms = np.ones(len(pitches))
    if U.shape[1] not in (0, 6):
        forms = _forms_on(U, inverse_root, pitches)
        G = forms @ U
        regular = np.linalg.norm(G, -2, axis=(1, 2)) >= ROUNDING
        norms[regular] = np.linalg.norm(np.linalg.solve(G[regular], forms[regular]), 2, axis=(1, 2))
        norms[~regular] = inf
    return norms


def upright_states(robot: Robot, q: Array) -> Array:
    """(k, m) states near the (n, m) given ones, inside the joint limits, with the last axis parallel to the first.

    Empty if fewer than two joints turn, if joint limits forbid them, and if the two axes are parallel in every state
    (a SCARA), where they would repeat the given states.
    """
    states = [state for start in q if (state := _turned_upright(robot, start)) is not None]
    return np.array(states).reshape(-1, q.shape[1])


def _turned_upright(robot: Robot, start: Array) -> Array | None:
    """The upright state nearest `start`, by Newton's method; None if there is none, or if it is `start`."""
    q = start
    for step in range(MAX_STEPS + 1):
        J = robot.jacobian(q)
        rates = angular_speeds(J)
        turns = rates > 0.0
        if np.count_nonzero(turns) < 2:
            return None
        axes = J[:3, turns] / rates[turns]
        first, last = axes[:, 0], axes[:, -1]
        if np.linalg.norm(np.cross(first, last)) < PARALLEL_TOLERANCE:
            return q if step else None
        gradient = np.cross(axes.T, last).T  # (3, k) of the last axis by the joints that turn
        missing = np.copysign(1.0, first.dot(last)) * first - last
        change = np.zeros(len(q))
        change[turns] = np.linalg.pinv(gradient, rcond=PARALLEL_TOLERANCE).dot(missing) / rates[turns]
        q = np.clip(q + np.clip(change, -MAX_STEP, MAX_STEP), robot.position_lower, robot.position_upper)
    return None


def _norms_in(robot: Robot, length: float, states: Array) -> _Norms:
    pitches = candidate_pitches(length)
    norms, has_full_rank = np.empty((len(states), len(pitches))), np.zeros(len(states), dtype=bool)
    for i, q in enumerate(states):
        U, inverse_root = achievable_at(robot, q, length)
        has_full_rank[i] = U.shape[1] == 6
        norms[i] = projector_norms(U, inverse_root, pitches)
    return _Norms(states, norms, has_full_rank)


def _blind_twists(U: Array, inverse_root: Array, pitches: Sequence[float]) -> Array:
    """(6, b) twists s of the arm that no pitch detects: |U'M s| is below |M| |s| / MAX_NORM for each of them."""
    _, size, directions = np.linalg.svd((_forms_on(U, inverse_root, pitches) @ U).reshape(-1, U.shape[1]))
    return np.asarray(inverse_root.dot(U).dot(directions[size < 1.0 / MAX_NORM].T))


def _forms_on(U: Array, inverse_root: Array, pitches: Sequence[float]) -> Array:
    """(p, k, 6) U'M with |M| = 1."""
    M = np.array([PitchForm(h).matrix(inverse_root) for h in pitches])
    return np.asarray(U.T @ M / np.linalg.norm(M, 2, axis=(1, 2))[:, None, None])


def _two_digits(x: float) -> float:
    """A positive number to two digits: what a person would type."""
    return round(x, 1 - floor(log10(x)))


def _pitch_reason(h: float, length: float, spread: _Norms, up: _Norms, best: int) -> str:
    times = "" if abs(h) == _two_digits(length) else f"{abs(h) / length:.2g} times "
    size = f"h = {written(h)}, {times}the arm's reach to the tool"
    if np.mean(spread.has_full_rank) >= MIN_SHARE:
        return (
            "A controller needs no form: the arm moves its tool in all six directions, so every h gives the same joint "
            f"velocities where no limit is active. To split twists and wrenches: {size}, lets rotation and "
            "translation count alike."
        )
    return (
        "A controller needs no form: without one, what the arm cannot do is missed by least squares at the tool. To "
        f"split twists and wrenches: {size}. It misses at most {MAX_NORM:g} times as much of a twist as least "
        f"squares in {_shares(spread, up, best)}. A much smaller |h| splits obliquely, a larger one puts orientation "
        "first."
    )


def _tool_reason(length: float, spread: _Norms, up: _Norms, best: int) -> str:
    serves = spread.shares()[best] or (len(up.states) and up.shares()[best])
    counts = f"in {_shares(spread, up, best)}" if serves else "nowhere"
    return (
        "Leave out the form: what the arm cannot do is then missed by least squares at the tool, |v|^2 + L^2 |omega|^2 "
        f"with L = {length:.3g}, the arm's reach. No pitch serves: the best of those tried misses at most "
        f"{MAX_NORM:g} times as much of a twist as least squares {counts}. To split twists and wrenches, name what "
        "may be given up, Complement(Z), or a metric."
    )


def _shares(spread: _Norms, up: _Norms, best: int) -> str:
    """The shares of the states of each kind in which a pitch serves."""
    shares = f"{100.0 * spread.shares()[best]:.3g} % of the states looked at"
    upright = (
        f" and {100.0 * up.shares()[best]:.3g} % of those with the last axis parallel to the first (tool up or down)"
    )
    return shares + upright if len(up.states) else shares


def _blind_note(q: Array, blind: Array, root: Array) -> str:
    at = ", ".join(f"{x:.3g}" for x in q)
    if not blind.shape[1]:
        return f"At q = ({at}) each pitch has a direction of its own that it does not see."
    measured = root.dot(blind)
    motions = [f"the twist {_tuple(twist)}" for twist in blind.T]
    if np.linalg.norm(measured[:3]) <= PARALLEL_TOLERANCE * np.linalg.norm(measured[3:]):
        slides = along_axes(np.vstack((np.zeros((3, blind.shape[1])), measured[3:])))
        # In an order that does not depend on rounding.
        directions = sorted(slides[3:].T, key=lambda v: tuple(np.abs(v).round(6)), reverse=True)
        motions = [f"translation along {_tuple(v)}" for v in directions]
    return (
        f"At q = ({at}) no pitch sees {' and '.join(motions)}: a form would neither ask for that motion nor correct it."
    )


def _tuple(values: Array) -> str:
    return f"({listed(values.round(4), 3)})"
