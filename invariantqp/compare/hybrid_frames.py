"""The same force/motion task written in displaced frames: what changes in the joint velocities.

    change = max |x(t) - x'(t)|,   T_tool' = T_tool X,   T_sensor' = T_sensor Y,   T_contact' = T_contact Z

A Panda presses a pen or a flat sole on a plane with a stiffness and moves along a circle. Nothing physical is changed:
the wrist is displaced in words alone, and whoever wrote the task has written all of it anew. The textbook's law keeps
its task frame's axes along the surface, as its users would see to.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from invariantqp.compare.frames import random_displacement
from invariantqp.compare.raibert_craig import RaibertCraig
from invariantqp.control.hybrid import HybridController
from invariantqp.control.hybrid_task import HybridTask
from invariantqp.control.wrench import WrenchSensor
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.systems.contacts import face_contact, point_contact

UP = np.array([0.0, 0.0, 1.0])
STIFFNESS = 1e4  # [N/m], of the plane under each corner of the tool
COMPLIANCE = 1e-3  # [m/s per N]
SIZE = 0.05  # [m]
GAIN = 10.0  # [1/s]
DT = 1e-3  # [s]
RADIUS, PERIOD = 0.03, 2.0  # of the circle [m], [s]
# Corners of the tool in its own frame [m], wanted press [N], and the axes of the task frame that are moved along.
TOOLS = {
    "pen": (np.zeros((1, 3)), 5.0, (1.0, 1.0, 1.0, 1.0, 1.0, 0.0)),
    "sole": (
        np.array([[x, y, 0.0] for x in (-0.04, 0.04) for y in (-0.04, 0.04)]),
        20.0,
        (0.0, 0.0, 1.0, 1.0, 1.0, 0.0),
    ),
}

# (q, target pose of the tool as its task has it, wrench exerted in the base frame, twist of the target) to a velocity.
Step = Callable[[Array, Array, Array, Array], Array]


@dataclass(frozen=True)
class HybridFrameCheck:
    """What displaced frames changed for one law on one task.

    Attributes:
        law: its name.
        tool: "pen" (point contact) or "sole" (face contact).
        change: largest change of a joint velocity along the run [rad/s].
        force_error: relative error of the press after contact settled, root mean square, as the task was first written.
        displaced_force_error: the same, written in displaced frames.
    """

    law: str
    tool: str
    change: float
    force_error: float
    displaced_force_error: float


def hybrid_frame_check(robot: Robot, q: Array, seed: int = 0, ticks: int = 1000) -> list[HybridFrameCheck]:
    """Run both tasks as written and in displaced frames, under our law and the textbook's.

    Args:
        robot: with its tool frame on the plane, z pointing down.
        q: (m,) where it starts.
        seed: of the three displacements.
        ticks: of 1 ms, the second half of which counts for the press.

    Returns:
        Four HybridFrameChecks, ours first.
    """
    displacements = tuple(random_displacement(seed + i) for i in range(3))
    checks = []
    for law, make in (("invariantqp", _ours), ("Raibert-Craig", _textbook)):
        for tool in TOOLS:
            plain = _run(robot, q, tool, make(robot, tool, (np.eye(4),) * 3), np.eye(4), ticks)
            moved = _run(robot, q, tool, make(robot, tool, displacements), displacements[0], ticks)
            change = float(np.abs(plain[0] - moved[0]).max())
            checks.append(HybridFrameCheck(law, tool, change, plain[1], moved[1]))
    return checks


def _ours(robot: Robot, tool: str, displacements: tuple[Array, ...]) -> Step:
    X, Y, Z = displacements
    _, press, _ = TOOLS[tool]
    contact = (lambda T: point_contact(T[:3, 3], UP)) if tool == "pen" else (lambda T: face_contact(T[:3, 3], UP))
    wrench = [press] if tool == "pen" else [press, 0.0, 0.0]
    task = HybridTask(contact, wrench, compliance=COMPLIANCE, size=SIZE).relabelled(Z, X)
    sensor = WrenchSensor(reads="action").relabelled(Y, X)
    loop = HybridController(robot.with_tool(X), task, dt=DT, sensor=sensor, gain=GAIN, posture=False)
    mount = np.asarray(sensor.mount)

    def step(q: Array, target: Array, wrench: Array, ahead: Array) -> Array:
        T = loop.robot.pose(q).dot(mount)
        return loop.step(q, target, se3.carried_wrenches(se3.inverted(T)).dot(wrench), ahead).velocity

    return step


def _textbook(robot: Robot, tool: str, displacements: tuple[Array, ...]) -> Step:
    X, Y, _ = displacements
    _, press, selection = TOOLS[tool]
    moved = robot.with_tool(X)
    mount = se3.inverted(X).dot(Y)
    axes = Rotation.from_euler("x", np.pi).as_matrix()  # z into the surface
    loop = RaibertCraig(
        moved,
        selection,
        axes,
        [0.0, 0.0, 0.0, 0.0, 0.0, press],
        dt=DT,
        gain=GAIN,
        compliance=np.repeat((COMPLIANCE / SIZE**2, COMPLIANCE), 3),
        sensor_axes=mount[:3, :3],
    )

    def step(q: Array, target: Array, wrench: Array, ahead: Array) -> Array:
        T = moved.pose(q).dot(mount)
        return loop.step(q, target, se3.carried_wrenches(se3.inverted(T)).dot(wrench), ahead).velocity

    return step


def _run(robot: Robot, q: Array, tool: str, step: Step, offset: Array, ticks: int) -> tuple[Array, float]:
    """Joint velocities of a run, and the press's relative error in its second half."""
    corners, press, _ = TOOLS[tool]
    start = robot.pose(q)
    height = start[2, 3]
    velocities, errors = [], []
    for k in range(ticks):
        T = robot.pose(q)
        pressed = [(p, STIFFNESS * max(0.0, height - p[2])) for p in corners.dot(T[:3, :3].T) + T[:3, 3]]
        force = [np.concatenate((se3.cross(p, -f * UP), -f * UP)) for p, f in pressed]
        angle = 2.0 * np.pi * k * DT / PERIOD
        target = start.copy()
        target[:2, 3] += RADIUS * np.array([np.cos(angle) - 1.0, np.sin(angle)])
        ahead = np.zeros(6)
        ahead[3:5] = 2.0 * np.pi / PERIOD * RADIUS * np.array([-np.sin(angle), np.cos(angle)])
        velocity = step(q, target.dot(offset), np.sum(force, axis=0), ahead)
        q = q + DT * velocity
        velocities.append(velocity)
        errors.append(sum(f for _, f in pressed) / press - 1.0)
    return np.array(velocities), float(np.sqrt(np.mean(np.square(errors[ticks // 2 :]))))
