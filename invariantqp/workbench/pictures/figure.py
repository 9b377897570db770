"""Figures that are written to a file and leave the caller's Matplotlib alone.

A figure has its own canvas: pyplot is not imported and no backend is selected, so the plots of a notebook, or of a
program with windows, stay as they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

from invariantqp.errors import BadInput
from invariantqp.extras import optional
from invariantqp.workbench.writing import complete_file

with optional("pictures", "matplotlib"):
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

SHEET = Path(__file__).with_name("style.mplstyle")


@contextmanager
def figure_file(
    file: Path | str, size: tuple[float, float], sheet: Path = SHEET, style: Mapping[str, Any] = MappingProxyType({})
) -> Iterator[Figure]:
    """An empty figure of a size [inches]; it is written to the file when the block ends without an error.

    Inside the block the rcParams of the style sheet hold, and those of `style` over them.

    Raises:
        BadInput: the ending is no format of Matplotlib's, or the file cannot be written.
    """
    ending = Path(file).suffix.lower()
    formats = FigureCanvasAgg.get_supported_filetypes()
    if ending.removeprefix(".") not in formats:
        raise BadInput(str(file), f"the ending {ending!r}", f"one of {', '.join(f'.{name}' for name in formats)}")
    with mpl.rc_context(dict(style), sheet):  # type: ignore[arg-type]
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)  # becomes figure.canvas
        yield figure
        # An SVG would contain the time of drawing: without it the same data give the same file.
        metadata = {"Date": None} if ending == ".svg" else None
        try:
            with complete_file(file) as part:
                figure.savefig(part, metadata=metadata)
        except OSError as error:
            raise BadInput(str(file), error.strerror or str(error), "a file that can be written") from error
