"""Python environments for libraries that exclude one another: NumPy and one library each, in the user's cache folder.

`invariantqp compare --setup` makes them: about 2 GB.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path


def folder() -> Path:
    """The folder of the environments."""
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "invariantqp" / "compare"


def python_of(environment: str) -> str | None:
    """The Python of an environment, "" being this one; None if it does not exist."""
    if not environment:
        return sys.executable
    place = folder() / environment
    candidates = (place / "bin" / "python", place / "Scripts" / "python.exe")
    return next((str(python) for python in candidates if python.exists()), None)


def make(environment: str, distribution: str) -> str:
    """Make or update an environment: "", or why that failed; the environment is then removed."""
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
