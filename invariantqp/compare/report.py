"""The report: a verdict, the chart and ten rows on the first screen; everything else folded below.

Every sentence with a figure or a winner is computed from the results.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

from invariantqp.compare import chart, tables
from invariantqp.compare.method import OURS
from invariantqp.compare.results import Results, kinds_in
from invariantqp.compare.tables import Table
from invariantqp.compare.verdict import verdict
from invariantqp.template import fill_template

ABOUT = {
    "loop": "Runs: errors, frame dependence beside its control, joint acceleration, settling time, failed ticks",
    "everyday": "What users meet first",
    "beyond": "A target out of reach",
    "calibration": "Joints not where the model says, each turned by 5 mrad and shifted by 5 mm (standard deviations), "
    "and a camera that sees the tool",
    "tick": "Time of a tick [us]",
}


def write_report(results: Results, out: Path) -> list[Path]:
    """Write report.html and the chart into a folder that exists: the files, the report first, then the chart if any."""
    drawn = []
    inline = ""
    if {"loop", "tick"} <= kinds_in(results):
        drawn.append(out / "speed_and_accuracy.svg")
        chart.draw(results, drawn[0])
        with tempfile.TemporaryDirectory() as folder:
            narrow = Path(folder) / "narrow.svg"
            chart.draw(results, narrow, columns=1)
            inline = themed(f'<div class="two">{inline_svg(drawn[0])}</div><div class="one">{inline_svg(narrow)}</div>')
    report = out / "report.html"
    report.write_text(html(results, inline), encoding="utf-8")
    return [report, *drawn]


def themed(svg: str) -> str:
    """A drawing in light colours with the page's in their place, which are dark where the reader's are."""
    for name, colour in chart.LIGHT._asdict().items():
        svg = svg.replace(colour.lower(), f"var(--{name})")
    return svg


def caption() -> str:
    """What the chart shows, in words."""
    return " ".join((chart.__doc__ or "").split("\n\n", 1)[1].split())


def html(results: Results, svg: str) -> str:
    """The page as one HTML file that needs no other file; `svg` is the chart by `themed`, "" without one."""
    quick = " --quick" if results["quick"] else ""
    values = {
        "opening": _opening(results),
        "verdict": verdict(results),
        "chart": svg,
        "light": chart.LIGHT._asdict(),
        "dark": chart.DARK._asdict(),
        "caption": caption(),
        "summary": tables.summary(results) if {"loop", "tick"} & kinds_in(results) else None,
        "everyday": tables.everyday(results),
        "cells": tables.EVERYDAY_CELLS.replace("*", ""),
        "folded": folded(results),
        "machine": machine(results),
        "command": f"invariantqp compare {' '.join(results['tasks'])}{quick} --seed {results['seed']} --out comparison",
    }
    return fill_template("invariantqp.compare", "page.html", values)


def folded(results: Results) -> list[tuple[str, Table]]:
    """Tables that a reader opens, with their titles."""
    found = []
    if (moved := tables.motion(results)).rows:
        found.append((tables.MOTION_CELLS, moved))
    names = [m["name"] for m in results["methods"]]
    if names != tables.shown(results):
        found.append(("Every method", tables.summary(results, names)))
    found.append(("What each method is, and what it makes of what every row is given", tables.information(results)))
    found += [(about, table) for kind, about in ABOUT.items() if (table := tables.listed(results, kind)).rows]
    cells = [cell for cell in results["cells"] if "failed" in cell["result"]]
    failed = [(cell["method"], cell["kind"], cell["task"], cell["result"]["failed"]) for cell in cells]
    if failed:
        found.append(("What could not be measured", Table(("method", "measurement", "task", "why"), failed)))
    return found


def _opening(results: Results) -> str:
    """What was measured."""
    rough = " This was a quick run: few states, and ticks ten times as long, but in what users meet first."
    quick = rough if results["quick"] else ""
    equal = "Every method is given the same posture, exact rows, limits, gain and feedforward."
    counts = f"{len(results['methods'])} methods on {len(results['tasks'])} tasks; seed {results['seed']}."
    own = results.get("kinematics") == OURS
    seen = f" Pinocchio was not installed: the loops of other methods read the arm from {OURS}." if own else ""
    return f"{counts} {equal}{seen}{quick}"


def machine(results: Results) -> str:
    """The machine and the versions, as far as the results have them."""
    m = results["machine"]
    releases = ", ".join(f"{name} {version}" for name, version in results.get("versions", {}).items())
    return f"{m['processor']}, {m['cores']} cores, {m['system']}, Python {m['python']}. {releases or 'No versions'}."


def inline_svg(file: Path) -> str:
    """An SVG file as an element of an HTML page; its ids begin with the name of the file, as no other picture's do."""
    text = file.read_text(encoding="utf-8")
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    name = file.stem
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = re.sub(r'((?:xlink:)?href)="#', rf'\1="#{name}-', text)
    return re.sub(r"url\(#", f"url(#{name}-", text)
