"""Whether two runs rank the methods alike: Spearman's rank correlation of their median times.

rho = 1 - 6 sum d^2 / (n (n^2 - 1)),   d the difference of a method's ranks; with ties, Pearson's of the ranks
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import spearmanr

from invariantqp.compare.results import Results, results_of


def rank_agreement(one: Results, other: Results) -> dict[str, float]:
    """{measurement, task and sort of states: rho} over the methods that both runs timed, if there are three or more."""
    found = {}
    for kind in ("time", "tick"):
        a, b = _medians(results_of(one, kind)), _medians(results_of(other, kind))
        for place in sorted(set(a) & set(b)):
            names = sorted(set(a[place]) & set(b[place]))
            if len(names) > 2:
                rho = spearmanr([a[place][n] for n in names], [b[place][n] for n in names]).statistic
                if np.isfinite(rho):
                    found[f"{kind}, {place}"] = float(rho)
    return found


def _medians(results: dict[tuple[str, str], dict[str, Any]]) -> dict[str, dict[str, float]]:
    """{task and sort of states: {method: median time}}."""
    table: dict[str, dict[str, float]] = {}
    for (task, method), result in results.items():
        sorts = {"": result} if "median_us" in result else {f", {k}": v for k, v in result.items()}
        for sort, figures in sorts.items():
            if isinstance(figures, dict) and figures.get("median_us") is not None:
                table.setdefault(task + sort, {})[method] = figures["median_us"]
    return table
