import dataclasses
import json
import os
import subprocess
import sys
import time
from importlib import metadata

import numpy as np
import pytest
from support.command_line import call
from typer.testing import CliRunner

from invariantqp import extras
from invariantqp.cli import app
from invariantqp.cli.console import Exit
from invariantqp.compare import sweep as module
from invariantqp.compare import tables
from invariantqp.compare.measurements import KINDS, STABILITY, Kind, interleaved
from invariantqp.compare.method import OURS, SCALED_LEAST_SQUARES
from invariantqp.compare.registry import METHODS
from invariantqp.compare.results import LIBRARIES, plain, results_of, versions, write_results
from invariantqp.compare.sweep import cells, sweep
from invariantqp.errors import BadInput, MissingExtra, UnknownName, install_command
from invariantqp.robots import load

FEW = ["DLS", "Moore-Penrose"]
MEASURED = []


def counted(cell):
    MEASURED.append(cell)
    return {name: {"seed": cell.seed, "nothing": float("nan")} for name in cell.methods}


def stumbling(cell):
    if cell.method == "DLS":
        raise ValueError("no such thing")
    return counted(cell)


def loaded(file):
    return json.loads(file.read_text(encoding="utf-8"))


@pytest.fixture
def toys(monkeypatch):
    table = {"counted": Kind(counted), "own": Kind(counted, tasks=("arm_3r", "scara"))}
    monkeypatch.setattr(module, "KINDS", table)
    MEASURED.clear()
    return table


def test_cells_are_kinds_times_tasks_times_methods(toys):
    toys["timed"] = Kind(counted, alone=True)
    work = cells(["t", "u"], FEW, seed=3, quick=True)
    by_kind = {kind: [c for c in work if c.kind == kind] for kind in toys}
    assert [(c.task, c.methods) for c in by_kind["counted"]] == [(t, (m,)) for t in "tu" for m in FEW]
    assert {c.task for c in by_kind["own"]} == {"arm_3r", "scara"}
    assert [(c.task, c.methods) for c in by_kind["timed"]] == [("t", tuple(FEW)), ("u", tuple(FEW))]
    assert [c.kind for c in work[-2:]] == ["timed", "timed"]
    assert {c.seed for c in work} == {3}
    toys["asked"] = Kind(counted, on_request=True)
    assert "asked" not in {c.kind for c in cells(["t"], FEW)}
    toys["slow"] = Kind(counted, slow=True)
    assert "slow" not in {c.kind for c in cells(["t"], FEW, quick=True)}
    assert "slow" in {c.kind for c in cells(["t"], FEW)}
    assert [c.kind for c in cells(["t"], FEW[:1], quick=True, only=["slow"])] == ["slow"]
    with pytest.raises(UnknownName, match="unknown measurement 'count'; did you mean counted"):
        cells(["t"], FEW, only=["count"])


def test_results_have_their_schema(toys, tmp_path):
    results = sweep(["so101_line"], FEW, seed=2, quick=True)
    assert set(results) == {"schema", "machine", "versions", "kinematics", "seed", "quick", "tasks", "methods", "cells"}
    assert results["methods"][0].keys() >= {"name", "family", "why", "takes", "shown"}
    assert all(set(cell) == {"kind", "task", "method", "result"} for cell in results["cells"])
    assert results["cells"][0]["result"]["nothing"] is None
    assert results["versions"]["numpy"] == np.__version__
    write_results(tmp_path / "results.json", results)
    assert loaded(tmp_path / "results.json") == results
    assert "NaN" not in (tmp_path / "results.json").read_text(encoding="utf-8")


def test_results_say_the_version_of_every_library_that_a_row_needs():
    called = {"pinocchio": "pin", "pink": "pin-pink", "pydrake": "drake"}
    for row in METHODS.values():
        for module_name in row.needs:
            name = called.get(module_name, module_name)
            assert name in LIBRARIES
            assert not row.installed or versions()[name] == metadata.version(name)
    assert versions().keys() >= {"invariantqp", "numpy", "scipy", "daqp", "pin", "example-robot-data"}


def test_what_cannot_be_measured_is_a_row_and_not_an_end(toys):
    toys["counted"] = Kind(stumbling)
    results = sweep(["compare/panda_limits"], FEW, only=["counted"])
    (failed,) = [c for c in results["cells"] if "failed" in c["result"]]
    assert failed["method"] == "DLS"
    assert failed["result"]["failed"] == "ValueError: no such thing"
    assert list(results_of(results, "counted")) == [("compare/panda_limits", "Moore-Penrose")]


def test_the_command_says_why_the_first_measurement_failed(toys, tmp_path):
    toys["counted"] = Kind(stumbling)
    chosen = [word for name in FEW for word in ("--methods", name)]
    done = CliRunner().invoke(app, ["compare", "scara", "--jobs", "1", "--out", str(tmp_path), *chosen])
    assert "1 of 6 measurements failed, as the report says; the first: ValueError: no such thing" in done.output


def test_a_sweep_tells_its_progress(toys):
    seen = []
    sweep(["compare/panda_limits"], FEW, progress=lambda *k: seen.append(k))
    assert seen[-1] == (6, 6)
    assert len(MEASURED) == 6


def test_wrong_settings_are_told_before_the_work(toys):
    with pytest.raises(UnknownName, match="task 'panda_pat'"):
        sweep(["panda_pat"], FEW)
    with pytest.raises(UnknownName, match="method"):
        sweep(["compare/panda_limits"], ["pinf"])
    assert not MEASURED


def test_a_figure_that_is_none_is_null():
    assert plain({"a": [1.0, float("inf"), (2, float("nan"))], 3: None}) == {"a": [1.0, None, [2, None]], "3": None}


def test_rounds_go_through_all_in_turn():
    order = []
    calls = {name: lambda i, name=name: order.append((name, i)) for name in "ab"}
    taken = interleaved(calls, 2, 5)
    assert order[:4] == [("a", 0), ("a", 1), ("b", 0), ("b", 1)]
    assert {name: len(t) for name, t in taken.items()} == {"a": 10, "b": 10}
    slow = interleaved({"fast": lambda _: None, "slow": lambda _: time.sleep(2e-3)}, 1, 3)
    assert np.median(slow["slow"]) > np.median(slow["fast"])


@pytest.fixture(scope="module")
def small_run(tmp_path_factory):
    """One real run of the command: two methods on one task."""
    out = tmp_path_factory.mktemp("comparison")
    words = ["compare", "so101_line", "--quick", "--only", "loop,tick", "--jobs", "1", "--out", str(out)]
    names = ("invariantqp", "Moore-Penrose")
    chosen = [word for name in names for word in ("--methods", name)]
    done = CliRunner().invoke(app, [*words, *chosen])
    assert done.exit_code == 0, done.output
    return out, done.output


def test_the_command_writes_everything(small_run):
    out, output = small_run
    results = loaded(out / "results.json")
    loops, times = (results_of(results, kind) for kind in ("loop", "tick"))
    assert set(times) == set(loops) == {("so101_line", m["name"]) for m in results["methods"]}
    assert all(0.0 < t["median_us"] <= t["p99_us"] for t in times.values())
    mine, other = (loops["so101_line", name] for name in ("invariantqp", "Moore-Penrose"))
    assert mine["frame"] < 1e-11
    assert other["frame"] > 1e-3
    assert max(mine["control"], other["control"]) < 1e-10
    assert mine["position_mm"] < 0.1 < 10.0 < other["position_mm"]
    html = (out / "report.html").read_text(encoding="utf-8")
    assert "Another tool frame for the same motion" in html
    assert "no exact, clips" in html
    assert "Moore-Penrose" in output


def test_everyday_tasks_alone_are_a_table_and_a_page(tmp_path):
    words = ["compare", "--only", "everyday", "--jobs", "1", "--out", str(tmp_path), "--methods", "invariantqp"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "turned in place" in done.output
    assert "frame, rad" not in done.output
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<h2>What users meet first</h2>" in html
    assert "frame, rad" not in html
    found = results_of(loaded(tmp_path / "results.json"), "everyday")
    assert len(found) == 7
    assert found["compare/stay", "invariantqp"]["settling_s"] == 0.0


@pytest.fixture(scope="module")
def hard_run(tmp_path_factory):
    """Where methods fail, run by the command, of a few tasks."""
    out = tmp_path_factory.mktemp("stability")
    few = {name: dataclasses.replace(kind, tasks=kind.tasks[-1:]) for name, kind in KINDS.items() if kind.on_request}
    words = ["compare", "--stability", "--jobs", "1", "--out", str(out)]
    chosen = [word for name in (OURS, SCALED_LEAST_SQUARES, "Pink") for word in ("--methods", name)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "KINDS", {**KINDS, **few})
        done = CliRunner().invoke(app, [*words, *chosen])
    return done, loaded(out / "results.json"), (out / "report.html").read_text(encoding="utf-8")


def test_stability_is_a_table_of_every_method_in_every_case(hard_run):
    done, results, html = hard_run
    assert done.exit_code == 0, done.output
    found = {kind: results_of(results, kind) for kind in STABILITY}
    names = [OURS, SCALED_LEAST_SQUARES, "Pink"]
    table = tables.stability(results)
    for kind, runs in found.items():
        told = [row[1] for row in table.rows if (kind in row[0] if kind != "stability" else "NaN" not in row[0])]
        assert told == names == [name for _, name in runs]
    assert [row[-1] for row in table.rows if row[1] == SCALED_LEAST_SQUARES] == ["1"] * 4
    spoilt, ours = (found["NaN in target"]["stability/jump", name] for name in ("Pink", OURS))
    assert spoilt["not_finite"] > 0.0 == spoilt["raised"]
    assert ours["not_finite"] == 0.0
    assert ours["raised"] == spoilt["not_finite"]
    for text in (done.output, html):
        assert "jump, NaN in target" in text
        assert "chatter" in text


def test_the_status_tells_when_ours_leaves_its_limits_or_is_not_finite(hard_run):
    _, results, _ = hard_run
    assert tables.failed_stability(results) == []
    for wrong in ({"excess": 1e-3}, {"excess": None}, {"not_finite": 0.01}, {"failed": "why"}):
        first, *rest = results["cells"]
        worse = {**first, "result": {**first["result"], **wrong}}
        assert tables.failed_stability({**results, "cells": [worse, *rest]}) == [first["task"]]


def test_what_is_not_installed_is_left_out_by_name(toys, tmp_path, monkeypatch):
    without = {"pinocchio", "mink"}
    monkeypatch.setattr(extras, "find_spec", lambda name: None if name in without else object())
    done = CliRunner().invoke(app, ["compare", "scara", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    for left_out, extra in (("hand-written loop", "pin"), ("Pink; mink", "peers")):
        assert f"not installed, so left out: {left_out}. Run: {install_command(extra)}" in done.stderr
    results = loaded(tmp_path / "results.json")
    assert {cell["kind"] for cell in results["cells"]} == {"counted", "own"}
    assert not {"hand-written loop", "Pink", "mink"} & {method["name"] for method in results["methods"]}


def test_a_robot_that_is_not_installed_ends_it_before_it_begins(toys, tmp_path, monkeypatch):
    monkeypatch.setattr(load, "DATA", "no-such-robots")
    done = CliRunner().invoke(app, ["compare", "scara", "panda_path", "--out", str(tmp_path)])
    assert isinstance(done.exception, MissingExtra)
    assert not list(tmp_path.rglob("results.json"))


# Put before every program of an environment: what README's own install does not bring cannot be imported.
BARE = """
import sys
from importlib.abc import MetaPathFinder
ABSENT = {"pinocchio", "pink", "mink", "mujoco", "placo", "pydrake", "qpsolvers", "osqp"}
class Nowhere(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.split(".")[0] in ABSENT:
            raise ModuleNotFoundError(f"no module named {name!r}", name=name)
sys.meta_path.insert(0, Nowhere())
"""


def test_it_runs_on_what_robots_installs_without_the_core_too(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(BARE, encoding="utf-8")
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    words = ["so101_line", "--quick", "--only", "loop", "--jobs", "1", "--out", str(tmp_path)]
    chosen = ["--methods", "invariantqp", "--methods", "written"]
    done = subprocess.run(
        [sys.executable, "-m", "invariantqp", "compare", *words, *chosen],
        env={**os.environ, "PYTHONPATH": path, "INVARIANTQP_NATIVE": "0"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert f"left out: hand-written loop. Run: {install_command('pin')}" in done.stderr
    results = loaded(tmp_path / "results.json")
    assert not [cell for cell in results["cells"] if "failed" in cell["result"]]
    names = {method["name"] for method in results["methods"]}
    assert names == {"invariantqp"}
    assert set(results_of(results, "loop")) == {("so101_line", "invariantqp")}
    assert "read the arm from invariantqp" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_results_that_cannot_be_written_are_no_bad_input(toys, tmp_path, monkeypatch, capsys):
    (tmp_path / "results.json" / "kept").mkdir(parents=True)
    status, _, err = call(monkeypatch, capsys, "compare", "scara", "--out", str(tmp_path), "--methods", "DLS")
    assert status == Exit.NOT_WRITTEN
    assert "could not be written" in err


def test_a_place_that_is_no_folder_is_told(tmp_path):
    file = tmp_path / "file"
    file.write_text("", encoding="utf-8")
    done = CliRunner().invoke(app, ["compare", "--out", str(file)])
    assert isinstance(done.exception, BadInput)
    assert "--out" in str(done.exception)


def test_results_are_json(small_run):
    text = (small_run[0] / "results.json").read_text(encoding="utf-8")
    assert json.loads(text)["schema"] == 1
