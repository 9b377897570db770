import json
import re
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from support.command_line import call
from typer.testing import CliRunner

import invariantqp as iq
from invariantqp.workbench import cli
from invariantqp.workbench.runs.taskfile import shipped_tasks

TASK = """
name = "short"
about = "A short line."
[robot]
source = "panda"
start = [0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8]
[path]
kind = "line"
duration = 0.05
move = [0.001, 0.0, 0.0]
[law]
dt = 0.002
[accept]
position_error_mm = 0.1
"""


@pytest.fixture
def task(tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(TASK, encoding="utf-8")
    return file


@pytest.fixture
def run(monkeypatch, capsys):
    """The command as a shell would see it: exit status, standard output, standard error."""
    monkeypatch.setenv("COLUMNS", "300")
    return partial(call, monkeypatch, capsys)


def test_a_run_that_is_accepted(run, task):
    status, out, err = run("run", task)
    assert (status, err) == (0, "")
    for said in (
        "short",
        "A short line.",
        "position error, mm",
        "median",
        "p99",
        "25 ticks",
        "closed-form",
        "accepted",
    ):
        assert said in out
    assert "not accepted" not in out


def test_a_run_that_is_not(run, task):
    task.write_text(TASK.replace("position_error_mm = 0.1", "position_error_mm = 1e-12"), encoding="utf-8")
    status, out, err = run("run", task)
    assert status == 1
    assert "not accepted" in out
    assert "not accepted: largest position error" in err
    status, out, err = run("run", task, "--quiet")
    assert (status, out) == (1, "")
    assert "largest position error" in err


def test_quiet_is_silent(run, task):
    assert run("run", task, "--quiet") == (0, "", "")


def test_json_has_the_fixed_keys(run, task, tmp_path):
    file = tmp_path / "out.json"
    status, out, _ = run("run", task, "--json", file)
    assert status == 0
    figures = json.loads(file.read_text(encoding="utf-8"))
    asked = "task passed ticks position_error_mm orientation_error_deg limit_violation peak_speed methods statuses"
    assert {*asked.split(), "peak_acceleration", "tick_us", "force_error_relative_rms", "q"} <= set(figures)
    assert np.shape(figures["q"]) == (26, 7)
    assert figures["task"] == "short"
    assert figures["passed"] is True
    speed, acceleration = figures["peak_speed"], figures["peak_acceleration"]
    assert f"speed: {speed:.3g}, acceleration: {acceleration:.3g}, counted from rest" in out


@pytest.mark.parametrize(
    ("law", "axis"), [("", "acceleration [rad/s²"), ("\nacceleration_limit = 40.0", "acceleration / limit")]
)
def test_a_picture_shows_accelerations_by_their_limit(run, task, tmp_path, law, axis):
    task.write_text(TASK.replace("dt = 0.002", "dt = 0.002" + law), encoding="utf-8")
    assert run("run", task, "--plot", tmp_path / "out.svg", "--quiet") == (0, "", "")
    assert f"<!-- joint {axis}" in (tmp_path / "out.svg").read_text(encoding="utf-8")  # each text is a comment, too


def test_another_back_end_and_the_frame_check(run, task):
    status, out, _ = run("run", task, "--backend", "osqp", "--check-frame", "--seed", "3")
    assert status == 0
    assert re.search(r"invariantqp +\d\.\de-1\d ", out)


PEN = """
[contact]
kind = "point"
gap = 0.001
settle = 0.3
[force]
press = 5.0
rate = 60.0
"""


def test_a_run_in_contact(run, task, tmp_path):
    slower = TASK.replace("duration = 0.05", "duration = 0.15")  # in contact motion is taken up at 1 m/s^2
    task.write_text(slower + PEN, encoding="utf-8")
    figures = tmp_path / "pen.json"
    status, out, err = run("run", task, "--json", figures, "--check-frame")
    assert (status, err) == (0, "")
    for said in ("force error", "rms of the wanted force", "counted from 0.3 s on", "invariantqp", "Raibert-Craig"):
        assert said in out
    written = json.loads(figures.read_text(encoding="utf-8"))
    assert 0.0 < written["force_error_relative_rms"] < 0.02
    assert written["physics"] == "ideal"


def test_a_run_on_the_physics_engine(run, task):
    pytest.importorskip("mujoco")
    task.write_text(TASK + PEN + "[accept_mujoco]\nforce_error = 0.2\n", encoding="utf-8")
    status, out, _ = run("run", task, "--physics", "mujoco")
    assert status == 0
    assert "physics: mujoco" in out
    task.write_text(TASK + PEN + "[accept_mujoco]\nforce_error = 1e-6\n", encoding="utf-8")
    status, _, err = run("run", task, "--physics", "mujoco", "--quiet")
    assert status == 1
    assert "not accepted: rms force error" in err


def test_the_tasks_are_listed(run):
    status, out, _ = run("tasks")
    assert status == 0
    for name in shipped_tasks():
        assert name in out


def test_version_and_help(run):
    assert run("--version") == (0, f"invariantqp {iq.__version__}\n", "")
    status, out, _ = run("run", "--help")
    assert (status, out, "") == run("run", "-h")
    assert status == 0
    for option in ("--json", "--plot", "--backend", "--check-frame", "--quiet"):
        assert option in out


def test_as_a_process(task):
    """The whole way once: `python -m`, exit status and streams."""
    done = subprocess.run(
        [sys.executable, "-m", "invariantqp", "run", str(task)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "accepted" in done.stdout


def test_without_a_command_help_is_shown():
    result = CliRunner().invoke(cli.app, [])
    assert "Usage" in result.output
