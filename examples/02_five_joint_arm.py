"""A five-joint arm cannot do every motion: what an SO-101 does of one, in two tool frames, and its point met exactly.

Run: python examples/02_five_joint_arm.py      needs the extra `robots`
"""

from functools import partial

import numpy as np

import invariantqp as iq

DT = 0.002  # [s]

robot = iq.load_robot("so101")
q0 = np.array([0.0, -0.4, 0.5, 0.6, 0.0])  # [rad]

# Another frame on the same link: 10 cm beyond the first and turned. The same motion of the same body is asked of it,
# and the same physical point of it is named as the one where accuracy counts: the first frame's origin.
offset = iq.exp([0.7, -0.4, 1.2, 0.05, 0.05, 0.07])
point = iq.inverse(offset)[:3, 3]


def damped_least_squares(robot, q, target):
    """What most programs do: the error in the tool frame, all six numbers weighed alike."""
    pose = robot.pose(q)
    to_tool = iq.adjoint(iq.inverse(pose))
    J = to_tool @ robot.jacobian(q)
    error = 100.0 * iq.log(iq.inverse(pose) @ target)
    return J.T @ np.linalg.solve(J @ J.T + 0.01**2 * np.eye(6), error)


def followed(law, robot, offset):
    """Joint positions after a second along 6 cm, the tool turning by 30 degrees: more than five joints can do."""
    q = q0.copy()
    start = robot.pose(q0) @ iq.inverse(offset)
    for tick in range(1, 501):
        way = tick * DT
        target = iq.transform(translation=[0, 0.06 * way, 0]) @ start @ iq.exp([0, 0, 0.5 * way, 0, 0, 0])
        q = q + DT * law(q, target @ offset)
    return q, target


def ours(robot, **options):
    loop = iq.Controller(robot, dt=DT, gain=100.0, **options)
    return lambda q, target: loop.step(q, target).velocity


print("After one second, what the tool frame changes of the joint positions, at most:")
here, moved = np.eye(4), robot.with_tool(offset)
for name, laws in {
    "damped least squares": [partial(damped_least_squares, arm) for arm in (robot, moved)],
    "invariantqp": [ours(robot), ours(moved, point=point)],
}.items():
    one, other = followed(laws[0], robot, here)[0], followed(laws[1], moved, offset)[0]
    print(f"  {name:21s} {np.abs(other - one).max():.1e} rad")

print("\nFive numbers can be met. Which, is yours to say; what is left is missed by least squares at the tool:")
for name, law in {
    "damped least squares": partial(damped_least_squares, robot),
    "least squares at tool": ours(robot),
    "pitch form, h = 0.45": ours(robot, form=0.45),
    'exact="position"': ours(robot, exact="position"),
    "ExactAxis, along z": ours(robot, exact=iq.control.ExactAxis([0, 0, 1])),
}.items():
    q, target = followed(law, robot, here)
    error = iq.inverse(robot.pose(q)) @ target
    point, angle = 1e3 * np.linalg.norm(error[:3, 3]), np.degrees(np.linalg.norm(iq.log(error)[:3]))
    axis = np.degrees(np.arccos(min(1.0, error[2, 2])))
    print(f"  {name:21s} point {point:5.2f} mm off, orientation {angle:5.2f} deg, of which the z axis {axis:5.2f} deg")
