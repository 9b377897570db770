"""The parts of README and of the guide that measurements say, as Markdown between two markers."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from invariantqp.workbench.compare.report import machine
from invariantqp.workbench.compare.results import Results
from invariantqp.workbench.compare.tables import (
    CELLS,
    COMPARED,
    OUTCOMES,
    RULE,
    Table,
    by_kind,
    kinds,
    losses,
    lost_kinds,
    settings,
    stability,
    summary,
)

ROOT = Path(__file__).parents[2]
MEASURED = ROOT / "examples" / "comparison"
# Kinds of tasks that stand in one table.
GROUPS = (
    ("free", "no feedforward", "limits", "accelerations", "other tool frame", "other unit"),
    ("singular", "principal pitch", "turn", "jump", "jump accelerations", "out of reach"),
    ("stay", "outside", "stale", "jitter", "NaN"),
)
OPTIONS = ("scene", "what it needs", "figure", "without it", "with it", "tick without, us", "tick with, us")
PROGRAMS = ("program", "rooms", "modules", "s to the first answer")
LAWS = {"ours": "this law", "line": "the line", "admittance": "admittance", "osc": "OSC"}


def better(results: Results) -> str:
    """Who is better, and where ours is dominated."""
    parts = (RULE, markdown(summary(results)), "## Where ours is dominated, worst first", COMPARED)
    return "\n\n".join((*parts, markdown(losses(results))))


def all_tables(results: Results) -> str:
    """The figures kind by kind, the tasks and the methods."""
    parts = (
        "## Kind by kind",
        CELLS,
        *(markdown(by_kind(results, group)) for group in GROUPS),
        "## The tasks",
        markdown(kinds(results)),
        "## The methods",
        markdown(settings(results)),
        f"Measured on {machine(results)}",
    )
    return "\n\n".join(parts)


def needs(found: dict[str, Any]) -> str:
    """What a scene needs, from examples/46_what_a_scene_needs.py."""
    return "\n\n".join(
        markdown(Table(*table)) for table in ((OPTIONS, found["options"]), (PROGRAMS, found["programs"]))
    )


def force(wipe: dict[str, Any], bullet: dict[str, Any]) -> str:
    """Force control at equal rate, from tests/benchmarks/equal_rate.py."""
    tables = (("robosuite's Wipe, 20 N", wipe), ("PyBullet, 10 N", bullet))
    return "\n\n".join(
        markdown(Table((title, *(LAWS[law] for law in found["laws"])), [(row, *c) for row, c in found["rows"].items()]))
        for title, found in tables
    )


def sections(results: Results) -> Iterator[tuple[Path, str, str]]:
    """(page, name of its section, content) of everything that is written from what was measured."""
    page = ROOT / "examples" / "guide" / "comparison.md"
    kept = {name: json.loads((MEASURED / f"{name}.json").read_text("utf-8")) for name in ("needs", "wipe", "bullet")}
    yield page, "who is better", better(results)
    yield page, "where methods fail", f"{OUTCOMES}\n\n{markdown(stability(results))}"
    yield page, "what a scene needs", needs(kept["needs"])
    yield page, "force at equal rate", force(kept["wipe"], kept["bullet"])
    yield page, "all tables", all_tables(results)
    yield ROOT / "README.md", "comparison", markdown(lost_kinds(results))


def markdown(table: Table) -> str:
    """A table as Markdown."""
    lines = ["| " + " | ".join(cell.replace("|", r"\|") for cell in row) + " |" for row in (table.columns, *table.rows)]
    lines.insert(1, "|" + "---|" * len(table.columns))
    return "\n".join(lines)


def with_section(page: str, name: str, section: str) -> str:
    """A page with a new section between its markers.

    Raises:
        ValueError: the page has no such markers.
    """
    first, last = f"<!-- {name} -->", f"<!-- end of {name} -->"
    before, begin, rest = page.partition(first)
    _, end, after = rest.partition(last)
    if not begin or not end:
        raise ValueError(f"no place for a section; expected the lines {first} and {last}")
    return f"{before}{begin}\n{section}\n{end}{after}"


def write_sections(results: Results) -> None:
    """Write every section into its page."""
    for page, name, section in sections(results):
        page.write_text(with_section(page.read_text("utf-8"), name, section), encoding="utf-8")
