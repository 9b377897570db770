"""`invariantqp new`: a task file to start from, with every key explained."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from invariantqp.cli.inspect import numbers
from invariantqp.cli.places import writable, write
from invariantqp.errors import BadInput
from invariantqp.printing import say


def new(
    task: Annotated[str, typer.Argument(help="What the task is called, or TASK.toml, the file it is written to.")],
    robot: Annotated[str, typer.Option(metavar="ROBOT", help="A robot's name, or a URDF or MJCF file.")] = "panda",
    start: Annotated[
        str | None, typer.Option(metavar="NUMBERS", help="Joint positions; a well-conditioned state if left out.")
    ] = None,
    path: Annotated[str, typer.Option(metavar="KIND", help="line, circle, screw, joints or hold.")] = "line",
    contact: Annotated[
        str | None, typer.Option(metavar="KIND", help="point, edge, face or hinge; without contact if left out.")
    ] = None,
    press: Annotated[float, typer.Option(metavar="NEWTON", help="Contact force, with --contact.")] = 5.0,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Another file to write to (.toml).")] = None,
) -> None:
    """Write a task file for TASK that runs as it is, with every key explained, to change and to run."""
    from invariantqp.runs.newtask import new_task

    file = Path(f"{task.removesuffix('.toml')}.toml") if out is None else out
    writable("TASK" if out is None else "--out", file, (".toml",))
    if file.exists():
        raise BadInput("TASK" if out is None else "--out", f"{file}, which exists", "the name of a new file")
    at = None if start is None else numbers("--start", start)
    write(file, new_task(file.stem, robot, start=at, path=path, contact=contact, press=press))
    say(f"written: {file}. Change it, then: invariantqp run {file}")
