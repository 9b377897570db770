"""placo and this library in one environment: both load, agree on an arm, and move it. Run by `.ci/run`."""

import tempfile
from pathlib import Path

import numpy as np
import pinocchio
import placo

import invariantqp as iq

JOINT = """<joint name="to {name}" type="revolute"><parent link="{parent}"/><child link="{name}"/>
<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="2"/></joint>"""
LINK = """<link name="{}"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>"""


def urdf():
    """An arm of five joints, as text."""
    places = ["0 0 0.1", "0 0.02 0.05", "0.11 0 0", "0.13 0.01 0", "0.06 0 0"]
    turns = ["0 0 0", "1.57 0 0.2", "0 0.1 0", "0.3 0 0", "0 1.2 0"]
    names = ["base", *(f"link{i}" for i in range(5))]
    rows = zip(names, names[1:], places, turns, strict=False)
    joints = [JOINT.format(parent=a, name=b, xyz=xyz, rpy=rpy) for a, b, xyz, rpy in rows]
    return f'<robot name="arm">{"".join(map(LINK.format, names))}{"".join(joints)}</robot>'


text = urdf()
with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "robot.urdf"
    file.write_text(text, encoding="utf-8")
    theirs = placo.RobotWrapper(str(file), placo.Flags.ignore_collisions)
ours, q = iq.load_robot(text), np.array([0.3, -0.5, 0.7, 0.2, -0.4])
for name, angle in zip(ours.names, q, strict=True):
    theirs.set_joint(name, angle)
theirs.update_kinematics()
np.testing.assert_allclose(ours.pose(q), theirs.get_T_world_frame(ours.tool), rtol=0.0, atol=1e-12)

solver = placo.KinematicsSolver(theirs)
solver.mask_fbase(True)  # noqa: FBT003
solver.add_frame_task(ours.tool, ours.pose(q + 0.05)).configure("tool", "soft", 1.0, 1.0)
controller = iq.Controller(ours, dt=0.01)
for _ in range(100):
    solver.solve(True)  # noqa: FBT003
    theirs.update_kinematics()
    q = q + 0.01 * controller.step(q, ours.pose(np.array([0.35, -0.45, 0.75, 0.25, -0.35]))).velocity
np.testing.assert_allclose(q, [0.35, -0.45, 0.75, 0.25, -0.35], atol=1e-3)
np.testing.assert_allclose([theirs.get_joint(name) for name in ours.names], q, atol=1e-3)
again = iq.load_robot(ours.model, tool=ours.tool)
np.testing.assert_allclose(again.pose(q), ours.pose(q), rtol=0.0, atol=1e-12)
print(f"placo, Pinocchio {pinocchio.__version__} and invariantqp {iq.__version__} move one arm in one environment")
