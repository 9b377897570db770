"""Exit statuses as a shell sees them. 1 says that a run was not accepted, and nothing else."""

import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest
from support.warm import Warm

import invariantqp as iq
from invariantqp.workbench import cli
from invariantqp.workbench.cli.console import HELP, Exit

TASK = """
name = "short"
about = "A [short] swing."
[robot]
screws = [
    { axis = [0.0, 0.0, 1.0] },
    { axis = [0.0, 0.0, 1.0], point = [0.5, 0.0, 0.0] },
    { axis = [0.0, 0.0, 1.0], point = [0.8, 0.0, 0.0] },
]
tool_point = [1.0, 0.0, 0.0]
start = [0.3, 0.8, 0.5]
[path]
kind = "line"
duration = 0.05
move = [0.001, 0.0, 0.0]
[law]
dt = 0.002
form = "tool"
[accept]
position_error_mm = 0.1
"""
FULL = Path("/dev/full")
BUFFERED = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
needs_full = pytest.mark.skipif(not FULL.exists(), reason="no device that is always full")
posix = pytest.mark.skipif(sys.platform == "win32", reason="pipes and signals of POSIX")


@pytest.fixture
def task(tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(TASK, encoding="utf-8")
    return file


@pytest.fixture
def refused(tmp_path):
    file = tmp_path / "refused.toml"
    file.write_text(TASK.replace("position_error_mm = 0.1", "position_error_mm = 1e-13"), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def started():
    """A command line as a process."""
    warm = Warm()
    yield warm
    warm.close()


def test_not_accepted(started, refused):
    """The statuses of a run that is, and of bad input, are below and in test_run.test_as_a_process."""
    assert started("run", refused).returncode == Exit.NOT_ACCEPTED


@pytest.fixture
def gone(started):
    """The status and standard error of a command whose reader goes away before it is written."""

    def call(command):
        reading, writing = os.pipe()
        os.close(reading)
        done = started(*command, stdout=writing)
        os.close(writing)
        return done.returncode, done.stderr

    return call


@posix
@pytest.mark.parametrize("command", [["run", "{refused}"], ["run", "--help"], ["tasks"], ["inspect", "planar_3r"]])
def test_a_reader_that_is_gone_is_not_a_refusal(gone, refused, command):
    """A run that is accepted is below."""
    status, said = gone([word.format(refused=refused) for word in command])
    assert status == Exit.NOT_WRITTEN
    assert "Traceback" not in said
    assert "Exception ignored" not in said


@posix
def test_what_a_run_is_to_write_is_written_though_nobody_reads_what_it_prints(gone, task, tmp_path):
    figures = tmp_path / "run.json"
    status, said = gone(["run", task, "--json", figures])
    assert status == Exit.NOT_WRITTEN
    assert "Traceback" not in said
    assert "Exception ignored" not in said
    assert figures.read_text(encoding="utf-8").endswith("}\n")


@posix
def test_the_first_line_of_a_passing_run(started, task):
    done = started("run", task)
    assert (done.returncode, done.stderr) == (Exit.DONE, "")
    assert done.stdout.startswith("short  A [short] swing.\n")


@needs_full
@pytest.mark.parametrize("command", [["run", "{task}"], ["inspect", "planar_3r"]])
def test_a_full_disk(started, task, command):
    done = started(*(word.format(task=task) for word in command), "--json", FULL)
    assert (done.returncode, done.stderr) == (
        Exit.NOT_WRITTEN,
        "error: /dev/full could not be written: No space left on device\n",
    )
    with FULL.open("w") as full:
        done = started(*(word.format(task=task) for word in command), stdout=full)
        assert done.returncode == Exit.NOT_WRITTEN
        assert done.stderr == "error: output could not be written: No space left on device\n"


@needs_full
@pytest.mark.parametrize("command", [["run", "{task}"], ["inspect", "planar_3r"]])
def test_a_picture_on_a_full_disk(started, task, tmp_path, command):
    picture = tmp_path / "full.png"
    picture.symlink_to(FULL)
    done = started(*(word.format(task=task) for word in command), "--plot", picture)
    assert (done.returncode, done.stderr) == (
        Exit.NOT_WRITTEN,
        f"error: {picture} could not be written: No space left on device\n",
    )


@needs_full
def test_a_full_disk_that_nobody_can_be_told_of(started, task):
    with FULL.open("w") as full:
        assert started("run", task, stdout=full, stderr=full).returncode == Exit.NOT_WRITTEN


@needs_full
def test_bad_input_though_nobody_can_be_told(started):
    with FULL.open("w") as full:
        assert started("run", "nowhere", stderr=full).returncode == Exit.BAD_INPUT


@posix
@pytest.mark.parametrize(
    ("closed", "named", "expected"), [(">&- 2>&-", True, Exit.DONE), ("2>&-", False, Exit.BAD_INPUT)]
)
def test_closed_streams(task, closed, named, expected):
    line = f"{sys.executable} -m invariantqp run {task if named else 'nowhere'} {closed}"
    assert subprocess.run(["bash", "-c", line], env=BUFFERED, check=False).returncode == expected


@posix
def test_ctrl_c(tmp_path):
    long = tmp_path / "long.toml"
    long.write_text(TASK.replace("duration = 0.05", "duration = 500.0"), encoding="utf-8")
    script = "import invariantqp.workbench.cli as c; print('on', flush=True); c.main()"
    command = [sys.executable, "-c", script, "run", str(long)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        try:
            assert running.stdout.readline() == "on\n"
            time.sleep(1.0)
            running.send_signal(signal.SIGINT)
            _, said = running.communicate(timeout=30)
        finally:
            running.kill()
    assert running.returncode == Exit.INTERRUPTED
    assert "Traceback" not in said


@pytest.mark.parametrize(
    "error", [ZeroDivisionError("division by zero"), MemoryError(), RecursionError("deep"), KeyError("a")]
)
def test_a_defect_says_where_to_report_it(monkeypatch, capsys, task, error):
    def broken(*_, **__):
        raise error

    monkeypatch.setattr("invariantqp.workbench.runs.run.run_task", broken)
    monkeypatch.setattr(sys, "argv", ["invariantqp", "run", str(task)])
    with pytest.raises(SystemExit) as left:
        cli.main()
    out, said = capsys.readouterr()
    assert left.value.code == Exit.DEFECT
    assert out == ""
    for words in (
        type(error).__name__,
        f"defect of invariantqp {iq.__version__}",
        "report it",
        f"invariantqp run {task}",
    ):
        assert words in said


def test_a_defect_is_not_one_of_the_others():
    assert sorted(Exit) == [0, 1, 2, 3, 4, 130]


@pytest.mark.parametrize("command", [[], ["run"], ["tasks"], ["inspect"], ["compare"]])
def test_help_says_what_the_statuses_mean(monkeypatch, capsys, command):
    monkeypatch.setenv("COLUMNS", "300")
    monkeypatch.setattr(sys, "argv", ["invariantqp", *command, "--help"])
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert left.value.code == Exit.DONE
    assert HELP in " ".join(capsys.readouterr().out.split())


def test_a_warning_is_a_note(monkeypatch, capsys):
    monkeypatch.setattr(cli, "_run_app", lambda: warnings.warn("beware", stacklevel=1) or Exit.DONE)
    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)  # which main sets
    warnings.simplefilter("always")  # pytest puts it back
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert (left.value.code, capsys.readouterr().err) == (Exit.DONE, "note: beware\n")
