"""Frame checks: how much a run changes when other frames describe the same motion of the same tool.

    T_tool' = T_tool X,  T_target' = T_target X,  T_sensor' = T_sensor Y,  T_contact' = T_contact Z

    change    max |q(t) - q'(t)|

Only the description changes, nothing physical. In contact our controller is compared with the hybrid controller of
textbooks, whose task frame keeps its axes along the surface.

Reference: Raibert & Craig 1981; Lipkin & Duffy 1988 and Duffy 1990 for its dependence on frames.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from invariantqp.control.tracking import tracking_gain
from invariantqp.errors import BadInput
from invariantqp.force.contact_kinds import SIX_DIGITS
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.limits import JointBox
from invariantqp.velocity.solution import Status, VelocitySolution
from invariantqp.workbench.runs.controllers import TaskController, controller_for
from invariantqp.workbench.runs.plant import Measurement, Plant, PlantState
from invariantqp.workbench.runs.prepare import ControlProblem, Goal, Setup, prepare
from invariantqp.workbench.runs.run import run
from invariantqp.workbench.runs.taskfile import Task

# Standard deviation of the random displacement along each axis [m]: about the length of a tool.
DISPLACEMENT = 0.25


def displaced(
    setup: Setup, tool: ArrayLike | None = None, sensor: ArrayLike | None = None, contact: ArrayLike | None = None
) -> Setup:
    """The setup with its frames displaced in themselves by (4, 4) motions, None for none; both setups share a plant."""
    problem, plant = setup.problem, setup.plant
    if tool is not None:
        problem = _with_tool(problem, arrays.pose(tool, "tool"))
    if sensor is not None:
        Y = arrays.pose(sensor, "sensor")
        plant = DisplacedSensor(plant, Y)
        problem = replace(problem, sensor=None if problem.sensor is None else problem.sensor.relabelled(Y))
    if contact is not None and problem.contact_task is not None:
        problem = replace(problem, contact_task=problem.contact_task.relabelled(arrays.pose(contact, "contact")))
    return replace(setup, plant=plant, problem=problem)


def _with_tool(problem: ControlProblem, X: Array) -> ControlProblem:
    """The problem for a tool frame displaced by X in itself."""
    back = se3.inverse(X)
    law = problem.law
    points = {key: back.dot([*getattr(law, key), 1.0])[:3] for key in ("point", "tool_speed_point")}
    return replace(
        problem,
        robot=problem.robot.with_tool(X),
        law=law.model_copy(update={key: tuple(p.tolist()) for key, p in points.items()}),
        poses=problem.poses.dot(X),
        part=None if problem.part is None else problem.part.relabelled(X),
        contact_task=None if problem.contact_task is None else problem.contact_task.relabelled(None, X),
        sensor=None if problem.sensor is None else problem.sensor.relabelled(None, X),
    )


class DisplacedSensor:
    """A plant whose force readings are expressed in a frame displaced by Y (4, 4) in the sensor's frame."""

    def __init__(self, plant: Plant, Y: Array) -> None:
        self._plant = plant
        self._from_sensor = se3.coadjoint(se3.inverse(Y))

    def measure(self) -> Measurement:
        """The measurement, its wrench in the displaced frame."""
        measured = self._plant.measure()
        return measured._replace(wrench=self._from_sensor.dot(measured.wrench))

    def command(self, velocity: Array) -> None:
        """Move for one tick at joint velocities (m,)."""
        self._plant.command(velocity)

    def state(self) -> PlantState:
        """The true state."""
        return self._plant.state()


def random_displacement(seed: int) -> Array:
    """A random (4, 4) rigid motion: a uniform rotation, and a normal translation of `DISPLACEMENT`."""
    rng = np.random.default_rng(seed)
    return se3.transform(Rotation.from_quat(rng.standard_normal(4)).as_matrix(), DISPLACEMENT * rng.standard_normal(3))


@dataclass(frozen=True)
class FrameCheck:
    """The effect of other frames on one controller.

    Attributes:
        law: the controller's name.
        change: largest change of a joint position during the run [rad, m].
        error_mm, displaced_error_mm: largest path error with the task's frames and with displaced ones, after the
            contact has settled [mm].
        force_error, displaced_force_error: rms error of the true force over the desired force; None without contact.
    """

    law: str
    change: float
    error_mm: float
    displaced_error_mm: float
    force_error: float | None
    displaced_force_error: float | None


class RaibertCraig(TaskController):
    """The hybrid controller of textbooks: a diagonal selection matrix of the axes of a task frame.

        xi = Sigma (gain e + s_d) + (I - Sigma) C (W_d - W),     x = clip(J^+ xi)

    All in the axes of the task frame, the contact's. e is the error of position and the rotation vector, xi the
    velocity of the tool's origin. W is the reading rotated into these axes; its moment is still about the sensor's
    origin, which is right only while tool, sensor and contact share an origin, as in textbooks.
    """

    def __init__(self, setup: Setup, tool: Array | None = None) -> None:
        """For a run in displaced frames; `tool` is the (4, 4) displacement of the tool frame."""
        problem, scene = setup.problem, setup.scene
        if scene is None or problem.sensor is None:
            raise BadInput("task", "a task without contact", "one with [contact] and [force]")
        robot, law = problem.robot, problem.law
        self._robot, self._sensor, self._contact_at = robot, problem.sensor, scene.task.contact_at
        self._back = np.eye(4) if tool is None else se3.inverse(tool)
        # 1 for motion along an axis of the task frame, 0 for force
        self._selection = (np.abs(scene.kind.freedoms).max(axis=1) > SIX_DIGITS).astype(float)
        self._wanted = scene.wanted
        self._gain, self._compliance = tracking_gain(law.gain, law.dt), np.diag(np.asarray(scene.task.compliance))
        self._sensor_axes = np.asarray(problem.sensor.mount)[:3, :3]
        self._box = JointBox(robot.position_lower, robot.position_upper, robot.velocity_limit, 1.0 / law.dt)

    def step(self, measured: Measurement, goal: Goal) -> VelocitySolution:
        """One tick."""
        state, T = self._robot.state(measured.q, goal.target), self._robot.pose(measured.q)
        exerted = self._sensor.load(measured.wrench, T)
        self.wrench = self._sensor.in_base(exerted, T)
        axes = np.asarray(self._contact_at(T.dot(self._back)).pose)[:3, :3]
        to_sensor = axes.T.dot(T[:3, :3]).dot(self._sensor_axes)
        read = np.concatenate((to_sensor.dot(exerted[:3]), to_sensor.dot(exerted[3:])))
        # Twists about the tool's origin, in the axes of the task frame.
        at_tool = se3.adjoint(se3.inverse(se3.transform(axes, T[:3, 3]), check=False), check=False)
        s = self._gain * state.error + goal.feedforward
        xi = self._selection * at_tool.dot(s) + (1.0 - self._selection) * self._compliance * (self._wanted - read)
        x: Array = np.linalg.pinv(at_tool.dot(state.J)).dot(xi)
        lower, upper = self._box.at(measured.q)
        clipped = np.minimum(np.maximum(x, lower), upper)
        active = tuple(np.flatnonzero(clipped != x).tolist())
        residual = s - state.J.dot(clipped)
        return VelocitySolution(clipped, "raibert-craig", Status.OK, "", active, residual, 1.0, 0.0, 0.0, "")


def frame_check(task: Task, seed: int = 0, physics: str = "ideal") -> list[FrameCheck]:
    """Run a task in its own frames and in randomly displaced ones: our controller first, in contact another one too.

    `seed` is that of the displacements, `physics` the plant, "ideal" or "mujoco". Of two elastic runs of different
    length the shorter one rests at its end.
    """
    laws: dict[str, Callable[[Setup, Array | None], TaskController]] = {
        "invariantqp": lambda setup, _: controller_for(setup.problem)  # it needs no displacement
    }
    if task.contact is not None:
        laws["Raibert-Craig"] = RaibertCraig
    tool, *others = (random_displacement(seed + i) for i in range(3 if task.contact is not None else 1))
    checks = []
    for name, make in laws.items():
        setup, moved = prepare(task, physics), displaced(prepare(task, physics), tool, *others)
        plain, other = run(setup, make(setup, None)), run(moved, make(moved, tool))
        n = max(len(plain.q), len(other.q))
        a, b = (trace.q[np.minimum(np.arange(n), len(trace.q) - 1)] for trace in (plain, other))
        error, displaced_error = (1e3 * float(t.position_error[t.counted_from :].max()) for t in (plain, other))
        forces = plain.force_error, other.force_error
        checks.append(FrameCheck(name, float(np.abs(a - b).max()), error, displaced_error, *forces))
    return checks
