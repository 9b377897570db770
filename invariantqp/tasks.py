"""Task files and their runs in closed loop."""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.runs.newtask import new_task as new_task
    from invariantqp.runs.run import run_task as run_task
    from invariantqp.runs.taskfile import LawSpec as LawSpec
    from invariantqp.runs.taskfile import Task as Task
    from invariantqp.runs.taskfile import load_task as load_task
    from invariantqp.runs.taskfile import shipped_tasks as shipped_tasks
    from invariantqp.runs.trace import ContactTrace as ContactTrace
    from invariantqp.runs.trace import Trace as Trace
