import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from invariantqp.compare import report, tables

RESULTS = json.loads((Path(__file__).parents[2] / "examples" / "comparison" / "results.json").read_text("utf-8"))
PANDA = {**RESULTS, "tasks": RESULTS["tasks"][:2]}
TAKES = dict.fromkeys(("posture", "exact", "limits", "damping", "feedforward"), "yes")


def results(**rows):
    """Results of one task from {method: (us, mm, deg, frame, control)}."""
    cells = []
    for method, (us, mm, deg, frame, control) in rows.items():
        loop = {"position_mm": mm, "orientation_deg": deg, "frame": frame, "control": control}
        for kind, result in (("loop", loop), ("tick", {"median_us": us, "p99_us": 2.0 * us})):
            cells.append({"kind": kind, "task": "compare/panda_limits", "method": method, "result": result})
    methods = [{"name": n, "family": "QP", "why": "w", "shown": True, "takes": TAKES} for n in rows]
    machine = {"processor": "a processor", "cores": 2, "system": "Linux", "python": "3.11"}
    base = {"schema": 1, "machine": machine, "versions": {}, "kinematics": "Pinocchio", "seed": 0, "quick": False}
    return {**base, "tasks": ["compare/panda_limits"], "methods": methods, "cells": cells}


def test_a_change_that_the_control_makes_too_is_no_dependence():
    found = results(
        invariantqp=(1.0, 1.0, 1.0, 1e-14, 1e-12), chaos=(1.0, 1.0, 1.0, 1.6, 1.6), other=(1.0, 1.0, 1.0, 1e-4, 1e-12)
    )
    (measured,) = report.by_task(found)
    colours = [p.colour for p in report.points(measured, tables.shown(found), report.LIGHT)]
    assert colours == [report.LIGHT.same, report.LIGHT.same, report.LIGHT.other]


def test_where_we_lose_it_is_said():
    found = results(
        invariantqp=(10.0, 0.5, 20.0, 1e-14, 1e-12), fast=(5.0, 0.5, 20.0, 0.1, 0.0), near=(50.0, 0.1, 3.0, 0.1, 0.0)
    )
    (told,) = report.losses(found)
    assert "nearer are near" in told
    assert "it tilts by 20 deg, at 0.5 mm; near by 3 deg, at 0.1 mm" in told
    found = results(invariantqp=(10.0, 0.5, 20.0, 1e-14, 1e-12), fast=(5.0, 0.5, 20.0, 0.1, 0.0))
    assert "faster are fast (5 us)" in report.losses(found)[0]
    assert report.losses(results(invariantqp=(10.0, 0.5, 20.0, 1e-14, 1e-12), slow=(20.0, 0.5, 20.0, 0.1, 0.0))) == []


@pytest.mark.parametrize(
    "rows", [{}, {"DLS": (1.0, None, None, None, None)}, {"invariantqp": (1.0, 0.0, 0.0, 0.0, 0.0)}]
)
def test_few_results_are_a_page_all_the_same(rows, tmp_path):
    files = report.write_report(results(**rows), tmp_path)
    text = files[0].read_text(encoding="utf-8")
    assert "<h2>Machine and versions</h2>" in text
    assert ("<table>" in text) == bool(rows)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The report of the committed results on one arm."""
    return report.write_report(PANDA, tmp_path_factory.mktemp("report"))


def test_the_page_has_the_first_things_first_and_the_rest_folded(files):
    text = files[0].read_text(encoding="utf-8")
    assert [file.name for file in files] == ["report.html", "speed_and_accuracy.svg"]
    first = text[: text.index("<details>")]
    assert first.index("as near as any") < first.index("<svg") < first.index("<table>")
    assert first.count("<tr>") == 11
    assert "http" not in re.sub(r'xmlns(:\w+)?="[^"]*"|<!DOCTYPE[^>]*>', "", text)


class Balanced(HTMLParser):
    def __init__(self):
        super().__init__()
        self.open = []

    def handle_starttag(self, tag, attrs):
        if tag not in {"meta", "path", "use", "rect", "br"}:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in {"path", "use", "rect"}:
            assert self.open.pop() == tag


def test_a_page_is_well_formed_and_says_what_it_is_given(tmp_path):
    file = tmp_path / "a.svg"
    file.write_text('<svg><g id="x"/><use href="#x"/><path clip-path="url(#x)"/></svg>', encoding="utf-8")
    drawn = report.inline_svg(file)
    assert drawn == '<svg><g id="x"/><use href="#x"/><path clip-path="url(#x)"/></svg>'
    text = report.html(results(**{"1 < 2": (1.0, 1.0, 1.0, 0.0, 0.0), "{{ b }}": (2.0, 1.0, 1.0, 0.0, 0.0)}), drawn)
    parser = Balanced()
    parser.feed(text)
    assert parser.open == []
    assert drawn in text
    assert "1 &lt; 2" in text
    assert "{{ b }}" in text
    assert "<figure>" not in report.html(results(), "")


def test_the_chart_is_drawn_for_dark_pages_too(tmp_path):
    file = tmp_path / "chart.svg"
    two = results(invariantqp=(10.0, 0.5, 20.0, 1e-14, 1e-12), other=(5.0, 0.5, 20.0, 0.1, 0.0))
    report.draw(two, file, report.DARK)
    text = file.read_text(encoding="utf-8").upper()
    for colour in (report.DARK.paper, report.DARK.same, report.DARK.other, report.DARK.text):
        assert colour.upper() in text


def test_points_stand_at_their_values_each_by_the_marker_of_its_method(tmp_path, monkeypatch):
    drawn = []
    keep = report._panel
    monkeypatch.setattr(report, "_panel", lambda axes, *rest: (keep(axes, *rest), drawn.append(axes)))
    one = {**RESULTS, "tasks": RESULTS["tasks"][1:2]}
    report.draw(one, tmp_path / "chart.svg")
    for axes, measured in zip(drawn, report.by_task(one), strict=True):
        found = report.points(measured, tables.shown(one), report.LIGHT)
        assert len({p.marker for p in found}) == len(found) == 10
        dots = {(*line.get_xydata()[0], line.get_marker()) for line in axes.lines}
        assert dots == {(p.time, p.error, p.marker) for p in found}
        low, high = axes.get_ylim()
        assert all(low < p.error < high for p in found)


def test_the_page_says_versions_and_whose_kinematics_they_are():
    assert "pin 3.8.0" in report.machine(RESULTS)
    assert "read the arm from" not in report.html(RESULTS, "")
    assert "read the arm from invariantqp" in report.html({**RESULTS, "kinematics": "invariantqp"}, "")


def test_one_task_is_not_all_one_tasks():
    both = dict.fromkeys(("invariantqp", "hand-written loop"), (10.0, 0.5, 0.1, 0.0, 0.0))
    assert "is as near here; it takes 1 times our time." in " ".join(report.verdict(results(**both)))


def test_the_page_is_dark_where_its_reader_is(files):
    text = files[0].read_text(encoding="utf-8")
    light, dark = text.index("prefers-color-scheme"), text.index("</style>")
    for name, colour in report.LIGHT._asdict().items():
        assert text.lower().count(colour.lower()) == 1  # where it gets its name, and nowhere else
        assert f"--{name}: {colour}" in text[:light]
        assert f"--{name}: {getattr(report.DARK, name)}" in text[light:dark]
        assert f"var(--{name})" in text[dark:]
    ids = re.findall(r'\bid="([^"]+)"', text)
    assert len(ids) == len(set(ids))
