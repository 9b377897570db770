"""A Panda draws a circle of 60 mm with 5 N on the pen: motion along the paper, force into it.

Run: python examples/04_hybrid_pen.py
"""

import numpy as np

import invariantqp as iq

DT, PRESS, STIFFNESS = 0.002, 5.0, 1e4  # [s], [N], [N/m]
RADIUS, PERIOD, SECONDS = 0.03, 3.0, 4.0  # [m], [s], [s]

robot = iq.load_robot("panda")
q = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])  # [rad]
start = robot.pose(q)
paper = start[2, 3] - 0.001  # a millimetre below the tip


# What the contact allows, in three lines: the tip slides and turns on the paper, and may press into it.
def contact(tool):
    return iq.point_contact(tool[:3, 3], normal=[0, 0, 1])


task = iq.HybridTask(contact, [PRESS], max_force=30.0)
# The sensor sits in the wrist, 100 mm behind the tip; 0.5 kg hang on it; its noise is filtered at 50 Hz. Its six numbers
# have moments first and say what the world does to the tool. This one is simulated and has no noise.
sensor = iq.WrenchSensor(
    mount=iq.transform(translation=[0, 0, -0.1]),
    order="moment first",
    reads="reaction",
    mass=0.5,
    centre=[0, 0, 0.04],
    cutoff=50.0,
    noise=0.0,
)
loop = iq.HybridController(robot, task, dt=DT, sensor=sensor)


def read_sensor(q):
    """What a real script reads from its driver: here, paper that pushes back in proportion, and the tool's weight."""
    tool = robot.pose(q)
    up = np.array([0, 0, STIFFNESS * max(0.0, paper - tool[2, 3])])
    reaction = np.concatenate((np.cross(tool[:3, 3], up), up))
    return sensor.tare(tool) + iq.coadjoint(iq.inverse(tool @ sensor.mount)) @ reaction


presses, errors, first = [], [], None
for tick in range(round(SECONDS / DT)):
    angle = 2 * np.pi * tick * DT / PERIOD
    target = start.copy()
    target[:2, 3] += RADIUS * np.array([np.cos(angle) - 1, np.sin(angle)])
    ahead = np.zeros(6)
    ahead[3:5] = 2 * np.pi / PERIOD * RADIUS * np.array([-np.sin(angle), np.cos(angle)])
    solution = loop.step(q, target, read_sensor(q), ahead)
    if solution.status == "ok" and first is None:
        first = tick * DT
    presses.append(solution.intensities[0])
    errors.append(np.linalg.norm(robot.pose(q)[:2, 3] - target[:2, 3]))
    q = q + DT * solution.velocity

settled = slice(round(1.0 / DT), None)
force_rms = np.sqrt(np.mean((np.array(presses[settled]) / PRESS - 1) ** 2))
print(f"touched after {first:.2f} s; last tick: {solution.status}, press {presses[-1]:.3f} N")
print(f"after one second: force {100 * force_rms:.2f} % rms off, path {1e6 * max(errors[settled]):.1f} micrometres")
