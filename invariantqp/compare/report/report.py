"""The report: a verdict, the chart and ten rows on the first screen; everything else folded below.

Every sentence with a figure or a winner is computed from the results.
"""

from __future__ import annotations

from pathlib import Path

from invariantqp.compare.report import chart, tables
from invariantqp.compare.report.page import (
    Block,
    Bullets,
    Code,
    Folded,
    Heading,
    Paragraph,
    Picture,
    Table,
    html,
    table_markdown,
)
from invariantqp.compare.report.verdict import short, verdict
from invariantqp.compare.results import Results, kinds_in
from invariantqp.progress import Progress

TITLE = "Speed against accuracy of velocity control"
LEGEND = (
    "Each cell: time of a tick [us], largest position error [mm] and orientation error [deg] of the run. takes: what a "
    "method has no place for of what every row is told. frame: the largest change of a joint position when the same "
    "motion is asked of a tool frame put elsewhere on the tool."
)
AGAIN = (
    "An interrupted run continues where it stopped. Times are measured with one BLAS thread while nothing else runs; "
    "--against OTHER/results.json tells whether two runs rank the methods alike."
)
ABOUT = {
    "loop": "Runs: errors, frame dependence beside its control, jumps of the joint velocity, failed ticks",
    "beyond": "A target out of reach",
    "turns": "Ten turns of a closed path: drift of the joints [rad] with a posture and without",
    "noise": "Encoders wrong by 0.1 mrad",
    "calibration": "Joints not where the model says, each turned by 5 mrad and shifted by 5 mm (standard deviations), "
    "and a camera that sees the tool",
    "error": "One solve against its exact answer",
    "tick": "Time of a tick [us]",
}


def write_report(results: Results, out: Path, progress: Progress | None = None) -> list[Path]:
    """Write report.html and the chart into a folder.

    Args:
        results: from `sweep` or `load_results`.
        out: the folder, which exists.
        progress: called with (charts drawn, charts in all).

    Returns:
        The files: the report, then the pictures.
    """
    pictures = []
    if {"loop", "tick"} <= kinds_in(results):
        file = out / "speed_and_accuracy.svg"
        chart.draw(results, file)
        pictures.append(Picture(file, chart.TITLE, caption()))
        if progress is not None:
            progress(1, 1)
    report = out / "report.html"
    report.write_text(html(TITLE, page(results, pictures)), encoding="utf-8")
    return [report, *(picture.file for picture in pictures)]


def guide(results: Results) -> str:
    """The tables of the guide's page, as Markdown."""
    parts = (
        table_markdown(tables.summary(results)),
        "Other libraries, each where it was installed beside this one:",
        table_markdown(tables.libraries(results)),
        f"{ABOUT['calibration']}: largest position error [mm] · variation of the joint velocities [rad/s] of the run.",
        table_markdown(tables.calibrated(results)),
    )
    return "\n\n".join(parts)


def caption() -> str:
    """What the chart shows, in words."""
    return " ".join((chart.__doc__ or "").split("\n\n", 1)[1].split())


def page(results: Results, pictures: list[Picture]) -> list[Block]:
    """The blocks of the page."""
    blocks: list[Block] = [Heading(TITLE, 1), Paragraph(_opening(results)), Bullets(short(results)), *pictures]
    blocks += [tables.summary(results), Paragraph(LEGEND)]
    blocks.append(Folded("Task by task", Table(("what the runs say",), [(sentence,) for sentence in verdict(results)])))
    names = [m["name"] for m in results["methods"]]
    if names != tables.shown(results):
        blocks.append(Folded("Every method", tables.summary(results, names)))
    blocks.append(
        Folded("What each method is, and what it makes of what every row is told", tables.information(results))
    )
    for kind, about in ABOUT.items():
        table = tables.listed(results, kind)
        if table.rows:
            blocks.append(Folded(about, table))
    failed = [c for c in results["cells"] if "failed" in c["result"]]
    if failed:
        rows = [(c["method"], c["kind"], c["task"], c["result"]["failed"]) for c in failed]
        blocks.append(Folded("What could not be measured", Table(("method", "measurement", "task", "why"), rows)))
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
    quick = " This was a quick run: few states, and ticks ten times as long." if results["quick"] else ""
    told = "Every method is told the same posture, exact rows, limits, gain and feedforward."
    counts = f"{len(results['methods'])} methods on {len(results['tasks'])} tasks; seed {results['seed']}."
    return f"{counts} {told}{exact}{quick}"


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
