"""What no velocity may leave: joint limits, rows of your own, the tool's speed, limits made for Pink."""

from invariantqp.lazy import lazily

with lazily(__name__):
    from invariantqp.control.joint_rows import PinkLimit as PinkLimit
    from invariantqp.velocity.limits import Bounds as Bounds
    from invariantqp.velocity.limits import LimitRows as LimitRows
    from invariantqp.velocity.limits import ToolSpeed as ToolSpeed
