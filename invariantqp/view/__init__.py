"""A run to look at: in a browser while it is running, or as one HTML file that needs nothing else."""

from invariantqp.lazy import lazily

with lazily(__name__):
    from invariantqp.view.page import animation as animation
    from invariantqp.view.server import Viewer as Viewer
