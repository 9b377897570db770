"""Whether two runs rank the methods alike: Spearman's rank correlation of their median times.

rho = 1 - 6 sum d^2 / (n (n^2 - 1)),   d the difference of a method's ranks; with ties, Pearson's of the ranks
"""

from __future__ import annotations

import numpy as np

from invariantqp.compare.results import Results, results_of


def rank_agreement(one: Results, other: Results) -> dict[str, float]:
    """{task: rho} over the methods that both runs timed, if there are three or more."""
    from scipy.stats import spearmanr  # half a second

    a, b = _medians(one), _medians(other)
    found = {}
    for task in sorted(set(a) & set(b)):
        names = sorted(set(a[task]) & set(b[task]))
        if len(names) > 2:
            rho = spearmanr([a[task][n] for n in names], [b[task][n] for n in names]).statistic
            if np.isfinite(rho):
                found[task] = float(rho)
    return found


def _medians(results: Results) -> dict[str, dict[str, float]]:
    """{task: {method: median time}}."""
    table: dict[str, dict[str, float]] = {}
    for (task, method), result in results_of(results, "tick").items():
        if result["median_us"] is not None:
            table.setdefault(task, {})[method] = result["median_us"]
    return table
