"""`invariantqp compare`: our law and other methods on the same tasks, in charts; or difficult tasks in a table."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from invariantqp.cli.console import WIDEST, NotAccepted, Quiet, folder, progress, writable, write
from invariantqp.errors import BadInput, install_command
from invariantqp.extras import require


def compare(
    tasks: Annotated[
        list[str] | None,
        typer.Argument(metavar="TASK", help="Names or files of tasks; six shipped ones by default."),
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
        str | None, typer.Option(metavar="KINDS", help="Measurements, separated by commas: loop, tick, error, ...")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of states, twists and displacements.", min=0)] = 0,
    stability: Annotated[
        bool, typer.Option("--stability", help="Run difficult tasks under our law and the usual ones.")
    ] = False,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="With --stability: write every figure as JSON.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Compare time and accuracy of our law and other methods on each TASK, in a chart, tables and a page.

    With --stability, print how each law does in difficult tasks; the exit status is 0 if our answers are always finite
    and inside the limits, 1 if not.
    """
    if stability:
        ignored = {"TASK": tasks, "--methods": methods, "--only": only, "--seed": seed}
        for option, value in (ignored | {"--quick": quick}).items():
            if value:
                raise BadInput(option, "--stability too", "one of them: --stability has its own tasks and laws")
        _compare_stability(json_file, quiet)
        return
    require("pictures", "matplotlib", "jinja2")
    from invariantqp.compare.registry import chosen, not_installed
    from invariantqp.compare.report import write_report
    from invariantqp.compare.sweep import DEFAULT_TASKS, cells, sweep

    if json_file is not None:
        raise BadInput("--json", "no --stability beside it", "--out DIR", "It writes results.json into DIR.")
    if jobs < -1 or jobs == 0:
        raise BadInput("--jobs", f"{jobs}", "a number of processes, or -1 for all cores")
    kinds = None if only is None else [word.strip() for word in only.split(",")]
    rows = chosen(methods)  # a wrong name is refused before a folder is made
    for cell in cells(tasks or DEFAULT_TASKS, [row.name for row in rows[:1]], only=kinds):
        cell.load()
    if not quiet:
        print_not_installed(not_installed(rows))
    folder("--out", out)
    with progress("measuring", quiet) as report:
        results = sweep(
            tasks or DEFAULT_TASKS, methods, out, seed=seed, quick=quick, jobs=jobs, only=kinds, progress=report
        )
    files = write_report(results, out)
    if not quiet:
        print_comparison(results, files)


def _compare_stability(json_file: Path | None, quiet: bool) -> None:
    """Run what breaks velocity control; not accepted if our law was not finite, or left its limits."""
    from invariantqp.compare.method import OURS
    from invariantqp.compare.registry import not_installed
    from invariantqp.compare.results import plain
    from invariantqp.compare.stability import compare_stability, rows
    from invariantqp.geometry.arrays import NEGLIGIBLE

    writable("--json", json_file)
    if not quiet:
        print_not_installed(not_installed(rows()))
    with progress("comparing", quiet) as report:
        outcomes = compare_stability(report)
    if json_file is not None:
        write(json_file, json.dumps(plain(outcomes), indent=1) + "\n")
    if not quiet:
        print_stability(outcomes)
    failed = [
        run["case"] for run in outcomes if run["law"] == OURS and (run["not_finite"] or run["excess"] > NEGLIGIBLE)
    ]
    if failed:
        raise NotAccepted([f"{case}: an answer of ours was not finite, or outside limits" for case in failed])


def print_not_installed(missing: dict[str, list[str]]) -> None:
    """What a comparison will leave out, on standard error, and how to install it; {extra: names}."""
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    for extra, names in missing.items():
        listed = "; ".join(names)
        console.print(f"not installed, so left out: {listed}. Run: {install_command(extra)}", markup=False)


def print_stability(outcomes: list[dict[str, Any]]) -> None:
    """A table of how each law did in each difficult case, with failures in red."""
    from invariantqp.geometry.arrays import NEGLIGIBLE

    errors = ("position_mm", "orientation_deg", "final_mm", "final_deg")
    headings = ("largest mm", "deg", "last mm", "deg", "tail rad/s", "chatter", "raised")
    table = Table("case", "law", "finite", "inside limits", "peak/limit", *headings, box=None)
    before = ""
    for run in outcomes:
        broken, raised = (round(run[key] * run["ticks"]) for key in ("not_finite", "raised"))
        table.add_row(
            "" if run["case"] == before else escape(run["case"]),
            escape(run["law"]),
            f"[red]no: {broken}[/red]" if broken else "yes",
            f"[red]{run['excess']:.1e}[/red]" if run["excess"] > NEGLIGIBLE else "yes",
            f"{run['peak']:.3f}",
            *(f"{run[key]:.3g}" for key in errors),
            f"{run['tail']:.1e}",
            f"{run['chatter']:.2f}",
            f"{raised or ''}",
        )
        before = run["case"]
    console = Console(highlight=False, width=None if Console().is_terminal else WIDEST)
    console.print(table)
    console.print(
        "finite: number of ticks without a finite answer; inside limits: largest excess over a limit; largest, last: "
        "errors of the run; tail: largest joint speed in its last tenth; chatter: total variation of the velocity "
        "relative to the QP with length and LM, given the same; raised: number of ticks in which the law raised."
    )


def print_comparison(results: dict[str, Any], files: list[Path]) -> None:
    """The tables of a comparison, its verdict, and the files that were written."""
    from invariantqp.compare.report import verdict
    from invariantqp.compare.results import kinds_in
    from invariantqp.compare.tables import EVERYDAY_CELLS, everyday, summary

    console = Console(highlight=False, width=None if Console().is_terminal else WIDEST)
    parts = [(summary(results), "")] if {"loop", "tick"} & kinds_in(results) else []
    if "everyday" in kinds_in(results):
        parts.append((everyday(results), EVERYDAY_CELLS.replace("*", "")))
    for found, cells in parts:
        table = Table(*found.columns, box=None)
        for row in found.rows:
            table.add_row(*(escape(cell) for cell in row))
        console.print(table)
        if cells:
            console.print(cells, markup=False)
    for sentence in verdict(results):
        console.print(f"- {sentence}", markup=False)
    failed = sum("failed" in cell["result"] for cell in results["cells"])
    if failed:
        console.print(f"{failed} of {len(results['cells'])} measurements failed: the report says why.")
    console.print(f"written: {', '.join(str(file) for file in files)}", markup=False)
