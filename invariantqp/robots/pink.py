"""Pink's names: this is the only file that imports it; without Pink it names the extra that installs it."""

from __future__ import annotations

from invariantqp.errors import MissingExtra

try:
    from pink import Configuration
    from pink.tasks import FrameTask
except ImportError as error:
    raise MissingExtra("pin-pink", "pink") from error

__all__ = ["Configuration", "FrameTask"]
