"""Time of a tick against how much the joint velocity depends on the choice of frames and of the unit of length."""

from __future__ import annotations

from pathlib import Path

from invariantqp.compare.names import DLS, LEAST_SQUARES, LU, OURS, PINK
from invariantqp.compare.report.charts.scatter import Point, band, positive, scatter
from invariantqp.compare.report.charts.style import chart_file
from invariantqp.compare.report.tables import across
from invariantqp.compare.results import Results, results_of

# Smaller changes are drawn at this value: the axis is logarithmic.
FLOOR = 1e-16
TITLES = {
    "frame": "Another tool frame and base frame, displaced at random",
    "unit": "Millimetres instead of metres",
}
READING = (
    "The same physical question is asked in two descriptions. A point is the worst state of all arms; its faint line "
    "ends at the median of the arm with the largest median."
)
# A relative change up to this is rounding.
ROUNDING = 1e-8


def points(results: Results, way: str) -> list[Point]:
    """For each method the time of a tick, the largest change in any state, and the largest median of an arm."""
    found = []
    for method in results["methods"]:
        name = method["name"]
        time = across(results, "tick", name, "median_us")
        mine = [run[way] for (_, n), run in results_of(results, "dependence").items() if n == name]
        worst = [change for run in mine if (change := positive(run["worst"], FLOOR)) is not None]
        usual = [change for run in mine if (change := positive(run["median"], FLOOR)) is not None]
        if time is not None and worst:
            found.append(Point(name, time, max(worst), max(usual)))
    return found


def dependence_chart(results: Results, file: Path) -> None:
    """Two panels: other frames, and another unit."""
    with chart_file(file, 2, height=8.8) as (figure, panels):
        drawn = [points(results, way) for way in TITLES]
        for axes, title in zip(panels[:, 0], TITLES.values(), strict=True):
            axes.set_title(title)
            band(axes, ROUNDING)
            axes.set_ylabel("relative change of the joint velocity, worst state")
        panels[-1, 0].set_xlabel("time of one whole tick, median [us]")
        scatter(figure, panels[:, 0], drawn, results, ROUNDING)


def dependence_caption(results: Results) -> str:
    """How much the methods depend on frames and units, and where Moore-Penrose does not depend on frames."""
    sentences = [READING]
    for way, words in (("frame", "with other frames"), ("unit", "in millimetres")):
        found = {p.method: p for p in points(results, way)}
        listed = [
            f"{name} {found[name].y:.2g} (median {found[name].reach:.2g})"
            for name in (OURS, LU, DLS, LEAST_SQUARES, PINK)
            if name in found
        ]
        if listed:
            sentences.append(f"Largest change {words}: {'; '.join(listed)}.")
    return " ".join([*sentences, *_trajectories(results), *_free(results)])


def _trajectories(results: Results) -> list[str]:
    """How much whole runs change."""
    runs = results_of(results, "trajectory")
    if not runs:
        return []
    moved = {name: max(run["change"] for (_, n), run in runs.items() if n == name) for _, name in runs}
    listed = "; ".join(f"{name} {change:.2g}" for name, change in moved.items())
    return [f"Another tool frame changes joint positions during whole runs by up to [rad]: {listed}."]


def _free(results: Results) -> list[str]:
    """The arms on which Moore-Penrose does not depend on frames."""
    free = [
        task
        for (task, name), run in results_of(results, "dependence").items()
        if name == LU and run["frame"]["median"] is not None and run["frame"]["median"] < ROUNDING
    ]
    if not free:
        return []
    return [f"On {' and '.join(free)} the median state of Moore-Penrose does not depend on frames: J has rank 6."]
