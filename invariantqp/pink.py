"""Pink's frame task, measured at one physical point of the tool: `invariantqp.adapters.pink`."""

from invariantqp.adapters.pink import InvariantFrameTask

__all__ = ["InvariantFrameTask"]
