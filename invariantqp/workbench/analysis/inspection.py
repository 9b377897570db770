"""An arm before it moves: one state, its joint range, and the pitch to split twists by.

The state: rank, type, principal pitches, blind directions, distance from a singularity (`systems.describe`). The range:
the same in many states (`analysis.survey`), because one pitch is chosen for all of them (`analysis.recommendation`).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, written
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot, middle
from invariantqp.systems import SystemReport, centre, describe
from invariantqp.workbench.analysis.recommendation import MAX_NORM, Recommendation, recommend, smallest_norm
from invariantqp.workbench.analysis.survey import Survey, spread, survey


@dataclass(frozen=True, eq=False)
class Inspection:
    """An arm in one state and over its range: in words (`use_words`, `state_words`, `range_words`) or as JSON.

    Attributes:
        robot: name, as given.
        tool: name of the tool frame.
        joints: joint names, base first.
        q: (m,) joint positions of the state [rad, length].
        where: how that state was chosen.
        report: the screw system in that state.
        survey: the joint range.
        own_length: the arm's own length in the middle of its range [length/rad]: inf if no joint turns, 0 if all axes
            meet.
        norm: the smallest |P_h| of the candidate pitches in this state.
        recommended: the pitch to split twists by, if any serves.
        unlimited: names of the joints without a velocity limit.
        notes: joints that the reader of the robot's description fixed, coupled or left out.
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
        """How to configure a controller of this arm, one fact a sentence."""
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
        rank = self.survey.attainable_rank
        if self.report.rank < rank:
            regular = _percent(self.survey.regular)
            note = f"That is this state, not the arm: its rank is {rank} in {regular} of the range."
            sentences = (sentences[0], note, *sentences[1:])
        elif self.report.singular:
            sentences = (*sentences, "No state does better: the joints are redundant, this is no singularity.")
        if self.norm > MAX_NORM and not self.report.blind_directions.shape[1]:
            sentences = (
                *sentences,
                f"But no pitch tried is useful here: its error is up to {self.norm:.2g} times the least-squares one.",
            )
        return sentences

    def range_words(self) -> tuple[str, ...]:
        """The range, one fact a sentence."""
        sampled = self.survey
        ranks = Counter(sampled.rank.tolist()).most_common()
        shares = ", ".join(f"{k} in {_percent(sampled.rank == k)}" for k, _ in ranks)
        median, least = float(np.median(sampled.distance)), float(sampled.distance.min())
        sentences = [f"Rank {shares}; {median:.2g} away from a singularity at the median, {least:.2g} at least."]
        pitches = sampled.all_pitches
        if sampled.attainable_rank < 6 and len(pitches):
            low, middle_low, middle_high, high = np.quantile(pitches, (0.0, 0.25, 0.75, 1.0)).tolist()
            if written(high - low, 1) == "0":
                sentences.append(f"The principal pitch is {written(low)} in every state: stay away from it.")
            else:
                sentences.append(
                    f"Principal pitches from {written(low, 3)} to {written(high, 3)}, half of them between "
                    f"{written(middle_low, 3)} and {written(middle_high, 3)}: pitches to stay away from."
                )
        if sampled.attainable_rank < 6 and sampled.blind_share > 0.0:
            share = f"{100.0 * sampled.blind_share:.3g} % of its regular states"
            sentences.append(f"No pitch works in {'any state' if sampled.blind_share == 1.0 else share}.")
        return tuple(sentences)

    def as_json(self) -> dict[str, Any]:
        """The values of `invariantqp inspect --json`: SI units, screws as (omega; v)."""
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
                "unseen": None
                if advice.q is None
                else {"q": advice.q.tolist(), "twists": advice.blind_twists.T.tolist()},
            },
            "samples": self.survey.as_json(),
        }


def inspect(robot: Robot, *, name: str = "robot", q: ArrayLike | None = None, samples: int = 64) -> Inspection:
    """Inspect an arm in one state and over its joint range.

    Args:
        robot: from `load_robot`, or any `Robot`.
        name: its name in the result.
        q: (m,) joint positions [rad, length]; None is the middle of each range or, if that is singular, the
            sampled state farthest from singularities.
        samples: number of states of the joint range; 64 take some 50 ms.
    """
    mid = middle(robot)
    state, where = mid, "in the middle of the joint range"
    if q is not None:
        state, where = arrays.joint_vector(q, robot.names, "q"), "at the joint positions given"
    if not arrays.count(samples, "samples", arrays.LARGEST_COUNT):
        raise BadInput("samples", "0", "one or more")
    report = describe(robot.jacobian(state))
    sampled = survey(robot, spread(robot, samples))
    if q is None and report.rank < sampled.attainable_rank:
        state = sampled.q[int(np.where(sampled.regular, sampled.distance, -1.0).argmax())]
        report = describe(robot.jacobian(state))
        where = "in a regular state, since the middle of the joint range is singular"
    advice = recommend(robot, sampled.q)
    return Inspection(
        robot=name,
        tool=str(getattr(robot, "tool", "tool_point")),
        joints=tuple(robot.names),
        q=state,
        where=where,
        report=report,
        survey=sampled,
        own_length=centre(robot.jacobian(mid)).length,
        norm=smallest_norm(robot, state, advice.length),
        recommended=advice,
        unlimited=tuple(name for name, v in zip(robot.names, robot.velocity_limit, strict=True) if not isfinite(v)),
        notes=getattr(robot, "notes", ()),
    )


def _percent(flags: Array) -> str:
    return f"{100.0 * float(np.mean(flags)):.3g} %"
