"""The kind of contact of a recording: a tool's poses and the wrenches it exerts while a person moves it in contact.

    S  what moved,  W  what was pushed without moving,  W'S = 0 but for friction

The kind is determined where dim S + dim W = 6 for the most constrained kind that is left: each twist was then either
moved along, or pushed against without moving. What neither moved nor was pushed is not known, and kinds that differ in
it alone cannot be distinguished; where all other kinds are refuted, what moved is enough.

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
from invariantqp.identification.fit import Samples, fit
from invariantqp.identification.judge import MISFIT, Verdict, explains, judged
from invariantqp.identification.models import MODELS
from invariantqp.identification.motions import adjoint, applied, coadjoint, inverse, propagated, twists
from invariantqp.identification.recording import FEWEST, Recording, recording

KINDS: tuple[str, ...] = tuple(MODELS)
# Second moment of a push or a motion, in its noise, above which there was one: a noise given or estimated a fifth too
# small is none. Of 150 samples of noise it is above 1.5 once in a million times.
EXCITED = 1.5
# Shortest contact that is looked for after another one, as a part of the whole.
COARSE = 10
# Share of a stretch that its contacts have to explain by a determined kind: less is noise cut into pieces.
MOSTLY = 0.7


@frozen(eq=False, repr=False, slots=False)
class Identification(Compared):
    """What a recording, or a stretch of it, says of a contact.

    Attributes:
        kind: the kind of contact; None where the recording does not tell it, or has several.
        candidates: the kinds that explain it, the most constrained first.
        refuted: why each of the others does not, by name.
        unexcited: (6, u) twists, in the base frame at the middle sample, that neither moved nor were pushed against.
        reason: why `kind` is None; "" if it is not.
        start, stop: the first sample in contact, and the one after the last.
        segments: one for each contact, in order; only itself where there is one.
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
        """One for each contact, in order."""
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
        """Where the surface is: "base" or "tool"; "both" for faces and joints."""
        return self.candidates[0].fixed_to if self.kind else None

    @property
    def point(self) -> Array | None:
        """(3,) as of the candidate; None where the kind is not determined."""
        return self.candidates[0].point if self.kind else None

    @property
    def normal(self) -> Array | None:
        """(3,) as of the candidate; None where the kind is not determined."""
        return self.candidates[0].normal if self.kind else None

    @property
    def axis(self) -> Array | None:
        """(3,) as of the candidate; None where the kind is not determined."""
        return self.candidates[0].axis if self.kind else None

    @property
    def pitch(self) -> float | None:
        """[length/rad] as of the candidate; None where the kind is not determined."""
        return self.candidates[0].pitch if self.kind else None

    @property
    def radius(self) -> float | None:
        """[length] as of the candidate; None where the kind is not determined."""
        return self.candidates[0].radius if self.kind else None

    def as_json(self) -> dict[str, Any]:
        """Everything in numbers, text, lists and dictionaries: one entry for each contact."""
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
        """The contact with the tool at a (4, 4) pose in the base frame.

        Raises:
            NoContactFound: the kind is not determined.
        """
        return self.best.contact(tool)

    def task(self, press: float | ArrayLike = 0.0, **options: Any) -> HybridTask:
        """`Candidate.task` of the kind that is determined.

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
    """The kind of contact that a recording shows, where it is, and what it leaves open.

    Move the tool in contact along every way it gives, and push and pull the ways it does not, for three to ten seconds
    at 100 Hz. Poses and wrenches are of the same moments, evenly spaced.

    Args:
        poses: (n, 4, 4) of the tool frame in the base frame, n >= 30.
        wrenches: (n, 6) in the tool frame about its origin, moment first; or n `Wrench`es; or, with a `sensor`, n of
            its readings. The weight of the tool is not to be among them: a sensor takes it off.
        exerts: whether these are what the tool exerts; False is what it feels.
        noise: (pose, wrench), each six standard deviations or a (6, 6) covariance in the tool frame: of the twist by
            which a pose is off [rad, length], and of a wrench [N length, N]. None estimates it from third differences,
            which sees white noise and not smooth errors, such as those of an arm's own geometry.
        accuracy: (angle [rad], length), or (angle, length, moment, force): how far a real contact may be from an ideal
            one beside noise, for clearance and bending. Without it, a simulation without noise is refused.
        kinds: those to look for; None is all of `KINDS`.
        sensor: whose readings `wrenches` are; it says order, sign, mount and weight.

    Returns:
        Identification: `kind`, `candidates`, `refuted`, `unexcited`; of each contact, where there are several.

    Raises:
        BadInput: shapes, NaN, fewer than 30 samples in contact, no noise.
        NoContactFound: no kind explains it, or nothing is touched; names the nearest.
    """
    wanted = KINDS if kinds is None else arrays.strings(kinds, "kinds")  # type: ignore[arg-type]
    for kind in wanted:
        arrays.choice(kind, "kinds", KINDS)
    if not wanted:
        raise BadInput("kinds", "none", f"some of {', '.join(KINDS)}")
    record = recording(poses, wrenches, exerts, noise, accuracy, sensor)
    runs = record.contacts()
    if not runs:
        raise NoContactFound("nothing is touched: no wrench above its noise in the whole recording")
    lengths = [b - a for a, b in runs]
    if max(lengths) < FEWEST:
        raise BadInput("wrenches", f"{max(lengths)} samples in contact", f"{FEWEST} or more")
    parts = _all_segments(record, wanted, [(a, b) for a, b in runs if b - a >= FEWEST])
    if len(parts) > 1:
        parts = _merged(record, wanted, parts)
    if len(parts) == 1:
        return parts[0]
    kinds_found = ", ".join(f"{p.kind or 'undecided'} in samples {p.start} to {p.stop}" for p in parts)
    reason = f"it has {len(parts)} contacts: {kinds_found}; see segments"
    return Identification(None, (), {}, np.zeros((6, 0)), reason, parts[0].start, parts[-1].stop, tuple(parts))


def _all_segments(record: Recording, kinds: tuple[str, ...], runs: list[tuple[int, int]]) -> list[Identification]:
    """The contacts of all stretches; an error where nothing explains more than a small part of them."""
    parts, unexplained = list[Identification](), list[tuple[int, NoContactFound]]()
    for start, stop in runs:
        try:
            parts += _segments(record, kinds, start, stop)
        except NoContactFound as error:
            unexplained.append((stop - start, error))
    lost, whole = sum(length for length, _ in unexplained), sum(b - a for a, b in runs)
    if unexplained and not (parts and lost <= (1.0 - MOSTLY) * whole):
        raise max(unexplained, key=lambda found: found[0])[1]
    return parts


def _segments(record: Recording, kinds: tuple[str, ...], start: int, stop: int) -> list[Identification]:
    """A stretch in contact as one contact or several, one after the other; an error where nothing explains it."""

    def explained(a: int, b: int) -> bool:
        return explains(record.blocks(a, b), kinds)

    def identified(a: int, b: int) -> tuple[Identification, Samples, list[Verdict]]:
        samples = record.blocks(a, b)
        verdicts = judged(samples, kinds)
        return _identification(samples, verdicts, a, b, record.every(a, b)), samples, verdicts

    whole, samples, verdicts = identified(start, stop)
    if whole.candidates:
        return [whole]
    parts = [part for a, b in _split(explained, start, stop) if (part := identified(a, b)[0]).candidates]
    if sum(part.stop - part.start for part in parts if part.kind) < MOSTLY * (stop - start):
        raise _no_contact_found(samples, verdicts, start, stop)
    return parts


def _split(explained: Callable[[int, int], bool], start: int, stop: int) -> list[tuple[int, int]]:
    """Stretches between changes: each change lies between the longest stretch that ends and the one that begins.

    From the start, the longest that some kind explains ends at the latest place where the contact can have changed;
    from the end, it begins at the earliest.
    """
    latest = _ends(lambda a, b: explained(start + a, start + b), stop - start)
    earliest = _ends(lambda a, b: explained(stop - b, stop - a), stop - start)
    if not latest or len(latest) != len(earliest):
        return []
    begins = [start, *(start + k for k in latest)]
    ends = [*(stop - k for k in reversed(earliest)), stop]
    return [(a, b) for a, b in zip(begins, ends, strict=True) if b - a >= FEWEST]


def _ends(explained: Callable[[int, int], bool], length: int) -> list[int]:
    """Where the longest stretches end that are explained one after the other, without the last; [] if they are not.

    The whole is known not to be explained.
    """
    found: list[int] = []
    begin, step = 0, max(FEWEST, length // COARSE)
    while len(found) < COARSE - 1:
        low, high = begin + step, length
        if low >= length or not explained(begin, low):
            return []
        while high - low > FEWEST // 2:  # so many say nothing by themselves
            middle = (low + high) // 2
            low, high = (middle, high) if explained(begin, middle) else (low, middle)
        begin = low
        found.append(begin)
        if explained(begin, length):
            return found
    return []


def _merged(record: Recording, kinds: tuple[str, ...], parts: list[Identification]) -> list[Identification]:
    """The same contact again and again as one: where one kind that explains each explains all together."""
    samples, every = (
        Samples(*(np.concatenate([getattr(s, name) for s in apart]) for name in Samples._fields))
        for apart in ([of(part.start, part.stop) for part in parts] for of in (record.blocks, record.every))
    )
    together = _identification(samples, judged(samples, kinds), parts[0].start, parts[-1].stop, every)
    kind = together.candidates[0].kind if together.candidates else ""
    same = all(part.kind in (None, kind) and kind in [c.kind for c in part.candidates] for part in parts)
    return [together] if same else parts


def _no_contact_found(samples: Samples, verdicts: list[Verdict], start: int, stop: int) -> NoContactFound:
    """The error where nothing explains a stretch."""
    nearest = min(verdicts, key=lambda v: v.misfit)
    what = f"no kind of contact explains samples {start} to {stop}; the nearest is {nearest.key}: {nearest.why}"
    off = nearest.fit.off
    first, last = (float(np.sqrt(np.mean(part**2))) for part in np.array_split(off, 2))
    if nearest.misfit < MISFIT:
        why = "Its motion fits: look at the sign, the frame and the weight in the wrenches"
    elif max(first, last) > 2.0 * min(first, last):
        why = f"It is off most at sample {samples.at[int(np.argmax(off))]}: the contact may change there, or be lost"
    else:
        why = (
            f"It is off throughout: noise {nearest.misfit:.2g} times as large would explain it. Smooth errors, of "
            "clearance, bending or an arm's own geometry, are not seen by an estimate: say noise= or accuracy="
        )
    return NoContactFound(f"{what}. {why}.", nearest.key, nearest.misfit)


def _identification(samples: Samples, verdicts: list[Verdict], start: int, stop: int, every: Samples) -> Identification:
    """The answer of a stretch: kinds by some samples, and where they are by every one."""
    candidates = _candidates(samples, verdicts, every)
    refuted = {v.key: v.why for v in verdicts if v.why}
    if not candidates:
        return Identification(None, (), refuted, np.zeros((6, 0)), "no kind explains it", start, stop)
    moved, pushed, unexcited = _excitation(candidates[0], samples)
    reason = _undecided(candidates, moved, pushed, unexcited.shape[1])
    return Identification(None if reason else candidates[0].kind, candidates, refuted, unexcited, reason, start, stop)


def _candidates(samples: Samples, verdicts: list[Verdict], every: Samples) -> tuple[Candidate, ...]:
    """The kinds that are not refuted, fitted to every sample, the most constrained first."""
    size = float(np.sqrt(samples.pose[:, :3, 3].var(axis=0).sum()))
    made = []
    for v in sorted((v for v in verdicts if not v.why), key=lambda v: (v.model.freedoms, v.fit.motion)):
        start = v.fit.base, v.fit.tool, v.fit.extra
        found = fit(v.model, every.reversed if v.reversed else every, start)
        # A place is well known or not by the motion, or by the arm that turns.
        length = max(size, 1e-3 * float(np.linalg.norm(found.tool[:3, 3])), 1e-12)
        made.append(candidate(found, v.reversed, v.press, length))
    return tuple(made)


def _undecided(candidates: tuple[Candidate, ...], moved: int, pushed: int, unexcited: int) -> str:
    """Why the first of the candidates is not the only one that can be meant; "" where it is."""
    best = candidates[0]
    k = best.contact_kind.freedoms.shape[1]
    if moved < k or (pushed < 6 - k and len(candidates) > 1):
        names = ", ".join(dict.fromkeys(c.kind for c in candidates))
        return (
            f"{unexcited} twists were neither moved along nor pushed against, and {names} differ in them: "
            "move the tool along every way it gives, push and pull the others"
        )
    pressed = next((c.kind for c in candidates if MODELS[c.kind].pressed), best.kind)
    if pressed != best.kind and not MODELS[best.kind].pressed:
        return f"a {best.kind}, or a {pressed} held by friction: pull it as well, and push sideways"
    return ""


def _excitation(candidate_: Candidate, samples: Samples) -> tuple[int, int, Array]:
    """How many of a contact's freedoms moved, how many of its constraints were pushed, and (6, u) twists of neither.

    A push is what is left of the wrench in the constraints beside what goes with the wrench in the freedoms: friction,
    and its moments about the origin, do not count.
    """
    S, W = (np.asarray(a) for a in (candidate_.contact_kind.freedoms, candidate_.contact_kind.constraints))
    frames = np.array([candidate_.frame(X) for X in samples.pose])
    to_contact = inverse(frames) @ samples.pose
    B = coadjoint(to_contact)
    w = applied(B, samples.wrench)
    noise = propagated(B, samples.wrench_noise).mean(axis=0)
    P = np.linalg.inv(noise)
    parts = np.linalg.solve(W.T @ P @ W, W.T @ P @ w.T).T
    friction = w @ S
    G = friction.T @ friction + len(w) * S.T @ noise @ S
    slope = np.linalg.solve(G, friction.T @ parts).T
    parts = parts - friction @ slope.T
    spread: Array = np.asarray(np.linalg.inv(W.T @ P @ W)) + slope @ (S.T @ noise @ S) @ slope.T
    pushes, directions = _above(parts.T @ parts / len(parts), spread)
    middle = len(frames) // 2
    xi = applied(adjoint(to_contact[middle]), twists(inverse(samples.pose[middle]) @ samples.pose))
    Q = np.linalg.inv(propagated(adjoint(to_contact[middle]), samples.pose_noise[middle]))
    along = np.linalg.solve(S.T @ Q @ S, S.T @ Q @ xi.T).T
    along = along - along.mean(axis=0)
    moves, ways = _above(along.T @ along / len(along), np.asarray(np.linalg.inv(S.T @ Q @ S)))
    # Left: what the pushes do no work on, across what moved in the metric of the noise.
    root: Array = np.asarray(np.linalg.cholesky(Q))
    free = orthogonal(np.asarray(np.linalg.solve(root, W @ directions))) if pushes else np.eye(6)  # columns root' t
    across = free @ orthogonal(free.T @ root.T @ S @ ways) if moves else free
    unexcited = adjoint(frames[middle]) @ np.linalg.solve(root.T, across)
    return moves, pushes, unexcited / np.maximum(np.linalg.norm(unexcited, axis=0), 1e-300)


def _above(moment: Array, noise: Array) -> tuple[int, Array]:
    """How many directions of a second moment are above noise, and these as columns of coefficients."""
    root = np.linalg.cholesky(noise)
    half = np.linalg.solve(root, np.linalg.solve(root, moment).T)
    values, vectors = np.linalg.eigh(0.5 * (half + half.T))
    above = values > EXCITED
    return int(above.sum()), np.asarray(root @ vectors[:, above])
