"""Workers and the driver: exceptions are counted, ends of processes are told, nothing stops a comparison."""

import sys

import numpy as np
import pytest

from invariantqp.errors import BadInput, UnknownName
from invariantqp.workbench.compare import drive, environments
from invariantqp.workbench.compare.drive import Process, RequestFailure, Workers, as_json, run_all
from invariantqp.workbench.compare.sweep import METHODS, methods_named, sweep, tasks_of
from invariantqp.workbench.compare.tasks import bed
from invariantqp.workbench.compare.worker import Run

FEW = ["DLS", "invariantqp"]


class Moody:
    """A loop that answers 1, raises, leaves, and answers NaN, in turn."""

    def __init__(self):
        self.ticks = 0

    def step(self, q, _target, _ahead, _before):
        self.ticks += 1
        if self.ticks % 4 == 2:
            raise RuntimeError("not now\nand more")
        if self.ticks % 4 == 3:
            sys.exit(1)
        return np.full(len(q), np.nan if self.ticks % 4 == 0 else 0.1)


def test_an_arm_stops_in_a_tick_that_fails_and_every_failure_is_counted():
    (task,) = bed(["so101"], ["jump"])
    run = Run(METHODS["DLS"], as_json(task))
    run.loop = Moody()
    run.run(100)
    run.run(1000)  # no further than to the end
    found = run.end()
    assert found["exceptions"] == dict.fromkeys(
        ("RuntimeError: not now", "SystemExit: 1", "the answer was not finite"), 100
    )
    assert found["stopped"] == [k for k in range(400) if k % 4]
    x = np.array(found["velocities"])
    np.testing.assert_array_equal(x[::4], 0.1)
    assert not x[1::4].any()
    np.testing.assert_allclose(np.diff(found["positions"], axis=0), task.spec.dt * x, atol=1e-15)


def test_to_refuse_a_target_that_is_not_finite_is_no_exception():
    (task,) = bed(["so101"], ["NaN"])
    run = Run(METHODS["invariantqp"], as_json(task))
    run.run(320)
    found = run.end()
    assert found["exceptions"] == {}
    assert found["stopped"] == list(range(300, 306))


def process(code):
    made = Process("", sys.executable)
    made._command = [sys.executable, "-c", code]
    return made


def test_a_process_that_takes_too_long_is_ended(monkeypatch):
    monkeypatch.setattr(drive, "REQUEST_TIMEOUT", 0.3)
    worker = process("import time; time.sleep(60)")
    with pytest.raises(RequestFailure, match=r"its process was ended after 0\.3 s"):
        worker.ask("methods")
    worker.close()


def test_a_process_that_ends_says_its_last_word_and_is_started_again():
    worker = process("import sys; sys.stdin.readline(); sys.exit('its last word')")
    for _ in range(2):
        with pytest.raises(RequestFailure, match="its process ended: its last word"):
            worker.ask("methods")
    worker.close()
    with pytest.raises(RequestFailure, match="interrupted"):
        worker.ask("methods")


def test_a_process_that_dies_takes_no_other_method_with_it(monkeypatch):
    (task,) = bed(["so101"], ["jump"])
    rows, ask = methods_named(["DLS", "LM", "invariantqp"]), Process.ask

    def dying(self, request, **more):
        if request == "run" and more["method"] == "DLS":
            self._process.kill()
        return ask(self, request, **more)

    monkeypatch.setattr(Process, "ask", dying)
    workers = Workers(rows)
    try:
        found = workers.run(task, rows)
    finally:
        workers.close()
    assert found["DLS"]["failed"].startswith("its process ended")
    for name in ("LM", "invariantqp"):
        assert found[name]["mm"] == pytest.approx(75.0, rel=1e-3)


def test_an_environment_that_is_not_complete_is_not_installed(monkeypatch):
    """A Python without this package's files and without NumPy, as where an installation failed."""
    rows = methods_named(["placo", "DLS"])
    workers = Workers(rows)
    for worker in workers.processes.values():
        worker.close()
    workers.processes = {"": Process("", sys.executable), "placo": process("raise SystemExit('no module named numpy')")}
    try:
        assert list(workers.installed()) == [name for name in METHODS if name in workers.processes[""].ask("methods")]
    finally:
        workers.close()


@pytest.mark.parametrize("name", ["placo", "OInK", "EmbodiK", "Drake"])
def test_libraries_with_environments_of_their_own_follow_a_slow_path(name):
    row = METHODS[name]
    if environments.python_of(row.environment) is None:
        pytest.skip(f"{name} is not installed: invariantqp compare --setup")
    (task,) = bed(["ur5e"], ["free"])
    ((_, found),) = run_all([task], [row])
    assert found[name]["exceptions"] == found[name]["violations"] == 0
    assert found[name]["mm"] < 0.02


def test_the_module_of_libraries_loads_numpy_alone():
    import subprocess

    code = (
        "import sys, invariantqp.workbench.compare.worker as w, invariantqp.workbench.compare.libraries; "
        "print([m for m in ('scipy', 'pinocchio', 'daqp', 'pydantic', 'attrs') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_method_that_fails_is_a_row_and_no_end(monkeypatch):
    tasks = bed(["so101"], ["jump"])
    (row,) = methods_named(["DLS"])
    team = Workers([row])
    ask = Process.ask
    wrong = {"ticks": "no number"}
    monkeypatch.setattr(Process, "ask", lambda self, r, **more: ask(self, r, **more | (wrong if r == "run" else {})))
    try:
        found = team.run(tasks[0], [row])
    finally:
        team.close()
    assert found["DLS"]["failed"].startswith("TypeError")


def test_tasks_with_acceleration_limits_leave_out_who_takes_none():
    tasks = bed(["so101"], ["jump accelerations"])
    rows = methods_named([*FEW, "mink"])
    ((_, found),) = run_all(tasks, rows)
    assert list(found) == ["invariantqp", "DLS"]
    assert found["invariantqp"]["violations"] == 0


def test_a_comparison_is_the_same_however_many_run_at_a_time():
    tasks, rows = tasks_of([], ["so101"], ["jump", "turn"], 0, quick=False), methods_named(FEW)
    done = []
    one, two = (sweep(tasks, rows, jobs=jobs, progress=lambda k, n: done.append((k, n))) for jobs in (1, 2))
    assert done == [(1, 3), (2, 3), (3, 3)] * 2
    assert [task["name"] for task in one["tasks"]] == ["so101/jump", "so101/turn 45", "so101/turn 90"]
    for a, b in zip(one["runs"], two["runs"], strict=True):
        for key in ("mm", "deg", "acceleration", "settling", "exceptions", "violations"):
            assert a["figures"][key] == b["figures"][key]


def test_wrong_words_are_told_before_the_work():
    with pytest.raises(UnknownName, match="unknown arm 'puma'"):
        tasks_of([], ["puma"], None, 0, quick=False)
    with pytest.raises(UnknownName, match="unknown kind 'jmp'; did you mean jump"):
        tasks_of([], None, ["jmp"], 0, quick=False)
    with pytest.raises(BadInput, match="TASK: found --arms or --kinds too; expected TASK alone"):
        tasks_of(["arm_3r"], ["panda"], None, 0, quick=False)
    assert len(tasks_of(["arm_3r", "arm_3r"], None, None, 0, quick=False)) == 2


def test_environments_that_were_not_made_are_left_out(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert environments.python_of("") == sys.executable
    assert environments.python_of("drake") is None
    assert environments.folder() == tmp_path / "invariantqp" / "compare"
    with pytest.raises(BadInput, match="--methods: found Drake: none of these can be run"):
        sweep(bed(["so101"], ["jump"]), methods_named(["Drake"]))
    assert environments.make("nothing", "/no/such/place")  # says why
    assert environments.python_of("nothing") is None
