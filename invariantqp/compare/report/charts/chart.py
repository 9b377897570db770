"""What a chart of the comparison is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from invariantqp.compare.results import Results


class CaptionedChart(NamedTuple):
    """A chart that is drawn from results, and its caption.

    Attributes:
        slug: the name of its file without the ending.
        title: its heading.
        draw: (results, file) draws it; the ending of the file tells the format.
        caption: what the results say, in sentences computed from them.
        shows: the measurements that it needs; it is left out if the results have nothing of one of them.
    """

    slug: str
    title: str
    draw: Callable[[Results, Path], None]
    caption: Callable[[Results], str]
    shows: tuple[str, ...]
