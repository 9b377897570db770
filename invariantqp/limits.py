"""Limits of a controller: joint limits, rows, tool speed, clearance, limits made for Pink."""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.control.clearance import Clearance as Clearance
    from invariantqp.control.clearance_bodies import OtherArm as OtherArm
    from invariantqp.control.limits import AccelerationLimit as AccelerationLimit
    from invariantqp.control.limits import JointLimits as JointLimits
    from invariantqp.control.limits import Limit as Limit
    from invariantqp.control.limits import Loop as Loop
    from invariantqp.control.pink_limit import PinkLimit as PinkLimit
    from invariantqp.geometry.coal import Mesh as Mesh
    from invariantqp.geometry.shapes import Box as Box
    from invariantqp.geometry.shapes import Capsule as Capsule
    from invariantqp.geometry.shapes import HalfSpace as HalfSpace
    from invariantqp.geometry.shapes import Sphere as Sphere
    from invariantqp.velocity.limits import Bounds as Bounds
    from invariantqp.velocity.limits import LimitRows as LimitRows
    from invariantqp.velocity.limits import ToolSpeed as ToolSpeed
