"""A run to look at: in a browser while it is running, or as one HTML file that needs nothing else."""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.view.page import animation as animation
    from invariantqp.view.server import Viewer as Viewer
