"""What can be said of an arm before it moves: in one state, over the joint range, and which pitch to use.

The state: rank, type, principal pitches, blind directions, distance from a singularity (`systems.report`). The range:
the same in many states (`analysis.survey`), because a pitch is chosen once for all of them.

A controller needs no pitch: without a form, what the arm cannot do is missed by least squares at the tool. A pitch is
for [DS]'s reciprocal splitting: dual projectors, hybrid and shared control. Recommended is the smallest |h| of +-1,
1.5, 2, 3, 4 L whose |P_h| stays small; L is the arm's reach to the tool, with |h| far below it projectors are oblique
and large, with |h| far above it orientation comes first.

    A = root J,  U its directions of which the law does half and more,  M the form on measured twists
    P_h = U (U'MU)^-1 U'M,    |s - P_h s| <= |P_h| |s - U U's|,    |P_h| = 1 / sin(angle between U and what P_h removes)

Proof: (I - P_h) U = 0, so (I - P_h) s = (I - P_h)(s - U U's), and |I - P_h| = |P_h| for every projector but 0 and I.
|P_h| is infinite at a principal pitch and where the arm is blind, and it is large near both. So no tolerance on the
type of a screw system is needed, and rounding in a URDF decides nothing.

|P_h| is looked at in states spread over the joint range and in states with the tool straight up or down, in which most
work is done. A random state is never such a state, and an SO-101, among others, has no pitch there at all.

Reference: [DS] Sect. 3, 5, and 6.1 for P_h; Szyld 2006 for |I - P| = |P|.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, inf, isfinite, log10
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, listed, written
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import ROUNDING, Array
from invariantqp.geometry.screws import angular_speeds
from invariantqp.robots.kinematics import Robot, middle, require_robot
from invariantqp.systems.points import centre
from invariantqp.systems.report import SystemReport, along_axes, describe
from invariantqp.velocity.forms import PitchForm
from invariantqp.velocity.measure import length_at, root_at
from invariantqp.workbench.analysis.survey import Survey, spread, survey

# The largest |P_h| that serves. Measured on SO-101, SO-100 and a three-joint arm with random twists: where |P_h| is
# between 3 and 4, P_h s is farther from s than standing still is in half of the cases, between 1.5 and 2 in a fifth.
LARGEST_NORM = 4.0
# The share of states in which it has to stay below that; near a singularity every arm has some in which it does not.
NEARLY_ALL = 0.9
# Pitches tried, of the reach.
MULTIPLES = (1.0, 1.5, 2.0, 3.0, 4.0)
# Starts of the search for states with the tool up or down: by 500 the same is recommended for each of 20 arms.
STARTS = 32
# Directions of the tool that need 500 times the joint speed of the strongest one are none that an arm has.
LEAST = 2e-3
# Sines, and shares of the largest, that nobody asks an arm for: finer than a tool is pointed.
SMALL = 1e-3
# Newton's steps; four to eight are enough from anywhere for arms whose wrist can turn that far.
STEPS = 20
# The longest of them in one joint [rad].
LONGEST = 0.5


@dataclass(frozen=True, eq=False)
class Recommendation:
    """Which pitch an arm's twists can be split by, if any.

    Attributes:
        form: "pitch" (`PitchForm(h)`) or "tool" (no form: least squares at the tool).
        h: pitch [length/rad]; None where none serves.
        length: L, what a radian counts for at the tool: the arm's reach [length/rad].
        reason: in words.
        q: (m,) joint positions at which no pitch that was tried serves [rad, length]; None where there are none such.
        unseen: (6, b) what of the arm's twists no pitch sees there, at the tool.
    """

    form: Literal["pitch", "tool"]
    h: float | None
    length: float
    reason: str
    q: Array | None
    unseen: Array


class _ProjectorNorms(NamedTuple):
    """|P_h| of (p,) pitches in n states."""

    states: Array  # (n, m)
    norms: Array  # (n, p)
    six: Array  # (n,) whether the tool can be moved in all six directions

    def share(self) -> Array:
        """(p,) share of the states in which each pitch serves; 1 of no states."""
        return np.ones(self.norms.shape[1]) if not len(self.states) else (self.norms <= LARGEST_NORM).mean(axis=0)


def recommend(robot: Robot, q: Array) -> Recommendation:
    """The pitch for an arm, from (n, m) states of its range."""
    mid = middle(robot)
    length = length_at(robot.jacobian(mid), robot.pose(mid)[:3, 3])
    pitches = tried_pitches(length)
    spread = _tried(robot, length, q)
    up = _tried(robot, length, upright(robot, q[: min(STARTS, len(q) // 2 + 1)]))
    shares = np.minimum(spread.share(), up.share())
    serving = np.flatnonzero(shares >= NEARLY_ALL)
    best = int(serving[0] if len(serving) else shares.argmax())
    states, least = np.vstack((spread.states, up.states)), np.vstack((spread.norms, up.norms)).min(axis=1)
    where, lost, notes = None, np.empty((6, 0)), []
    if least.max() > LARGEST_NORM:
        where = states[least.argmax()]
        lost = unseen(*at_tool(robot, where, length), pitches, LARGEST_NORM)
        notes = [_unseen_words(where, lost, root_at(robot.pose(where)[:3, 3], length))]
    h = pitches[best] if len(serving) else None
    words = _tool_words(length, spread, up, best) if h is None else _pitch_words(h, length, spread, up, best)
    return Recommendation("tool" if h is None else "pitch", h, length, " ".join([words, *notes]), where, lost)


def tried_pitches(length: float) -> tuple[float, ...]:
    """The pitches tried for an arm with this reach [length/rad], smallest first."""
    return tuple(sign * rounded(times * length) for times in MULTIPLES for sign in (1.0, -1.0))


def smallest_norm(robot: Robot, q: Array, length: float) -> float:
    """The smallest |P_h| of the pitches tried, in one state."""
    U, inverse_root = at_tool(robot, q, length)
    return float(projector_norms(U, inverse_root, tried_pitches(length)).min())


def at_tool(robot: Robot, q: Array, length: float) -> tuple[Array, Array]:
    """What the joints can do at q (6, k), measured at the tool, and the inverse of the measure's root (6, 6)."""
    root = root_at(robot.pose(q)[:3, 3], length)
    return achievable(root.dot(robot.jacobian(q))), np.asarray(np.linalg.inv(root), dtype=np.float64)


def rounded(x: float) -> float:
    """A positive number to two digits: what a person would type."""
    return round(x, 1 - floor(log10(x)))


def _tried(robot: Robot, length: float, states: Array) -> _ProjectorNorms:
    pitches = tried_pitches(length)
    norms, six = np.empty((len(states), len(pitches))), np.zeros(len(states), dtype=bool)
    for i, q in enumerate(states):
        U, inverse_root = at_tool(robot, q, length)
        six[i] = U.shape[1] == 6
        norms[i] = projector_norms(U, inverse_root, pitches)
    return _ProjectorNorms(states, norms, six)


def _pitch_words(h: float, length: float, spread: _ProjectorNorms, up: _ProjectorNorms, i: int) -> str:
    times = "" if abs(h) == rounded(length) else f"{abs(h) / length:.2g} times "
    size = f"h = {written(h)}, {times}the arm's reach to the tool"
    if np.mean(spread.six) >= NEARLY_ALL:
        return (
            "A controller needs no form: the arm moves its tool in all six directions, so every h gives the same joint "
            f"velocities where no limit is active. To split twists and wrenches: {size}, lets rotation and "
            "translation count alike."
        )
    return (
        "A controller needs no form: without one, what the arm cannot do is missed by least squares at the tool. To "
        f"split twists and wrenches: {size}. It misses at most {LARGEST_NORM:g} times as much of a twist as least "
        f"squares in {_shares(spread, up, i)}. A much smaller |h| splits obliquely, a larger one puts orientation "
        "first."
    )


def _tool_words(length: float, spread: _ProjectorNorms, up: _ProjectorNorms, i: int) -> str:
    counts = f"in {_shares(spread, up, i)}" if spread.share()[i] or (len(up.states) and up.share()[i]) else "nowhere"
    return (
        "Leave out the form: what the arm cannot do is then missed by least squares at the tool, |v|^2 + L^2 |omega|^2 "
        f"with L = {length:.3g}, the arm's reach. No pitch serves: the best of those tried misses at most "
        f"{LARGEST_NORM:g} times as much of a twist as least squares {counts}. To split twists and wrenches, name what "
        "may be given up, Complement(Z), or a metric."
    )


def _shares(spread: _ProjectorNorms, up: _ProjectorNorms, i: int) -> str:
    """In how many states of each kind a pitch serves."""
    shares = f"{100.0 * spread.share()[i]:.3g} % of the states looked at"
    upright = f" and {100.0 * up.share()[i]:.3g} % of those with the last axis parallel to the first (tool up or down)"
    return shares + upright if len(up.states) else shares


def _unseen_words(q: Array, lost: Array, root: Array) -> str:
    at = ", ".join(f"{x:.3g}" for x in q)
    if not lost.shape[1]:
        return f"At q = ({at}) each pitch has a direction of its own that it does not see."
    measured = root.dot(lost)
    motions = [f"the twist {_tuple(twist)}" for twist in lost.T]
    if np.linalg.norm(measured[:3]) <= SMALL * np.linalg.norm(measured[3:]):
        slides = along_axes(np.vstack((np.zeros((3, lost.shape[1])), measured[3:])))
        # In an order that does not depend on rounding.
        ways = sorted(slides[3:].T, key=lambda v: tuple(np.abs(v).round(6)), reverse=True)
        motions = [f"translation along {_tuple(v)}" for v in ways]
    named = " and ".join(motions)
    return f"At q = ({at}) no pitch sees {named}: a form would neither ask for that motion nor correct it."


def _tuple(values: Array) -> str:
    return f"({listed(values.round(4), 3)})"


def achievable(A: Array) -> Array:
    """(6, k) orthonormal: the twists that the measured joints A (6, m) can do at speeds that an arm has."""
    U, sigma, _ = np.linalg.svd(A, full_matrices=False)
    return np.asarray(U[:, sigma >= max(LEAST * sigma[0], np.finfo(float).tiny)])


def projector_norms(U: Array, inverse_root: Array, pitches: Sequence[float]) -> Array:
    """(p,) |P_h| in the measure: 1 where the joints can do every twist, inf where h [length/rad] has no projector.

    U (6, k) is what the joints can do, orthonormal; (6, 6) the inverse of the measure's root.
    """
    norms = np.ones(len(pitches))
    if U.shape[1] not in (0, 6):
        on_arm = _on_arm(U, inverse_root, pitches)
        G = on_arm @ U
        some = np.linalg.norm(G, -2, axis=(1, 2)) >= ROUNDING
        norms[some] = np.linalg.norm(np.linalg.solve(G[some], on_arm[some]), 2, axis=(1, 2))
        norms[~some] = inf
    return norms


def unseen(U: Array, inverse_root: Array, pitches: tuple[float, ...], bound: float) -> Array:
    """(6, b) twists of the arm that none of the pitches sees: |U'M s| is below |M| |s| / bound for each of them.

    U (6, k) is what the joints can do, orthonormal in the measure; `bound` the largest |P_h| that serves.
    """
    _, size, directions = np.linalg.svd((_on_arm(U, inverse_root, pitches) @ U).reshape(-1, U.shape[1]))
    return np.asarray(inverse_root.dot(U).dot(directions[size < 1.0 / bound].T))


def _on_arm(U: Array, inverse_root: Array, pitches: Sequence[float]) -> Array:
    """(p, k, 6) U'M with |M| = 1."""
    M = np.array([PitchForm(h).matrix(inverse_root) for h in pitches])
    return np.asarray(U.T @ M / np.linalg.norm(M, 2, axis=(1, 2))[:, None, None])


def upright(robot: Robot, q: Array) -> Array:
    """(k, m) states near the (n, m) given ones, inside the joint limits, with the last axis parallel to the first.

    There are none where no joint or only one turns, where joint limits forbid them, and where the two axes are parallel
    in every state (a SCARA): then they are no other states than the rest.
    """
    states = [state for start in q if (state := _turned(robot, start)) is not None]
    return np.array(states).reshape(-1, q.shape[1])


def _turned(robot: Robot, start: Array) -> Array | None:
    """The state near `start` with the last axis parallel to the first; None where there is none, or it is `start`."""
    q = start
    for step in range(STEPS + 1):
        J = robot.jacobian(q)
        rates = angular_speeds(J)
        turns = rates > 0.0
        if np.count_nonzero(turns) < 2:
            return None
        axes = J[:3, turns] / rates[turns]
        first, last = axes[:, 0], axes[:, -1]
        if np.linalg.norm(np.cross(first, last)) < SMALL:
            return q if step else None
        led = np.cross(axes.T, last).T  # (3, k) how each joint that turns leads the last axis
        wanted = np.copysign(1.0, first.dot(last)) * first - last
        change = np.zeros(len(q))
        change[turns] = np.linalg.pinv(led, rcond=SMALL).dot(wanted) / rates[turns]
        q = np.clip(q + np.clip(change, -LONGEST, LONGEST), robot.position_lower, robot.position_upper)
    return None


@dataclass(frozen=True, eq=False)
class Inspection:
    """An arm in one state and over its range, in words (`state_words`, `range_words`) and in numbers (`as_json`).

    Attributes:
        robot: its name, as given.
        tool: name of the tool frame.
        joints: names, base first.
        q: (m,) the state [rad, length].
        where: a description of that state.
        report: the state.
        survey: the range.
        own_length: the arm's own length in the middle of its range [length/rad]: inf where no joint turns, 0 where all
            axes meet.
        norm: the smallest |P_h| of the pitches tried in this state: how many times the least-squares error it leaves.
        recommended: the pitch to split twists by, if any serves.
        unlimited: names of the joints without a velocity limit.
        notes: what the reader of its description held still, coupled or left out.
    """

    robot: str
    tool: str
    joints: tuple[str, ...]
    q: Array
    where: str
    report: SystemReport
    survey: Survey
    own_length: float
    norm: float
    recommended: Recommendation
    unlimited: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def use_words(self) -> tuple[str, ...]:
        """What to tell a controller of this arm, one fact a sentence."""
        rank, m = self.survey.attainable_rank, len(self.joints)
        joints = f"{m} joint{'s' if m > 1 else ''}"
        use = 'every pose near: nothing but a target is needed; exact="position" for a tip that draws'
        if rank < 6:
            use = (
                f'{rank} of 6 directions: exact="position" and point= at the tip put the position first, where these '
                "joints can have it; the turn is then as near as they come"
            )
        sentences = [f"{joints}, {use}."]
        if m > rank:
            more = "one is" if m - rank == 1 else f"{m - rank} are"
            sentences.append(f"Of the joints {more} left over: posture= says where to.")
        if self.unlimited:
            sentences.append(f"No velocity limit is known for {', '.join(self.unlimited)}: say velocity_limit=.")
        return (*sentences, *(f"{note[0].upper()}{note[1:]}." for note in self.notes))

    def state_words(self) -> tuple[str, ...]:
        """The state, one fact a sentence."""
        sentences = self.report.sentences()
        most = self.survey.attainable_rank
        if self.report.rank < most:
            regular = _percent(self.survey.regular)
            note = f"That is this state, not the arm: its rank is {most} in {regular} of the range."
            sentences = (sentences[0], note, *sentences[1:])
        elif self.report.singular:
            sentences = (*sentences, "No state does better: the joints are redundant, this is no singularity.")
        if self.norm > LARGEST_NORM and not self.report.blind_directions.shape[1]:
            sentences = (
                *sentences,
                f"But no pitch tried is useful here: its error is up to {self.norm:.2g} times the least-squares one.",
            )
        return sentences

    def range_words(self) -> tuple[str, ...]:
        """The range, one fact a sentence."""
        seen = self.survey
        ranks = Counter(seen.rank.tolist()).most_common()
        shares = ", ".join(f"{k} in {_percent(seen.rank == k)}" for k, _ in ranks)
        median, least = float(np.median(seen.distance)), float(seen.distance.min())
        sentences = [f"Rank {shares}; {median:.2g} away from a singularity at the median, {least:.2g} at least."]
        pitches = seen.all_pitches
        if seen.attainable_rank < 6 and len(pitches):
            low, middle_low, middle_high, high = np.quantile(pitches, (0.0, 0.25, 0.75, 1.0)).tolist()
            if written(high - low, 1) == "0":
                sentences.append(f"The principal pitch is {written(low)} in every state: stay away from it.")
            else:
                sentences.append(
                    f"Principal pitches from {written(low, 3)} to {written(high, 3)}, half of them between "
                    f"{written(middle_low, 3)} and {written(middle_high, 3)}: pitches to stay away from."
                )
        if seen.attainable_rank < 6 and seen.blind_share > 0.0:
            share = f"{100.0 * seen.blind_share:.3g} % of its regular states"
            sentences.append(f"No pitch works in {'any state' if seen.blind_share == 1.0 else share}.")
        return tuple(sentences)

    def as_json(self) -> dict[str, Any]:
        """Everything in numbers; SI units, screws as (omega; v)."""
        kind, advice = self.report.type, self.recommended
        return {
            "robot": self.robot,
            "tool": self.tool,
            "joints": list(self.joints),
            "notes": list(self.notes),
            "q": self.q.tolist(),
            "rank": self.report.rank,
            "gibson_hunt": str(kind),
            "named_by_reciprocal": kind.reciprocal,
            "moduli": dict(zip(kind.modulus_names, kind.moduli, strict=True)),
            "admits_pseudoinverse": kind.admits_pseudoinverse,
            "principal_pitches": self.report.principal_pitches.tolist(),
            "principal_screws": self.report.principal_screws.T.tolist(),
            "blind_directions": self.report.blind_directions.T.tolist(),
            "singularity_distance": self.report.singularity_distance,
            "attainable_rank": self.survey.attainable_rank,
            "own_length": self.own_length if isfinite(self.own_length) else None,
            "recommended": {
                "form": advice.form,
                "h": advice.h,
                "length": advice.length,
                "reason": advice.reason,
                "unseen": None if advice.q is None else {"q": advice.q.tolist(), "twists": advice.unseen.T.tolist()},
            },
            "samples": self.survey.as_json(),
        }


def inspect(robot: Robot, *, name: str = "robot", q: ArrayLike | None = None, samples: int = 64) -> Inspection:
    """Look at an arm in one state and over its joint range.

    Args:
        robot: from `load_robot`, or anything that meets `Robot`.
        name: what to call it.
        q: (m,) joint positions [rad, length]; None is the middle of each range or, where that is singular, the state of
            the range farthest from singularities.
        samples: states of the joint range to look at; 64 take some 50 ms.
    """
    mid = middle(require_robot(robot))
    state, where = mid, "in the middle of the joint range"
    if q is not None:
        state, where = arrays.joint_vector(q, robot.names, "q"), "at the joint positions given"
    if not arrays.count(samples, "samples", arrays.LARGEST_COUNT):
        raise BadInput("samples", "0", "one or more")
    report = describe(robot.jacobian(state))
    seen = survey(robot, spread(robot, samples))
    if q is None and report.rank < seen.attainable_rank:
        state = seen.q[int(np.where(seen.regular, seen.distance, -1.0).argmax())]
        report = describe(robot.jacobian(state))
        where = "in a regular state, since the middle of the joint range is singular"
    advice = recommend(robot, seen.q)
    return Inspection(
        robot=name,
        tool=str(getattr(robot, "tool", "tool_point")),
        joints=tuple(robot.names),
        q=state,
        where=where,
        report=report,
        survey=seen,
        own_length=centre(robot.jacobian(mid)).length,
        norm=smallest_norm(robot, state, advice.length),
        recommended=advice,
        unlimited=tuple(name for name, v in zip(robot.names, robot.velocity_limit, strict=True) if not isfinite(v)),
        notes=getattr(robot, "notes", ()),
    )


def _percent(flags: Array) -> str:
    return f"{100.0 * float(np.mean(flags)):.3g} %"
