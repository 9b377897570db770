"""What a tick costs against what depends on how the problem was written down: on frames, on the unit of length."""

from __future__ import annotations

from pathlib import Path

from invariantqp.compare.laws.invariant import OURS
from invariantqp.compare.measure.stability import YARDSTICK
from invariantqp.compare.report.charts.scatter import Point, band, positive, scatter
from invariantqp.compare.report.charts.style import chart
from invariantqp.compare.report.findings import LU
from invariantqp.compare.report.tables import across
from invariantqp.compare.results import Results, picked

# Changes below this are drawn there.
FLOOR = 1e-16
TITLES = {
    "frame": "Tool frame and base frame displaced by about 25 cm",
    "unit": "Millimetres for metres",
}
ASKED = "The same physical question, asked twice"
# Up to this a change is rounding.
ROUNDING = 1e-8


def points(results: Results, way: str) -> list[Point]:
    """Every method's time of a tick, its worst change over all states and arms, and its largest median."""
    found = []
    for method in results["methods"]:
        name = method["name"]
        time = across(results, "tick", name, "median_us")
        mine = [run[way] for (_, n), run in picked(results, "dependence").items() if n == name]
        worst = [change for run in mine if (change := positive(run["worst"], FLOOR)) is not None]
        usual = [change for run in mine if (change := positive(run["median"], FLOOR)) is not None]
        if time is not None and worst:
            found.append(Point(name, time, max(worst), max(usual)))
    return found


def dependence_chart(results: Results, file: Path) -> None:
    """Two panels: frames, units."""
    with chart(file, 2, height=8.8) as (figure, panels):
        drawn = [points(results, way) for way in TITLES]
        for axes, title in zip(panels[:, 0], TITLES.values(), strict=True):
            axes.set_title(title)
            band(axes, ROUNDING)
            axes.set_ylabel("change of the joint velocity, relative, worst state")
        panels[-1, 0].set_xlabel("time of one whole tick, median [us]")
        scatter(figure, panels[:, 0], drawn, results, ROUNDING)


def dependence_caption(results: Results) -> str:
    """How much changes for whom; and where Moore-Penrose does not depend on frames either."""
    said = [f"{ASKED}; a point is the worst state, its faint line ends at the median of the arm with the largest."]
    for way, words in (("frame", "with frames displaced"), ("unit", "in millimetres")):
        found = {p.method: p for p in points(results, way)}
        listed = [
            f"{name} {found[name].y:.2g} (median {found[name].reach:.2g})"
            for name in (OURS, LU, "DLS", YARDSTICK, "Pink")
            if name in found
        ]
        if listed:
            said.append(f"Worst change {words}: {', '.join(listed)}.")
    runs = picked(results, "trajectory")
    moved = {name: max(run["change"] for (_, n), run in runs.items() if n == name) for _, name in runs}
    if moved:
        listed = [f"{name} {change:.2g}" for name, change in moved.items()]
        said.append(f"A displaced tool frame changes joint positions along whole runs by [rad]: {', '.join(listed)}.")
    free = [
        task
        for (task, name), run in picked(results, "dependence").items()
        if name == LU and run["frame"]["median"] is not None and run["frame"]["median"] < ROUNDING
    ]
    if free:
        said.append(
            f"On {' and '.join(free)} the median state of Moore-Penrose does not depend on frames: J has rank 6."
        )
    return " ".join(said)
