"""Pink, through here alone: the one file that imports it, or says which extra brings it."""

from __future__ import annotations

from invariantqp.errors import MissingExtra

try:
    from pink import Configuration
    from pink.tasks import FrameTask
except ImportError as error:
    raise MissingExtra("pin-pink", "pink") from error

__all__ = ["Configuration", "FrameTask"]
