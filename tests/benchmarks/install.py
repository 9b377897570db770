"""How long the install takes and how large it is, with the compiled core and without.

    python tests/benchmarks/install.py

Each wheel is built from the sources here and installed in a fresh environment without its dependencies, which are the
same for both; `CC=/bin/false` leaves the core out. Needs the build dependencies of `pyproject.toml` (the extra `dev`).
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from time import perf_counter

ROOT = Path(__file__).resolve().parents[2]


def installed(folder, **variables):
    """Seconds of the build, of its processes and of the install; bytes of the wheel and installed; the wheel's name."""
    python = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    environment = os.environ | variables
    start, before = perf_counter(), os.times()
    build = [*python, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, str(ROOT)]
    subprocess.run(build, check=True, env=environment)
    built, after = perf_counter(), os.times()
    busy = after.children_user + after.children_system - before.children_user - before.children_system
    wheel = next(Path(folder).glob("*.whl"))
    target = Path(folder) / "environment"
    venv.create(target)
    start_install = perf_counter()
    install = [*python, "--python", str(target / "bin" / "python"), "install", "--no-deps", str(wheel)]
    subprocess.run(install, check=True)
    done = perf_counter()
    package = next(target.glob("lib/*/site-packages/invariantqp"))
    files = [file for file in package.rglob("*") if file.is_file() and file.suffix != ".pyc"]
    return (
        built - start,
        busy,
        done - start_install,
        wheel.stat().st_size,
        sum(file.stat().st_size for file in files),
        wheel,
    )


def main():
    print("| | build | its CPU time | install | wheel | installed |\n|---|---|---|---|---|---|")
    for title, variables in (("with the core", {}), ("without", {"CC": "/bin/false"})):
        with tempfile.TemporaryDirectory() as folder:
            build, busy, install, wheel, size, name = installed(folder, **variables)
        sizes = f"{wheel / 1e6:.2f} MB | {size / 1e6:.2f} MB"
        print(f"| {title} ({name}) | {build:.1f} s | {busy:.1f} s | {install:.1f} s | {sizes} |", flush=True)


if __name__ == "__main__":
    main()
