"""Every block of the README as a newcomer pastes it: in fresh sources, with what it names and nothing else.

A block of shell is run as it stands. Python is run block by block, each after those before it, where what its comments
name is installed. The block marked "test" is left out: it is what `.ci/run` begins with.

Run: PYTHONPATH=tests python .ci/readme.py
"""

import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

from support.readme import blocks, in_python

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
INSTALL = "python3 -m venv .venv\n.venv/bin/pip install --quiet -e {}\n"
INSTALLED = re.compile(r"pip install --quiet -e '?\.(?:\[([\w,]+)\])?")
# A newcomer has nothing of the environment that this runs in.
CLEAN = {name: value for name, value in os.environ.items() if not re.match("VIRTUAL_ENV|PYTHON|INVARIANTQP", name)}


def fresh(folder: Path) -> Path:
    """The sources as a clone has them, with changes that are not committed yet."""
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    for name in names:
        if (ROOT / name).is_file():  # and not deleted
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    return folder


def run(block: str, folder: Path, *command: str) -> None:
    """Run a command in a folder, and print its block and what it said; the first that fails ends this."""
    before = perf_counter()
    done = subprocess.run(
        command, cwd=folder, env=CLEAN, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    print(f"\n{block}--> {perf_counter() - before:.0f} s\n{done.stdout}", end="", flush=True)
    if done.returncode:
        sys.exit(f"this block of the README left with status {done.returncode}")


def main(scratch: Path) -> None:
    """Run all blocks."""
    shell = [block.code for block in blocks(README) if not block.language and block.mark != "test"]
    python = in_python(README)
    installs = [(INSTALLED.search(code), code) for code in shell]
    places = {found[1] or "": code for found, code in installs if found}  # by the extras that are installed
    places |= {
        extras: INSTALL.format(f"'.[{extras}]'" if extras else ".") for _, _, extras in python if extras not in places
    }
    folders = {code: fresh(scratch / str(number)) for number, code in enumerate({*shell, *places.values()})}
    with ThreadPoolExecutor() as pool:  # installing waits for disk and network
        list(pool.map(lambda code: run(code, folders[code], "bash", "-euo", "pipefail", "-c", code), folders))
    for block, code, extras in python:
        run(block, folders[places[extras]], ".venv/bin/python", "-W", "error", "-c", code)


if __name__ == "__main__":
    with TemporaryDirectory() as scratch:
        main(Path(scratch))
