"""A press that changes: a ramp, a sine, and a stop in the middle, while the tool draws a circle on a table.

Each tick says what it wants, `step(..., wanted=[newtons])`. For a second in between nothing is commanded, as in a
protective stop; the loop goes on afterwards as it was, on the same contact. `loop.reset()` would feel for it again.

Run: python examples/37_force_profile.py [arm ...]
"""

import sys

import numpy as np
from shared.cells import ARMS, DELAY, DT, Cell, table

import invariantqp as iq

RADIUS, TURN = 0.03, 6.0  # of the circle [m], [s]
STOP, RESUME, END = 9.0, 10.0, 12.0  # [s] since the touch


def press(t):
    """What is wanted [N]: 5, a ramp to 15 in two seconds, then a sine of 5 N about 15."""
    return 5.0 + 10.0 * np.clip((t - 2.0) / 2.0, 0.0, 1.0) + 5.0 * np.sin(np.pi * (t - 6.0)) * (6.0 < t < 8.0)


for arm in sys.argv[1:] or ARMS:
    cell = Cell(arm, table(arm))
    task = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], [0, 0, 1]), [5.0], max_force=40.0)
    loop = iq.HybridController(cell.robot, task, dt=DT, sensor=cell.sensor, delay=DELAY)
    t, touched, off, statuses = 0.0, False, {"ramp": [], "sine": [], "stop": []}, set()
    for _ in range(round(40.0 / DT)):
        q, reading = cell.read()
        if STOP <= t < RESUME:
            cell.drive(np.zeros(len(q)))
        else:
            angle = 2.0 * np.pi * (t - (1.0 if t >= RESUME else 0.0)) / TURN
            target = iq.transform(translation=RADIUS * np.array([np.cos(angle) - 1.0, np.sin(angle), 0.0])) @ cell.home
            ahead = 2.0 * np.pi / TURN * RADIUS * np.array([0, 0, 0, -np.sin(angle), np.cos(angle), 0.0]) * touched
            solution = loop.step(q, target, reading, ahead, wanted=[press(t)])
            cell.drive(solution.velocity)
            touched = touched or solution.status == "ok"
            if touched:
                statuses.add(str(solution.status))
        error = cell.pressed()[2] - press(t)
        for name, begin, end in (("ramp", 2.0, 6.0), ("sine", 6.0, 8.0), ("stop", STOP, END)):
            if begin <= t < end:
                off[name].append(error)
        t += DT * touched
        if t > END:
            break
    told = ", ".join(f"{name} {np.sqrt(np.mean(np.square(e))):.2f} ({np.abs(e).max():.1f})" for name, e in off.items())
    print(f"{arm:6s} N rms (most) off what is wanted: {told}; {sorted(statuses)}")
