"""Decoded task files that tests change key by key, and a run in another tool frame."""

from invariantqp.workbench.runs.controllers import controller_for
from invariantqp.workbench.runs.frames import displaced
from invariantqp.workbench.runs.prepare import prepare
from invariantqp.workbench.runs.run import run
from support.arms import READY


def content(**changes):
    """A task that decodes, with keys changed by dotted path; None removes one."""
    task = {
        "name": "t",
        "robot": {"source": "panda", "start": list(READY["panda"])},
        "path": {"kind": "line", "duration": 0.05, "move": [0.001, 0.0, 0.0]},
        "law": {"dt": 0.002},
        "accept": {"position_error_mm": 0.1},
    }
    for key, value in changes.items():
        *parents, last = key.split("__")
        place = task
        for name in parents:
            place = place[name]
        if value is None:
            del place[last]
        else:
            place[last] = value
    return task


PEN = {"contact": {"kind": "point"}, "force": {"press": 5.0}}


def pen(**changes):
    """What makes a task one in contact, with keys changed by section."""
    return {name: {**PEN.get(name, {}), **changes.get(name, {})} for name in {**PEN, **changes}}


def run_displaced(task, tool, **overrides):
    """A run of the same physical motion, asked of a tool frame displaced in itself by a (4, 4) motion."""
    setup = displaced(prepare(task, **overrides), tool)
    return run(setup, controller_for(setup.problem))
