"""The parts of README and of the guide that a comparison's results say, as Markdown between two markers."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from invariantqp.compare.report import ABOUT, machine
from invariantqp.compare.results import Results, results_of
from invariantqp.compare.tables import (
    EVERYDAY_CELLS,
    MOTION_CELLS,
    Table,
    everyday,
    figure,
    motion,
    shown,
    summary,
    title,
)

BEGIN, END = "<!-- comparison -->", "<!-- end of comparison -->"

EVERYDAY_MORE = (
    "After a path the target rests for a second. The way through the singularity, a UR5's wrist, has feedforward. The "
    "posture that every row is given moves the joints of an arm that stays, but for those of invariantqp; without one "
    "all would stay. The late arm is told as `delay`, which lowers every gain alike."
)


def guide(results: Results, first: Results) -> str:
    """The tables of the guide's page; `first` are the results of the everyday tasks, measured by themselves."""
    libraries = [m["name"] for m in results["methods"] if m["family"] == "library"]
    parts = (
        markdown(summary(results)),
        *((MOTION_CELLS, markdown(moved)) if (moved := motion(results)).rows else ()),
        "Other libraries, each where it was installed beside this one:",
        markdown(summary(results, libraries)),
        f"{ABOUT['calibration']}: largest position error [mm] · variation of the joint velocities [rad/s] of the run.",
        markdown(calibrated(results)),
        f"Measured on {machine(results)}",
        "## What users meet first",
        f"{EVERYDAY_CELLS} {EVERYDAY_MORE}",
        markdown(everyday(first)),
        f"Measured on {machine(first)}",
    )
    return "\n\n".join(parts)


def calibrated(results: Results) -> Table:
    """Largest position error [mm] and variation of the joint velocities of arms that are not where their model says."""
    found = results_of(results, "calibration")
    tasks = list(dict.fromkeys(task for task, _ in found))
    rows = []
    for name in shown(results):
        runs = [found.get((task, name), {}) for task in tasks]
        cells = [f"{figure(run.get('position_mm'))} · {figure(run.get('variation'))}" for run in runs]
        rows.append([name, *cells])
    return Table(["method", *map(title, tasks)], rows)


def markdown(table: Table) -> str:
    """A table as Markdown."""
    lines = ["| " + " | ".join(cell.replace("|", r"\|") for cell in row) + " |" for row in (table.columns, *table.rows)]
    lines.insert(1, "|" + "---|" * len(table.columns))
    return "\n".join(lines)


def listed(sentences: Iterable[str]) -> str:
    """Sentences as a list."""
    return "\n".join(f"- {sentence}" for sentence in sentences)


def with_section(page: str, section: str) -> str:
    """A page with a new comparison between its markers.

    Raises:
        ValueError: the page has no markers.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"no place for the comparison; expected the lines {BEGIN} and {END}")
    return f"{before}{begin}\n{section}\n{end}{after}"


def write_section(page: Path, section: str) -> None:
    """Write a part of the comparison into a page."""
    page.write_text(with_section(page.read_text("utf-8"), section), encoding="utf-8")
