"""How the charts look: one colour and marker a family, told apart by colour-blind readers, text that stays text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from invariantqp.compare.laws.invariant import OURS
from invariantqp.compare.results import Results, family
from invariantqp.pictures.run import COLOURS

# Inches; 100 dots to the inch are the width of a README.
WIDTH = 9.0
DOTS = 100


# Ratios of a logarithmic axis's ends below which it is short, and above which it is long.
SHORT, LONG = 3e3, 1e6


class Look(NamedTuple):
    """A family's colour and marker."""

    colour: str
    marker: str


BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION = COLOURS[:6]
LOOKS = {
    "invariant": Look(BLUE, "o"),
    "Moore-Penrose": Look(VERMILION, "s"),
    "damped": Look(ORANGE, "^"),
    "QP": Look(GREEN, "D"),
    "system": Look(PURPLE, "P"),
}
TITLES = {
    "invariant": "invariant (pitch form)",
    "Moore-Penrose": "Moore-Penrose",
    "damped": "damped",
    "QP": "QP solvers",
    "system": "whole systems",
}
RC: Any = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "invariantqp",
}


@contextmanager
def chart(file: Path, rows: int, columns: int = 1, height: float = 4.0, **options: Any) -> Iterator[tuple[Figure, Any]]:
    """A figure of README width with its panels, written to the file in the end.

    Args:
        file: .svg, .png or .pdf.
        rows: of panels.
        columns: of panels.
        height: of the figure [inches].
        options: of `matplotlib.pyplot.subplots`.
    """
    with mpl.rc_context(RC):
        figure, panels = plt.subplots(
            rows, columns, figsize=(WIDTH, height), dpi=DOTS, layout="constrained", squeeze=False, **options
        )
        try:
            yield figure, panels
            # The time of drawing is no result: the same figures make the same file.
            metadata = {"Date": None} if file.suffix == ".svg" else None
            figure.savefig(file, dpi=DOTS, metadata=metadata)
        finally:
            plt.close(figure)


def laid_out(figure: Figure) -> None:
    """Lay the panels out, once: what is placed by pixels may be placed now."""
    figure.canvas.draw()
    figure.set_layout_engine("none")


def look(results: Results, method: str) -> Look:
    """A method's colour and marker; grey for what has no family."""
    return LOOKS.get(family(results, method), Look("#555555", "o"))


def short(method: str) -> str:
    """A method's name as charts write it: its family is told by its colour."""
    return (
        method.removeprefix("QP, ")
        .replace(", polished", " polished")
        .replace(", warm", " warm")
        .replace(", cold", " cold")
        .replace("Robotics Toolbox, ", "Robotics Toolbox ")
    )


def is_ours(method: str) -> bool:
    """Whether a name is set in bold."""
    return method == OURS


def families_legend(figure: Figure, results: Results, names: Iterable[str], extra: Sequence[Line2D] = ()) -> None:
    """The families of the named methods, and extra lines, above the panels."""
    there = {family(results, name) for name in names}
    handles = [
        Line2D([], [], color=LOOKS[name].colour, marker=LOOKS[name].marker, linestyle="", label=TITLES[name])
        for name in LOOKS
        if name in there
    ]
    handles += extra
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False, fontsize=9.0)


def grid(axes: Axes) -> None:
    """Faint lines behind everything."""
    axes.grid(visible=True, which="major", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)


def plain_ticks(axis: Axis, limits: tuple[float, float]) -> None:
    """1, 10, 100 on a logarithmic axis, or 1, 2, 5, 10 where it is short; powers of ten where it is long."""
    span = limits[1] / limits[0]
    if span < LONG:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if span < SHORT else (1.0,), numticks=20))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def percent(share: float) -> str:
    """A share in words."""
    return f"{100.0 * share:.3g} %"
