"""Arms: from joint positions to tool pose and joint twists, all in the base frame.

Each name is loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from invariantqp.lazy import load_lazily

if TYPE_CHECKING:
    from invariantqp.robots.chain import Chain as Chain
    from invariantqp.robots.compose import mobile_base as mobile_base
    from invariantqp.robots.compose import rail as rail
    from invariantqp.robots.compose import relative as relative
    from invariantqp.robots.compose import stand_on as stand_on
    from invariantqp.robots.kinematics import Robot as Robot
    from invariantqp.robots.kinematics import Sighting as Sighting
    from invariantqp.robots.load import load_robot as load_robot

load_lazily(
    __name__,
    {
        "invariantqp.robots.chain": ("Chain",),
        "invariantqp.robots.compose": ("mobile_base", "rail", "relative", "stand_on"),
        "invariantqp.robots.kinematics": ("Robot", "Sighting"),
        "invariantqp.robots.load": ("load_robot",),
    },
)
