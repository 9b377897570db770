"""An arm whose joints are not where its model says, and a camera that sees the tool: what methods make of it.

    q <- q + dt x,   the tool at T(q) by the true screws,   x from the model's J(q) and log(T(q)^-1 T_target)

The error twist is true, as an eye sees it, and J is wrong. A method is told a target that its model sees where the eye
sees the true one. The true error is what counts.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.laws.view import pose_of
from invariantqp.compare.measure.cell import Cell, Kind, Result
from invariantqp.compare.measure.watched import figures, watched_run
from invariantqp.compare.registry import controller_named
from invariantqp.control.controller import Controls
from invariantqp.geometry import se3
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.plants.ideal import IdealPlant
from invariantqp.runs.prepare import prepare
from invariantqp.velocity.solution import VelocitySolution

# Standard deviations of how far each joint is turned and shifted, about and along each axis of the base [rad], [m]:
# an arm whose links were measured by a ruler.
TURNED, SHIFTED = 5e-3, 5e-3
TASKS = ("compare/panda", "compare/panda_limits", "compare/ur5_limits", "compare/so101_limits")


class Seen:
    """A law that is told its target as a camera on the true arm sees it."""

    def __init__(self, law: Controls, model: Robot, true: Robot) -> None:
        self._law, self._model, self._true = law, model, true

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; the target is the true arm's."""
        seen = np.dot(self._model.pose(q), se3.inverse(self._true.pose(q), check=False))
        ahead = None if feedforward is None else se3.adjoint(seen, check=False).dot(feedforward)
        return self._law.step(q, self._model.target(seen.dot(pose_of(target))), ahead)


def misplaced(robot: Robot, seed: int) -> Chain:
    """The arm with every joint turned and shifted at random."""
    rng = np.random.default_rng(seed)
    m = len(robot.names)
    off = rng.normal(size=(m, 6)) * np.repeat((TURNED, SHIFTED), 3)
    screws = robot.jacobian(np.zeros(m))
    moved = np.column_stack([se3.adjoint(se3.exp(d)).dot(s) for d, s in zip(off, screws.T, strict=True)])
    limits = (robot.position_lower, robot.position_upper, robot.velocity_limit)
    return Chain(moved, robot.pose(np.zeros(m)), robot.names, *limits)


def calibration(cell: Cell) -> dict[str, Result]:
    """Largest true error of the run, and the variation of the joint velocities."""
    setup = prepare(cell.load())
    model, law, start = setup.robot, setup.brief.law, np.asarray(setup.task.start())
    true = misplaced(model, cell.seed)
    moved = true.pose(start).dot(se3.inverse(model.pose(start)))  # the path begins where the tool is
    poses, ahead = moved @ setup.wanted, setup.brief.feedforward.dot(se3.adjoint(moved).T)
    brief = replace(setup.brief, robot=true, poses=poses, feedforward=ahead)
    other = replace(setup, robot=true, plant=IdealPlant(true, start, law.dt), wanted=poses, brief=brief)
    found = figures(*watched_run(other, lambda *_: Seen(controller_named(cell.method)(model, law), model, true)))
    return {cell.method: {key: found[key] for key in ("position_mm", "orientation_deg", "variation", "failed_ticks")}}


KINDS = {"calibration": Kind(calibration, tasks=TASKS, slow=True)}
