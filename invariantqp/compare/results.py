"""results.json: everything that a sweep measured, and all that charts and report read.

    {"schema": 1, "machine": {...}, "versions": {...}, "kinematics": "Pinocchio", "seed": 0, "quick": false,
     "tasks": [...], "methods": [Method.as_json(), ...],
     "cells": [{"kind": "loop", "task": "compare/panda_limits", "method": "DLS", "result": {...}}, ...]}

A figure that is not finite is null. A measurement that failed has the result {"failed": "why"}: charts leave it out,
and the report lists it.
"""

from __future__ import annotations

import json
import math
import os
import platform
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from invariantqp.version import __version__

SCHEMA = 1
# Distributions whose version may change a result: solvers, the methods' own, references, and models of arms.
SOLVERS, OTHERS = ("daqp", "osqp", "qpsolvers"), ("pin-pink", "mink", "placo", "drake", "mujoco", "example-robot-data")
LIBRARIES = ("numpy", "scipy", "pin", *SOLVERS, *OTHERS)

Results = dict[str, Any]


def write_results(file: Path, results: Results) -> None:
    """Write `plain` results with one cell in a line, so that two files can be compared line by line.

    The file appears complete or not at all, even if the program is interrupted.
    """
    lines = ",\n  ".join(json.dumps(cell, allow_nan=False, separators=(",", ":")) for cell in results["cells"])
    head = json.dumps({key: value for key, value in results.items() if key != "cells"}, indent=1, allow_nan=False)
    part = file.with_suffix(".part")
    part.write_text(f'{head[:-2]},\n "cells": [\n  {lines}\n ]\n}}\n', encoding="utf-8")
    part.replace(file)


def plain(value: Any) -> Any:
    """The value as JSON has it: null for a figure that is not finite, four significant digits for every other one.

    Repeated measurements do not agree to more.
    """
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.4g}") if math.isfinite(value) else None
    return value


def results_of(results: Results, kind: str) -> dict[tuple[str, str], dict[str, Any]]:
    """{(task, method): result} of one measurement, without those that failed."""
    return {
        (cell["task"], cell["method"]): cell["result"]
        for cell in results["cells"]
        if cell["kind"] == kind and "failed" not in cell["result"]
    }


def kinds_in(results: Results) -> dict[str, None]:
    """The measurements that the results contain, in their order."""
    return dict.fromkeys(cell["kind"] for cell in results["cells"])


def machine() -> dict[str, str | int]:
    """Processor, number of cores, operating system, and version of Python."""
    info = Path("/proc/cpuinfo")  # where the system's name of the processor is a family's
    lines = info.read_text(encoding="utf-8", errors="replace").splitlines() if info.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "processor": (names or [platform.processor() or platform.machine()])[0],
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def versions() -> dict[str, str]:
    """The version of this package and of each library above that is installed."""
    found = {"invariantqp": __version__}
    for name in LIBRARIES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found
