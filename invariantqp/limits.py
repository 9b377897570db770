"""What no velocity may leave: joint limits, rows of your own, the tool's speed, clearance, limits made for Pink."""

from invariantqp.lazy import lazily

with lazily(__name__):
    from invariantqp.control.clearance import Clearance as Clearance
    from invariantqp.control.clearance import OtherArm as OtherArm
    from invariantqp.control.joint_rows import PinkLimit as PinkLimit
    from invariantqp.geometry.shapes import Box as Box
    from invariantqp.geometry.shapes import Capsule as Capsule
    from invariantqp.geometry.shapes import HalfSpace as HalfSpace
    from invariantqp.geometry.shapes import Sphere as Sphere
    from invariantqp.velocity.limits import Bounds as Bounds
    from invariantqp.velocity.limits import LimitRows as LimitRows
    from invariantqp.velocity.limits import ToolSpeed as ToolSpeed
