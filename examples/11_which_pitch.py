"""Which h? What a five-joint arm misses with each pitch, beside least squares at the tool, on four arms.

Six- and seven-joint arms have joints blocked until five are left, as limits do. Twists ask for 100 mm/s and 30 deg/s in
random directions; what is missed is measured at the tool. |P| is the norm of the projector there, a radian counted as
the arm's reach: no twist is missed by more than |P| times what least squares misses. With five joints every twist is.

Run: python examples/11_which_pitch.py [STATES]      needs the extra `robots`
"""

import sys

import numpy as np

import invariantqp as iq

ARMS = {"so101": [0, 1, 2, 3, 4], "ur5": [0, 1, 2, 3, 5], "panda": [0, 1, 3, 5, 6], "xarm7": [0, 1, 3, 4, 5]}
MULTIPLES = (0.3, 1.0, -1.0, 2.0, 4.0)  # of the arm's reach L
STATES = int(sys.argv[1]) if len(sys.argv) > 1 else 400


def at_tool(tool, length):
    """(6, 6) that takes a twist to (L omega; v at the tool): what least squares there measures."""
    return np.diag(np.repeat((length, 1.0), 3)) @ iq.adjoint(iq.transform(translation=-tool))


rng = np.random.default_rng(0)
titles = ("arm", "law", "mm/s missed", "deg/s missed", "of least", "|P|", "|P| p95")
print("{:6s} {:>14s} {:>12s} {:>13s} {:>9s} {:>6s} {:>8s}".format(*titles))
for name, joints in ARMS.items():
    robot = iq.load_robot(name)
    low, high = np.maximum(robot.position_lower, -np.pi), np.minimum(robot.position_upper, np.pi)
    rows = {law: [] for law in (*(f"h = {k:g} L" for k in MULTIPLES), "least squares")}
    for q in rng.uniform(low, high, (STATES, len(low))):
        J = robot.jacobian(q)[:, joints]
        tool = robot.pose(q)[:3, 3]
        length = iq.systems.reach(J, tool)
        measure = at_tool(tool, length)
        omega, v = rng.standard_normal((2, 3))
        omega *= np.radians(30.0) / np.linalg.norm(omega)
        v *= 0.1 / np.linalg.norm(v)
        twist = np.concatenate((omega, v - np.cross(omega, tool)))
        inverses = {f"h = {k:g} L": iq.pseudoinverse(J, k * length) for k in MULTIPLES}
        inverses["least squares"] = np.linalg.pinv(measure @ J) @ measure
        least = np.linalg.norm(measure @ (twist - J @ inverses["least squares"] @ twist))
        for law, inverse in inverses.items():
            left = measure @ (twist - J @ inverse @ twist)
            P = measure @ J @ inverse @ np.linalg.inv(measure)
            mm, deg = 1e3 * np.linalg.norm(left[3:]), np.degrees(np.linalg.norm(left[:3]) / length)
            rows[law].append((mm, deg, np.linalg.norm(left) / least, np.linalg.norm(P, 2)))
    for law, values in rows.items():
        mm, deg, times, norm = np.median(values, axis=0)
        p95 = np.percentile([v[3] for v in values], 95)
        print(f"{name:6s} {law:>14s} {mm:12.1f} {deg:13.2f} {times:9.2f} {norm:6.2f} {p95:8.1f}")
