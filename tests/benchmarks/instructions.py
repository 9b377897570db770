"""How many instructions the compiled core executes in a tick, by Valgrind: a count that does not depend on load.

    python tests/benchmarks/instructions.py

Needs `valgrind` (the Debian package of that name) and a minute or two. What is counted is the core's `step_beside`,
from joint positions and target to velocity, limits and memory of the loop, with what it calls of the C library; the
conversion of Python's arguments is not.
"""

from __future__ import annotations

import pickle
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import invariantqp as iq

CASES = (
    ("Panda, free", "compare/panda_limits", {}, False),
    ("Panda, limits met", "compare/panda_limits", {}, True),
    ("SO-101, exact position", "so101_line", {"exact": "position"}, False),
    ("SO-101, exact position, limits met", "stability/limit_all_along", {"exact": "position"}, True),
)
TICKS = 50


def run(file):
    """The ticks of a file, where Valgrind counts."""
    name, options, ticks = pickle.loads(Path(file).read_bytes())
    task = iq.load_task(name)
    controller = iq.Controller(task.load_robot(), dt=task.law.dt, **options)
    for tick in ticks:
        controller.step(*tick)


def counted(name, options, *, limited):
    """Instructions in one tick, on average."""
    from table import ticks_of

    _, found, _ = ticks_of(iq.load_task(name), lambda s: bool(s.active) == limited, **options)
    ticks = [(q, target.homogeneous, ahead) for q, target, ahead in found[:TICKS]]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "ticks"
        file.write_bytes(pickle.dumps((name, options, ticks)))
        command = ["valgrind", "--tool=callgrind", "--collect-atstart=no", "--toggle-collect=step_beside"]
        command += [f"--callgrind-out-file={folder}/out", sys.executable, __file__, str(file)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    return int(re.search(r"Collected : (\d+)", done.stderr)[1]) / len(ticks)


def main():
    print("| tick | instructions |\n|---|---|")
    for title, name, options, limited in CASES:
        print(f"| {title} | {counted(name, options, limited=limited):,.0f} |", flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        run(sys.argv[1])
    else:
        main()
