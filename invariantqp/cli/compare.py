"""`invariantqp compare`: our law and others on the same problems, charted; or what breaks them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from invariantqp.cli.places import folder, writable
from invariantqp.cli.status import NOT_ACCEPTED
from invariantqp.errors import BadInput
from invariantqp.printing import print_comparison, print_stability, progress


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
    from invariantqp.compare.report.ranking import rank_agreement
    from invariantqp.compare.report.report import write_report
    from invariantqp.compare.results import load_results
    from invariantqp.compare.sweep import DEFAULT_TASKS, sweep

    if json_file is not None:
        raise BadInput("--json", "no --stability beside it", "--out DIR, which has results.json")
    if jobs < -1 or jobs == 0:
        raise BadInput("--jobs", f"{jobs}", "a number of processes, or -1 for all cores")
    other = None if against is None else load_results(against)
    folder(out)
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
    from invariantqp.compare.laws.invariant import OURS
    from invariantqp.compare.measure.stability import compare_stability

    writable(json_file)
    with progress("comparing", quiet) as report:
        outcomes = compare_stability(report)
    if not quiet:
        print_stability(outcomes)
    if json_file is not None:
        json_file.write_text(json.dumps([run.as_json() for run in outcomes], indent=1) + "\n", encoding="utf-8")
    if not all(run.finite and run.inside for run in outcomes if run.law == OURS):
        raise typer.Exit(NOT_ACCEPTED)
