"""The command line: parsing and printing, nothing else. Exit status 0 done, 1 not accepted, 2 bad input."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from invariantqp import __version__
from invariantqp.errors import BadInput, InvariantQPError

if TYPE_CHECKING:
    from invariantqp.control.simulate import Trace
    from invariantqp.control.taskfile import Task

BAD_INPUT = 2
NOT_ACCEPTED = 1
PICTURES = (".png", ".svg", ".pdf")

app = typer.Typer(
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
    from invariantqp.control.taskfile import load_task, shipped_tasks

    table = Table("task", "what it is", box=None)
    for name in shipped_tasks():
        table.add_row(name, load_task(name).about)
    Console().print(table)


@app.command()
def run(
    task: Annotated[str, typer.Argument(help="A task file, or the name of one that comes with the package.")],
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write figures and joint trajectory as JSON.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE", help="Write a picture (.png, .svg, .pdf) of the run.")
    ] = None,
    backend: Annotated[
        str | None, typer.Option(metavar="NAME", help="QP solver: daqp, osqp, or any that qpsolvers has.")
    ] = None,
    check_frame: Annotated[
        bool, typer.Option("--check-frame", help="Also displace the tool frame and show what that changes.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Of the displacement of --check-frame.", min=0)] = 0,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing unless something is wrong.")] = False,
) -> None:
    """Run TASK in closed loop and tell how it went: 0 when its acceptance numbers are met, 1 when not."""
    from invariantqp.control.simulate import run_task
    from invariantqp.control.taskfile import load_task

    problem = load_task(task)
    _writable(json_file)
    _writable(plot, PICTURES)
    overrides: dict[str, Any] = {} if backend is None else {"backend": backend}
    with _progress("running", quiet) as report:
        trace = run_task(problem, progress=report, **overrides)
    if not quiet:
        _print_summary(trace)
    if json_file is not None:
        json_file.write_text(json.dumps(trace.as_json(), indent=1) + "\n", encoding="utf-8")
    if plot is not None:
        from invariantqp.control.picture import picture

        picture(trace, plot)
    if check_frame:
        _print_frame_check(trace.task, seed, quiet)
    if not trace.passed:
        complaint = "\n".join(f"not accepted: {s}" for s in trace.shortfalls)
        Console(stderr=True, highlight=False).print(complaint, style="red", markup=False)
        raise typer.Exit(NOT_ACCEPTED)


def _writable(file: Path | None, suffixes: tuple[str, ...] = ()) -> None:
    """Refuse a place that cannot be written to before the work is done, not after."""
    if file is None:
        return
    if not file.parent.is_dir():
        raise BadInput(str(file), "a folder that does not exist", "a file in an existing folder")
    if file.is_dir():
        raise BadInput(str(file), "a folder", "the name of a file")
    if suffixes and file.suffix.lower() not in suffixes:
        raise BadInput(str(file), f"suffix {file.suffix!r}", f"one of {', '.join(suffixes)}")


@contextmanager
def _progress(what: str, quiet: bool) -> Iterator[Callable[[int, int], None] | None]:
    """A progress bar on standard error; nothing at all when quiet or when nobody watches."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    with Progress(
        TextColumn(what), BarColumn(), TextColumn("{task.percentage:3.0f} %"), TimeRemainingColumn(), console=console
    ) as bar:
        job = bar.add_task(what, total=None)

        def report(done: int, total: int) -> None:
            if done % 50 == 0 or done == total:
                bar.update(job, completed=done, total=total)

        yield report


def _print_summary(trace: Trace) -> None:
    figures = trace.summary()
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"[bold]{figures['task']}[/bold]  {trace.task.about}")
    table = Table("", "median", "p99", "max", box=None)
    for label, key, form in (
        ("position error, mm", "position_error_mm", "{:.2g}"),
        ("orientation error, deg", "orientation_error_deg", "{:.2g}"),
        ("time of a tick, us", "tick_us", "{:.1f}"),
    ):
        spread = figures[key]
        table.add_row(label, *(form.format(spread[k]) for k in ("median", "p99", "max")))
    console.print(table)
    lines = [
        f"ticks {figures['ticks']}, limits active in {_percent(figures['limits_active'])}",
        f"largest excess over a limit {figures['limit_violation']:.1e}, peak joint speed {figures['peak_speed']:.3g}",
        f"method: {_shares(figures['methods'])};  status: {_shares(figures['statuses'])}",
        *(f"[yellow]note:[/yellow] {_plain(w)}" for w in figures["warnings"]),
        "[green]accepted[/green]" if figures["passed"] else "[red]not accepted[/red]",
    ]
    for line in lines:
        console.print(line)


def _print_frame_check(task: Task, seed: int, quiet: bool) -> None:
    from invariantqp.compare.frames import frame_check

    with _progress("tool frame displaced", quiet) as report:
        checks = frame_check(task, seed, report)
    table = Table("law", "change of joint positions, rad", "largest error, mm", box=None)
    for check in checks:
        table.add_row(check.law, f"{check.change:.1e}", f"{check.worst_error_mm:.2g}")
    console = Console(highlight=False)
    console.print("\nthe same motion, with the tool frame displaced at random:")
    console.print(table)


def _shares(counts: dict[str, Any]) -> str:
    return ", ".join(f"{name} {_percent(share)}" for name, share in sorted(counts.items(), key=lambda i: -i[1]))


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"


def _plain(text: str) -> str:
    return text.replace("[", r"\[")


if __name__ == "__main__":
    main()
