"""A ROS 2 node that drives an arm by twists or poses from a joystick, a headset or a policy; without ROS, a rehearsal.

In: joint states, geometry_msgs/TwistStamped (the tool point's velocity, along the axes of the robot's base frame, as
MoveIt Servo has it), geometry_msgs/PoseStamped (in the base frame). Out: joint velocities for a velocity controller.
Commands that stop coming stop the arm, inside the joints' limits, and so do joint states.

Run: python examples/18_servo_ros.py [robot, panda]
"""

import sys

import numpy as np

import invariantqp as iq

DT = 0.002  # [s]
NAME = sys.argv[1] if len(sys.argv) > 1 else "panda"
robot = iq.load_robot(NAME)
follower = iq.Follower(iq.Controller(robot, dt=DT, acceleration_limit=8.0), jerk=200.0)


def twist_of(linear, angular):
    """ROS puts the linear part first; this library the angular one."""
    return np.array([*angular, *linear])


def pose_of(position, quaternion):
    """(4, 4) from (x, y, z) and (x, y, z, w)."""
    x, y, z, w = np.asarray(quaternion) / np.linalg.norm(quaternion)
    angle, axis = 2.0 * np.arctan2(np.linalg.norm((x, y, z)), w), np.array([x, y, z])
    turn = axis * (angle / max(np.linalg.norm(axis), 1e-12))
    return iq.transform(iq.exp([*turn, 0.0, 0.0, 0.0])[:3, :3], position)


def node():
    """The node, where rclpy and the message packages are installed."""
    import rclpy
    from geometry_msgs.msg import PoseStamped, TwistStamped
    from rclpy.node import Node
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64MultiArray

    class ServoNode(Node):
        def __init__(self):
            super().__init__("invariantqp_servo")
            self.q, self.missed = None, 0
            self.out = self.create_publisher(Float64MultiArray, "joint_velocity_controller/commands", 1)
            self.create_subscription(JointState, "joint_states", self.measured, 1)
            self.create_subscription(TwistStamped, "servo/twist", self.twisted, 1)
            self.create_subscription(PoseStamped, "servo/pose", self.posed, 1)
            self.create_timer(DT, self.tick)

        def measured(self, message):
            by_name = dict(zip(message.name, message.position, strict=True))
            if by_name.keys() >= set(robot.names):  # others tell of a gripper alone
                self.q = np.array([by_name[name] for name in robot.names])

        def twisted(self, message):
            v, w = message.twist.linear, message.twist.angular
            follower.twist(twist_of((v.x, v.y, v.z), (w.x, w.y, w.z)))

        def posed(self, message):
            p, o = message.pose.position, message.pose.orientation
            follower.add(pose_of((p.x, p.y, p.z), (o.x, o.y, o.z, o.w)))

        def tick(self):
            q, self.q, self.missed = self.q, None, self.missed + 1
            if q is None:
                if self.missed > 10:
                    self.out.publish(Float64MultiArray(data=[0.0] * len(robot.names)))
                return
            self.missed = 0
            solution = follower.step(q)
            if solution.status in ("left", "held"):
                self.get_logger().warning(solution.reason, throttle_duration_sec=1.0)
            self.out.publish(Float64MultiArray(data=solution.velocity.tolist()))

    rclpy.init()
    rclpy.spin(ServoNode())


def rehearsal():
    """Half a second of twists at 50 Hz, then silence: what is commanded and told."""
    q = 0.5 * (robot.position_lower + robot.position_upper) + 0.1
    start, told = robot.pose(q)[:3, 3], []
    for k in range(500):
        if k < 250 and k % 10 == 0:
            follower.twist(twist_of((0.0, 0.1, 0.0), (0.0, 0.0, 0.0)))
        solution = follower.step(q)
        q = q + DT * solution.velocity
        told.append(solution.reason.split(" for ")[0] or solution.status)
    moved = 1e3 * (robot.pose(q)[:3, 3] - start)
    print(f"the tool moved by {moved.round(1)} mm: {', '.join(dict.fromkeys(told[1:]))}")


if __name__ == "__main__":
    try:
        node()
    except ImportError:
        print("rclpy is not installed here; a rehearsal without it:")
        rehearsal()
