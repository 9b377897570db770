"""Inverse kinematics: joint positions for a pose, or for a part of one, inside the position limits.

In: a robot, targets, a start, exact demands, a clearance. Out: a `PoseSolution` for each target.
The room must not know loops, time or contact.
"""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.pose.ik import PoseSolution as PoseSolution
    from invariantqp.pose.ik import solve_pose as solve_pose
    from invariantqp.pose.ik import solve_poses as solve_poses
