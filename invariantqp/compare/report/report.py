"""The report: findings, charts, tables, the machine, and the command that repeats the comparison.

Every sentence with a figure or a winner is computed from the results.
"""

from __future__ import annotations

from pathlib import Path

from invariantqp.compare.report import tables
from invariantqp.compare.report.charts import CHARTS
from invariantqp.compare.report.charts.chart import CaptionedChart
from invariantqp.compare.report.findings import findings
from invariantqp.compare.report.page import Block, Bullets, Code, Heading, Paragraph, Picture, Table, html, markdown
from invariantqp.compare.results import Results, kinds_in
from invariantqp.progress import Progress

TITLE = "Speed against accuracy of velocity control"
LEGEND = (
    "All figures are medians over the tasks. error: relative to the exact answer of the method's own problem; with "
    "active limits, of the problem inside the limits that the method solves or that clipping approximates. residual: "
    "the share of the twist that is not achieved while limits are active, in the tool frame, with metres and radians "
    "alike. tracking: the largest position error of a run. frame: the largest relative change of the joint velocity "
    "when another tool frame and base frame are chosen."
)
AGAIN = (
    "An interrupted run continues where it stopped. Times are measured with one BLAS thread while nothing else runs; "
    "--against OTHER/results.json tells whether two runs rank the methods alike."
)
# Measurements with tables of their own.
TOLD = {"error", "time", "growth"}


def charts_of(results: Results) -> list[CaptionedChart]:
    """The charts for which the results have figures."""
    have = kinds_in(results)
    return [chart for chart in CHARTS if set(chart.shows) <= have]


def write_report(results: Results, out: Path, progress: Progress | None = None) -> list[Path]:
    """Write report.html, report.md and the pictures into a folder.

    Args:
        results: from `sweep` or `load_results`.
        out: the folder, which exists.
        progress: called with (charts drawn, charts in all).

    Returns:
        The files: both reports, then the pictures.
    """
    pictures = []
    charts = charts_of(results)
    for k, chart in enumerate(charts):
        file = out / f"{chart.slug}.svg"
        chart.draw(results, file)
        pictures.append(Picture(file, chart.title, chart.caption(results)))
        if progress is not None:
            progress(k + 1, len(charts))
    blocks = page(results, pictures)
    files = [out / "report.html", out / "report.md"]
    files[0].write_text(html(TITLE, blocks), encoding="utf-8")
    files[1].write_text(markdown(blocks), encoding="utf-8")
    return [*files, *(picture.file for picture in pictures)]


def page(results: Results, pictures: list[Picture]) -> list[Block]:
    """The blocks of the page."""
    blocks: list[Block] = [Heading(TITLE, 1), Paragraph(_opening(results)), Heading("Findings")]
    blocks.append(Bullets(findings(results)))
    blocks.append(tables.summary(results))
    blocks.append(Paragraph(LEGEND))
    for picture in pictures:
        blocks += [Heading(picture.title), picture]
    blocks += [Heading("What was compared"), _methods(results)]
    for task in results["tasks"]:
        blocks += [Heading(f"Single solves: the arm of {task}"), tables.solves(results, task)]
    if "growth" in kinds_in(results):
        blocks += [Heading("Growth of the time of a solve"), tables.growth(results)]
    for kind in sorted(kinds_in(results) - TOLD):
        table = tables.listed(results, kind)
        if table.rows:
            blocks += [Heading(kind.replace("_", " ").capitalize()), table]
    failed = [c for c in results["cells"] if "failed" in c["result"]]
    if failed:
        rows = [(c["method"], c["kind"], c["task"], c["result"]["failed"]) for c in failed]
        blocks += [Heading("What could not be measured"), Table(("method", "measurement", "task", "why"), rows)]
    return [*blocks, *_closing(results)]


def _opening(results: Results) -> str:
    """What was measured, and how exact the references are."""
    agreement = [
        sort["agreement"]
        for c in results["cells"]
        if c["kind"] == "error" and "failed" not in c["result"]
        for sort in c["result"].values()
        if sort["agreement"] is not None
    ]
    exact = f" Two independent computations of each exact answer agree to {max(agreement):.0e}." if agreement else ""
    quick = " This was a quick run, with few states and long ticks." if results["quick"] else ""
    return f"{len(results['methods'])} methods on {', '.join(results['tasks'])}; seed {results['seed']}.{exact}{quick}"


def _methods(results: Results) -> Table:
    rows = [(m["name"], m["family"], m["limits"], m["frame"], m["why"]) for m in results["methods"]]
    return Table(("method", "family", "limits", "frame", "what it is"), rows)


def _closing(results: Results) -> list[Block]:
    """The machine, the versions, and the command."""
    m = results["machine"]
    quick = " --quick" if results["quick"] else ""
    command = f"invariantqp compare {' '.join(results['tasks'])}{quick} --seed {results['seed']} --out comparison"
    releases = ", ".join(f"{name} {version}" for name, version in results["versions"].items())
    return [
        Heading("Machine and versions"),
        Paragraph(f"{m['processor']}, {m['cores']} cores, {m['system']}, Python {m['python']}. {releases}."),
        Heading("How to repeat this"),
        Code(command),
        Paragraph(AGAIN),
    ]
