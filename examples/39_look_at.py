"""A camera in the hand looks at a part while the arm carries it past, faster than the joints can.

The camera's direction is an exact demand, an `ExactAxis`: limits give up its place and the turn about that direction
instead. Without it all of the pose is as near as it can be, and the part leaves the middle of the picture. What is left
is no limit's: a direction that turns by up to 360 deg/s is followed 1/gain behind, half as far at twice the gain.

Run: python examples/39_look_at.py
"""

import numpy as np

import invariantqp as iq

DT, SECONDS, WAY = 0.002, 1.0, 1.0  # [s], [s], to and fro along y [m]
robot = iq.load_robot("fr3")
HOME = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])  # [rad]
start = robot.pose(HOME)
PART = start[:3, 3] + 0.3 * start[:3, 2]  # 300 mm in front of the camera, which looks along the tool's z


def looking_from(place):
    """The pose at a place (3,) that looks at the part, turned about that direction as little as can be."""
    z = (PART - place) / np.linalg.norm(PART - place)
    x = start[:3, 0] - (start[:3, 0] @ z) * z
    x /= np.linalg.norm(x)
    return iq.transform(np.column_stack((x, np.cross(z, x), z)), place)


def run(**options):
    """The most that the camera looks past the part [deg], and is off its place [mm]."""
    controller, q, past, off = iq.Controller(robot, dt=DT, **options), HOME, 0.0, 0.0
    for tick in range(round(SECONDS / DT)):
        phase = 2.0 * np.pi * tick * DT / SECONDS
        target = looking_from(robot.pose(q)[:3, 3])  # from where it is, not from where it should be
        target[:3, 3] = start[:3, 3] + [0.0, 0.5 * WAY * np.sin(phase), 0.0]
        q = q + DT * controller.step(q, target).velocity
        pose = robot.pose(q)
        ray = PART - pose[:3, 3]
        past = max(past, np.degrees(np.arccos(min(1.0, ray @ pose[:3, 2] / np.linalg.norm(ray)))))
        off = max(off, np.linalg.norm(pose[:3, 3] - target[:3, 3]))
    return past, 1e3 * off


AXIS = iq.control.ExactAxis([0, 0, 1])
for name, options in (
    ("as near as can be", {}),
    ("the direction first", {"exact": AXIS}),
    ("at five times the gain", {"exact": AXIS, "gain": 250.0}),
):
    past, off = run(**options)
    print(f"{name:22s} {past:6.2f} deg past the part, {off:5.0f} mm off its place")
