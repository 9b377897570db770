"""A part controller for robosuite, see `invariantqp.adapters.robosuite`."""

from invariantqp.adapters.robosuite import InvariantPose, controller_config

__all__ = ["InvariantPose", "controller_config"]
