"""Limits in the loop: positions, speeds, accelerations, the tool's speed, rows of your own; and what statuses say.

Run: python examples/03_limits.py      needs the extra `robots`
"""

from collections import Counter

import numpy as np

import invariantqp as iq

DT = 0.005  # [s]
TICKS = 600

robot = iq.load_robot("panda")
start = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])  # [rad]
target = robot.pose(start) @ iq.exp([0.0, 0.0, 0.6, 0.25, 0.3, 0.1])  # some 40 cm away, and turned


def run(goal, q=start, **limits):
    """The loop, and the largest value of what limits are about."""
    controller = iq.Controller(robot, dt=DT, gain=20.0, **limits)
    before, most, solutions = np.zeros(7), Counter(), []
    for _ in range(TICKS):
        solution = controller.step(q, goal)
        x = solution.velocity
        J, tool = robot.jacobian(q), robot.pose(q)[:3, 3]
        most["tool speed"] = max(most["tool speed"], np.linalg.norm((J @ x)[3:] + np.cross((J @ x)[:3], tool)))
        most["joint speed"] = max(most["joint speed"], (np.abs(x) / robot.velocity_limit).max())
        most["acceleration"] = max(most["acceleration"], np.abs(x - before).max() / DT)
        q, before = q + DT * x, x
        room = np.minimum(q - robot.position_lower, robot.position_upper - q).min()
        most["past a position limit"] = max(most["past a position limit"], -room)
        solutions.append(solution)
    error = 1e3 * np.linalg.norm(robot.pose(q)[:3, 3] - goal[:3, 3])
    return q, most, solutions, error


print("The same way with more and more limits (joint speed as a share of the robot's own limit):")
ALL = {"acceleration_limit": 8.0, "tool_speed": 0.25, "position_margin": 0.02}
for name, limits in {
    "the robot's own": {},
    "+ 8 rad/s^2": {"acceleration_limit": 8.0},
    "+ tool at 0.25 m/s": {"acceleration_limit": 8.0, "tool_speed": 0.25},
    # Joints 0 and 2 share a hose: their speeds may differ by no more than 0.1 rad/s.
    "+ a row": ALL | {"rows": iq.limits.LimitRows([[1, 0, -1, 0, 0, 0, 0]], [-0.1], [0.1])},
}.items():
    _, most, _, error = run(target, **limits)
    said = (
        f"joint speed {most['joint speed']:.2f}, {most['acceleration']:7.1f} rad/s^2, tool {most['tool speed']:.3f} m/s"
    )
    print(f"  {name:19s} {said}, at the end {error:.3f} mm off")

print("\nA target out of reach: the arm stays inside its limits and says what holds it:")
away = iq.transform(translation=[1.2, 0.4, 0.5])
q, most, solutions, error = run(away)
print(f"  {error / 1e3:.2f} m off, past a limit by {max(0.0, most['past a position limit']):.0e} rad, ", end="")
print(f"last speed {np.abs(solutions[-1].velocity).max():.0e} rad/s")
print(f"  statuses {dict(Counter(s.status for s in solutions))}; the last: {solutions[-1].reason}")

print("\nAn arm found outside its limits is led back at its velocity limit, whatever the target:")
outside = start.copy()
outside[3] = robot.position_upper[3] + 0.1
solution = iq.Controller(robot, dt=DT).step(outside, target)
print(f"  joint 3 is 0.1 rad outside and goes at {solution.velocity[3]:.3f} rad/s: {solution.status}")

print("\nAn exact demand that limits forbid is slowed down, not bent:")
controller = iq.Controller(robot, dt=DT, gain=100.0, exact="position")
solution = controller.step(start, target)
print(f"  {solution.status}: {solution.reason}")
