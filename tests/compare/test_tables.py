"""Every number in README's and the guide's comparison is the committed results', worked out here a second time."""

import json
import re
import runpy
from pathlib import Path
from types import SimpleNamespace

import pytest

from invariantqp.compare import measurements, tables
from invariantqp.compare.report import losses, verdict
from invariantqp.compare.tables import figure

ROOT = Path(__file__).parents[2]
FILE = ROOT / "examples" / "comparison" / "results.json"
PAGES = SimpleNamespace(**runpy.run_path(str(ROOT / "examples" / "shared" / "pages.py")))
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGE = (ROOT / "examples" / "guide" / "comparison.md").read_text(encoding="utf-8")
RESULTS = json.loads(FILE.read_text(encoding="utf-8"))
EVERYDAY = json.loads(FILE.with_name("everyday.json").read_text(encoding="utf-8"))
SECTION = README.split(PAGES.BEGIN)[1].split(PAGES.END)[0].strip()
PARTS = PAGE.split(PAGES.BEGIN)[1].split(PAGES.END)[0].strip().split("\n\n")
(HEADINGS, *ROWS), (_, *MOVED), (_, *LIBRARIES), (CALIBRATED, *OFF), (FIRST, *MET) = (
    [[cell.strip() for cell in line.strip("|").split(" | ")] for line in part.splitlines() if "---" not in line]
    for part in PARTS
    if part.startswith("|")
)
ROUNDED = 0.051  # two digits


def result(kind, task, method, results=RESULTS):
    (found,) = [
        cell["result"]
        for cell in results["cells"]
        if (cell["kind"], cell["task"], cell["method"]) == (kind, task, method)
    ]
    return found


def test_there_are_ten_rows_and_a_column_for_each_task():
    assert len(ROWS) == 10
    assert ROWS[0][0] == "invariantqp"
    assert HEADINGS[2:-1] == [tables.TASKS[task] for task in RESULTS["tasks"]]
    assert len(set(HEADINGS)) == 9


@pytest.mark.parametrize("row", [*ROWS, *LIBRARIES], ids=lambda row: row[0])
def test_every_number_is_one_of_the_committed_results(row):
    method, _, *cells, frame = row
    for cell, task in zip(cells, RESULTS["tasks"], strict=True):
        took, mm, deg = (float(part) for part in cell.split(" · "))
        loop = result("loop", task, method)
        assert took == pytest.approx(result("tick", task, method)["median_us"], rel=ROUNDED)
        assert mm == pytest.approx(loop["position_mm"], rel=ROUNDED)
        assert deg == pytest.approx(loop["orientation_deg"], rel=ROUNDED)
    worst = max(result("loop", task, method)["frame"] for task in RESULTS["tasks"])
    assert float(frame) == pytest.approx(worst, rel=0.51)


@pytest.mark.parametrize("row", MOVED, ids=lambda row: row[0])
def test_every_acceleration_and_settling_time_is_one_too(row):
    method, *cells = row
    for cell, task in zip(cells, RESULTS["tasks"], strict=True):
        found = result("loop", task, method)
        acceleration, settled = cell.split(" · ")
        assert float(acceleration) == pytest.approx(found["acceleration"], rel=ROUNDED)
        assert settled == ("never" if found["settling_s"] is None else figure(found["settling_s"]))


@pytest.mark.parametrize("row", OFF, ids=lambda row: row[0])
def test_every_number_of_a_miscalibrated_arm_is_one_too(row):
    tasks = {name: task for task, name in tables.TASKS.items()}
    for cell, name in zip(row[1:], CALIBRATED[1:], strict=True):
        found = result("calibration", tasks[name], row[0])
        mm, variation = (float(part) for part in cell.split(" · "))
        assert mm == pytest.approx(found["position_mm"], rel=ROUNDED)
        assert variation == pytest.approx(found["variation"], rel=ROUNDED)


@pytest.mark.parametrize("row", MET, ids=lambda row: row[0])
def test_every_number_of_an_everyday_task_is_one_too(row):
    method, *cells, joints = row
    tasks = {name: task for task, name in tables.EVERYDAY.items()}
    assert [tasks[name] for name in FIRST[1:-1]] == list(measurements.EVERYDAY)
    for cell, name in zip(cells, FIRST[1:], strict=False):
        found = result("everyday", tasks[name], method, EVERYDAY)
        *measured, settled = cell.split(" · ")
        keys = ("grown_mm", "grown_deg", "acceleration")
        assert [float(x) for x in measured] == [pytest.approx(found[key], rel=ROUNDED) for key in keys]
        assert settled == ("never" if found["settling_s"] is None else figure(found["settling_s"]))
    stays = result("everyday", "compare/stay", method, EVERYDAY)
    assert float(joints) == pytest.approx(stays["joints_deg"], rel=ROUNDED)


def test_everyday_rows_are_those_of_the_first_table():
    assert [row[0] for row in MET] == [row[0] for row in ROWS]
    assert EVERYDAY["tasks"] == []
    assert {cell["kind"] for cell in EVERYDAY["cells"]} == {"everyday"}


def test_motion_is_a_table_where_it_was_measured():
    loop = {"acceleration": 12.3, "settling_s": None}
    methods = [{"name": name, "shown": True} for name in ("a", "b")]
    cells = [{"kind": "loop", "task": "compare/panda", "method": "a", "result": loop}]
    found = {"tasks": ["compare/panda"], "methods": methods, "cells": cells}
    assert tables.motion(found) == (["method", "Panda"], [["a", "12 · never"], ["b", "- · -"]])
    assert tables.motion({**found, "cells": []}).rows == ()
    assert tables.everyday(found).rows == []


def test_the_other_libraries_were_measured_too():
    assert [row[0] for row in LIBRARIES] == ["Pink", "mink", "placo", "Drake"]


def test_every_figure_of_the_sentences_is_in_the_results():
    """Each is a figure of a cell, to two digits, or the ratio of two times of one task."""
    known = {0.0}
    for cell in RESULTS["cells"]:
        for value in numbers(cell["result"]):
            known |= {float(f"{value:.2g}"), float(f"{value:.0e}")}
    for task in RESULTS["tasks"]:
        hand = result("tick", task, "hand-written loop")["median_us"]
        for other in ("invariantqp", "invariantqp (Python)"):
            ratio = hand / result("tick", task, other)["median_us"]
            known |= {float(f"{ratio:.2g}"), float(f"{1.0 / ratio:.2g}")}
    sentences = "\n".join(verdict(RESULTS))
    for name in ("SO-101", "UR5", *(f"in all {k} tasks" for k in (6,)), *(f"in {k} of 6 tasks" for k in range(6))):
        sentences = sentences.replace(name, "")
    told = re.findall(r"\d+(?:\.\d+)?(?:e[-+]\d+)?", sentences)
    assert len(told) > 10
    assert [number for number in told if float(number) not in known] == []


def numbers(value):
    if isinstance(value, dict):
        for item in value.values():
            yield from numbers(item)
    elif isinstance(value, float):
        yield value


def test_no_other_part_of_the_readme_compares_times_by_figures_of_its_own():
    assert not re.search(r"\d+ us \(\d", README.replace(SECTION, ""))


def test_the_command_would_write_what_is_there():
    assert PAGES.with_section(README, PAGES.listed(losses(RESULTS))) == README
    assert PAGES.with_section(PAGE, PAGES.guide(RESULTS, EVERYDAY)) == PAGE
    with pytest.raises(ValueError, match="no place for the comparison"):
        PAGES.with_section("nothing", "")


def test_the_results_are_small_enough_to_keep_and_name_no_place():
    assert FILE.stat().st_size < 500_000
    assert not re.search(r'"/|\\\\', FILE.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "-"), (float("nan"), "-"), (22.3, "22"), (124.0, "120"), (0.00123, "0.0012"), (3e-9, "3e-09")],
)
def test_figures_have_two_digits(value, text):
    assert figure(value) == text
