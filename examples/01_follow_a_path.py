"""A Panda's tool follows a line inside its limits; the answer does not depend on where the tool frame was put.

Run: python examples/01_follow_a_path.py
"""

import numpy as np

import invariantqp as iq

DT = 0.001  # [s]

robot = iq.load_robot("panda")
controller = iq.Controller(robot, dt=DT)
q = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])  # [rad]
start = robot.pose(q)

for tick in range(1000):
    target = start.copy()
    target[1, 3] += 0.1 * tick * DT  # 10 cm/s along y
    ahead = np.array([0.0, 0.0, 0.0, 0.0, 0.1, 0.0])  # the twist that keeps up: (omega; v), base frame
    solution = controller.step(q, target, ahead)
    q += DT * solution.velocity

wanted = target[:3, 3] + DT * ahead[3:]
print(f"after {tick + 1} ticks: {1e6 * np.linalg.norm(robot.pose(q)[:3, 3] - wanted):.2f} micrometres off the line")
print(f"law: {controller.law.form.describe()}; last tick: {solution.method}, {solution.status}")
