"""Environments for libraries that exclude one another: each has NumPy and one of them, in a folder of the user's cache.

`invariantqp compare --setup` makes them: about 2 GB.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path


def folder() -> Path:
    """Where the environments are."""
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "invariantqp" / "compare"


def python_of(environment: str) -> str | None:
    """The Python of an environment, "" being this one; None where it has not been made."""
    if not environment:
        return sys.executable
    place = folder() / environment
    found = [python for python in (place / "bin" / "python", place / "Scripts" / "python.exe") if python.exists()]
    return str(found[0]) if found else None


def make(environment: str, distribution: str) -> str:
    """Make an environment, or bring what it has up to date: "", or why it could not be made; then it is removed."""
    place = folder() / environment
    venv = ["-m", "venv", str(place)]
    pip = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--upgrade", "numpy", distribution]
    for words in (pip,) if python_of(environment) else (venv, pip):
        python = sys.executable if words is venv else python_of(environment)
        done = subprocess.run([str(python), *words], capture_output=True, text=True, check=False)  # noqa: S603
        if done.returncode:
            shutil.rmtree(place, ignore_errors=True)
            return (done.stderr.strip() or done.stdout.strip() or "no reason given").splitlines()[-1]
    return ""
