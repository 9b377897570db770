"""How long a tick takes beside placo, in an environment of its own: placo brings another Pinocchio.

    python -m venv placo && placo/bin/pip install placo '.[pin,robots]'
    placo/bin/python tests/benchmarks/placo_row.py

Rows as in `table.py`: median (99th percentile) in microseconds, and the ratio of the medians; both take turns at every
tick. placo's tick is `set_joint` for every joint, `update_kinematics`, the task's target, and `solve` with its position
and velocity limits on; ours is `Controller.step`.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import placo
from table import ticks_of, times

import invariantqp as iq


class Placo:
    """placo's solver on the URDF of an arm, without its meshes."""

    def __init__(self, robot, dt):
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "robot.urdf"
            file.write_text(urdf_of(robot), encoding="utf-8")
            self.robot = placo.RobotWrapper(str(file), placo.Flags.ignore_collisions)
        self.names = robot.names
        self.solver = placo.KinematicsSolver(self.robot)
        self.solver.mask_fbase(True)  # noqa: FBT003 (placo's signature)
        self.solver.dt = dt
        self.solver.enable_velocity_limits(True)  # noqa: FBT003
        self.solver.enable_joint_limits(True)  # noqa: FBT003
        self.task = self.solver.add_frame_task("tool", np.eye(4))
        self.task.configure("tool", "soft", 1.0, 1.0)

    def step(self, q, target, ahead):
        for name, position in zip(self.names, q, strict=True):
            self.robot.set_joint(name, position)
        self.robot.update_kinematics()
        self.task.T_world_frame = target
        return self.solver.solve(False)  # noqa: FBT003


def urdf_of(robot):
    """The arm as a URDF: links whose frames are the base frame at q = 0."""
    inertia = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    link = f'<link name="{{}}"><inertial><mass value="1"/>{inertia}</inertial></link>'
    home, q = robot.pose(np.zeros(len(robot.names))), np.zeros(len(robot.names))
    J = robot.jacobian(q)
    parts, before, last = [link.format("base")], "base", np.zeros(3)
    for i, name in enumerate(robot.names):
        axis, v = J[:3, i], J[3:, i]
        place = np.cross(axis, v)
        limit = (robot.position_lower[i], robot.position_upper[i], robot.velocity_limit[i])
        parts.append(joint(name, "revolute", before, f"link{i}", place - last, axis, limit) + link.format(f"link{i}"))
        before, last = f"link{i}", place
    rpy = np.array([np.arctan2(home[2, 1], home[2, 2]), -np.arcsin(home[2, 0]), np.arctan2(home[1, 0], home[0, 0])])
    parts.append(joint("to tool", "fixed", before, "tool", home[:3, 3] - last, None, None, rpy) + link.format("tool"))
    return f'<robot name="arm">{"".join(parts)}</robot>'


def joint(name, kind, parent, child, xyz, axis, limit, rpy=(0.0, 0.0, 0.0)):
    """A joint of a URDF."""
    text = f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
    text += f'<origin xyz="{" ".join(map(repr, map(float, xyz)))}" rpy="{" ".join(map(repr, map(float, rpy)))}"/>'
    if axis is not None:
        lower, upper, speed = map(float, limit)
        text += f'<axis xyz="{" ".join(map(repr, map(float, axis)))}"/>'
        text += f'<limit lower="{lower}" upper="{upper}" velocity="{speed}" effort="100"/>'
    return text + "</joint>"


def main():
    print("| tick | compiled | placo | compiled / placo |\n|---|---|---|---|")
    for title, name, wanted in (
        ("Panda, free", "compare/panda_limits", lambda s: not s.active),
        ("Panda, limits met", "compare/panda_limits", lambda s: s.active),
        ("UR5, limits met", "compare/ur5_limits", lambda s: s.active),
    ):
        controller, ticks, kept = ticks_of(iq.load_task(name), wanted)
        ticks = [(q, target.homogeneous, ahead) for q, target, ahead in ticks]
        theirs = Placo(controller.robot, controller.dt)
        took = list(times({"ours": controller.step, "theirs": theirs.step}, ticks, (controller,), kept).values())
        cells = [f"{np.median(each):.1f} ({np.quantile(each, 0.99):.0f})" for each in took]
        print(f"| {title} | {' | '.join(cells)} | {np.median(took[0]) / np.median(took[1]):.2f} |", flush=True)


if __name__ == "__main__":
    main()
