"""Many states of an arm, spread over its joint range: what is true of the arm, not of one state.

    x_k = frac(x_0 + k a),   a_i = 1 / phi^i,   phi^(m+1) = phi + 1     (evenly spread, the same in every run)

Reference: the sequence is Roberts', a generalisation of the golden ratio's to m dimensions.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot, cached_for, joint_ranges
from invariantqp.systems.report import describe


@dataclass(frozen=True, eq=False)
class Survey:
    """Many states of an arm.

    Attributes:
        q: (n, m) joint positions.
        rank: (n,).
        types: (n,) Gibson-Hunt names.
        pitches: (n, 6) principal pitches, ascending, NaN where there are fewer [length/rad].
        blind: (n,) number of blind directions; above zero no pitch works in that state.
        distance: (n,) from a singularity, as `SystemReport.singularity_distance`.
    """

    q: Array
    rank: Array
    types: tuple[str, ...]
    pitches: Array
    blind: Array
    distance: Array

    @property
    def attainable_rank(self) -> int:
        """The largest rank of any state."""
        return int(self.rank.max())

    @property
    def regular(self) -> Array:
        """(n,) bool: the states of that rank."""
        return np.asarray(self.rank == self.attainable_rank)

    @property
    def blind_share(self) -> float:
        """Share of the regular states in which no pitch works."""
        return float(np.mean(self.blind[self.regular] > 0))

    @property
    def all_pitches(self) -> Array:
        """Every principal pitch of every regular state, in no order."""
        pitches = self.pitches[self.regular]
        return np.asarray(pitches[np.isfinite(pitches)])

    def as_json(self) -> dict[str, Any]:
        """Statistics; SI units."""
        n = len(self.rank)
        finite = self.all_pitches
        return {
            "count": n,
            "ranks": {str(k): c / n for k, c in sorted(Counter(self.rank.tolist()).items(), reverse=True)},
            "types": {name: c / n for name, c in Counter(self.types).most_common()},
            "blind_share": self.blind_share,
            "principal_pitches": _quantiles(finite) if len(finite) else None,
            "singularity_distance": _quantiles(self.distance),
        }


def _quantiles(values: Array) -> dict[str, float]:
    names = {"min": 0.0, "p05": 0.05, "median": 0.5, "p95": 0.95, "max": 1.0}
    return {name: float(np.quantile(values, share)) for name, share in names.items()}


def spread(robot: Robot, samples: int, origin: Array | float = 0.5) -> Array:
    """(n, m) joint positions spread evenly over the joint range; x_0, in [0, 1), is where the sequence begins."""
    low, high = cached_for(robot, "ranges", joint_ranges)
    m = len(low)
    phi = max(np.roots([1.0, *[0.0] * (m - 1), -1.0, -1.0]).real)
    share = (origin + np.arange(1.0, samples + 1.0)[:, None] * phi ** -np.arange(1.0, m + 1.0)) % 1.0
    return np.asarray(low + share * (high - low))


def survey(robot: Robot, q: Array) -> Survey:
    """Describe the arm in each of (n, m) states."""
    reports = [describe(robot.jacobian(state)) for state in q]
    pitches = np.full((len(q), 6), np.nan)
    for row, report in zip(pitches, reports, strict=True):
        row[: len(report.principal_pitches)] = report.principal_pitches
    return Survey(
        q=q,
        rank=np.array([report.rank for report in reports]),
        types=tuple(str(report.type) for report in reports),
        pitches=pitches,
        blind=np.array([report.blind_directions.shape[1] for report in reports]),
        distance=np.array([report.singularity_distance for report in reports]),
    )
