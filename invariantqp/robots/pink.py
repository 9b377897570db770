"""Pink's names: this is the only file that imports it; without Pink it names the extra that installs it."""

from __future__ import annotations

from invariantqp.extras import optional

with optional("pink", "pin-pink"):
    from pink import Configuration
    from pink.barriers import SelfCollisionBarrier
    from pink.tasks import FrameTask

__all__ = ["Configuration", "FrameTask", "SelfCollisionBarrier"]
