"""results.json: everything that a comparison measured; charts, tables and page are made from it.

    {"schema": 2, "machine": {...}, "versions": {...}, "seed": 0, "quick": false,
     "kinematics": "Pinocchio", "methods": [{"name": ..., "family": ..., "about": ..., "setting": {...}}, ...],
     "tasks": [{"name": "panda/free", "arm": "panda", "kind": "free"}, ...],
     "runs": [{"task": "panda/free", "method": "DLS", "figures": {...}}, ...]}

A figure that is not finite is null. The figures of a run that failed are {"failed": "why"}.
"""

from __future__ import annotations

import json
import math
import os
import platform
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from invariantqp.extras import is_installed
from invariantqp.version import __version__
from invariantqp.workbench.compare.figures import CHANGES, Figures, dominates
from invariantqp.workbench.compare.method import OURS, Method
from invariantqp.workbench.compare.tasks import BedTask
from invariantqp.workbench.writing import write_text

SCHEMA = 2
# Distributions that may change a result, besides those of the methods.
LIBRARIES = ("numpy", "scipy", "pin", "daqp", "mujoco")
Results = dict[str, Any]


class TaskRuns(NamedTuple):
    """The runs on one task."""

    name: str
    kind: str
    runs: dict[str, Figures]  # by method, without those that failed

    @property
    def is_compared(self) -> bool:
        """Whether dominance counts."""
        return self.kind not in CHANGES

    def dominating(self, name: str) -> list[str]:
        """The methods that dominate one; none if dominance does not count."""
        return [other for other in self.runs if self.is_compared and dominates(self.runs[other], self.runs[name])]


def collect(
    methods: Sequence[Method],
    versions: dict[str, str],
    measured: Sequence[tuple[BedTask, dict[str, Figures]]],
    *,
    seed: int,
    quick: bool,
) -> Results:
    """The content of results.json."""
    rows = [
        {**{k: getattr(m, k) for k in ("name", "family", "about")}, "setting": m.setting._asdict()} for m in methods
    ]
    theirs = {m.distribution: versions[m.name] for m in methods if versions[m.name]}
    return {
        "schema": SCHEMA,
        "machine": machine(),
        "versions": own_versions() | theirs,
        "seed": seed,
        "quick": quick,
        "kinematics": "Pinocchio" if is_installed("pinocchio") else OURS,
        "methods": rows,
        "tasks": [{key: getattr(task, key) for key in ("name", "arm", "kind")} for task, _ in measured],
        "runs": [
            {"task": task.name, "method": name, "figures": plain(run)}
            for task, runs in measured
            for name, run in runs.items()
        ],
    }


def measured(results: Results) -> list[TaskRuns]:
    """The runs, task by task."""
    runs: dict[str, dict[str, Figures]] = {task["name"]: {} for task in results["tasks"]}
    for run in results["runs"]:
        if "failed" not in run["figures"]:
            runs[run["task"]][run["method"]] = run["figures"]
    return [TaskRuns(task["name"], task["kind"], runs[task["name"]]) for task in results["tasks"]]


def failures(results: Results) -> list[tuple[str, str, str]]:
    """(method, task, why) of the runs that failed."""
    failed = [run for run in results["runs"] if "failed" in run["figures"]]
    return [(run["method"], run["task"], run["figures"]["failed"]) for run in failed]


def tick_us(tasks: Sequence[TaskRuns], name: str) -> tuple[float, float]:
    """Median and 99th percentile of a method's ticks [us]: medians over tasks."""
    runs = [task.runs[name] for task in tasks if name in task.runs]
    times = [[run["us"], run["us_p99"]] for run in runs] or [[math.nan, math.nan]]
    median, p99 = np.median(times, axis=0).tolist()
    return median, p99


def write_results(file: Path, results: Results) -> None:
    """Write results, a run a line, so that two files can be compared by lines."""
    lines = ",\n  ".join(json.dumps(run, allow_nan=False, separators=(",", ":")) for run in results["runs"])
    head = json.dumps({key: value for key, value in results.items() if key != "runs"}, indent=1, allow_nan=False)
    write_text(file, f'{head[:-2]},\n "runs": [\n  {lines}\n ]\n}}\n')


def plain(figures: Figures) -> Figures:
    """Figures as JSON: null if not finite, else four digits; repeated measurements do not agree to more."""
    return {key: _plain(value) for key, value in figures.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.4g}") if math.isfinite(value) else None
    return value


def machine() -> dict[str, str | int]:
    """Processor, number of cores, operating system, and version of Python."""
    info = Path("/proc/cpuinfo")  # Linux; elsewhere `platform` has the name
    lines = info.read_text(encoding="utf-8", errors="replace").splitlines() if info.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "processor": (names or [platform.processor() or platform.machine()])[0],
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def own_versions() -> dict[str, str]:
    """Versions of this package and of the installed ones of LIBRARIES."""
    found = {"invariantqp": __version__}
    for name in LIBRARIES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found
