"""How the charts look: each family of methods has a colour and a marker, and text in an SVG stays text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from invariantqp.compare.names import OURS
from invariantqp.compare.results import Results, family
from invariantqp.pictures.figure import figure_file
from invariantqp.pictures.palette import BLUE, GREEN, ORANGE, PURPLE, TEXT, VERMILION

# Width of a chart [inches] and its resolution [dots per inch], such that it fits the width of a README.
WIDTH = 9.0
DOTS = 100
# Largest over smallest value of a logarithmic axis: below SHORT ticks are at 1, 2, 5; from LONG on at powers of ten.
SHORT, LONG = 3e3, 1e6


class FamilyStyle(NamedTuple):
    """Colour and marker of a family of methods, and its name in a legend."""

    colour: str
    marker: str
    title: str


STYLES = {
    "invariant": FamilyStyle(BLUE, "o", "invariant"),
    "Moore-Penrose": FamilyStyle(VERMILION, "s", "Moore-Penrose"),
    "damped": FamilyStyle(ORANGE, "^", "damped"),
    "QP": FamilyStyle(GREEN, "D", "QP solvers"),
    "system": FamilyStyle(PURPLE, "P", "whole systems"),
}
NO_FAMILY = FamilyStyle(TEXT, "o", "")
RC: dict[str, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "invariantqp",
}


@contextmanager
def chart_file(
    file: Path, rows: int, columns: int = 1, *, height: float = 4.0, shared: bool = False
) -> Iterator[tuple[Figure, Any]]:
    """A figure and its panels to draw on; it is written to the file when the block ends.

    Args:
        file: ends in .svg, .png or .pdf.
        rows: number of rows of panels.
        columns: number of columns of panels.
        height: of the figure [inches].
        shared: whether all panels have the same axes.

    Raises:
        BadInput: the file cannot be written.
    """
    with figure_file(file, (WIDTH, height), RC, dots=DOTS) as figure:
        yield figure, figure.subplots(rows, columns, squeeze=False, sharex=shared, sharey=shared)


def lay_out(figure: Figure) -> None:
    """Place the panels for good, so that positions in pixels are known."""
    figure.canvas.draw()
    figure.set_layout_engine("none")


def style_of(results: Results, method: str) -> FamilyStyle:
    """Colour and marker of a method."""
    return STYLES.get(family(results, method), NO_FAMILY)


def short(method: str) -> str:
    """A method's name in a chart, where the colour tells its family."""
    return (
        method.removeprefix("QP, ")
        .replace(", polished", " polished")
        .replace(", warm", " warm")
        .replace(", cold", " cold")
        .replace("Robotics Toolbox, ", "Robotics Toolbox ")
    )


def is_ours(method: str) -> bool:
    """Whether this is our method, whose name is written in bold."""
    return method == OURS


def families_legend(figure: Figure, results: Results, names: Iterable[str], extra: Sequence[Line2D] = ()) -> None:
    """A legend above the panels: the families of the named methods, and extra lines."""
    there = {family(results, name) for name in names}
    handles = [
        Line2D([], [], color=style.colour, marker=style.marker, linestyle="", label=style.title)
        for name, style in STYLES.items()
        if name in there
    ]
    handles += extra
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False, fontsize=9.0)


def grid(axes: Axes) -> None:
    """Faint grid lines behind the data."""
    axes.grid(visible=True, which="major", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)


def plain_ticks(axis: Axis, limits: tuple[float, float]) -> None:
    """Ticks of a logarithmic axis as 1, 10, 100; also 2 and 5 if the axis is short; as powers of ten if it is long."""
    span = limits[1] / limits[0]
    if span < LONG:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if span < SHORT else (1.0,), numticks=20))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def percent(share: float) -> str:
    """A share as a percentage."""
    return f"{100.0 * share:.3g} %"
