"""Which h? What a five-joint arm gives up for each pitch, beside Moore-Penrose, on four arms.

Six- and seven-joint arms have joints blocked until five are left, as limits do. Twists ask for 100 mm/s and 30 deg/s in
random directions; what is missed is measured at the tool. |P| is the norm of the projector about the arm's own point
in its own length: how much larger than the demand an answer can get.

Run: python examples/11_which_pitch.py
"""

import numpy as np

import invariantqp as iq

ARMS = {"so101": [0, 1, 2, 3, 4], "ur5": [0, 1, 2, 3, 5], "panda": [0, 1, 3, 5, 6], "xarm7": [0, 1, 3, 4, 5]}
MULTIPLES = (0.3, 1.0, -1.0, 2.0, 4.0)  # of the arm's own length L
STATES = 400


def missed(J, x, twist, tool):
    """Tool-point speed [mm/s] and angular speed [deg/s] of what is missed."""
    r = twist - J @ x
    return 1e3 * np.linalg.norm(r[3:] + np.cross(r[:3], tool)), np.degrees(np.linalg.norm(r[:3]))


def own_norm(J, inverse, point, length):
    """|P| with twists taken about the own point, radians counted as the own length."""
    to_own = iq.adjoint(iq.transform(translation=-point))
    scale = np.diag(np.repeat((length, 1.0), 3)) @ to_own
    return np.linalg.norm(scale @ J @ inverse @ np.linalg.inv(scale), 2)


rng = np.random.default_rng(0)
titles = ("arm", "law", "mm/s missed", "deg/s missed", "|P|", "|P| p95", "conditioning")
print("{:6s} {:>10s} {:>12s} {:>13s} {:>6s} {:>8s} {:>13s}".format(*titles))
for name, joints in ARMS.items():
    robot = iq.load_robot(name)
    low, high = np.maximum(robot.position_lower, -np.pi), np.minimum(robot.position_upper, np.pi)
    rows = {law: [] for law in (*(f"h = {k:g} L" for k in MULTIPLES), "pinv, tool")}
    for q in rng.uniform(low, high, (STATES, len(low))):
        J = robot.jacobian(q)[:, joints]
        tool = robot.pose(q)[:3, 3]
        own = iq.systems.centre(J)
        omega, v = rng.standard_normal((2, 3))
        omega *= np.radians(30.0) / np.linalg.norm(omega)
        v *= 0.1 / np.linalg.norm(v)
        twist = np.concatenate((omega, v - np.cross(omega, tool)))
        for k in MULTIPLES:
            h = k * own.length
            inverse = iq.pseudoinverse(J, h)
            conditioning = iq.velocity.method_for(J, twist, form=h).conditioning
            norm = own_norm(J, inverse, own.point, own.length)
            rows[f"h = {k:g} L"].append((*missed(J, inverse @ twist, twist, tool), norm, conditioning))
        at_tool = iq.adjoint(iq.transform(translation=-tool))
        inverse = np.linalg.pinv(at_tool @ J) @ at_tool
        sigma = np.linalg.svd(at_tool @ J, compute_uv=False)
        norm = own_norm(J, inverse, own.point, own.length)
        rows["pinv, tool"].append((*missed(J, inverse @ twist, twist, tool), norm, (sigma[-1] / sigma[0]) ** 2))
    for law, values in rows.items():
        mm, deg, norm, conditioning = np.median(values, axis=0)
        p95 = np.percentile([v[2] for v in values], 95)
        print(f"{name:6s} {law:>10s} {mm:12.1f} {deg:13.2f} {norm:6.2f} {p95:8.1f} {conditioning:13.1e}")
