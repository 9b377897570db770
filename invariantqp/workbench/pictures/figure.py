"""A Matplotlib figure that is written to a file and belongs to nobody else.

The figure has its own canvas. pyplot is not imported and no backend is selected, so the plots of a notebook, or of a
program with windows, stay as they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from invariantqp.errors import BadInput
from invariantqp.extras import optional

with optional("pictures", "matplotlib"):
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure


@contextmanager
def figure_file(
    file: Path | str, size: tuple[float, float], style: Mapping[str, Any], *, dots: int = 120
) -> Iterator[Figure]:
    """An empty figure of a size [inches] to draw on; it is written to the file when the block ends without an error.

    `style` has Matplotlib's rcParams that hold inside the block, `dots` is the resolution [dots per inch].
    """
    ending = Path(file).suffix.lower()
    known = FigureCanvasAgg.get_supported_filetypes()
    if ending.removeprefix(".") not in known:
        raise BadInput(str(file), f"the ending {ending!r}", f"one of {', '.join(f'.{name}' for name in known)}")
    parameters: Any = dict(style)
    with mpl.rc_context(parameters):
        figure = Figure(figsize=size, dpi=dots, layout="constrained")
        FigureCanvasAgg(figure)  # becomes figure.canvas
        yield figure
        # An SVG would contain the time of drawing: without it the same data give the same file.
        metadata = {"Date": None} if ending == ".svg" else None
        try:
            figure.savefig(file, dpi=dots, metadata=metadata)
        except OSError as error:
            raise BadInput(str(file), error.strerror or str(error), "a file that can be written") from error
