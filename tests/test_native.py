"""Which engine an installation has, and how it is switched off."""

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
from invariantqp.engine import core, engine

PYTHON = (
    "import invariantqp as iq; from invariantqp.engine import engine; "
    "print(iq.native, iq.solve_velocity([[1]] + 5 * [[0]], [1, 0, 0, 0, 0, 0]).velocity, engine)"
)


def run(*command, folder=None, check=True, **environment):
    environment = {**os.environ, **environment}
    command = [sys.executable, *command]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=check)


def told(*command, **environment):
    return run(*command, **environment).stdout.strip()


def test_native_tells_whether_there_is_a_core():
    assert iq.native is (core is not None)
    assert (engine == "compiled core") is iq.native


def test_the_environment_switches_it_off():
    assert told("-c", PYTHON, INVARIANTQP_NATIVE="0") == "False [1.] pure Python: INVARIANTQP_NATIVE=0"


@pytest.mark.parametrize("name", ["_core", "_native"])
def test_the_core_is_part_of_the_package(name):
    assert Path(import_module(f"invariantqp.{name}").__file__).parent == Path(iq.__file__).parent


@pytest.mark.parametrize(("name", "used"), [("_native", "solve_pose"), ("_core", "solve_velocity")])
def test_sources_that_were_not_compiled_say_what_to_do(tmp_path, name, used):
    """As in a clone, where the folder hides what is installed; an editable installation would be found before it."""
    without = shutil.ignore_patterns(f"{name}*.so", f"{name}*.pyd")
    shutil.copytree(Path(iq.__file__).parent, tmp_path / "invariantqp", ignore=without)
    done = run("-c", f"import invariantqp as iq; iq.{used}", folder=tmp_path, check=False, INVARIANTQP_NATIVE="1")
    said = f"ImportError: the compiled core of invariantqp in {tmp_path} cannot be imported (No module named "
    assert said in done.stderr
    assert "run there: pip install -e . " in done.stderr


@pytest.mark.skipif(
    core is None or not LONG or shutil.which("valgrind") is None, reason="long; needs a core and Valgrind"
)
def test_the_core_decides_nothing_by_memory_that_was_never_written():
    """Sanitizers do not see it; a tick's answer once hung on what lay there. Python's own complaints are left out."""
    tests, root = Path(__file__).parent, Path(iq.__file__).parents[1]
    done = subprocess.run(
        ["valgrind", "--error-limit=no", sys.executable, "-m", "support.every_tick"],
        env={**os.environ, "PYTHONMALLOC": "malloc", "PYTHONPATH": os.pathsep.join((str(root), str(tests)))},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    complaints = re.split(r"==\d+== \n", done.stderr)
    ours = [each for each in complaints if re.search(r" at 0x\w+: \w+ \(in .*_native", each)]
    assert len(complaints) > 1
    assert not ours, ours[0]
