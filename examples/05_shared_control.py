"""An operator slides the tool over a surface, the robot keeps its distance and attitude: neither is in the other's way.

Run: python examples/05_shared_control.py
"""

import numpy as np

import invariantqp as iq

DT, GAIN, DISTANCE = 0.002, 20.0, 0.10  # [s], [1/s], [m]

robot = iq.load_robot("panda")
loop = iq.Controller(robot, dt=DT)
q = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])  # [rad]
upright = robot.pose(q)
surface = upright[2, 3] - 0.12  # the tool is 20 mm too high
slides = np.column_stack([iq.se3.prismatic([1, 0, 0]), iq.se3.prismatic([0, 1, 0])])  # the operator's: two slides
kept = np.column_stack(
    [iq.se3.prismatic([0, 0, 1]), *(iq.revolute(axis) for axis in np.eye(3))]
)  # the robot's: the rest
rng = np.random.default_rng(0)
hand, heights, slid = np.zeros(6), [], []
task = iq.control.SharedTask(kept, slides)  # at the tool point; two systems that fill six dimensions need no form

for _ in range(1000):
    tool = robot.pose(q)
    to_tool = iq.adjoint(iq.transform(translation=-tool[:3, 3]))  # from the base's origin to the tool point
    hand += 0.02 * (0.2 * rng.standard_normal(6) - hand)  # a restless hand on all six axes of a joystick
    wanted = upright.copy()
    wanted[:3, 3] = [tool[0, 3], tool[1, 3], surface + DISTANCE]
    twist = task.twist(to_tool @ (GAIN * iq.log(wanted @ iq.inverse(tool))), hand)
    solution = loop.follow(q, twist)
    q = q + DT * solution.velocity
    heights.append(robot.pose(q)[2, 3] - surface)
    slid.append(DT * hand[3:5])

off = 1e6 * np.abs(np.array(heights[500:]) - DISTANCE).max()
moved = robot.pose(q)[:2, 3] - upright[:2, 3]
lost = 1e6 * np.linalg.norm(moved - np.sum(slid, axis=0))
turned = np.rad2deg(np.linalg.norm(iq.log(robot.pose(q) @ iq.inverse(upright))[:3]))
print(f"the operator slid the tool {1e3 * np.linalg.norm(moved):.1f} mm, {lost:.2f} micrometres of it lost")
print(f"the robot kept 100 mm to {off:.3f} micrometres and the attitude to {turned:.1e} degrees")
