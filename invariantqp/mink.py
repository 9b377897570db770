"""mink's frame task, measured at one physical point of the tool: `invariantqp.adapters.mink`."""

from invariantqp.adapters.mink import InvariantFrameTask

__all__ = ["InvariantFrameTask"]
