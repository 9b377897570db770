"""How much a joint velocity depends on the choice of frames and of the unit of length.

    |x - x'| / |x|,    x' the answer to the same physical question with tool and base frame displaced, or in millimetres

States are drawn over the joint range, limits are on, and each method runs in its own control loop. Parameters with a
unit of length (a pitch, an inertia) are converted. A damping in mixed units cannot be converted.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from invariantqp.compare.cell import Cell, Kind, Result
from invariantqp.compare.laws.baselines import MethodLaw, controller_of
from invariantqp.compare.laws.setting import setting_of
from invariantqp.compare.measure.closed_loop import task_of
from invariantqp.compare.measure.frames import frame_check, random_displacement
from invariantqp.compare.measure.rewrite import rewrite, scale_lengths
from invariantqp.compare.measure.states import joint_range
from invariantqp.compare.method import Method
from invariantqp.compare.names import DLS, LEAST_SQUARES, MINK, OURS, PINK, PINV
from invariantqp.compare.registry import methods
from invariantqp.control.controls import Controls
from invariantqp.control.tracking import tracking_gain
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.taskfile import LawSpec, load_task

# Displacements of a full run and of a quick one, and states for each displacement.
DISPLACEMENTS, QUICK_DISPLACEMENTS = 10, 2
STATES = 20
# Standard deviation of each component of the wanted twists [rad/s, m/s]: limits become active in some states.
TWIST = 0.5
MILLIMETRES = 1000.0
# Methods for which a whole run is repeated with another tool frame.
TRAJECTORIES = (OURS, PINV, DLS, LEAST_SQUARES, PINK, MINK)


class Writing(NamedTuple):
    """A choice of frames and of the unit of length in which an arm and its targets are described.

    Attributes:
        base: (4, 4) pose of the old base frame in the new one.
        tool: (4, 4) pose of the new tool frame in the old one, in the new unit.
        unit: how many new units of length make a metre.
    """

    base: Array
    tool: Array
    unit: float = 1.0

    def target(self, pose: Array) -> Array:
        """A (4, 4) target in this description."""
        return np.asarray(self.base.dot(scale_lengths(pose, self.unit)).dot(self.tool))

    def loop(self, method: Method, robot: Robot, law: LawSpec) -> tuple[Controls, Robot]:
        """The control loop of a method for the arm in this description, and that arm."""
        moved = rewrite(robot, base=self.base, unit=self.unit).with_tool(self.tool)
        back = se3.inverse(self.tool)
        point = back.dot([*(self.unit * np.asarray(law.point)), 1.0])[:3]
        law = law.model_copy(update={"point": tuple(point.tolist())})
        if method.system is not None or method.make is None:
            return controller_of(method)(moved, law), moved
        setting = setting_of(moved, law)
        inertia = setting.inertia * np.repeat((self.unit**2, 1.0), 3)
        setting = replace(setting, inertia=inertia, body=back, unit=self.unit)
        return MethodLaw(moved, law, method, method.make(setting)), moved


def dependence(cell: Cell) -> dict[str, Result]:
    """How much one method depends on frames and on the unit, over the joint range of the arm of a task."""
    method = methods()[cell.method]
    task = load_task(cell.task)
    robot, law = task.load_robot(), task.law
    rng = np.random.default_rng([cell.seed, 2])
    plain = Writing(np.eye(4), np.eye(4))
    frames, units = _Changes(), _Changes()
    for i in range(QUICK_DISPLACEMENTS if cell.quick else DISPLACEMENTS):
        base, tool = (random_displacement(1000 * cell.seed + 2 * i + k) for k in range(2))
        q, poses = _drawn(robot, law, rng)
        before = _answers(plain, method, robot, law, q, poses)
        frames.add(before, _answers(Writing(base, tool), method, robot, law, q, poses))
        in_mm = Writing(np.eye(4), np.eye(4), MILLIMETRES)
        units.add(before, _answers(in_mm, method, robot, law, q, poses))
    return {cell.method: {"frame": frames.figures(), "unit": units.figures()}}


def _drawn(robot: Robot, law: LawSpec, rng: np.random.Generator) -> tuple[Array, list[Array]]:
    """Random joint positions (n, m), and for each a target pose that asks for a random twist of the tool."""
    low, high = joint_range(robot)
    q = rng.uniform(low, high, (STATES, len(low)))
    gain = tracking_gain(law.gain, law.dt)
    return q, [robot.pose(x).dot(se3.exp(TWIST / gain * rng.standard_normal(6), check=False)) for x in q]


def _answers(
    writing: Writing, method: Method, robot: Robot, law: LawSpec, q: Array, poses: list[Array]
) -> list[Array | None]:
    loop, arm = writing.loop(method, robot, law)
    return [_answer(loop, x, arm.target(writing.target(T))) for x, T in zip(q, poses, strict=True)]


def _answer(loop: Controls, q: Array, target: Any) -> Array | None:
    try:
        x = np.asarray(loop.step(q, target).velocity, dtype=np.float64)
    except Exception:  # noqa: BLE001 (a state without an answer is counted as left out)
        return None
    return x if np.isfinite(x).all() else None


class _Changes:
    """Relative changes, and the number of states in which there was nothing to compare."""

    def __init__(self) -> None:
        self._found: list[float] = []
        self._left_out = 0

    def add(self, before: list[Array | None], after: list[Array | None]) -> None:
        for x, y in zip(before, after, strict=True):
            if x is None or y is None or not x.any():
                self._left_out += 1
            else:
                self._found.append(float(np.linalg.norm(x - y) / np.linalg.norm(x)))

    def figures(self) -> Result:
        if not self._found:
            return {"median": None, "p99": None, "worst": None, "states": 0, "left_out": self._left_out}
        return {
            "median": float(np.median(self._found)),
            "p99": float(np.percentile(self._found, 99.0)),
            "worst": max(self._found),
            "states": len(self._found),
            "left_out": self._left_out,
        }


def trajectory(cell: Cell) -> dict[str, Result]:
    """How much the joint trajectory of a whole task changes when another tool frame is chosen."""
    (check,) = frame_check(task_of(cell), cell.seed, laws={cell.method: controller_of(methods()[cell.method])})
    return {cell.method: {"change": check.change, "worst_error_mm": check.worst_error_mm}}


KINDS = {
    "dependence": Kind(dependence),
    "trajectory": Kind(trajectory, fits=TRAJECTORIES.__contains__),
}
