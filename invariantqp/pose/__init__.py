"""Joint positions for a pose.

Each name is loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from invariantqp.lazy import load_lazily

if TYPE_CHECKING:
    from invariantqp.pose.batch import solve_poses as solve_poses
    from invariantqp.pose.ik import PoseSolution as PoseSolution
    from invariantqp.pose.ik import solve_pose as solve_pose

load_lazily(
    __name__,
    {"invariantqp.pose.batch": ("solve_poses",), "invariantqp.pose.ik": ("PoseSolution", "solve_pose")},
)
