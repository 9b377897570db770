"""Every number in README's comparison is the committed results', worked out here a second time."""

import json
import re
from pathlib import Path
from statistics import median

import pytest

from invariantqp.compare.report.tables import BEGIN, END, readme_table, with_table

ROOT = Path(__file__).parents[3]
FILE = ROOT / "examples" / "comparison" / "results.json"
README = (ROOT / "README.md").read_text(encoding="utf-8")
RESULTS = json.loads(FILE.read_text(encoding="utf-8"))
LINES = README.split(BEGIN)[1].split(END)[0].strip().splitlines()
HEADINGS, *ROWS = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in LINES if "---" not in line]
# Where the figures of a column are: the kind of measurement, then the keys of its result.
PLACES = [
    ("time", "free", "median_us"),
    ("error", "free", "error"),
    ("time", "limited", "median_us"),
    ("error", "limited", "error"),
    ("tick", "median_us"),
    ("closed_loop", "position_mm", "max"),
    ("dependence", "frame", "worst"),
]


def figures(method, kind, *keys):
    found = []
    for cell in RESULTS["cells"]:
        if (cell["kind"], cell["method"]) == (kind, method):
            value = cell["result"]
            for key in keys:
                value = value.get(key) if isinstance(value, dict) else None
            found += [] if value is None else [value]
    return found


def test_there_are_at_most_ten_rows():
    assert len(HEADINGS) == 1 + len(PLACES)
    assert 5 <= len(ROWS) <= 10
    assert ROWS[0][0] == "invariantqp"


@pytest.mark.parametrize("row", ROWS, ids=[row[0] for row in ROWS])
def test_every_number_is_the_median_of_the_committed_results(row):
    method, *cells = row
    assert method in {m["name"] for m in RESULTS["methods"]}
    for cell, place in zip(cells, PLACES, strict=True):
        found = figures(method, *place)
        if cell == "-":
            assert not found
        else:
            digits = 1 if "e" in cell else len(re.sub(r"\D", "", cell).lstrip("0")) or 1
            assert float(cell) == pytest.approx(median(found), rel=0.5 * 10.0 ** (1 - digits) * 1.01)


def test_the_command_would_write_what_is_there():
    assert with_table(README, readme_table(RESULTS)) == README


def test_the_results_are_small_enough_to_keep():
    assert FILE.stat().st_size < 500_000
    assert not re.search(r'"/|\\\\', FILE.read_text(encoding="utf-8"))
