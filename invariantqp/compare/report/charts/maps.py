"""Where methods fail, drawn over two joints; and how many ticks fail where control is hard."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
from matplotlib.colors import LinearSegmentedColormap

from invariantqp.compare.laws.invariant import OURS
from invariantqp.compare.report.charts.loops import failed
from invariantqp.compare.report.charts.style import chart, percent, short
from invariantqp.compare.results import Results, family, picked
from invariantqp.geometry.arrays import Array

# Maps whose squares differ by less than this on average are drawn once.
ALIKE = 0.004
COLUMNS = 5
FAILURE = (
    "A state fails when a method raises, asks a joint for more than its speed limit before clipping, or leaves the "
    "tool further from its target in position and in orientation; other joints at random."
)
# White where nothing fails, dark where everything does; told apart in grey too.
SHADES = LinearSegmentedColormap.from_list("failures", ["#ffffff", "#f6c667", "#d55e00", "#3b0f1e"])
WAYS = {"raised": "#000000", "not_finite": "#0072B2", "outside": "#D55E00"}
# Letters in a line as wide as a chart.
LINE = 135
SAID = {"raised": "raised", "not_finite": "NaN or infinite", "outside": "further outside limits"}


class Group(NamedTuple):
    """Methods that fail in the same places, in the order of the results, and the map of each."""

    names: list[str]
    runs: list[dict[str, Any]]

    @property
    def share(self) -> str:
        """Of states that fail, or from the least to the most."""
        low, high = (percent(pick(run["share"] for run in self.runs)) for pick in (min, max))
        return low if low == high else f"{low} to {high}"


def groups(results: Results, arm: str) -> list[Group]:
    """Groups of methods, ours by itself, the others from the least failures to the most."""
    found: list[Group] = []
    runs = {name: run for (task, name), run in picked(results, "failure_map").items() if task == arm}
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
    """Which of a group stands for it: the first that is of the family most of them are of."""
    families = [family(results, name) for name in group.names]
    return families.index(Counter(families).most_common(1)[0][0])


def shares(run: dict[str, Any]) -> Array:
    """The map of a run as shares of its samples."""
    counts = np.asarray(run["map"], dtype=np.float64)
    return np.asarray(counts / run["samples"])


def _chart(results: Results, file: Path, arm: str) -> None:
    found = groups(results, arm)
    rows = -(-len(found) // COLUMNS)
    with chart(file, rows, COLUMNS, height=2.5 * rows + 0.5, sharex=True, sharey=True) as (figure, panels):
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
            others = [f"and {len(group.names) - 1} alike"] if len(group.names) > 1 else []
            weight = "bold" if group.names[0] == OURS else "normal"
            title = "\n".join((short(group.names[shown]), *others, group.share))
            axes.set_title(title, fontsize=8.0, fontweight=weight)
        for axes in flat[max(0, len(found) - COLUMNS) : len(found)]:
            axes.tick_params(labelbottom=True)
            axes.set_xlabel(f"{found[0].runs[0]['axes'][0]} [rad]", fontsize=8.0)
        for axes in panels[:, 0]:
            axes.set_ylabel(f"{found[0].runs[0]['axes'][1]} [rad]", fontsize=8.0)
        figure.colorbar(picture, ax=panels, label="share of states that fail", shrink=0.8, aspect=30)


def ur5_map(results: Results, file: Path) -> None:
    """The UR5's maps."""
    _chart(results, file, "ur5")


def so101_map(results: Results, file: Path) -> None:
    """The SO-101's maps."""
    _chart(results, file, "so101")


def _caption(results: Results, arm: str) -> str:
    several = [group for group in groups(results, arm) if len(group.names) > 1]
    alike = [f"Alike ({group.share}): {', '.join(short(name) for name in group.names)}." for group in several]
    return " ".join([FAILURE, *alike])


def ur5_caption(results: Results) -> str:
    """What counts as a failure, and whose maps are one."""
    return _caption(results, "ur5")


def so101_caption(results: Results) -> str:
    """What counts as a failure, and whose maps are one."""
    return _caption(results, "so101")


def failed_chart(results: Results, file: Path) -> None:
    """Bars of the methods that fail at all; the others by name."""
    found = failed(results)
    some = sorted((name for name in found if sum(found[name].values()) > 0.0), key=lambda n: sum(found[n].values()))
    never = [name for name in found if name not in some]
    with chart(file, 1, height=0.24 * len(some) + 2.0) as (figure, panels):
        axes = panels[0, 0]
        left = np.zeros(len(some))
        for way, colour in WAYS.items():
            width = 100.0 * np.array([found[name][way] for name in some])
            axes.barh([short(name) for name in some], width, left=left, color=colour, height=0.7, label=SAID[way])
            left += width
        for row, total in enumerate(left.tolist()):
            axes.text(total, row, f" {total:.2g}", va="center", fontsize=8.0)
        axes.set_xlabel("failed ticks [%], mean over the hard runs that a method can have")
        axes.set_xlim(0.0, 1.07 * max(left.max(initial=0.0), 1.0))
        axes.legend(loc="lower right", frameon=False)
        if never:
            said = "No failed tick: " + "; ".join(short(name) for name in never) + "."
            figure.suptitle(fill(said, LINE, break_on_hyphens=False), x=0.01, ha="left", fontsize=8.0)
