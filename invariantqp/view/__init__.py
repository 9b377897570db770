"""A run to look at: in a browser while it is running, or as one HTML file that needs nothing else.

Each name is loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from invariantqp.lazy import load_lazily

if TYPE_CHECKING:
    from invariantqp.view.page import animation as animation
    from invariantqp.view.server import Viewer as Viewer

load_lazily(
    __name__,
    {"invariantqp.view.page": ("animation",), "invariantqp.view.server": ("Viewer",)},
)
