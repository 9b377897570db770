"""LeRobot's kinematics class, and its action chunks on a `Follower`, see `invariantqp.adapters.lerobot`."""

from invariantqp.adapters.lerobot import ActionFollower, RobotKinematics

__all__ = ["ActionFollower", "RobotKinematics"]
