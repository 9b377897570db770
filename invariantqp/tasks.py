"""Task files and their runs in closed loop.

Each name is loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from invariantqp.lazy import load_lazily

if TYPE_CHECKING:
    from invariantqp.runs.log import ContactTrace as ContactTrace
    from invariantqp.runs.newtask import new_task as new_task
    from invariantqp.runs.run import run_task as run_task
    from invariantqp.runs.taskfile import LawSpec as LawSpec
    from invariantqp.runs.taskfile import Task as Task
    from invariantqp.runs.taskfile import load_task as load_task
    from invariantqp.runs.taskfile import shipped_tasks as shipped_tasks
    from invariantqp.runs.trace import Trace as Trace

load_lazily(
    __name__,
    {
        "invariantqp.runs.log": ("ContactTrace",),
        "invariantqp.runs.newtask": ("new_task",),
        "invariantqp.runs.run": ("run_task",),
        "invariantqp.runs.taskfile": ("LawSpec", "Task", "load_task", "shipped_tasks"),
        "invariantqp.runs.trace": ("Trace",),
    },
)
