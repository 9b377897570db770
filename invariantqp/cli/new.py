"""`invariantqp new`: a task file to start from, with every key explained."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from invariantqp.cli.console import say, writable, write
from invariantqp.errors import BadInput


def new(
    task: Annotated[str, typer.Argument(help="What the task is called, or TASK.toml, the file it is written to.")],
    robot: Annotated[str, typer.Option(metavar="ROBOT", help="A robot's name, or a URDF or MJCF file.")] = "panda",
    path: Annotated[str, typer.Option(metavar="KIND", help="line, circle, screw, joints or hold.")] = "line",
    contact: Annotated[
        str | None, typer.Option(metavar="KIND", help="point, edge, face or hinge; without contact if left out.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Another file to write to (.toml).")] = None,
) -> None:
    """Write a task file for TASK that runs as it is, with every key explained, to change and to run."""
    from invariantqp.runs.newtask import new_task

    file = Path(f"{task.removesuffix('.toml')}.toml") if out is None else out
    writable("TASK" if out is None else "--out", file, (".toml",))
    if file.exists():
        raise BadInput("TASK" if out is None else "--out", f"{file}, which exists", "the name of a new file")
    write(file, new_task(file.stem, robot, path=path, contact=contact))
    say(f"written: {file}. Change it, then: invariantqp run {file}")
