"""The command line: parsing only (`printing` prints). Exit status 0 done, 1 not accepted, 2 bad input."""

from __future__ import annotations

import sys
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from invariantqp.cli.compare import compare
from invariantqp.cli.inspect import ManyNumbers, inspect
from invariantqp.cli.run import ViewAlone, run
from invariantqp.cli.status import BAD_INPUT
from invariantqp.errors import InvariantQPError
from invariantqp.version import __version__

app: typer.Typer = typer.Typer(
    help="Task-space velocity control of robot arms whose answers do not depend on frames or length units.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Run the command line; our own errors become one message and exit status 2."""
    try:
        app()
    except InvariantQPError as error:
        Console(stderr=True, highlight=False, soft_wrap=True).print(f"error: {error}", style="red", markup=False)
        sys.exit(BAD_INPUT)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"invariantqp {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    """Task-space velocity control of robot arms whose answers do not depend on frames or length units."""


@app.command()
def tasks() -> None:
    """List the tasks that come with the package."""
    from invariantqp.runs.taskfile import load_task, shipped_tasks

    table = Table("task", "what it is", box=None)
    for name in shipped_tasks():
        table.add_row(name, load_task(name).about)
    Console().print(table)


app.command(cls=ViewAlone)(run)
app.command(cls=ManyNumbers)(inspect)
app.command()(compare)
