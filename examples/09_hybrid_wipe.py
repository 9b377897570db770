"""A flat sole wipes a table with 20 N: face contact, for which no pitch works, so the complement is the compliance's.

Run: python examples/09_hybrid_wipe.py
"""

import numpy as np

import invariantqp as iq

DT, PRESS, STIFFNESS, HALF = 0.002, 20.0, 1e4, 0.04  # [s], [N], [N/m] at each corner, half the sole's side [m]

robot = iq.load_robot("panda")
q = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.85, 0.8])  # [rad]: the sole is tilted by three degrees
start = robot.pose(q)
table = start[2, 3] - 0.005
corners = [[x, y, 0.0] for x in (-HALF, HALF) for y in (-HALF, HALF)]


# What the contact allows: two slides and a turn about the normal; a press and no moments are wanted.
def contact(tool):
    return iq.contacts.face_contact(tool[:3, 3], normal=[0, 0, 1])


try:
    iq.HybridTask(contact(start), [PRESS, 0, 0], h=0.3)
except iq.NoProjectors as refused:
    print(f"a pitch is refused: {refused.system}")
task = iq.HybridTask(contact, [PRESS, 0, 0], compliance=1e-3, size=HALF)
loop = iq.HybridController(robot, task, dt=DT, order="moment first")


def felt(q):
    """What the tool exerts on a table that pushes back at each corner, moments about the base's origin."""
    tool, wrench = robot.pose(q), np.zeros(6)
    for corner in corners:
        p = tool[:3, :3] @ corner + tool[:3, 3]
        down = np.array([0, 0, -STIFFNESS * max(0.0, table - p[2])])
        wrench += np.concatenate((np.cross(p, down), down))
    return wrench


def tilt(q):
    return np.rad2deg(np.arccos(min(1.0, -robot.pose(q)[2, 2])))


print(f"tilted by {tilt(q):.2f} degrees in the air")
presses = []
for tick in range(1000):
    target = start.copy()
    target[1, 3] += 0.05 * np.sin(2 * np.pi * tick * DT / 2.0)  # to and fro, 100 mm
    ahead = [0, 0, 0, 0, 0.05 * np.pi * np.cos(2 * np.pi * tick * DT / 2.0), 0]
    solution = loop.step(q, target, felt(q), ahead)
    presses.append(solution.intensities)
    q = q + DT * solution.velocity

settled = np.array(presses[500:])
print(f"tilted by {tilt(q):.4f} degrees on the table; {solution.status}")
print(f"press {100 * np.sqrt(np.mean((settled[:, 0] / PRESS - 1) ** 2)):.2f} % rms off", end=", ")
print(f"moments at most {1e3 * np.abs(settled[:, 1:]).max():.1f} N mm")
