"""What measured times depend on besides the code: the machine and the versions of libraries, but no names or paths."""

from __future__ import annotations

import hashlib
import os
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from invariantqp.version import __version__

# Distributions whose version may change a result: solvers, the methods' own, references, and models of arms.
LIBRARIES = (
    "numpy",
    "scipy",
    "pin",
    "daqp",
    "osqp",
    "qpsolvers",
    "pin-pink",
    "mink",
    "placo",
    "drake",
    "mujoco",
    "mpmath",
    "example-robot-data",
)


@cache
def machine() -> dict[str, str | int]:
    """Processor, number of cores, operating system, and version of Python."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def _processor() -> str:
    """The name of the processor as the operating system gives it."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


@cache
def versions() -> dict[str, str]:
    """The version of this package and of each library above that is installed."""
    found = {"invariantqp": __version__}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


@cache
def source_digest() -> str:
    """A digest of the source of this package: after a change everything is measured again."""
    digest = hashlib.sha256()
    root = Path(__file__).parents[2]
    for file in sorted(root.rglob("*.py")):
        digest.update(file.relative_to(root).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()
