"""A ROS 2 node that presses on a table: joint states and a wrench topic in, joint velocities out.

In: sensor_msgs/JointState, geometry_msgs/WrenchStamped of the wrist, geometry_msgs/PoseStamped (where to be, of which
the part along the table counts) and std_msgs/Float64 (the press [N]). Out: joint velocities for a velocity controller.
Joint states or readings that stop coming stop the arm. A tick runs when joint states come: readings wait for them.
Trouble is in the log, in words; a call of `reset` (std_srvs/Trigger) begins anew.

Run: python examples/38_force_ros.py [robot, ur5]      where rclpy is not installed, nothing but its kinematics
"""

import sys

import numpy as np

import invariantqp as iq

DT, SILENCE = 0.002, 0.05  # [s] of a tick, without joint states or readings


def pose_of(pose):
    """(4, 4) of a geometry_msgs/Pose."""
    p, o = pose.position, pose.orientation
    w, axis = o.w, np.array([o.x, o.y, o.z])
    turn = 2.0 * np.arctan2(np.linalg.norm(axis), w) * axis / max(np.linalg.norm(axis), 1e-12)
    return iq.transform(iq.exp([*turn, 0.0, 0.0, 0.0])[:3, :3], [p.x, p.y, p.z])


def make_loop(robot):
    """A tool of half a kilogram behind the sensor, on whatever is below."""
    task = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], normal=[0, 0, 1]), [5.0], max_force=40.0)
    # order=None: a geometry_msgs/Wrench has names. Its frame, that of the topic's header, is the sensor's: mount=.
    sensor = iq.WrenchSensor(np.eye(4), order=None, reads="reaction", mass=0.5, centre=[0, 0, -0.03], cutoff=50.0)
    return iq.HybridController(robot, task, dt=DT, sensor=sensor, delay=0.014)


def main(name="ur5"):
    """Spin."""
    import rclpy
    from geometry_msgs.msg import PoseStamped, WrenchStamped
    from rclpy.node import Node
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64, Float64MultiArray
    from std_srvs.srv import Trigger

    robot = iq.load_robot(name)

    class PressNode(Node):
        def __init__(self):
            super().__init__("invariantqp_press")
            self.loop, self.reading, self.target, self.press, self.silent = make_loop(robot), None, None, [5.0], 0.0
            self.out = self.create_publisher(Float64MultiArray, "joint_velocity_controller/commands", 1)
            self.create_subscription(JointState, "joint_states", self.measured, 1)
            self.create_subscription(WrenchStamped, "wrench", lambda m: setattr(self, "reading", m.wrench), 1)
            self.create_subscription(PoseStamped, "pose", lambda m: setattr(self, "target", pose_of(m.pose)), 1)
            self.create_subscription(Float64, "press", lambda m: setattr(self, "press", [m.data]), 1)
            self.create_service(Trigger, "reset", self.begin_anew)
            self.create_timer(SILENCE, self.watch)

        def measured(self, message):
            by_name = dict(zip(message.name, message.position, strict=True))
            if self.reading is None or not by_name.keys() >= set(robot.names):  # others tell of a gripper alone
                return
            q, reading, self.silent = np.array([by_name[name] for name in robot.names]), self.reading, 0.0
            self.reading = None  # an old one is none
            self.target = robot.pose(q) if self.target is None else self.target
            solution = self.loop.step(q, self.target, reading, wanted=self.press)
            if solution.reason:
                self.get_logger().warning(f"{solution.status}: {solution.reason}", throttle_duration_sec=1.0)
            self.out.publish(Float64MultiArray(data=solution.velocity.tolist()))

        def watch(self):
            self.silent += SILENCE
            if self.silent > SILENCE:
                self.out.publish(Float64MultiArray(data=[0.0] * len(robot.names)))

        def begin_anew(self, _request, response):
            self.loop.reset()
            response.success = True
            return response

    rclpy.init()
    rclpy.spin(PressNode())


if __name__ == "__main__":
    try:
        main(*sys.argv[1:2])
    except ImportError as missing:
        print(f"{missing.name} is not installed here; the loop alone says in free air:")
        loop = make_loop(iq.load_robot("ur5"))
        start = [0.0, -1.2, 1.8, -2.2, -1.57, 0.0]
        weight = iq.Wrench(force=[0.0, 0.0, 4.9], moment=[0.0, 0.0, 0.0])
        print(loop.step(start, loop.robot.pose(start), weight).reason)
