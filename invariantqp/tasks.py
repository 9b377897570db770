"""Task files, and closed-loop runs of them; public names of the workbench, loaded on first use."""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.workbench.runs.newtask import new_task as new_task
    from invariantqp.workbench.runs.run import run_task as run_task
    from invariantqp.workbench.runs.taskfile import LawSpec as LawSpec
    from invariantqp.workbench.runs.taskfile import Task as Task
    from invariantqp.workbench.runs.taskfile import load_task as load_task
    from invariantqp.workbench.runs.taskfile import shipped_tasks as shipped_tasks
    from invariantqp.workbench.runs.trace import Trace as Trace
