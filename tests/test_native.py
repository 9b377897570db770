"""Which engine an installation has, and how it is switched off."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.repeats import LONG

import invariantqp as iq
from invariantqp.engine import core, engine

PYTHON = (
    "import invariantqp as iq; from invariantqp.engine import engine; "
    "print(iq.native, iq.solve_velocity([[1]] + 5 * [[0]], [1, 0, 0, 0, 0, 0]).velocity, engine)"
)


def run(*command, folder=None, **environment):
    environment = {**os.environ, **environment}
    command = [sys.executable, *command]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)


def told(*command, **environment):
    return run(*command, **environment).stdout.strip()


def test_native_tells_whether_there_is_a_core():
    assert iq.native is (core is not None)
    assert (engine == "compiled core") is iq.native


def test_the_environment_switches_it_off():
    assert told("-c", PYTHON, INVARIANTQP_NATIVE="0") == "False [1.] pure Python: INVARIANTQP_NATIVE=0"


@pytest.mark.skipif(core is None, reason="no compiled core here")
def test_the_core_is_part_of_the_package():
    assert Path(core.__file__).parent == Path(iq.__file__).parent


def test_without_a_core_everything_is_there():
    code = "import sys; sys.modules['invariantqp._native'] = None; " + PYTHON
    assert told("-c", code, INVARIANTQP_NATIVE="1") == "False [1.] pure Python: no compiled core was built"


@pytest.mark.parametrize("wheel", [False, True])
def test_sources_without_a_core_say_so_once(tmp_path, wheel):
    """As in a clone, where what is installed is hidden by the folder; a wheel without a core has been told of."""
    without = ["_native*.so", "_native*.pyd", *(["csrc"] if wheel else [])]
    shutil.copytree(Path(iq.__file__).parent, tmp_path / "invariantqp", ignore=shutil.ignore_patterns(*without))
    use = "import invariantqp as iq; iq.solve_pose; iq.Controller; print(iq.native)"
    done = run("-c", use, folder=tmp_path, INVARIANTQP_NATIVE="1")
    assert done.stdout == "False\n"
    said = f"invariantqp runs from its sources in {tmp_path}, where no compiled core was built"
    assert (said in done.stderr, done.stderr.count("run there: pip install -e .")) == (not wheel, int(not wheel))
    if not wheel:
        assert run("-c", use, folder=tmp_path, INVARIANTQP_NATIVE="0").stderr == ""


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
