"""Maps of the states in which methods fail, over two joints; and the shares of ticks that fail in difficult tasks."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
from matplotlib.colors import LinearSegmentedColormap

from invariantqp.compare.names import OURS
from invariantqp.compare.report.charts.loops import failed
from invariantqp.compare.report.charts.style import chart_file, percent, short
from invariantqp.compare.results import Results, family, results_of
from invariantqp.geometry.arrays import Array
from invariantqp.pictures.palette import BLACK, BLUE, VERMILION

# Maps whose squares differ by less than this share on average are drawn once.
ALIKE = 0.004
COLUMNS = 5
FAILURE = (
    "A state counts as failed if the method raises an exception, if it exceeds the speed limit of a joint before "
    "clipping, or if it moves the tool further from its target in both position and orientation. The other joints are "
    "at random."
)
# From white, where nothing fails, to dark, where everything fails; the steps differ in grey as well.
SHADES = LinearSegmentedColormap.from_list("failures", ["#ffffff", "#f6c667", "#d55e00", "#3b0f1e"])
# Colour and label of each cause of a failed tick.
CAUSES = {
    "raised": (BLACK, "raised an exception"),
    "not_finite": (BLUE, "not finite"),
    "outside": (VERMILION, "further outside limits"),
}
# Characters in a line as wide as a chart.
LINE = 135


class Group(NamedTuple):
    """Methods that fail in the same places, in the order of the results, with the map of each."""

    names: list[str]
    runs: list[dict[str, Any]]

    @property
    def share(self) -> str:
        """The share of states that fail; of several methods from the smallest share to the largest."""
        low, high = (percent(pick(run["share"] for run in self.runs)) for pick in (min, max))
        return low if low == high else f"{low} to {high}"


def groups(results: Results, arm: str) -> list[Group]:
    """Groups of methods: ours alone, then the others from the fewest failures to the most."""
    found: list[Group] = []
    runs = {name: run for (task, name), run in results_of(results, "failure_map").items() if task == arm}
    for method in results["methods"]:
        name = method["name"]
        if name not in runs:
            continue
        mine = shares(runs[name])
        alike = (g for g in found if OURS not in g.names and np.abs(shares(g.runs[0]) - mine).mean() < ALIKE)
        group = next(alike, None)
        if group is None:
            found.append(Group([name], [runs[name]]))
        else:
            group.names.append(name)
            group.runs.append(runs[name])
    return sorted(found, key=lambda g: (OURS not in g.names, g.runs[0]["share"]))


def _shown(results: Results, group: Group) -> int:
    """The index of the method whose map stands for a group: the first of the family with most of its members."""
    families = [family(results, name) for name in group.names]
    return families.index(Counter(families).most_common(1)[0][0])


def shares(run: dict[str, Any]) -> Array:
    """The map of a method as shares of the states in each square."""
    counts = np.asarray(run["map"], dtype=np.float64)
    return np.asarray(counts / run["samples"])


def _chart(results: Results, file: Path, arm: str) -> None:
    """Draw the maps of all groups."""
    found = groups(results, arm)
    rows = -(-len(found) // COLUMNS)
    with chart_file(file, rows, COLUMNS, height=2.5 * rows + 0.5, shared=True) as (figure, panels):
        flat = panels.ravel().tolist()
        for axes in flat[len(found) :]:
            axes.set_axis_off()
        for axes, group in zip(flat, found, strict=False):
            shown = _shown(results, group)
            run = group.runs[shown]
            (left, right), (low, high) = run["ranges"]
            extent = (left, right, low, high)
            picture = axes.imshow(
                shares(run), cmap=SHADES, vmin=0.0, vmax=1.0, origin="lower", aspect="auto", extent=extent
            )
            axes.spines[["top", "right"]].set_visible(True)
            weight = "bold" if group.names[0] == OURS else "normal"
            axes.set_title(_title(group, shown), fontsize=8.0, fontweight=weight)
        for axes in flat[max(0, len(found) - COLUMNS) : len(found)]:
            axes.tick_params(labelbottom=True)
            axes.set_xlabel(f"{found[0].runs[0]['axes'][0]} [rad]", fontsize=8.0)
        for axes in panels[:, 0]:
            axes.set_ylabel(f"{found[0].runs[0]['axes'][1]} [rad]", fontsize=8.0)
        figure.colorbar(picture, ax=panels, label="share of states that fail", shrink=0.8, aspect=30)


def _title(group: Group, shown: int) -> str:
    """The method whose map is shown, how many others share it, and the share of states that fail."""
    others = len(group.names) - 1
    lines = [short(group.names[shown]), *([f"and {others} other{'s' if others > 1 else ''}"] if others else [])]
    return "\n".join((*lines, group.share))


def ur5_map(results: Results, file: Path) -> None:
    """The maps of the UR5."""
    _chart(results, file, "ur5")


def so101_map(results: Results, file: Path) -> None:
    """The maps of the SO-101."""
    _chart(results, file, "so101")


def _caption(results: Results, arm: str) -> str:
    several = [group for group in groups(results, arm) if len(group.names) > 1]
    alike = [f"The same map ({group.share}): {'; '.join(short(name) for name in group.names)}." for group in several]
    return " ".join([FAILURE, *alike])


def ur5_caption(results: Results) -> str:
    """What counts as a failure, and which methods share a map."""
    return _caption(results, "ur5")


def so101_caption(results: Results) -> str:
    """What counts as a failure, and which methods share a map."""
    return _caption(results, "so101")


def failed_chart(results: Results, file: Path) -> None:
    """Bars for the methods with failed ticks; the names of the others above them."""
    found = failed(results)
    never = [name for name, shares_of in found.items() if not any(shares_of.values())]
    some = sorted((name for name in found if name not in never), key=lambda name: sum(found[name].values()))
    with chart_file(file, 1, height=0.24 * max(len(some), 1) + 2.4) as (figure, panels):
        axes = panels[0, 0]
        ends = np.zeros(len(some))
        for cause, (colour, label) in CAUSES.items():
            width = 100.0 * np.array([found[name][cause] for name in some])
            axes.barh([short(name) for name in some], width, left=ends, color=colour, height=0.7, label=label)
            ends += width
        for row, total in enumerate(ends.tolist()):
            axes.text(total, row, f" {total:.3g}", va="center", fontsize=8.0)
        axes.set_xlabel("failed ticks [%], mean over the difficult runs of a method")
        axes.set_xlim(0.0, 1.07 * max(ends.max(initial=0.0), 1.0))
        axes.set_ylim(-0.6, max(len(some), 1) - 0.4)
        figure.legend(loc="outside lower right", ncols=len(CAUSES), frameon=False)
        if never:
            text = "No failed tick: " + "; ".join(short(name) for name in never) + "."
            figure.suptitle(fill(text, LINE, break_on_hyphens=False), x=0.01, ha="left", fontsize=8.0)
