"""What no velocity may leave: joint limits, rows of your own, the tool's speed, limits made for Pink.

Each name is loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from invariantqp.lazy import load_lazily

if TYPE_CHECKING:
    from invariantqp.control.joint_rows import PinkLimit as PinkLimit
    from invariantqp.velocity.limits.box import Bounds as Bounds
    from invariantqp.velocity.limits.rows import LimitRows as LimitRows
    from invariantqp.velocity.limits.toolspeed import ToolSpeed as ToolSpeed

load_lazily(
    __name__,
    {
        "invariantqp.control.joint_rows": ("PinkLimit",),
        "invariantqp.velocity.limits.box": ("Bounds",),
        "invariantqp.velocity.limits.rows": ("LimitRows",),
        "invariantqp.velocity.limits.toolspeed": ("ToolSpeed",),
    },
)
