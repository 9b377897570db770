import re
from html.parser import HTMLParser

import pytest
from matplotlib.figure import Figure

from invariantqp.compare.report import report, tables
from invariantqp.compare.report.charts.chart import CaptionedChart
from invariantqp.compare.report.findings import findings
from invariantqp.compare.report.page import (
    Bullets,
    Code,
    Heading,
    Paragraph,
    Picture,
    Table,
    html,
    inline_svg,
    markdown,
)
from invariantqp.errors import BadInput

SORTS = ("free", "limited", "singular")


def solve(error, missed=0.0, median=10.0):
    errors = {
        s: {"error": error, "error_max": error, "missed": missed, "failed": 0.0, "agreement": 1e-40} for s in SORTS
    }
    return errors, {s: {"median_us": median, "p99_us": 2.0 * median} for s in SORTS}


def results(**figures):
    """Results of single solves from {method: (error, missed, median)}."""
    cells = []
    for method, (error, missed, median) in figures.items():
        for kind, result in zip(("error", "time"), solve(error, missed, median), strict=True):
            cells.append({"kind": kind, "task": "so101_line", "method": method, "result": result})
    keys = ("family", "limits", "why", "frame", "problem", "limited", "group")
    return {
        "schema": 1,
        "machine": {"processor": "a processor", "cores": 2, "system": "Linux", "python": "3.11"},
        "versions": {"numpy": "2.0"},
        "seed": 0,
        "quick": True,
        "tasks": ["so101_line"],
        "methods": [{"name": name, **dict.fromkeys(keys, "QP")} for name in figures],
        "cells": cells,
    }


PLAIN = {
    "invariantqp": (1e-15, 0.9, 30.0),
    "invariantqp, h": (1e-15, 0.95, 35.0),
    "Moore-Penrose, pinv": (0.3, 0.4, 9.0),
    "Moore-Penrose, LU": (1e-9, 0.4, 3.0),
}


def said(found):
    return "\n".join(findings(found))


def test_sentences_follow_the_figures():
    text = said(results(**PLAIN))
    assert "While limits are active the fastest solve is Moore-Penrose, LU (3.0 us)" in text
    assert "alike, is: Moore-Penrose, pinv 0.40; invariantqp 0.90; invariantqp, h 0.95." in text
    assert "clipped Moore-Penrose against least squares inside the limits is 30%" in text
    turned = PLAIN | {"invariantqp, h": (1e-15, 0.1, 1.0), "Moore-Penrose, LU": (1e-9, 0.4, 30.0)}
    text = said(results(**turned))
    assert "the fastest solve is invariantqp, h (1.0 us), Moore-Penrose by plain LU takes 30.0 us" in text
    assert "alike, is: invariantqp, h 0.10; Moore-Penrose, pinv 0.40; invariantqp 0.90." in text


def test_what_the_figures_do_not_allow_is_not_said():
    assert said(results(DLS=(1e-3, 0.5, 5.0))) == ""
    alike = dict.fromkeys(PLAIN, (1e-15, 1e-14, 5.0))
    assert "cannot achieve every twist" not in said(results(**alike))


def test_the_summary_has_a_row_a_method_and_no_empty_column():
    table = tables.summary(results(**PLAIN))
    assert [row[0] for row in table.rows] == list(PLAIN)
    assert "tick, us" not in table.columns
    assert table.rows[0][:3] == ["invariantqp", "30", "1e-15"]


def test_the_readme_gets_the_table_between_its_markers(tmp_path):
    file = tmp_path / "README.md"
    file.write_text(f"before\n{tables.BEGIN}\nold\n{tables.END}\nafter\n", encoding="utf-8")
    tables.write_readme(results(**PLAIN), file)
    text = file.read_text(encoding="utf-8")
    assert text.startswith(f"before\n{tables.BEGIN}\n| method |")
    assert text.endswith(f"\n{tables.END}\nafter\n")
    assert "old" not in text
    assert text.count("\n| ") == 1 + 3  # invariantqp and both Moore-Penroses are rows of the README
    tables.write_readme(results(**PLAIN), file)
    assert file.read_text(encoding="utf-8") == text
    with pytest.raises(BadInput, match="no place for the table"):
        tables.with_table("nothing here", "")


class Balanced(HTMLParser):
    """Every tag that opens closes, no id is there twice, nothing is fetched."""

    def __init__(self):
        super().__init__()
        self.open, self.ids = [], []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.ids += [values["id"]] if "id" in values else []
        assert not (values.get("src") or "").startswith("http")
        assert tag != "link"
        if tag != "meta":
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.ids += [v for k, v in attrs if k == "id"]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def drawn(_, file):
    figure = Figure()
    axes = figure.subplots()
    axes.plot([1, 2], label="a <b> & c")
    axes.legend()
    figure.savefig(file)


def test_the_page_is_one_sound_file(tmp_path, monkeypatch):
    charts = [CaptionedChart(slug, slug, drawn, lambda _: "it says so", ("error",)) for slug in ("one", "two")]
    left_out = CaptionedChart("three", "three", drawn, lambda _: "", ("growth",))
    monkeypatch.setattr(report, "charts_of", lambda r: [c for c in [*charts, left_out] if "growth" not in c.shows])
    steps = []
    files = report.write_report(results(**PLAIN), tmp_path, lambda *k: steps.append(k))
    assert [f.name for f in files] == ["report.html", "report.md", "one.svg", "two.svg"]
    assert steps == [(1, 2), (2, 2)]
    text = files[0].read_text(encoding="utf-8")
    reader = Balanced()
    reader.feed(text)
    assert not reader.open
    assert len(reader.ids) == len(set(reader.ids))
    assert text.count("<svg") == 2
    for target in re.findall(r'(?:href="#|url\(#)([^")]+)', text):
        assert target in reader.ids
    assert "![one](one.svg)" in files[1].read_text(encoding="utf-8")


def test_a_chart_without_its_figures_is_left_out(monkeypatch):
    have, lacks = (CaptionedChart(k, k, drawn, str, (k,)) for k in ("error", "growth"))
    monkeypatch.setattr(report, "CHARTS", [have, lacks])
    assert report.charts_of(results(**PLAIN)) == [have]


def test_blocks_are_escaped(tmp_path):
    file = tmp_path / "p.svg"
    drawn(None, file)
    blocks = [
        Heading("a < b", 1),
        Paragraph("c & d"),
        Bullets(["<e>"]),
        Code("f > g"),
        Table(("h|i", "j"), [("<k>", "l")]),
        Picture(file, "m", "<n>"),
    ]
    page = html("t & u {{ title }}", blocks)
    assert "<title>t &amp; u {{ title }}</title>" in page
    for raw in ("<e>", "<k>", "<n>", "t & u", "a < b"):
        assert raw not in page
    assert r"| h\|i | j |" in markdown(blocks)
    assert 'id="p-' in inline_svg(file)


def test_what_could_not_be_measured_is_listed():
    found = results(**PLAIN)
    found["cells"].append({"kind": "tick", "task": "t", "method": "DLS", "result": {"failed": "no robot"}})
    blocks = report.page(found, [])
    assert Heading("What could not be measured") in blocks
    assert "no robot" in markdown(blocks)
    assert "agree to 1e-40" in markdown(blocks)
