"""No import statement is reached inside a tick, in any task: what a tick needs is there before the loop begins."""

import builtins
import sys
from pathlib import Path

import pytest

import invariantqp as iq
from invariantqp.control.controller import Controller
from invariantqp.force.control import HybridController

ROOT = Path(__file__).parents[2]
OURS = str(Path(iq.__file__).parent)
STABILITY = sorted(f"stability/{file.stem}" for file in (ROOT / "tasks" / "stability").glob("*.toml"))
TASKS = [*iq.tasks.shipped_tasks(), *STABILITY]


@pytest.fixture
def imports(monkeypatch):
    """(module, file) of every import in a tick: statements of this package, and whatever was not loaded before."""
    seen, depth, really = set(), [0], builtins.__import__

    def watched(name, *arguments, **options):
        file = sys._getframe(1).f_code.co_filename
        # NumPy's C code looks up its own loaded modules this way, once in a process, in whatever file calls it first.
        ours = file.startswith(OURS) and not name.startswith("numpy._core.")
        if depth[0] and (ours or name not in sys.modules):
            seen.add((name, file))
        return really(name, *arguments, **options)

    def counted(method):
        def run(*arguments, **options):
            depth[0] += 1
            try:
                return method(*arguments, **options)
            finally:
                depth[0] -= 1

        return run

    monkeypatch.setattr(builtins, "__import__", watched)
    for kind, name in ((Controller, "step"), (Controller, "follow"), (Controller, "rest"), (HybridController, "step")):
        monkeypatch.setattr(kind, name, counted(getattr(kind, name)))
    return seen


@pytest.mark.cases(20)
@pytest.mark.parametrize("name", TASKS)
def test_no_tick_imports_anything(imports, name):
    task = iq.load_task(name)
    short = task.path.model_copy(update={"duration": 0.3 * task.path.duration})
    iq.run_task(task.model_copy(update={"path": short}), dt=0.05, gain=None)
    assert imports == set()


def test_the_watch_sees_an_import(imports, monkeypatch):
    monkeypatch.delitem(sys.modules, "this", raising=False)
    robot = iq.load_robot("ur5")
    q = [0.1, -1.0, 1.2, 0.3, 0.5, 0.0]
    iq.Controller(robot, dt=0.01, rows=lambda _: __import__("this") and None).step(q, robot.pose(q))
    assert {name for name, _ in imports} == {"this"}
