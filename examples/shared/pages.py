"""The parts of README and of the guide that a comparison's results say, as Markdown between two markers."""

from __future__ import annotations

from pathlib import Path

from invariantqp.workbench.compare.report import machine
from invariantqp.workbench.compare.results import Results
from invariantqp.workbench.compare.tables import CELLS, RULE, Table, by_kind, kinds, losses, settings, summary

BEGIN, END = "<!-- comparison -->", "<!-- end of comparison -->"
# Kinds of tasks that stand in one table.
GROUPS = (
    ("free", "no feedforward", "limits", "accelerations", "other tool frame"),
    ("singular", "turn", "jump", "jump accelerations", "out of reach"),
    ("stay", "outside", "stale", "jitter", "NaN"),
)


def guide(results: Results) -> str:
    """The tables of the guide's page."""
    parts = (
        "## The tasks",
        markdown(kinds(results)),
        "## The methods",
        markdown(settings(results)),
        "## Who is better",
        RULE,
        markdown(summary(results)),
        "## Kind by kind",
        CELLS,
        *(markdown(by_kind(results, group)) for group in GROUPS),
        "## Where ours is dominated",
        "mm · deg · rad/s^2 · rms rad/s^2 · s until settled",
        markdown(losses(results)),
        f"Measured on {machine(results)}",
    )
    return "\n\n".join(parts)


def markdown(table: Table) -> str:
    """A table as Markdown."""
    lines = ["| " + " | ".join(cell.replace("|", r"\|") for cell in row) + " |" for row in (table.columns, *table.rows)]
    lines.insert(1, "|" + "---|" * len(table.columns))
    return "\n".join(lines)


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
