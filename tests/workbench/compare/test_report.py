"""Tables, chart and page say what was measured; what is committed is what the command would write."""

import json
import math
import re
import runpy
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.command_line import call

from invariantqp.workbench.compare import tables
from invariantqp.workbench.compare.method import OURS
from invariantqp.workbench.compare.report import DARK, LIGHT, draw, html, inline_svg, marker_of, point, write_report
from invariantqp.workbench.compare.results import failures, measured, plain, tick_us, write_results
from invariantqp.workbench.compare.sweep import METHODS, methods_named, sweep, tasks_of
from invariantqp.workbench.compare.tables import by_kind, losses, lost_kinds, summary

ROOT = Path(__file__).parents[3]
KEPT = json.loads((ROOT / "examples" / "comparison" / "results.json").read_text("utf-8"))


def made(runs, tasks=("panda/free",), kind="free"):
    """Results of {method: figures} on one task after the other."""
    base = {
        "mm": 1.0, "deg": 1.0, "mm_rms": 1.0, "deg_rms": 1.0, "acceleration": 10.0, "acceleration_rms": 1.0,
        "settling": 1.0, "violations": 0, "exceptions": 0, "why": "", "joints_deg": 5.0, "us": 10.0,
        "us_p99": 20.0,
    }  # fmt: skip
    rows = [
        {"name": n, "family": METHODS[n].family, "about": "", "setting": METHODS[n].setting._asdict()} for n in runs
    ]
    return {
        **{key: KEPT[key] for key in ("schema", "machine", "versions", "seed", "quick", "kinematics")},
        "methods": rows,
        "tasks": [{"name": task, "arm": "panda", "kind": kind} for task in tasks],
        "runs": [
            {"task": task, "method": name, "figures": more if "failed" in more else {**base, **more}}
            for task in tasks
            for name, more in runs.items()
        ],
    }


def test_the_summary_counts_tasks():
    results = made(
        {
            OURS: {"us": 4.0},
            "DLS": {"mm": 0.5, "us": 8.0},
            "LM": {"mm": 2.0, "exceptions": 3},
            "SNS": {"violations": 2},
            "QP": {"failed": "its process ended"},
        },
        tasks=("a", "b"),
    )
    rows = {row[0]: row[1:] for row in summary(results).rows}
    assert rows[OURS] == ["4", "20", "-", "-", "2 of 2", "0", "0", "-"]
    assert rows["DLS"] == ["8", "20", "2", "0", "0 of 2", "0", "0", "-"]
    assert rows["LM"] == ["10", "20", "0", "2", "2 of 2", "2", "0", "-"]
    assert rows["SNS"][-3:] == ["0", "2", "-"]
    assert rows["QP"] == ["-", "-", "0", "0", "0 of 0", "2", "0", "-"]
    assert [row[0] for row in losses(results).rows] == ["a", "b"]
    assert losses(results).rows[0][2] == "DLS"
    assert lost_kinds(results).rows == [["free", "2 of 2", "DLS (2)"]]
    assert failures(results)[0] == ("QP", "a", "its process ended")


def test_a_cell_has_geometric_means_and_the_longest_settling_time():
    results = made({OURS: {}}, tasks=("a", "b"))
    results["runs"][1]["figures"] |= {"mm": 4.0, "deg": 0.0, "settling": 3.0}
    assert by_kind(results).rows == [[OURS, "2 · 1e-06 · 10 · 3"]]
    results["runs"][1]["figures"]["settling"] = None
    assert by_kind(results).rows[0][1].endswith("never")


def test_broken_promises_are_ours():
    assert tables.broken_promises(made({OURS: {}, "DLS": {"violations": 1}})) == []
    for more in ({"violations": 1}, {"exceptions": 1}):
        (said,) = tables.broken_promises(made({OURS: more}))
        assert said == "panda/free: invariantqp violated a limit, raised or returned a velocity that is not finite"
    (said,) = tables.broken_promises(made({OURS: {"failed": "it ended"}}))
    assert said == "panda/free: invariantqp could not be measured: it ended"


def test_in_another_tool_frame_methods_are_not_compared():
    results = made({OURS: {"frame_rad": 1e-14}, "DLS": {"mm": 0.5, "frame_rad": 0.2}}, kind="other tool frame")
    assert losses(results).rows == lost_kinds(results).rows == []
    assert [row[-1] for row in summary(results).rows] == ["1e-14", "0.2"]


@pytest.mark.parametrize("runs", [{OURS: {}}, {"DLS": {}, "LM": {"failed": "ended"}}, {OURS: {"failed": "ended"}}])
def test_few_results_are_a_page_all_the_same(runs, tmp_path):
    page, chart = write_report(made(runs), tmp_path)
    assert chart.stat().st_size > 1000
    assert "<table>" in page.read_text("utf-8")


def test_one_task_file_is_a_panel():
    assert point(measured(made({OURS: {}}, kind="task file")), OURS, "mm", 1e-3) == (10.0, pytest.approx(1.0))


def test_points_stand_at_their_values_by_the_marker_of_their_method():
    names = [name for name in tables.names_of(KEPT) if name != "invariantqp in Python"]
    assert len({marker_of(name, names) for name in names}) == len(names)
    singular = [task for task in measured(KEPT) if task.kind == "singular"]
    for name in names:
        runs = [t.runs[name] for t in singular if name in t.runs]
        mean = math.prod(max(run["acceleration"], 1.0) for run in runs) ** (1.0 / len(runs))
        time, value = point(singular, name, "acceleration", 1.0)
        assert value == pytest.approx(mean)
        assert time == tick_us(singular, name)[0]
    assert point([], OURS, "mm", 1e-3) is None


class Tags(HTMLParser):
    """Every tag is closed in its order."""

    VOID = ("meta", "br", "img", "path", "use", "rect")

    def __init__(self):
        super().__init__()
        self.open, self.text = [], []

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID and "/" not in (self.get_starttag_text() or "")[-2:]:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def test_the_page_is_well_formed_dark_where_its_reader_is_and_has_everything(tmp_path):
    draw(KEPT, tmp_path / "chart.svg")
    page = html(KEPT, inline_svg(tmp_path / "chart.svg"))
    tags = Tags()
    tags.feed(page)
    assert tags.open == []
    said = " ".join("".join(tags.text).split())
    for sentence in (tables.RULE, KEPT["machine"]["processor"], *tables.names_of(KEPT)):
        assert " ".join(sentence.split()) in said
    for colour in (*LIGHT, *DARK):
        assert colour in page
    chart = page[page.index("<svg") : page.index("</svg>")]
    assert not any(colour.lower() in chart for colour in LIGHT)


def test_a_figure_that_is_none_is_null():
    assert plain({"a": math.inf, "b": 1.23456, "c": 3, "d": "x", "e": None}) == {
        "a": None, "b": 1.235, "c": 3, "d": "x", "e": None
    }  # fmt: skip


@pytest.mark.parametrize(
    ("value", "text"), [(None, "-"), (math.nan, "-"), (1234.5, "1200"), (0.00012, "0.00012"), (1e-9, "1e-09")]
)
def test_figures_have_two_digits(value, text):
    assert tables.figure(value) == text


def test_the_committed_results_are_of_every_method_and_every_task():
    assert set(tables.names_of(KEPT)) >= {method.name for method in methods_named(None)}
    assert [task["name"] for task in KEPT["tasks"]] == [
        t.name for t in tasks_of([], None, None, KEPT["seed"], quick=False)
    ]
    assert not KEPT["quick"]
    assert tables.broken_promises(KEPT) == []
    assert re.search(r"/(home|root|tmp|work)/", json.dumps(KEPT)) is None


def test_the_committed_pages_are_what_the_command_would_write():
    pages = SimpleNamespace(**runpy.run_path(str(ROOT / "examples" / "shared" / "pages.py")))
    page = (ROOT / "examples" / "guide" / "comparison.md").read_text("utf-8")
    assert pages.with_section(page, pages.guide(KEPT)) == page
    readme = (ROOT / "README.md").read_text("utf-8")
    assert pages.with_section(readme, pages.markdown(lost_kinds(KEPT))) == readme
    with pytest.raises(ValueError, match="no place for the comparison"):
        pages.with_section("nothing", "x")


@pytest.fixture(scope="module")
def small():
    """One kind of task under two methods, as the command measures it."""
    return sweep(tasks_of([], ["so101"], ["jump"], 0, quick=True), methods_named(["DLS", OURS]), quick=True)


def test_results_survive_their_file(small, tmp_path):
    write_results(tmp_path / "results.json", small)
    text = (tmp_path / "results.json").read_text("utf-8")
    assert json.loads(text) == json.loads(json.dumps(small))
    assert len([line for line in text.splitlines() if '"method":' in line]) == len(small["runs"]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["results.json"]


def test_the_command_prints_tables_and_writes_three_files(monkeypatch, capsys, tmp_path):
    words = ["--arms", "so101", "--kinds", "jump", "--methods", "DLS", "--methods", "placo", "--methods", OURS]
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    status, out, err = call(monkeypatch, capsys, "compare", *words, "--out", str(tmp_path / "new" / "out"))
    assert status == 0
    for word in ("dominates ours", "DLS", "so101/jump", "written: "):
        assert word in out
    assert "not installed: placo. Run: invariantqp compare --setup" in " ".join(err.split())
    files = {"report.html", "results.json", "speed_and_accuracy.svg"}
    assert {path.name for path in (tmp_path / "new" / "out").iterdir()} == files


def test_a_task_of_one_s_own_is_compared_in_two_tool_frames(monkeypatch, capsys, tmp_path):
    words = ["arm_3r", "--methods", OURS, "--methods", "Moore", "--jobs", "1", "--quiet", "--out", str(tmp_path)]
    assert call(monkeypatch, capsys, "compare", *words)[:2] == (0, "")
    found = json.loads((tmp_path / "results.json").read_text("utf-8"))
    assert [task["kind"] for task in found["tasks"]] == ["task file", "other tool frame"]
    assert tables.frame_change(measured(found), OURS) < 1e-11


def test_a_place_that_cannot_be_written_is_told_before_the_work(monkeypatch, capsys):
    def never(*_, **__):
        raise AssertionError

    monkeypatch.setattr("invariantqp.workbench.compare.sweep.sweep", never)
    status, out, err = call(monkeypatch, capsys, "compare", "--arms", "so101", "--kinds", "jump", "--out", "/proc/x")
    assert status != 0
    assert out == ""
    assert "/proc/x" in err
    assert "Traceback" not in err


def test_the_status_tells_when_ours_leaves_its_limits(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("invariantqp.workbench.compare.sweep.sweep", lambda *_, **__: made({OURS: {"violations": 1}}))
    words = ["--arms", "so101", "--kinds", "jump", "--out", str(tmp_path)]
    status, _, err = call(monkeypatch, capsys, "compare", *words)
    assert status == 1
    said = "panda/free: invariantqp violated a limit, raised or returned a velocity that is not finite"
    assert said in " ".join(err.split())
