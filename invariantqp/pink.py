"""Pink's frame task with the error at a physical point of the tool, see `invariantqp.adapters.pink`."""

from invariantqp.adapters.pink import InvariantFrameTask

__all__ = ["InvariantFrameTask"]
