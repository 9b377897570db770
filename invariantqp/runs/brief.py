"""What a controller is told before a run, and in each tick of it.

A brief may be expressed in other frames than the task file: a tool frame elsewhere on the tool, say. What it asks of
the arm stays the same, so a controller that is right answers with the same joint velocities.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from invariantqp.force.hybrid_task import HybridTask
from invariantqp.force.wrench import WrenchSensor
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.clearancespec import Around
from invariantqp.runs.contactspec import OperatorSpec
from invariantqp.runs.taskfile import LawSpec


class Goal(NamedTuple):
    """What is asked for in a tick."""

    target: Any  # tool pose, as `robot.target` returned it
    feedforward: Array  # (6,) twist of the target, base frame [rad/s, m/s]
    time: float  # [s]


@dataclass(frozen=True, eq=False)
class Brief:
    """What a controller is told."""

    robot: Robot  # the arm, with the tool frame that targets are for
    law: LawSpec  # the [law] table; its points are in that tool frame
    time: Array  # (n + 1,) [s]
    poses: Array  # (n + 1, 4, 4) tool poses that are asked for
    feedforward: Array  # (n, 6) their twists, base frame [rad/s, m/s]
    contact_task: HybridTask | None = None  # what to do at a contact; None without one
    sensor: WrenchSensor | None = None  # what is known of the force sensor; None without contact
    operator: OperatorSpec | None = None  # the person who moves the tool too; None without one
    around: Around | None = None  # what is around the arm, and the clearance from it; None without
    elastic: Array | None = None  # (m,) joint positions at the start of a path that may be late; None keeps its timing

    def goals(self) -> list[Goal]:
        """What is asked for, tick by tick."""
        ticks = zip(self.poses, self.feedforward, self.time.tolist(), strict=False)
        return [Goal(self.robot.target(T), twist, t) for T, twist, t in ticks]
