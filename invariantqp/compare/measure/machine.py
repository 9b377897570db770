"""What figures depend on besides the code: the machine and the libraries, without a name or a path of anyone's."""

from __future__ import annotations

import hashlib
import os
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from invariantqp.version import __version__

# Distributions whose releases move figures.
LIBRARIES = (
    "numpy",
    "scipy",
    "pin",
    "daqp",
    "osqp",
    "qpsolvers",
    "proxsuite",
    "piqp",
    "quadprog",
    "clarabel",
    "highspy",
    "cvxpy",
    "pin-pink",
    "mink",
    "roboticstoolbox-python",
    "mujoco",
    "mpmath",
)


@cache
def machine() -> dict[str, str | int]:
    """Processor, cores, system, Python."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def _processor() -> str:
    """The processor's name, where the system tells it."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


@cache
def versions() -> dict[str, str]:
    """The release of this package and of every library that is installed."""
    found = {"invariantqp": __version__}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


@cache
def source_digest() -> str:
    """A digest of this package's own source: a changed law is measured again."""
    digest = hashlib.sha256()
    root = Path(__file__).parents[2]
    for file in sorted(root.rglob("*.py")):
        digest.update(file.relative_to(root).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()
