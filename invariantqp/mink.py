"""mink's frame task with the error at a physical point of the tool, see `invariantqp.adapters.mink`."""

from invariantqp.adapters.mink import InvariantFrameTask

__all__ = ["InvariantFrameTask"]
