"""The compiled engine of an installation."""

import os
import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from support.repeats import LONG

import invariantqp as iq


def run(*command, folder=None, check=True, **environment):
    environment = {**os.environ, **environment}
    command = [sys.executable, *command]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=check)


def test_the_engine_is_part_of_the_package():
    assert iq.native is True
    assert Path(import_module("invariantqp._core").__file__).parent == Path(iq.__file__).parent


def test_sources_that_were_not_compiled_say_what_to_do(tmp_path):
    """As in a clone, where the folder hides what is installed; an editable installation would be found before it."""
    without = shutil.ignore_patterns("_core*.so", "_core*.pyd")
    shutil.copytree(Path(iq.__file__).parent, tmp_path / "invariantqp", ignore=without)
    done = run("-c", "import invariantqp as iq; iq.solve_velocity", folder=tmp_path, check=False)
    said = f"ImportError: the compiled engine of invariantqp in {tmp_path} cannot be imported (No module named "
    assert said in done.stderr
    assert "run there: pip install -e . " in done.stderr


@pytest.mark.skipif(not LONG or shutil.which("valgrind") is None, reason="long; needs Valgrind")
def test_the_engine_decides_nothing_by_memory_that_was_never_written():
    """Sanitizers do not see it; a tick's answer once hung on what lay there. Python's own complaints are left out."""
    tests, root = Path(__file__).parent, Path(iq.__file__).parents[1]
    done = subprocess.run(
        ["valgrind", "--error-limit=no", sys.executable, "-m", "support.every_tick"],
        env={**os.environ, "PYTHONMALLOC": "malloc", "PYTHONPATH": os.pathsep.join((str(root), str(tests)))},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    complaints = re.split(r"==\d+== \n", done.stderr)
    ours = [each for each in complaints if re.search(r" at 0x\w+: \w+ \(in .*_core", each)]
    assert len(complaints) > 1
    assert not ours, ours[0]
