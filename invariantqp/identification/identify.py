"""Identification of the contact from poses of a tool and the wrenches it exerts while a person moves it in contact.

    S  twists of the motion,  W  wrenches of constraint,  W'S = 0 but for friction

The kind is determined if dim S + dim W = 6 for the most constrained kind that is left: the person then moved along, or
pushed against, every twist. Kinds that differ only in unexcited twists cannot be distinguished. If all other kinds are
refuted, the motion is enough.

Reference: [DS] Sect. 3 and 6.3.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, NoContactFound
from invariantqp.force.contact import HybridTask
from invariantqp.force.contact_kinds import Contact
from invariantqp.force.sensor import WrenchSensor
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.geometry.linear import orthogonal
from invariantqp.identification.candidate import Candidate, candidate
from invariantqp.identification.fit import TINY, Samples, fit
from invariantqp.identification.hypotheses import MISFIT, Hypothesis, is_explained, tested_kinds
from invariantqp.identification.models import MODELS
from invariantqp.identification.recording import MIN_SAMPLES, Recording, recording
from invariantqp.identification.se3_batch import adjoint, approximate_log, coadjoint, inverse, matvec, propagate

KINDS: tuple[str, ...] = tuple(MODELS)
# Second moment of a push or a motion, relative to its noise, above which the direction was excited: 150 samples of
# noise exceed it once in a million times.
EXCITATION = 1.5
# Most contacts that are looked for in a stretch.
MAX_SEGMENTS = 10
# Share of a stretch that contacts of a determined kind have to explain; less is noise cut into pieces.
MIN_EXPLAINED = 0.7


@frozen(eq=False, repr=False, slots=False)
class Identification(Compared):
    """The contact, or contacts, of a recording.

    Attributes:
        kind: the kind of contact; None if the recording does not determine it or has several contacts.
        candidates: the kinds that explain the recording, the most constrained first.
        refuted: why each of the other kinds does not, by name.
        unexcited: (6, u) twists, in the base frame at the middle sample, that neither moved nor were pushed against.
        reason: why `kind` is None; "" if it is not.
        start, stop: the first sample in contact, and the one after the last.
        segments: one identification for each contact, in order; itself if there is one contact.
    """

    kind: str | None
    candidates: tuple[Candidate, ...]
    refuted: dict[str, str]
    unexcited: Array
    reason: str
    start: int
    stop: int
    _parts: tuple[Identification, ...] = field(default=(), eq=False)

    def __repr__(self) -> str:
        if self._parts:
            return f"Identification({', '.join(f'{s.start}-{s.stop}: {s.kind}' for s in self._parts)})"
        others = [c.kind for c in self.candidates if c.kind != self.kind]
        others_too = f", candidates={self.candidates!r}" if others or not self.kind else ""
        return f"Identification({self.kind!r}{others_too})"

    @property
    def segments(self) -> tuple[Identification, ...]:
        """One identification for each contact, in order."""
        return self._parts or (self,)

    @property
    def best(self) -> Candidate:
        """The candidate that `kind` names.

        Raises:
            NoContactFound: the kind is not determined.
        """
        if self.kind is None:
            raise NoContactFound(f"the recording does not determine the contact: {self.reason}")
        return self.candidates[0]

    @property
    def fixed_to(self) -> str | None:
        """Body with the surface, see `Candidate`; None if the kind is not determined."""
        return self.candidates[0].fixed_to if self.kind else None

    @property
    def point(self) -> Array | None:
        """(3,) point of the contact, see `Candidate`; None if the kind is not determined."""
        return self.candidates[0].point if self.kind else None

    @property
    def normal(self) -> Array | None:
        """(3,) outward normal of the plane, see `Candidate`; None if the kind is not determined."""
        return self.candidates[0].normal if self.kind else None

    @property
    def axis(self) -> Array | None:
        """(3,) direction of the axis or edge, see `Candidate`; None if the kind is not determined."""
        return self.candidates[0].axis if self.kind else None

    @property
    def pitch(self) -> float | None:
        """Pitch of the joint [length/rad], see `Candidate`; None if the kind is not determined."""
        return self.candidates[0].pitch if self.kind else None

    @property
    def radius(self) -> float | None:
        """Radius of the sphere [length], see `Candidate`; None if the kind is not determined."""
        return self.candidates[0].radius if self.kind else None

    def as_json(self) -> dict[str, Any]:
        """The identification as JSON types, with one entry in "contacts" for each contact."""
        keys = ("kind", "reason", "start", "stop", "refuted")
        return {
            "kind": self.kind,
            "reason": self.reason,
            "contacts": [
                {
                    **{key: getattr(part, key) for key in keys},
                    "candidates": [c.as_json() for c in part.candidates],
                    "unexcited": part.unexcited.T.tolist(),
                }
                for part in self.segments
            ],
        }

    def contact(self, tool: ArrayLike) -> Contact:
        """The contact at a tool pose (4, 4) in the base frame.

        Raises:
            NoContactFound: the kind is not determined.
        """
        return self.best.contact(tool)

    def task(self, press: float | ArrayLike = 0.0, **options: Any) -> HybridTask:
        """The task of the determined kind, see `Candidate.task`.

        Raises:
            NoContactFound: the kind is not determined.
        """
        return self.best.task(press, **options)


def identify(
    poses: ArrayLike,
    wrenches: ArrayLike | Iterable[Any],
    *,
    exerts: bool = True,
    noise: tuple[ArrayLike, ArrayLike] | None = None,
    accuracy: ArrayLike | None = None,
    kinds: Iterable[str] | None = None,
    sensor: WrenchSensor | None = None,
) -> Identification:
    """Identify the kind and place of the contacts in a recording.

    Move the tool in contact in every free direction, and push and pull in the constrained ones, for three to ten
    seconds at 100 Hz. Poses and wrenches have the same time stamps, evenly spaced.

    Args:
        poses: (n, 4, 4) of the tool frame in the base frame, n >= 30.
        wrenches: (n, 6) in the tool frame about its origin, moment first; or n `Wrench`es; or, with a `sensor`, n of
            its readings. They must not contain the weight of the tool, which a sensor subtracts.
        exerts: whether the tool exerts these wrenches; False if they act on the tool.
        noise: (pose, wrench), each six standard deviations or a (6, 6) covariance in the tool frame: of the twist from
            the true to the measured pose [rad, length], and of a wrench [N length, N]. None estimates white noise from
            third differences, which does not include smooth errors, such as those of the arm's calibration.
        accuracy: (angle [rad], length), or (angle, length, moment, force): deviation of the real contact from an ideal
            one in addition to noise, by clearance and compliance. Without it, a simulation without noise is refused.
        kinds: kinds to test; None is all of `KINDS`.
        sensor: sensor of the readings `wrenches`, with order, sign, mount and weight.

    Returns:
        Identification: with one of its `segments` for each contact.

    Raises:
        BadInput: shapes, NaN, fewer than 30 samples in contact, no noise.
        NoContactFound: no kind explains the recording, or no wrench exceeds its noise; it names the nearest kind.
    """
    tested = KINDS if kinds is None else arrays.strings(kinds, "kinds")  # type: ignore[arg-type]
    for kind in tested:
        arrays.choice(kind, "kinds", KINDS)
    if not tested:
        raise BadInput("kinds", "none", f"some of {', '.join(KINDS)}")
    record = recording(poses, wrenches, exerts, noise, accuracy, sensor)
    stretches = record.loaded_stretches()
    if not stretches:
        raise NoContactFound("nothing is touched: no wrench above its noise in the whole recording")
    longest = max(b - a for a, b in stretches)
    if longest < MIN_SAMPLES:
        raise BadInput("wrenches", f"{longest} samples in contact", f"{MIN_SAMPLES} or more")
    parts = _identified_segments(record, tested, [(a, b) for a, b in stretches if b - a >= MIN_SAMPLES])
    if len(parts) > 1:
        parts = _merged_if_same(record, tested, parts)
    if len(parts) == 1:
        return parts[0]
    contacts = ", ".join(f"{p.kind or 'undecided'} in samples {p.start} to {p.stop}" for p in parts)
    reason = f"it has {len(parts)} contacts: {contacts}; see segments"
    return Identification(None, (), {}, np.zeros((6, 0)), reason, parts[0].start, parts[-1].stop, tuple(parts))


def _identified_segments(
    record: Recording, kinds: tuple[str, ...], stretches: list[tuple[int, int]]
) -> list[Identification]:
    """The contacts of all stretches; NoContactFound if more than a small part of them is unexplained."""
    parts, unexplained = list[Identification](), list[tuple[int, NoContactFound]]()
    for start, stop in stretches:
        try:
            parts += _segments_of(record, kinds, start, stop)
        except NoContactFound as error:
            unexplained.append((stop - start, error))
    lost, whole = sum(length for length, _ in unexplained), sum(b - a for a, b in stretches)
    if unexplained and not (parts and lost <= (1.0 - MIN_EXPLAINED) * whole):
        raise max(unexplained, key=lambda one: one[0])[1]
    return parts


def _segments_of(record: Recording, kinds: tuple[str, ...], start: int, stop: int) -> list[Identification]:
    """The contact of a stretch, or several in sequence; NoContactFound if nothing explains it."""

    def is_contact(a: int, b: int) -> bool:
        return is_explained(record.blocks(a, b), kinds)

    def identified(a: int, b: int) -> tuple[Identification, Samples, list[Hypothesis]]:
        samples = record.blocks(a, b)
        hypotheses = tested_kinds(samples, kinds)
        return _identification(samples, hypotheses, a, b, record.every(a, b)), samples, hypotheses

    whole, samples, hypotheses = identified(start, stop)
    if whole.candidates:
        return [whole]
    parts = [part for a, b in _spans(is_contact, start, stop) if (part := identified(a, b)[0]).candidates]
    if sum(part.stop - part.start for part in parts if part.kind) < MIN_EXPLAINED * (stop - start):
        raise _no_contact_found(samples, hypotheses, start, stop)
    return parts


def _spans(is_contact: Callable[[int, int], bool], start: int, stop: int) -> list[tuple[int, int]]:
    """Stretches of one contact each, without the samples between the earliest and the latest place of a change.

    The longest explained stretch from the start ends at the latest place of a change; from the end, at the earliest.
    """
    latest = _change_points(lambda a, b: is_contact(start + a, start + b), stop - start)
    earliest = _change_points(lambda a, b: is_contact(stop - b, stop - a), stop - start)
    if not latest or len(latest) != len(earliest):
        return []
    begins = [start, *(start + k for k in latest)]
    ends = [*(stop - k for k in reversed(earliest)), stop]
    return [(a, b) for a, b in zip(begins, ends, strict=True) if b - a >= MIN_SAMPLES]


def _change_points(is_contact: Callable[[int, int], bool], length: int) -> list[int]:
    """Ends of the longest contacts in sequence, without the last, by bisection; [] if one is unexplained.

    The whole is not one contact.
    """
    changes: list[int] = []
    begin, step = 0, max(MIN_SAMPLES, length // MAX_SEGMENTS)
    while len(changes) < MAX_SEGMENTS - 1:
        low, high = begin + step, length
        if low >= length or not is_contact(begin, low):
            return []
        while high - low > MIN_SAMPLES // 2:  # fewer samples refute nothing
            middle = (low + high) // 2
            low, high = (middle, high) if is_contact(begin, middle) else (low, middle)
        begin = low
        changes.append(begin)
        if is_contact(begin, length):
            return changes
    return []


def _merged_if_same(record: Recording, kinds: tuple[str, ...], parts: list[Identification]) -> list[Identification]:
    """One contact in place of parts that the same kind explains one by one and together."""
    samples, every = (
        Samples(*(np.concatenate([getattr(s, name) for s in apart]) for name in Samples._fields))
        for apart in ([of(part.start, part.stop) for part in parts] for of in (record.blocks, record.every))
    )
    merged = _identification(samples, tested_kinds(samples, kinds), parts[0].start, parts[-1].stop, every)
    kind = merged.candidates[0].kind if merged.candidates else ""
    is_same = all(part.kind in (None, kind) and kind in [c.kind for c in part.candidates] for part in parts)
    return [merged] if is_same else parts


def _no_contact_found(samples: Samples, hypotheses: list[Hypothesis], start: int, stop: int) -> NoContactFound:
    """The error for a stretch that no kind explains, with the nearest kind and a remedy."""
    nearest = min(hypotheses, key=lambda one: one.misfit)
    what = f"no kind of contact explains samples {start} to {stop}; the nearest is {nearest.name}: {nearest.rejection}"
    residuals = nearest.fit.residuals
    first, last = (float(np.sqrt(np.mean(half**2))) for half in np.array_split(residuals, 2))
    if nearest.misfit < MISFIT:
        remedy = "Its motion fits: check the sign, the frame and the weight in the wrenches"
    elif max(first, last) > 2.0 * min(first, last):
        worst = samples.indices[int(np.argmax(residuals))]
        remedy = f"The residuals are largest at sample {worst}: the contact may change there, or be lost"
    else:
        remedy = (
            f"The residuals are large throughout: noise {nearest.misfit:.2g} times as large would explain them. Smooth "
            "errors, of clearance, bending or the arm's calibration, are not estimated: pass noise= or accuracy="
        )
    return NoContactFound(f"{what}. {remedy}.", nearest.name, nearest.misfit)


def _identification(
    samples: Samples, hypotheses: list[Hypothesis], start: int, stop: int, every: Samples
) -> Identification:
    """The identification of a stretch: the kind from block averages, the geometry from every sample."""
    candidates = _candidates(samples, hypotheses, every)
    refuted = {one.name: one.rejection for one in hypotheses if one.rejection}
    if not candidates:
        return Identification(None, (), refuted, np.zeros((6, 0)), "no kind explains it", start, stop)
    moved, pushed, unexcited = _excitation(candidates[0], samples)
    reason = _why_undecided(candidates, moved, pushed, unexcited.shape[1])
    return Identification(None if reason else candidates[0].kind, candidates, refuted, unexcited, reason, start, stop)


def _candidates(samples: Samples, hypotheses: list[Hypothesis], every: Samples) -> tuple[Candidate, ...]:
    """The kinds that are not refuted, fitted to every sample, the most constrained first."""
    left, made = [one for one in hypotheses if not one.rejection], []
    for one in sorted(left, key=lambda one: (one.model.freedoms, one.fit.pose_misfit)):
        start = one.fit.base, one.fit.tool, one.fit.parameters
        found = fit(one.model, every.inverted if one.on_tool else every, start)
        # If the tool only turns, its lever arm sets the scale.
        size = max(samples.size, 1e-3 * float(np.linalg.norm(found.tool[:3, 3])), 1e-12)
        made.append(candidate(found, one.on_tool, one.press, size))
    return tuple(made)


def _why_undecided(candidates: tuple[Candidate, ...], moved: int, pushed: int, unexcited: int) -> str:
    """Why the first candidate is not determined; "" if it is."""
    best = candidates[0]
    k = best.contact_kind.freedoms.shape[1]
    if moved < k or (pushed < 6 - k and len(candidates) > 1):
        names = ", ".join(dict.fromkeys(c.kind for c in candidates))
        return (
            f"{unexcited} twists were neither moved along nor pushed against, and {names} differ in them: "
            "move the tool in every free direction, push and pull in the others"
        )
    pressed = next((c.kind for c in candidates if MODELS[c.kind].is_unilateral), best.kind)
    if pressed != best.kind and not MODELS[best.kind].is_unilateral:
        return f"a {best.kind}, or a {pressed} held by friction: pull it as well, and push sideways"
    return ""


def _excitation(candidate_: Candidate, samples: Samples) -> tuple[int, int, Array]:
    """Number of excited freedoms, number of excited constraints, and (6, u) unexcited twists in the base frame.

    The part of a wrench of constraint that is correlated with the wrench along the freedoms is friction: no excitation.
    """
    S, W = (np.asarray(a) for a in (candidate_.contact_kind.freedoms, candidate_.contact_kind.constraints))
    frames = np.array([candidate_.frame(X) for X in samples.pose])
    to_contact = inverse(frames) @ samples.pose
    B = coadjoint(to_contact)
    w = matvec(B, samples.wrench)
    noise = propagate(B, samples.wrench_noise).mean(axis=0)
    P = np.linalg.inv(noise)
    parts = np.linalg.solve(W.T @ P @ W, W.T @ P @ w.T).T
    friction = w @ S
    G = friction.T @ friction + len(w) * S.T @ noise @ S
    slope = np.linalg.solve(G, friction.T @ parts).T
    parts = parts - friction @ slope.T
    variance: Array = np.asarray(np.linalg.inv(W.T @ P @ W)) + slope @ (S.T @ noise @ S) @ slope.T
    pushes, pushed = _above_noise(parts.T @ parts / len(parts), variance)
    middle = len(frames) // 2
    xi = matvec(adjoint(to_contact[middle]), approximate_log(inverse(samples.pose[middle]) @ samples.pose))
    Q = np.linalg.inv(propagate(adjoint(to_contact[middle]), samples.pose_noise[middle]))
    along = np.linalg.solve(S.T @ Q @ S, S.T @ Q @ xi.T).T
    along = along - along.mean(axis=0)
    moves, moved = _above_noise(along.T @ along / len(along), np.asarray(np.linalg.inv(S.T @ Q @ S)))
    # Unexcited: the pushes do no work on it, and it is orthogonal to the motion in the metric of the noise.
    root: Array = np.asarray(np.linalg.cholesky(Q))
    free = orthogonal(np.asarray(np.linalg.solve(root, W @ pushed))) if pushes else np.eye(6)  # columns root' t
    still = free @ orthogonal(free.T @ root.T @ S @ moved) if moves else free
    unexcited = adjoint(frames[middle]) @ np.linalg.solve(root.T, still)
    return moves, pushes, unexcited / np.maximum(np.linalg.norm(unexcited, axis=0), TINY)


def _above_noise(moment: Array, noise: Array) -> tuple[int, Array]:
    """Number of directions of a second moment above the noise, and these directions as columns of coefficients."""
    root = np.linalg.cholesky(noise)
    whitened = np.linalg.solve(root, np.linalg.solve(root, moment).T)
    values, vectors = np.linalg.eigh(0.5 * (whitened + whitened.T))
    above = values > EXCITATION
    return int(above.sum()), np.asarray(root @ vectors[:, above])
