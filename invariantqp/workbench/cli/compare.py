"""`invariantqp compare`: our law and other methods on the same tasks, as tables, a chart and a page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from invariantqp.errors import BadInput, install_command
from invariantqp.extras import require
from invariantqp.workbench.cli.console import WIDEST, NotAccepted, Quiet, folder, progress, say, writing

MORE = "give it again for each further one"


def compare(
    tasks: Annotated[
        list[str] | None,
        typer.Argument(metavar="TASK", help="Names or files of tasks; by default the bed: every kind on five arms."),
    ] = None,
    arms: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help=f"An arm of the bed (panda, ur5e, so101, xarm7, random4); {MORE}."),
    ] = None,
    kinds: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help=f"A kind of task, such as limits, singular or turn; {MORE}."),
    ] = None,
    methods: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help=f"A method, a family, or part of a name; {MORE}.")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the report, its chart and results.json.")] = Path(
        "comparison"
    ),
    jobs: Annotated[
        int, typer.Option(metavar="N", help="Tasks at a time; -1 is one a core. For times to quote: 1.")
    ] = -1,
    quick: Annotated[bool, typer.Option("--quick", help="Two arms, without slow methods: two minutes.")] = False,
    seed: Annotated[int, typer.Option(help="Seed of the bed's tasks.", min=0)] = 0,
    setup: Annotated[
        bool,
        typer.Option(
            "--setup",
            help="Only install placo, RoboPlan, EmbodiK and Drake, each into an environment of its own: 2 GB.",
        ),
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Compare speed and accuracy of our law and other methods, all given the same.

    Without TASK, on the bed: each kind of task on a Panda, a UR5e, an SO-101, an xArm7 and a random arm of four joints.
    The exit status is 0 if our answers are always finite and inside the limits, 1 if not.
    """
    from invariantqp.workbench.compare.sweep import methods_named, tasks_of

    if jobs < -1 or jobs == 0:
        raise BadInput("--jobs", f"{jobs}", "a number of tasks at a time, or -1 for one a core")
    rows = methods_named(methods)
    if setup:
        make_environments(rows)
        return
    require("pictures", "matplotlib", "jinja2")
    from invariantqp.workbench.compare.report import write_report
    from invariantqp.workbench.compare.results import write_results
    from invariantqp.workbench.compare.sweep import sweep
    from invariantqp.workbench.compare.tables import broken_promises
    from invariantqp.workbench.writing import require_room

    folder("--out", out)
    bed_tasks = tasks_of(tasks or (), arms, kinds, seed, quick=quick)
    with writing(out):  # refused before the work
        out.mkdir(parents=True, exist_ok=True)
        require_room(out)
    with progress("measuring", quiet) as report:
        results = sweep(bed_tasks, rows, seed=seed, quick=quick, jobs=jobs, progress=report)
    if not quiet:
        print_comparison(results)
        report_omitted([row for row in rows if row.name not in {m["name"] for m in results["methods"]}], quick)
    with writing(out):
        write_results(out / "results.json", results)
        files = write_report(results, out)
    if not quiet:
        print(f"written: {', '.join(str(file) for file in files)}")
    failed = broken_promises(results)
    if failed:
        raise NotAccepted(failed)


def make_environments(rows: list[Any]) -> None:
    """Make the environment of each method that needs its own.

    Raises:
        NotAccepted: with the environments that failed.
    """
    from invariantqp.workbench.compare.environments import folder as place
    from invariantqp.workbench.compare.environments import make

    failed = []
    for environment, distribution in {row.environment: row.distribution for row in rows if row.environment}.items():
        say(f"installing {distribution} in {place() / environment}")
        why = make(environment, distribution)
        failed += [f"{distribution}: {why}"] if why else []
    if failed:
        raise NotAccepted(failed)


def report_omitted(rows: list[Any], quick: bool) -> None:
    """Print the methods that were not measured, and how to install them."""
    slow = [row.name for row in rows if quick and row.slow]
    missing = [row.name for row in rows if not row.environment and row.name not in slow]
    separate = [row.name for row in rows if row.environment]
    parts = (
        (slow, "left out by --quick: {}"),
        (missing, f"not installed: {{}}. Run: {install_command('peers')}"),
        (separate, "not installed: {}. Run: invariantqp compare --setup"),
    )
    for names, sentence in parts:
        if names:
            say(sentence.format(", ".join(names)))


def print_comparison(results: dict[str, Any]) -> None:
    """Print the tables of a comparison, and the number of failed runs."""
    from invariantqp.workbench.compare.results import failures
    from invariantqp.workbench.compare.tables import COMPARED, RULE, losses, summary

    console = Console(highlight=False, width=None if Console().is_terminal else WIDEST)
    for found, about in (
        (summary(results), RULE),
        (losses(results), COMPARED),
    ):
        if found.rows:
            table = Table(*found.columns, box=None)
            for row in found.rows:
                table.add_row(*map(escape, row))
            console.print(table)
            console.print(about, markup=False)
    failed = failures(results)
    if failed:
        method, task, why = failed[0]
        console.print(
            f"{len(failed)} runs failed, as the report says; the first: {method} on {task}: {why}", markup=False
        )
