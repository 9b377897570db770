"""What charts and report read: results.json, one cell a line of the comparison, and nothing else.

The schema is told in `compare.sweep`. Charts are functions of the results alone: a committed file can be drawn again.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from invariantqp.errors import BadInput

SCHEMA = 1

Results = dict[str, Any]


class Chart(NamedTuple):
    """A picture of the results.

    Attributes:
        slug: its file's stem.
        title: its heading.
        draw: (results, file) draws it; the file's ending tells the format.
        caption: what the results say, computed from them: where others win, and where not.
        shows: the kinds of cells that it needs; it is left out where the results have none of one.
    """

    slug: str
    title: str
    draw: Callable[[Results, Path], None]
    caption: Callable[[Results], str]
    shows: tuple[str, ...]


def load_results(file: Path) -> Results:
    """Results from a file that `invariantqp compare` wrote.

    Raises:
        BadInput: no such file, or not one of these.
    """
    try:
        results = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise BadInput(
            str(file), f"{type(error).__name__}: {error}", "a results.json of invariantqp compare"
        ) from error
    if not isinstance(results, dict) or results.get("schema") != SCHEMA:
        found = f"schema {results.get('schema')!r}" if isinstance(results, dict) else type(results).__name__
        raise BadInput(str(file), found, f"results of schema {SCHEMA}", "Run invariantqp compare again.")
    return results


def picked(results: Results, kind: str) -> dict[tuple[str, str], dict[str, Any]]:
    """{(task, method): result} of one kind, without those that failed."""
    return {
        (cell["task"], cell["method"]): cell["result"]
        for cell in results["cells"]
        if cell["kind"] == kind and "failed" not in cell["result"]
    }


def kinds(results: Results) -> set[str]:
    """The kinds that there are results of."""
    return {cell["kind"] for cell in results["cells"]}


def family(results: Results, method: str) -> str:
    """The family of a method in the results."""
    return next((str(m["family"]) for m in results["methods"] if m["name"] == method), "")
