"""Joint positions for a pose."""

from invariantqp.lazy import lazily

with lazily(__name__):
    from invariantqp.pose.batch import solve_poses as solve_poses
    from invariantqp.pose.ik import PoseSolution as PoseSolution
    from invariantqp.pose.ik import solve_pose as solve_pose
