"""`invariantqp run`: a task in closed loop, and where it is told, drawn and seen."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from typer.core import TyperCommand

from invariantqp.cli.places import PAGES, PICTURES, writable
from invariantqp.cli.status import NOT_ACCEPTED
from invariantqp.printing import print_contact_frame_check, print_frame_check, print_run, progress

if TYPE_CHECKING:
    from invariantqp.runs.taskfile import Task
    from invariantqp.view.server import Viewer


class ViewAlone(TyperCommand):
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
    from invariantqp.runs.run import run_task
    from invariantqp.runs.taskfile import load_task

    problem = load_task(task)
    writable(json_file)
    writable(plot, PICTURES)
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
        from invariantqp.pictures.run import picture

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
        writable(page, PAGES)
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
