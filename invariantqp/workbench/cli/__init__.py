"""The command line: a file for each command but the shortest, and `console` for what they share."""

from __future__ import annotations

import os
import sys
import traceback
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Annotated, TextIO

import typer
from rich.console import Console
from rich.table import Table

from invariantqp.errors import BadInput, InvariantQPError
from invariantqp.version import __version__
from invariantqp.workbench.cli.compare import compare
from invariantqp.workbench.cli.console import HELP, Exit, NotAccepted, NotWritten, say, writable, write
from invariantqp.workbench.cli.drag import drag
from invariantqp.workbench.cli.identify import identify
from invariantqp.workbench.cli.inspect import inspect
from invariantqp.workbench.cli.run import ViewAlone, run

app: typer.Typer = typer.Typer(
    epilog=HELP,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["--help", "-h"]},
)
REPORT = "Please report it where you got invariantqp from, with all of these lines."


def main() -> None:
    """Run the command line and leave with a status of `invariantqp.workbench.cli.console`."""
    for stream in ("stdout", "stderr"):
        if getattr(sys, stream) is None:  # closed by whoever started this
            setattr(sys, stream, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, PTH123 (open to the end)
    warnings.showwarning = _show_warning
    sentences: list[str] = []
    try:
        status = _run_app()
        sys.stdout.flush()
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001 (any other error is reported as a defect)
        status, sentences = _outcome(error)
        if isinstance(error, OSError):
            _discard(sys.stdout)
    try:
        for sentence in sentences:
            say(sentence, style="red")
    except (OSError, SystemExit):  # standard error is closed or full, too
        _discard(sys.stderr)
    sys.exit(status)


def _outcome(error: BaseException) -> tuple[int, list[str]]:
    """The exit status of an error, and its messages."""
    match error:
        case NotAccepted():
            return Exit.NOT_ACCEPTED, [f"not accepted: {reason}" for reason in error.reasons]
        case InvariantQPError():
            return Exit.BAD_INPUT, [f"error: {error}"]
        case NotWritten():
            return Exit.NOT_WRITTEN, [f"error: {error}"]
        case OSError():
            sentence = f"error: output could not be written: {error.strerror or error}"
            return Exit.NOT_WRITTEN, [] if isinstance(error, BrokenPipeError) else [sentence]
        case KeyboardInterrupt():
            return Exit.INTERRUPTED, []
    return Exit.DEFECT, [
        "".join(traceback.format_exception(error)).rstrip(),
        f"This is a defect of invariantqp {__version__}, not of your input. {REPORT}",
        f"The command was: {' '.join(['invariantqp', *sys.argv[1:]])}",
    ]


def _run_app() -> int:
    """The exit status of Typer and Rich; theirs of a closed pipe is 1."""
    try:
        app()
    except SystemExit as error:
        if error.code == 1:
            _discard(sys.stdout)
            return Exit.NOT_WRITTEN
        return error.code if isinstance(error.code, int) else Exit.DONE
    return Exit.DONE


def _discard(stream: TextIO) -> None:
    """Discard what could not be written: Python would try again at its end, and leave with status 120."""
    with suppress(OSError, ValueError):  # a stream without a file
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    """Print a warning as a note, without its line of code."""
    with suppress(OSError, SystemExit):
        say(f"note: {message}", style="yellow")


def _version(is_given: bool) -> None:
    if is_given:
        print(f"invariantqp {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Task-space velocity control of robot arms whose answers do not depend on frames or length units."""


@app.command(epilog=HELP)
def tasks() -> None:
    """List the tasks that come with the package."""
    from invariantqp.workbench.runs.taskfile import load_task, shipped_tasks

    table = Table("task", "what it is", box=None)
    for name in shipped_tasks():
        table.add_row(name, load_task(name).about)
    Console().print(table)


app.command(cls=ViewAlone, epilog=HELP)(run)
app.command(epilog=HELP)(inspect)
app.command(epilog=HELP)(identify)
app.command(epilog=HELP)(compare)
app.command(epilog=HELP)(drag)


@app.command(epilog=HELP)
def new(
    task: Annotated[str, typer.Argument(help="What the task is called, or TASK.toml, the file it is written to.")],
    robot: Annotated[str, typer.Option(metavar="ROBOT", help="A robot's name, or a URDF or MJCF file.")] = "panda",
    path: Annotated[str, typer.Option(metavar="KIND", help="line, circle, screw, joints, hold or poses.")] = "line",
    contact: Annotated[
        str | None, typer.Option(metavar="KIND", help="point, edge, face or hinge; without contact if left out.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Another file to write to (.toml).")] = None,
) -> None:
    """Write a task file for TASK that runs as it is, with every key explained, to change and to run."""
    from invariantqp.workbench.runs.newtask import new_task

    file = Path(f"{task.removesuffix('.toml')}.toml") if out is None else out
    writable("TASK" if out is None else "--out", file, (".toml",))
    if file.exists():
        raise BadInput("TASK" if out is None else "--out", f"{file}, which exists", "the name of a new file")
    write(file, new_task(file.stem, robot, path=path, contact=contact))
    say(f"written: {file}. Change it, then: invariantqp run {file}")
