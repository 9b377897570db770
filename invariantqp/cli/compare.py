"""`invariantqp compare`: our law and other methods on the same tasks, in charts and tables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from invariantqp.cli.console import WIDEST, NotAccepted, Quiet, folder, progress, say, writing
from invariantqp.errors import BadInput, install_command
from invariantqp.extras import require


def compare(
    tasks: Annotated[
        list[str] | None, typer.Argument(metavar="TASK", help="Names or files of tasks; six shipped ones by default.")
    ] = None,
    methods: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="A method, a family, or part of a name; give it again for each further one. Default: all.",
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for the report, its pictures and results.json.")
    ] = Path("comparison"),
    jobs: Annotated[int, typer.Option(metavar="N", help="Processes for what is not timed; -1 uses all cores.")] = -1,
    quick: Annotated[bool, typer.Option("--quick", help="Measure few states and long ticks: about a minute.")] = False,
    only: Annotated[
        str | None, typer.Option(metavar="KINDS", help="Measurements, separated by commas: loop, tick, beyond, ...")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of states, twists and displacements.", min=0)] = 0,
    stability: Annotated[
        bool, typer.Option("--stability", help="Instead, tasks at which methods fail, and inputs with NaN.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Compare time and accuracy of our law and other methods on each TASK, in a chart, tables and a page.

    With --stability the exit status is 0 if our answers are always finite and inside the limits, 1 if not.
    """
    for option, value in {"TASK": tasks, "--only": only}.items():
        if stability and value:
            raise BadInput(option, "--stability too", "one of them: --stability has its own tasks and measurements")
    require("pictures", "matplotlib", "jinja2")
    from invariantqp.compare.measurements import STABILITY
    from invariantqp.compare.registry import chosen, not_installed
    from invariantqp.compare.report import write_report
    from invariantqp.compare.results import write_results
    from invariantqp.compare.sweep import DEFAULT_TASKS, sweep
    from invariantqp.compare.tables import failed_stability

    if jobs < -1 or jobs == 0:
        raise BadInput("--jobs", f"{jobs}", "a number of processes, or -1 for all cores")
    kinds = list(STABILITY) if stability else None if only is None else [word.strip() for word in only.split(",")]
    for extra, names in {} if quiet else not_installed(chosen(methods)).items():
        say(f"not installed, so left out: {'; '.join(names)}. Run: {install_command(extra)}")
    folder("--out", out)
    with progress("measuring", quiet) as report:
        results = sweep(tasks or DEFAULT_TASKS, methods, seed=seed, quick=quick, jobs=jobs, only=kinds, progress=report)
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
        write_results(out / "results.json", results)
        files = write_report(results, out)
    if not quiet:
        print_comparison(results, files)
    failed = failed_stability(results) if stability else []
    if failed:
        raise NotAccepted([f"{task}: an answer of ours was not finite, or outside limits" for task in failed])


def print_comparison(results: dict[str, Any], files: list[Path]) -> None:
    """The tables of a comparison, its verdict, and the files that were written."""
    from invariantqp.compare.report import verdict
    from invariantqp.compare.tables import EVERYDAY_CELLS, STABILITY_CELLS, everyday, stability, summary

    console = Console(highlight=False, width=None if Console().is_terminal else WIDEST)
    parts = ((summary(results), ""), (everyday(results), EVERYDAY_CELLS), (stability(results), STABILITY_CELLS))
    for found, cells in parts:
        if not found.rows:
            continue
        table = Table(*found.columns, box=None)
        for row in found.rows:
            table.add_row(*(escape(cell) for cell in row))
        console.print(table)
        if cells:
            console.print(cells, markup=False)
    for sentence in verdict(results):
        console.print(f"- {sentence}", markup=False)
    failed = [cell["result"]["failed"] for cell in results["cells"] if "failed" in cell["result"]]
    if failed:
        sentence = (
            f"{len(failed)} of {len(results['cells'])} measurements failed, as the report says; the first: {failed[0]}"
        )
        console.print(sentence, markup=False)
    console.print(f"written: {', '.join(str(file) for file in files)}", markup=False)
