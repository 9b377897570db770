import json

import pytest
from typer.testing import CliRunner

from invariantqp.cli import app
from invariantqp.compare import stability
from invariantqp.compare.method import OURS
from invariantqp.compare.stability import YARDSTICK, Case, compare_stability
from invariantqp.errors import MissingExtra
from invariantqp.runs.taskfile import Task

LAWS = (OURS, YARDSTICK, "hand-written loop", "Moore-Penrose", "[DS] Lambda", "Pink")
ALL = stability.laws()
FEW = [Case("stability/pitch_crossing"), Case("stability/jump", "target")]


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr(stability, "cases", lambda: FEW)


@pytest.fixture(scope="module")
def compared():
    """The outcomes of the few cases, and the progress that was told."""
    seen = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stability, "cases", lambda: FEW)
        patch.setattr(stability, "laws", lambda: {name: law for name, law in ALL.items() if name in LAWS})
        return compare_stability(lambda k, n: seen.append((k, n))), seen


def test_every_law_runs_every_case_it_can_have(compared):
    outcomes, seen = compared
    table = {(run["case"], run["law"]): run for run in outcomes}
    laws = set(LAWS)
    assert {law for case, law in table if case == "jump, NaN in target"} == laws
    assert {law for case, law in table if case == "pitch_crossing"} == laws
    assert all(table[case.name, YARDSTICK]["chatter"] == 1.0 for case in FEW)
    assert seen[-1] == (2 * len(laws), 2 * len(laws))
    spoilt = table["jump, NaN in target", "Pink"]
    assert spoilt["not_finite"] > 0.0
    assert spoilt["raised"] == 0.0
    assert table["jump, NaN in target", OURS]["not_finite"] == 0.0
    assert table["jump, NaN in target", OURS]["raised"] == spoilt["not_finite"]


def test_missing_robot_models_are_told_before_the_first_run(few, monkeypatch):
    def no_models(_):
        raise MissingExtra("example-robot-data", "robots")

    monkeypatch.setattr(Task, "load_robot", no_models)
    monkeypatch.setattr(stability, "run_case", lambda *_: pytest.fail("a case was run"))
    with pytest.raises(MissingExtra, match="pip install 'example-robot-data>="):
        compare_stability()


def test_the_command_prints_a_table_and_writes_every_figure(compared, monkeypatch, tmp_path):
    monkeypatch.setattr(stability, "compare_stability", lambda _: compared[0])
    file = tmp_path / "stability.json"
    result = CliRunner().invoke(app, ["compare", "--stability", "--json", str(file)])
    assert result.exit_code == 0, result.output
    for word in ("pitch_crossing", "jump, NaN in target", "Moore-Penrose", "[DS] Lambda", "chatter"):
        assert word in result.output
    written = json.loads(file.read_text(encoding="utf-8"))
    told = {"case", "law", "excess", "peak", "final_mm", "position_mm", "tail", "chatter", "raised"}
    assert told <= set(written[0])
    assert written[0]["law"] == OURS


def test_the_status_tells_when_ours_leaves_its_limits(monkeypatch):
    left = [{"case": "c", "law": OURS, "not_finite": 0.0, "excess": 1.0}]
    monkeypatch.setattr(stability, "compare_stability", lambda _: left)
    assert CliRunner().invoke(app, ["compare", "--stability", "--quiet"]).exit_code == 1
