"""The command line: parsing only (`printing` prints). Exit status 0 done, 1 not accepted, 2 bad input."""

from __future__ import annotations

import json
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table
from typer.core import TyperCommand

from invariantqp import __version__
from invariantqp.errors import BadInput, InvariantQPError
from invariantqp.printing import (
    print_comparison,
    print_contact_frame_check,
    print_frame_check,
    print_inspection,
    print_run,
    print_stability,
    progress,
)

if TYPE_CHECKING:
    from invariantqp.control.taskfile import Task
    from invariantqp.view.server import Viewer

BAD_INPUT = 2
NOT_ACCEPTED = 1
PICTURES = (".png", ".svg", ".pdf")
PAGES = (".html",)

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
    from invariantqp.control.taskfile import load_task, shipped_tasks

    table = Table("task", "what it is", box=None)
    for name in shipped_tasks():
        table.add_row(name, load_task(name).about)
    Console().print(table)


class _ViewAlone(TyperCommand):
    """A command whose --view may stand alone (--view means --view=) or before a file (--view a.html, --view=a.html)."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Join them before anything else looks at them: a task's name has no ending, a task's file has .toml."""
        joined: list[str] = []
        for word in args:
            is_file = not word.startswith("-") and Path(word).suffix not in ("", ".toml")
            if is_file and joined[-1:] == ["--view="]:
                joined[-1] += word
            else:
                joined.append("--view=" if word == "--view" else word)
        return super().parse_args(ctx, joined)


@app.command(cls=_ViewAlone)
def run(
    ctx: typer.Context,
    task: Annotated[str, typer.Argument(help="A task file, or the name of one that comes with the package.")],
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write figures and joint trajectory as JSON.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE", help="Write a picture (.png, .svg, .pdf) of the run.")
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(metavar="[FILE]", help="Watch in a browser; to a FILE, or where there is no display, one .html."),
    ] = None,
    backend: Annotated[
        str | None, typer.Option(metavar="NAME", help="QP solver: daqp, osqp, or any that qpsolvers has.")
    ] = None,
    physics: Annotated[
        str, typer.Option(metavar="NAME", help="ideal, or mujoco: friction, lag and noise as an independent referee.")
    ] = "ideal",
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
    page, viewer = _watched(ctx, problem, view, quiet)
    overrides: dict[str, Any] = {} if backend is None else {"backend": backend}
    with progress("running", quiet) as report:
        observer = None if viewer is None else viewer.watch
        trace = run_task(problem, physics=physics, progress=report, observer=observer, **overrides)
    if not quiet:
        print_run(trace)
    if json_file is not None:
        json_file.write_text(json.dumps(trace.as_json(), indent=1) + "\n", encoding="utf-8")
    if plot is not None:
        from invariantqp.control.picture import picture

        picture(trace, plot)
    if check_frame:
        if trace.contact is None:
            print_frame_check(trace.task, seed, quiet)
        else:
            print_contact_frame_check(trace.task, seed, trace.physics, quiet)
    if page is not None:
        from invariantqp.view.page import animation

        animation(trace, page)
    if viewer is not None:
        with suppress(KeyboardInterrupt):
            _tell("playing; Ctrl-C leaves", quiet)
            viewer.play(trace)
    if not trace.passed:
        complaint = "\n".join(f"not accepted: {s}" for s in trace.shortfalls)
        Console(stderr=True, highlight=False).print(complaint, style="red", markup=False)
        raise typer.Exit(NOT_ACCEPTED)


def _watched(ctx: Any, task: Task, view: str | None, quiet: bool) -> tuple[Path | None, Viewer | None]:
    """Where a run is to be seen: a page to write, or a browser that shows it from now on; neither if nobody asked."""
    if view is None:
        return None, None
    from invariantqp.view.display import has_display, page_name

    if view or not has_display():
        page = Path(view or page_name(task))
        _writable(page, PAGES)
        if not view:
            _tell(f"no display: the view is written to {page}", quiet)
        return page, None
    from invariantqp.view.server import Viewer

    viewer = Viewer(task)
    ctx.call_on_close(viewer.close)
    viewer.open_browser()
    _tell(f"the view is at {viewer.url}", quiet)
    return None, viewer


def _tell(sentence: str, quiet: bool) -> None:
    """Say on standard error what is no result."""
    if not quiet:
        Console(stderr=True, highlight=False, soft_wrap=True).print(sentence, markup=False)


class _ManyNumbers(TyperCommand):
    """A command in which every number after --q belongs to it: --q 0 0.5 -1 means --q 0,0.5,-1."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Join them before anything else looks at them: -1 is no option."""
        joined: list[str] = []
        for word in args:
            before = joined[-2:]
            if len(before) == 2 and before[0] == "--q" and _is_numbers(before[1]) and _is_numbers(word):
                joined[-1] += f",{word}"
            else:
                joined.append(word)
        return super().parse_args(ctx, joined)


def _is_numbers(text: str) -> bool:
    try:
        _numbers(text)
    except BadInput:
        return False
    return True


def _numbers(text: str) -> list[float]:
    """Numbers apart by commas or spaces."""
    try:
        return [float(word) for word in text.replace(",", " ").split()]
    except ValueError as error:
        raise BadInput("--q", repr(text), "numbers, one a joint, such as --q 0 0.5 -1") from error


@app.command(cls=_ManyNumbers)
def inspect(
    robot: Annotated[str, typer.Argument(help="A robot's name, a URDF file, a task's name or a task file.")],
    tool: Annotated[
        str | None, typer.Option(metavar="FRAME", help="The tool frame; the robot's own if left out.")
    ] = None,
    q: Annotated[
        str | None, typer.Option("--q", metavar="NUMBERS", help="Joint positions; the middle of the range if left out.")
    ] = None,
    samples: Annotated[
        int | None, typer.Option(metavar="N", help="States of the joint range to look at.", min=1)
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write everything as JSON.")] = None,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Draw the principal pitches over the range (.png, .svg, .pdf)."),
    ] = None,
) -> None:
    """Tell what ROBOT can do and which form to give it: rank, type, pitches to stay away from, blind directions."""
    from invariantqp.control.inspection import DEFAULT_SAMPLES, arm
    from invariantqp.control.inspection import inspect as look

    if q is not None and samples is not None:
        raise BadInput("--q", "--samples beside it", "one of them: a state, or the range")
    _writable(json_file)
    _writable(plot, PICTURES)
    loaded = arm(robot, tool)
    state = None if q is None else _numbers(q)
    with progress("looking", samples is None) as report:
        found = look(loaded, name=robot, q=state, samples=samples or DEFAULT_SAMPLES, progress=report)
    print_inspection(found)
    if json_file is not None:
        json_file.write_text(json.dumps(found.as_json(), indent=1) + "\n", encoding="utf-8")
    if plot is not None:
        from invariantqp.control.pitch_picture import pitch_picture

        pitch_picture(found, loaded, plot)


@app.command()
def compare(
    tasks: Annotated[
        list[str] | None,
        typer.Argument(metavar="TASK", help="Task files or names; three shipped ones if left out."),
    ] = None,
    methods: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Methods, families, parts of names, apart by commas; all if left out."),
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where report, pictures and results.json go.")] = Path(
        "comparison"
    ),
    jobs: Annotated[int, typer.Option(metavar="N", help="Processes for what is not timed; -1 is all cores.")] = -1,
    quick: Annotated[bool, typer.Option("--quick", help="Few states and coarse ticks: a minute and a half.")] = False,
    only: Annotated[
        str | None, typer.Option(metavar="KINDS", help="Measurements, apart by commas: error, time, growth, ...")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of states, twists and displacements.", min=0)] = 0,
    against: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Another results.json: tell how alike the two rank by time.")
    ] = None,
    stability: Annotated[
        bool, typer.Option("--stability", help="What breaks velocity control, under our law and the usual ones.")
    ] = False,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="With --stability: write every figure as JSON.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing unless something is wrong.")] = False,
) -> None:
    """Chart speed against accuracy of our law and others, TASK by TASK; or, with --stability, what breaks them.

    With --stability the exit status is 0 when ours stays finite and inside limits, 1 when not.
    """
    if stability:
        _compare_stability(json_file, quiet)
        return
    from invariantqp.compare.ranking import rank_agreement
    from invariantqp.compare.report import write_report
    from invariantqp.compare.results import load_results
    from invariantqp.compare.sweep import DEFAULT_TASKS, sweep

    if json_file is not None:
        raise BadInput("--json", "no --stability beside it", "--out DIR, which has results.json")
    if jobs < -1 or jobs == 0:
        raise BadInput("--jobs", f"{jobs}", "a number of processes, or -1 for all cores")
    other = None if against is None else load_results(against)
    _folder(out)
    with progress("measuring", quiet) as report:
        results = sweep(
            tasks or DEFAULT_TASKS,
            methods,
            out,
            seed=seed,
            quick=quick,
            jobs=jobs,
            only=None if only is None else [word.strip() for word in only.split(",")],
            progress=report,
        )
    with progress("drawing", quiet) as report:
        files = write_report(results, out, report)
    if not quiet:
        print_comparison(results, files, None if other is None else rank_agreement(results, other))


def _compare_stability(json_file: Path | None, quiet: bool) -> None:
    from invariantqp.compare.invariant import OURS
    from invariantqp.compare.stability import compare_stability

    _writable(json_file)
    with progress("comparing", quiet) as report:
        outcomes = compare_stability(report)
    if not quiet:
        print_stability(outcomes)
    if json_file is not None:
        json_file.write_text(json.dumps([run.as_json() for run in outcomes], indent=1) + "\n", encoding="utf-8")
    if not all(run.finite and run.inside for run in outcomes if run.law == OURS):
        raise typer.Exit(NOT_ACCEPTED)


def _folder(out: Path) -> None:
    """Refuse a folder that cannot be had before the work is done."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput("--out", f"{out}: {error.strerror}", "a folder, or a place where one can be made") from error
    if not os.access(out, os.W_OK):
        raise BadInput("--out", f"{out}, which may not be written to", "a folder of yours")


def _writable(file: Path | None, suffixes: tuple[str, ...] = ()) -> None:
    """Refuse a place that cannot be written to before the work is done, not after."""
    if file is None:
        return
    if not file.parent.is_dir():
        raise BadInput(str(file), "a folder that does not exist", "a file in an existing folder")
    if file.is_dir():
        raise BadInput(str(file), "a folder", "the name of a file")
    if not os.access(file if file.exists() else file.parent, os.W_OK):
        raise BadInput(str(file), "a place that may not be written to", "a file in a folder of yours")
    if suffixes and file.suffix.lower() not in suffixes:
        raise BadInput(str(file), f"the ending {file.suffix!r}", f"one of {', '.join(suffixes)}")


if __name__ == "__main__":
    main()
