"""`invariantqp compare`: our law and other methods on the same tasks, in charts; or difficult tasks in a table."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from invariantqp.cli.places import folder, writable, write
from invariantqp.cli.status import NotAccepted
from invariantqp.errors import BadInput
from invariantqp.extras import require
from invariantqp.printing import print_comparison, print_not_installed, print_stability, progress


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
    against: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Another results.json: print how alike both rank by time.")
    ] = None,
    stability: Annotated[
        bool, typer.Option("--stability", help="Run difficult tasks under our law and the usual ones.")
    ] = False,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="With --stability: write every figure as JSON.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing unless something is wrong.")] = False,
) -> None:
    """Compare time and accuracy of our law and other methods on each TASK, in a chart, tables and a page.

    With --stability, print how each law does in difficult tasks; the exit status is 0 if our answers are always finite
    and inside the limits, 1 if not.
    """
    if stability:
        ignored = {"TASK": tasks, "--methods": methods, "--only": only, "--against": against, "--seed": seed}
        for option, value in (ignored | {"--quick": quick}).items():
            if value:
                raise BadInput(option, "--stability too", "one of them: --stability has its own tasks and laws")
        _compare_stability(json_file, quiet)
        return
    require("pictures", "matplotlib", "jinja2")
    from invariantqp.compare.report import write_report
    from invariantqp.compare.results import load_results, rank_agreement
    from invariantqp.compare.sweep import DEFAULT_TASKS, not_installed, sweep

    if json_file is not None:
        raise BadInput("--json", "no --stability beside it", "--out DIR", "It writes results.json into DIR.")
    if jobs < -1 or jobs == 0:
        raise BadInput("--jobs", f"{jobs}", "a number of processes, or -1 for all cores")
    other = None if against is None else load_results(against)
    kinds = None if only is None else [word.strip() for word in only.split(",")]
    missing = not_installed(tasks or DEFAULT_TASKS, methods, kinds)  # a wrong name is told before a folder is made
    if not quiet:
        print_not_installed(missing)
    folder("--out", out)
    with progress("measuring", quiet) as report:
        results = sweep(
            tasks or DEFAULT_TASKS, methods, out, seed=seed, quick=quick, jobs=jobs, only=kinds, progress=report
        )
    files = write_report(results, out)
    if not quiet:
        print_comparison(results, files, None if other is None else rank_agreement(results, other))


def _compare_stability(json_file: Path | None, quiet: bool) -> None:
    """Run what breaks velocity control.

    Raises:
        NotAccepted: our law was not finite, or left its limits.
    """
    from invariantqp.compare.method import OURS
    from invariantqp.compare.stability import compare_stability, not_installed

    writable("--json", json_file)
    if not quiet:
        print_not_installed(not_installed())
    with progress("comparing", quiet) as report:
        outcomes = compare_stability(report)
    if json_file is not None:
        write(json_file, json.dumps([run.as_json() for run in outcomes], indent=1) + "\n")
    if not quiet:
        print_stability(outcomes)
    failed = [run.case for run in outcomes if run.law == OURS and not (run.finite and run.inside)]
    if failed:
        raise NotAccepted([f"{case}: an answer of ours was not finite, or outside limits" for case in failed])
