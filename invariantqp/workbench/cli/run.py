"""`invariantqp run`: a task in closed loop, written to files and shown in a browser."""

from __future__ import annotations

import json
import os
import re
import sys
import webbrowser
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from typer.core import TyperCommand

from invariantqp.errors import BadInput
from invariantqp.extras import require
from invariantqp.workbench.cli.console import (
    PAGES,
    PICTURES,
    JsonFile,
    NotAccepted,
    Quiet,
    progress,
    say,
    writable,
    write,
    writing,
)

if TYPE_CHECKING:
    from invariantqp.velocity.solution import VelocitySolution
    from invariantqp.workbench.runs.plant import PlantState
    from invariantqp.workbench.runs.run import Observer
    from invariantqp.workbench.runs.taskfile import Task
    from invariantqp.workbench.runs.trace import PathTrace, Trace

# Environment variables of sessions without this machine's screen.
REMOTE = ("CI", "SSH_CONNECTION", "SSH_TTY")
# Environment variables of sessions with a screen on Linux and the BSDs.
SCREEN = ("DISPLAY", "WAYLAND_DISPLAY")


class ViewAlone(TyperCommand):
    """A command whose --view takes an optional file: --view, --view a.html, --view=a.html."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Join --view and its file, if any: a task's name has no ending, and a task file has .toml."""
        joined: list[str] = []
        for word in args:
            after_view = joined[-1:] == ["--view="]
            if after_view and not word:
                raise BadInput("--view", "an empty name", "a file that ends in .html, or --view alone")
            if after_view and not word.startswith("-") and Path(word).suffix not in ("", ".toml"):
                joined[-1] += word
            else:
                joined.append("--view=" if word == "--view" else word)
        return super().parse_args(ctx, joined)


def run(
    task: Annotated[str, typer.Argument(help="A task file, or the name of one that comes with the package.")],
    json_file: JsonFile = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE", help="Write a picture (.png, .svg, .pdf) of the run.")
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(metavar="[FILE]", help="Write the run as an .html page; without a FILE, TASK.html, and open it."),
    ] = None,
    backend: Annotated[
        str | None, typer.Option(metavar="NAME", help="QP solver: daqp, osqp, or any that qpsolvers has.")
    ] = None,
    physics: Annotated[
        str, typer.Option(metavar="NAME", help="ideal, or mujoco with friction, lag and noise.")
    ] = "ideal",
    check_frame: Annotated[
        bool, typer.Option("--check-frame", help="Also displace the tool frame, and show what that changes.")
    ] = False,
    seed: Annotated[
        int | None, typer.Option(help="Seed of the displacement of --check-frame; 0 if left out.", min=0)
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Run TASK in closed loop, and say whether its acceptance numbers are met."""
    from invariantqp.workbench.runs.taskfile import load_task

    if check_frame and quiet:
        raise BadInput("--check-frame", "--quiet too", "one of them: --check-frame prints what it finds")
    if seed is not None and not check_frame:
        raise BadInput("--seed", "no --check-frame beside it", "--check-frame too: the seed is of its displacement")
    problem = load_task(task)  # before the rest is imported: a wrong name is refused sooner
    from invariantqp.workbench.runs.run import run_task

    writable("--json", json_file)
    writable("--plot", plot, PICTURES)
    if plot is not None:
        require("pictures", "matplotlib")
    if physics == "mujoco":
        require("sim", "mujoco")
    page = _page_of(problem, view)
    overrides: dict[str, Any] = {} if backend is None else {"backend": backend}
    with progress("running", quiet) as report:
        observer = None if report is None else _observer(report, problem.ticks)
        trace = run_task(problem, physics=physics, observer=observer, **overrides)
    _write(trace, json_file, plot, page)
    if page is not None and not view:
        _open(page, quiet)
    if not quiet:
        print_run(trace)
    if check_frame:
        print_frame_check(trace, seed or 0)
    if not trace.passed:
        raise NotAccepted(trace.shortfalls)


def _observer(report: Callable[[int, int], None], ticks: int) -> Observer:
    """An observer that updates a progress bar."""

    def observer(tick: int, _state: PlantState, _solution: VelocitySolution) -> None:
        report(min(tick + 1, ticks), ticks)

    return observer


def _page_of(task: Task, view: str | None) -> Path | None:
    """The page to write; None without --view."""
    if view is None:
        return None
    require("pictures", "jinja2")
    page = Path(view or page_name(task))
    writable("--view", page, PAGES)
    return page


def page_name(task: Task) -> str:
    """The default file name of the page of a task."""
    return f"{re.sub(r'[^A-Za-z0-9._-]+', '_', task.name)}.html"


def has_display() -> bool:
    """Whether this session has a screen."""
    if any(os.environ.get(name) for name in REMOTE):
        return False
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in SCREEN)


def _open(page: Path, quiet: bool) -> None:
    """Open a page in a browser where there is a screen."""
    if not quiet:
        say(f"the view is written to {page}")
    if has_display():
        webbrowser.open(page.resolve().as_uri())


def _write(trace: Trace, json_file: Path | None, plot: Path | None, page: Path | None) -> None:
    """Write the files of the options."""
    if json_file is not None:
        write(json_file, json.dumps(trace.as_json(), indent=1) + "\n")
    if plot is not None:
        from invariantqp.workbench.pictures.run import picture

        with writing(plot):
            picture(trace, plot)
    if page is not None:
        from invariantqp.workbench.view.page import page as page_of
        from invariantqp.workbench.view.timeline import timeline_of

        write(page, page_of(timeline_of(trace)))


def print_run(trace: Trace) -> None:
    """Print the figures of a run, and whether it is accepted."""
    figures = trace.summary()
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"[bold]{escape(figures['task'])}[/bold]  {escape(trace.task.about)}")
    table = Table("", "median", "p99", "max", box=None)
    for label, key, form in (
        ("position error, mm", "position_error_mm", "{:.2g}"),
        ("orientation error, deg", "orientation_error_deg", "{:.2g}"),
        ("time of a tick, us", "tick_us", "{:.1f}"),
    ):
        spread = figures[key]
        table.add_row(label, *(form.format(spread[k]) for k in ("median", "p99", "max")))
    console.print(table)
    for line in _run_lines(trace, figures):
        console.print(line)


def _run_lines(trace: Trace, figures: dict[str, Any]) -> Iterator[str]:
    if figures["physics"] != "ideal":
        yield f"physics: {figures['physics']}"
    read = figures["force_error_relative_rms_measured"]
    if read is not None:
        error = (
            f"{percent(trace.force_error or 0.0)} rms of the wanted force, {percent(read)} as the controller read it"
        )
        yield f"force error: {error}; counted from {trace.time[trace.counted_from]:g} s on, after contact has settled"
    if trace.along is not None:
        yield from _path_lines(trace.along, figures)
    yield f"{figures['ticks']} ticks; a limit was active in {percent(figures['limits_active'])} of them"
    speed, acceleration = figures["peak_speed"], figures["peak_acceleration"]
    yield (
        f"largest joint speed: {speed:.3g}, acceleration: {acceleration:.3g}, counted from rest "
        "(rad/s, rad/s^2; of a slide m/s, m/s^2)"
    )
    yield f"largest excess over a limit: {figures['limit_violation']:.1e} (SI units)"
    if figures["nearest"]:
        yield f"least distance: {escape(figures['nearest'])}"
    if figures["form"]:
        yield f"attempted of a twist beyond the joints: by the {figures['form']}"
    yield f"methods: {_shares(figures['methods'])}; statuses: {_shares(figures['statuses'])}"
    for warning in figures["warnings"]:
        yield f"[yellow]note:[/yellow] {escape(warning)}"
    yield "[green]accepted[/green]" if figures["passed"] else "[red]not accepted[/red]"


def _path_lines(along: PathTrace, figures: dict[str, Any]) -> Iterator[str]:
    end = "arrived" if along.status == "done" else "stopped"
    yield (
        f"path: {end} {figures['path_lag']:.3g} s late; speed along it {figures['path_speed']['median']:.2g} of its "
        f"timing's in the median, {along.moving_speed.min():.2g} to {along.moving_speed.max():.2g}"
    )
    slowed = ", ".join(f"{name} {percent(share)}" for name, share in along.slowdowns.items())
    yield f"slowed down by: {slowed or 'nothing'}"


def print_frame_check(trace: Trace, seed: int) -> None:
    """Print how other frames of the tool, and in contact of sensor and contact, change a run."""
    from invariantqp.workbench.runs.frames import frame_check

    contact = trace.contact is not None
    columns = ["law", "change of joint positions, rad", "path error, mm", "in displaced frames"]
    table = Table(*columns, *(["force error", "in displaced frames"] if contact else []), box=None)
    for c in frame_check(trace.task, seed, trace.physics):
        forces = [percent(f or 0.0) for f in (c.force_error, c.displaced_force_error)] if contact else []
        table.add_row(c.law, f"{c.change:.1e}", f"{c.error_mm:.2g}", f"{c.displaced_error_mm:.2g}", *forces)
    frames = "frames of tool, sensor and contact" if contact else "tool frame"
    title = f"The same motion, with the {frames} displaced at random:"
    console = Console(highlight=False)
    console.print(f"\n{title}")
    console.print(table)


def percent(share: float) -> str:
    """A share in percent."""
    return f"{100.0 * share:.3g} %"


def _shares(counts: dict[str, Any]) -> str:
    return ", ".join(f"{name} {percent(share)}" for name, share in sorted(counts.items(), key=lambda i: -i[1]))
