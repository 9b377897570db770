"""The controllers of a run, by the [law] of a task: each tick they get measurements and a goal.

Without contact the controller follows the path; in contact it moves along the freedoms S and presses along the
constraints. With an operator it keeps the tool on a plane, s = P1 gain log(T_d T^-1) + P2 s_operator.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from math import pi

import numpy as np

from invariantqp.control.controller import Controller, Controls
from invariantqp.control.loop_limits import AnyLimit as Limit
from invariantqp.control.shared import SharedTask
from invariantqp.control.tracking import tracking_twist
from invariantqp.errors import BadInput
from invariantqp.force.contact_kinds import face_contact
from invariantqp.force.control import HybridController
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.paths.path_follower import PathFollower
from invariantqp.paths.solution import FollowerSolution
from invariantqp.robots.kinematics import Robot
from invariantqp.velocity.forms import Form
from invariantqp.velocity.solution import Status, VelocitySolution, degraded
from invariantqp.workbench.runs.contactspec import OperatorSpec
from invariantqp.workbench.runs.plant import Measurement
from invariantqp.workbench.runs.prepare import ControlProblem, Goal
from invariantqp.workbench.runs.taskfile import LawSpec, law_options

MakeController = Callable[[Robot, LawSpec], Controls]
# The most samples of an elastic path.
PATH_SAMPLES = 1500


def our_controller(robot: Robot, law: LawSpec, limits: Sequence[Limit] = ()) -> Controller:
    """The velocity controller of a [law], with more limits."""
    return Controller(robot, limits=limits, **law_options(robot, law))


class TaskController(ABC):
    """A controller of a plant in a run."""

    form: Form | None = None  # the form of its law; None where it has none
    # (6,) the wrench that the tool exerts, as measured in the last tick, base frame; zero without a sensor
    wrench: Array = np.zeros(6)
    is_done: bool = False  # whether the run may end before its time

    @abstractmethod
    def step(self, measured: Measurement, goal: Goal) -> VelocitySolution:
        """One tick."""


class PathController(TaskController):
    """A velocity controller that follows the path."""

    def __init__(self, loop: Controls) -> None:
        self._loop = loop
        self.form = loop.form if isinstance(loop, Controller) else None

    def step(self, measured: Measurement, goal: Goal) -> VelocitySolution:
        """One tick."""
        return self._loop.step(measured.q, goal.target, goal.feedforward)


class ElasticPathController(TaskController):
    """A path follower: the tool stays on the path and is late where limits bind."""

    def __init__(self, loop: Controller, problem: ControlProblem, q: Array) -> None:
        """A follower of the path of a problem, prepared at joint positions q (m,)."""
        n = len(problem.poses)
        samples = np.unique(np.linspace(0, n - 1, min(n, PATH_SAMPLES)).round().astype(int))
        poses = problem.poses[samples]
        path = poses if problem.part is None else [problem.part.met_by(T) for T in poses]
        self.follower: PathFollower = PathFollower(loop, path, times=problem.time[samples], rate=1.0)
        self.follower.prepare(q)
        self.form = loop.form
        self.followed: list[FollowerSolution] = []

    def step(self, measured: Measurement, goal: Goal) -> VelocitySolution:  # noqa: ARG002 (the path has its own time)
        """One tick."""
        solution = self.follower.step(measured.q)
        self.followed.append(solution)
        self.is_done = solution.status in ("done", "blocked")
        answer = VelocitySolution(solution.velocity, "planned", Status.OK, (), (), np.zeros(6), 1.0, 0.0, 0.0, "")
        return answer if solution.status != "blocked" else degraded(answer, solution.reason)


class ContactController(TaskController):
    """The hybrid controller."""

    def __init__(self, loop: HybridController) -> None:
        self._loop = loop
        self.form = loop.loop.form

    def step(self, measured: Measurement, goal: Goal) -> VelocitySolution:
        """One tick."""
        solution = self._loop.step(measured.q, goal.target, measured.wrench, goal.feedforward)
        self.wrench = solution.wrench
        return solution.velocity_solution._replace(status=solution.status, reasons=solution.reason)


class OperatorController(TaskController):
    """Shared control: an operator moves the tool on a plane and also leaves it; the robot brings it back."""

    def __init__(self, loop: Controller, operator: OperatorSpec, point: Array) -> None:
        """The robot levels the tool about a point (3,) of its frame [m]."""
        plane = face_contact((0.0, 0.0, 0.0), operator.normal)
        robot_twists = se3.adjoint(plane.pose).dot(np.eye(6)[:, [5, 0, 1]])  # along the normal, and both tilts
        self._loop = loop
        self.form = loop.form
        self._shared = SharedTask(robot_twists, plane.freedoms)
        self._amplitudes = robot_twists.dot([operator.strays, operator.tilts, operator.tilts])
        self._frequency = operator.beats
        self._point = np.append(point, 1.0)

    def step(self, measured: Measurement, goal: Goal) -> VelocitySolution:
        """One tick."""
        robot = self._loop.robot
        state = robot.state(measured.q, goal.target)
        here = se3.transform(None, robot.pose(measured.q).dot(self._point)[:3])
        disturbance = se3.adjoint(here).dot(self._amplitudes) * np.sin(2.0 * pi * self._frequency * goal.time)
        s = self._shared.moved(here).twist(tracking_twist(state.error, self._loop.gain), goal.feedforward + disturbance)
        return self._loop.follow(measured.q, s, at="base")


def controller_for(problem: ControlProblem, controller: MakeController | None = None) -> TaskController:
    """The controller of a problem; `controller` makes its velocity controller, None is ours."""
    robot, law = problem.robot, problem.law
    if controller is not None:
        arrays.function(controller, "controller", "a function of robot and law that makes a controller")
    limits = [] if problem.obstacle_scene is None else [problem.obstacle_scene.clearance]
    if problem.contact_task is not None:
        if controller is not None:
            found = "a velocity controller for a task in contact"
            raise BadInput("controller", found, "a task without [contact]", "A contact needs a hybrid controller.")
        options = law_options(robot, law)
        return ContactController(
            HybridController(robot, problem.contact_task, sensor=problem.sensor, limits=limits, **options)
        )
    loop = our_controller(robot, law, limits) if controller is None else controller(robot, law)
    if problem.elastic is not None:
        if not isinstance(loop, Controller):
            found = f"{type(loop).__name__} on an elastic path"
            raise BadInput("controller", found, "ours, or none", "Others keep its timing.")
        return ElasticPathController(loop, problem, problem.elastic)
    if problem.operator is not None and isinstance(loop, Controller):
        return OperatorController(loop, problem.operator, np.array(law.point))
    return PathController(loop)
