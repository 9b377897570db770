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
from invariantqp.workbench.compare.report import (
    DARK,
    LIGHT,
    MARKERS,
    PANELS,
    acceleration,
    colour_of,
    draw,
    fails,
    html,
    inline_svg,
    mm,
    point,
    write_report,
)
from invariantqp.workbench.compare.results import failures, measured, plain, tick_us, write_results
from invariantqp.workbench.compare.sweep import METHODS, methods_named, sweep, tasks_of
from invariantqp.workbench.compare.tables import by_kind, change, losses, lost_kinds, stability, summary

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
    assert rows[OURS] == ["4", "20", "-", "-", "2 of 2", "0", "0", "-", "-"]
    assert rows["DLS"] == ["8", "20", "2", "0", "0 of 2", "0", "0", "-", "-"]
    assert rows["LM"] == ["10", "20", "0", "2", "2 of 2", "2", "0", "-", "-"]
    assert rows["SNS"][-4:] == ["0", "2", "-", "-"]
    assert rows["QP"] == ["-", "-", "0", "0", "0 of 0", "2", "0", "-", "-"]
    assert [row[0] for row in losses(results).rows] == ["a", "b"]
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


def test_losses_are_listed_from_the_worst():
    results = made({OURS: {}, "DLS": {"mm": 0.5}, "LM": {"acceleration": 8.0}}, tasks=("mild", "bad"))
    results["runs"][4]["figures"]["acceleration"] = 2.0
    rows = losses(results).rows
    assert [(row[0], row[3], row[4]) for row in rows] == [("bad", "5", "DLS, LM"), ("mild", "2", "DLS, LM")]
    assert [row[2].partition(":")[0] for row in rows] == ["DLS", "DLS"]


@pytest.mark.parametrize(("kind", "key"), [("other tool frame", "frame_rad"), ("other unit", "unit_rad")])
def test_where_the_same_motion_is_told_otherwise_methods_are_not_compared(kind, key):
    runs = {OURS: {key: 1e-14}, "DLS": {"mm": 0.5, key: 0.2}, "Drake": {key: 0.0, "joints_deg": 0.0, "mm": 5.0}}
    results = made(runs, kind=kind)
    assert losses(results).rows == lost_kinds(results).rows == []
    assert [change(measured(results), name, kind) for name in (OURS, "DLS", "Drake")] == [1e-14, 0.2, None]
    assert [row[1] for row in stability(results).rows] == ["1e-14", "0.2", "stands still 1/1; 10 · 5"]


def test_the_table_of_stability_says_first_what_is_worst():
    results = made(
        {
            OURS: {},
            "DLS": {"settling": None},
            "LM": {"exceptions": 1, "violations": 2, "settling": None},
            "SNS": {"violations": 2, "settling": None},
            "QP": {"failed": "its process ended"},
            "Pink": {"joints_deg": 0.0, "settling": None, "acceleration": 0.0, "mm": 5.0},
        },
        tasks=("a", "b"),
        kind="singular",
    )
    results["runs"][1]["figures"]["settling"] = 1.0
    assert dict(stability(results).rows) == {
        OURS: "10 · 1",
        "DLS": "not back 1/2; 10 · 1",
        "LM": "raises 2/2; 10 · 1",
        "SNS": "over limits 2/2; 10 · 1",
        "QP": "fails 2/2",
        "Pink": "stands still 2/2; 0 · 5",
    }
    assert stability(made({OURS: {}})).rows == ()


@pytest.mark.parametrize("runs", [{OURS: {}}, {"DLS": {}, "LM": {"failed": "ended"}}, {OURS: {"failed": "ended"}}])
def test_few_results_are_a_page_all_the_same(runs, tmp_path):
    page, chart = write_report(made(runs), tmp_path)
    assert chart.stat().st_size > 1000
    assert "<table>" in page.read_text("utf-8")


def test_one_task_file_is_a_panel():
    assert point(measured(made({OURS: {}}, kind="task file")), mm("task file"), OURS) == (10.0, pytest.approx(1.0))


def test_a_marker_is_of_one_method_whatever_was_measured():
    assert len(set(MARKERS.values())) == len(MARKERS)
    assert MARKERS.keys() == {method.name for method in methods_named(None)}


def test_points_stand_at_their_values():
    tasks = measured(KEPT)
    singular = [task for task in tasks if task.kind == "singular"]
    for name in MARKERS.keys() - {"J^{+h}"}:
        runs = [t.runs[name] for t in singular if name in t.runs]
        mean = math.prod(max(run["acceleration"], 1.0) for run in runs) ** (1.0 / len(runs))
        time, value = point(tasks, acceleration("singular"), name)
        assert value == pytest.approx(mean)
        assert time == tick_us(singular, name)[0]
    assert point([], mm("free"), OURS) is None


@pytest.mark.parametrize("failure", [{"exceptions": 1}, {"violations": 1}, {"joints_deg": 0.0, "mm": 100.0}])
def test_a_method_that_fails_in_a_run_is_grey_there(failure):
    tasks = measured(made({OURS: {}, "DLS": failure}))
    assert [fails(tasks, mm("free"), name) for name in (OURS, "DLS")] == [False, True]
    assert not fails(tasks, mm("limits"), "DLS")


def test_every_panel_is_of_a_kind_of_task():
    kinds = {task["kind"] for task in KEPT["tasks"]}
    assert {panel.kind for panel in PANELS} <= kinds
    assert [colour_of(moved, LIGHT) for moved in (None, 1e-14, 0.1)] == [LIGHT.text, LIGHT.same, LIGHT.other]


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
    page = html(KEPT, *[inline_svg(tmp_path / "chart.svg")] * 2)
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
    for page, name, section in pages.sections(KEPT):
        text = page.read_text("utf-8")
        assert pages.with_section(text, name, section) == text
    with pytest.raises(ValueError, match="no place for a section"):
        pages.with_section("nothing", "a", "x")


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
    assert change(measured(found), OURS) < 1e-11


def never(*_, **__):
    raise AssertionError


def full_disk(**_):
    return Path("/dev/full").open("wb")


def test_a_full_disk_is_told_before_the_work(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("invariantqp.workbench.compare.sweep.sweep", never)
    monkeypatch.setattr("invariantqp.workbench.writing.TemporaryFile", full_disk)
    words = ["--arms", "so101", "--kinds", "jump", "--out", str(tmp_path)]
    status, out, err = call(monkeypatch, capsys, "compare", *words)
    assert (status, out) == (3, "")
    assert f"{tmp_path} could not be written: No space left on device" in " ".join(err.split())


def test_a_place_that_cannot_be_written_is_told_before_the_work(monkeypatch, capsys):
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
