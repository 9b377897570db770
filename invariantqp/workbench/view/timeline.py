"""A run as a timeline: the state of arm, contact and obstacles in a few hundred frames, and the charts.

An arm without meshes is drawn from its kinematics: straight links from joint to joint, each joint along its axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.screws import angular_speeds
from invariantqp.robots.chain import Chain, CoupledJoints
from invariantqp.robots.kinematics import Robot
from invariantqp.workbench.pictures.charts import (
    FRAMES,
    GREEN,
    VERMILION,
    CurveChart,
    charts_of,
    extremes,
    frame_ends,
    limit_charts,
    ticks_of,
)
from invariantqp.workbench.runs.taskfile import Task
from invariantqp.workbench.runs.trace import Trace
from invariantqp.workbench.view.appearance import Appearance, Part, appearance_of
from invariantqp.workbench.view.scenery import Solid, Surroundings, solids, surroundings

# Smallest velocity, relative to the size of the scene [1/s], and smallest force [N] with an arrow.
MIN_VELOCITY, MIN_FORCE = 2e-4, 0.05
FORCE, TRAVEL = VERMILION, GREEN


@dataclass(frozen=True, eq=False)
class Timeline:
    """A run in k frames; lengths in the robot's unit, base frame."""

    title: str  # the task's name
    about: str  # description and result
    joints: tuple[str, ...]  # (m) names
    slides: list[bool]  # (m) whether a joint is prismatic
    time: Array  # (k,) [s]
    points: Array  # (k, m + 2, 3) base, joints, tool
    tool: Array  # (k, 4, 4) tool poses
    screws: Array  # (6, n) twists of all joints at q = 0, mimic joints among them
    coordinates: Sequence[int]  # (n) which of the m moves each
    drivers: Sequence[int]  # (m) which of the n has its name
    places: Array  # (m, 3) points of the joints at q = 0
    home: Array  # (4, 4) tool pose at q = 0
    appearance: Appearance  # of the arm
    wanted: Array  # (k, 4, 4) desired poses
    q: Array  # (k, m) joint positions
    limits: Array  # (2, m) lower and upper
    speed: Array  # (k, m) joint velocities, the largest of each frame's ticks
    speed_limit: Array  # (m,)
    limit_active: list[bool]  # (k) whether a limit was active in one of them
    status: list[str]  # (k) the first status of them that is not "ok"
    charts: tuple[CurveChart, ...]  # curves to draw
    surroundings: Surroundings  # what the tool touches
    travel: Array  # (k, 3) velocity of the tool frame's origin [length/s]
    force: Array | None = None  # (k, 3) force of the tool [N]; None without contact
    solids: tuple[Solid, ...] = ()  # bodies and obstacles of a clearance
    recorded: bool = False  # whether it is a recording, without desired poses

    @property
    def limit_charts(self) -> list[CurveChart]:
        """Joint positions and velocities by their limits."""
        return limit_charts(self.joints, self.q, self.limits, self.speed, self.speed_limit)

    @property
    def centre(self) -> Array:
        """(3,) centre of the scene."""
        low, high = self._box()
        return 0.5 * (low + high)

    @property
    def size(self) -> float:
        """Radius of the scene about its centre [length]."""
        low, high = self._box()
        return 0.5 * float(np.linalg.norm(high - low))

    @property
    def floor(self) -> float:
        """Height of the lowest point of the arm [length]."""
        return min(float(points[..., 2].min()) for points in (self.points, *(part.vertices for part in self._fixed)))

    @property
    def force_scale(self) -> tuple[float, float]:
        """The forces with the shortest and the longest arrow [N]."""
        return _scale(np.zeros((1, 3)) if self.force is None else self.force, MIN_FORCE)

    @property
    def travel_scale(self) -> tuple[float, float]:
        """The velocities with the shortest and the longest arrow [length/s]."""
        return _scale(self.travel, MIN_VELOCITY * self.size)

    @property
    def _fixed(self) -> list[Part]:
        """Parts that no joint moves."""
        return [part for part in self.appearance.parts if part.joint == 0]

    def _box(self) -> tuple[Array, Array]:
        touched, fixed = self.surroundings.faces.reshape(-1, 3), [part.vertices for part in self._fixed]
        around = [_corners_of(solid.faces, solid.poses) for solid in self.solids if solid.poses is not None]
        drawn = np.vstack((self.points.reshape(-1, 3), self.wanted[:, :3, 3], touched, *fixed, *around))
        return drawn.min(axis=0), drawn.max(axis=0)


def _corners_of(faces: Array, poses: Array) -> Array:
    """(n, 3) corners of an obstacle at the start, in the middle and at the end."""
    corners, some = faces.reshape(-1, 3), poses[[0, len(poses) // 2, -1]]
    return np.vstack([corners.dot(T[:3, :3].T) + T[:3, 3] for T in some])


def _scale(vectors: Array, least: float) -> tuple[float, float]:
    """`least`, and the 99th percentile of the sizes of vectors (k, 3), at least ten times `least`."""
    return least, max(float(np.percentile(np.linalg.norm(vectors, axis=1), 99)), 10.0 * least)


def timeline_of(trace: Trace) -> Timeline:
    """The timeline of a run from `run_task`, in at most FRAMES frames."""
    robot = trace.task.load_robot()
    ends = frame_ends(len(trace.velocity))
    result = "Accepted." if trace.passed else f"Not accepted: {'; '.join(trace.shortfalls)}."
    latest = np.maximum(ends - 1, 0)
    return replace(
        _timeline(trace.task, robot, trace.time[ends], trace.q[ends], trace.wanted[ends]),
        speed=extremes(trace.velocity, ends),
        about=f"{trace.task.about.removesuffix('.')}. {result}" if trace.task.about else result,
        **states(trace.statuses, trace.limit_active, ends),
        charts=tuple(charts_of(trace, ends)),
        travel=np.array(
            [
                se3.velocity_at(robot.jacobian(q).dot(velocity), robot.pose(q)[:3, 3])
                for q, velocity in zip(trace.q[ends], trace.velocity[latest], strict=True)
            ]
        ),
        force=None if trace.contact is None else trace.contact.wrench[latest, 3:],
    )


def timeline_before(task: Task) -> Timeline:
    """The timeline before a run: the arm at its start and the path."""
    robot = task.load_robot()
    pose = task.path.along(robot, task.start())
    time = np.linspace(0.0, task.settle + task.path.duration, FRAMES)
    wanted = np.array([pose(t) for t in np.maximum(time - task.settle, 0.0).tolist()])
    before = _timeline(task, robot, time, np.tile(task.start(), (FRAMES, 1)), wanted)
    return replace(before, travel=np.gradient(wanted[:, :3, 3], time, axis=0))


def arm_in(robot: Robot, q: Array) -> dict[str, Any]:
    """The arm's attributes of a timeline at joint positions q (k, m)."""
    tool, zero = np.array([robot.pose(state) for state in q]), np.zeros(len(robot.names))
    joints, each = [robot.origins(state) for state in q], tuple(range(len(zero)))
    made_of = robot.joints if isinstance(robot, Chain) else CoupledJoints(robot.jacobian(zero), each, each)
    return {
        "joints": robot.names,
        "slides": (angular_speeds(robot.jacobian(q[0])) == 0.0).tolist(),
        "points": np.array([(np.zeros(3), *p, T[:3, 3]) for p, T in zip(joints, tool, strict=True)]),
        "tool": tool,
        **made_of._asdict(),
        "places": robot.origins(zero),
        "home": robot.pose(zero),
        "q": q,
        "limits": np.stack((robot.position_lower, robot.position_upper)),
        "speed_limit": robot.velocity_limit,
    }


def _timeline(task: Task, robot: Chain, time: Array, q: Array, wanted: Array) -> Timeline:
    """A timeline without results."""
    arm, around = arm_in(robot, q), task.obstacle_scene(robot)
    reach = np.linalg.norm(arm["points"] - arm["points"][:, :1], axis=2).max()
    return Timeline(
        title=task.name,
        about=task.about,
        time=time,
        appearance=appearance_of(robot, task.urdf),
        wanted=wanted,
        speed=np.zeros_like(q),
        limit_active=[False] * len(time),
        status=[""] * len(time),
        charts=(),
        surroundings=surroundings(task, robot, wanted[:, :3, 3]),
        travel=np.zeros((len(time), 3)),
        solids=() if around is None else solids(around, time, len(robot.names), float(reach)),
        **arm,
    )


def states(statuses: Sequence[str], limited: Sequence[bool], ends: Array) -> dict[str, Any]:
    """`status` and `limit_active` of a timeline, from those of the ticks."""
    ticks = ticks_of(ends)
    status = [next((s for s in statuses[a:b] if s != "ok"), statuses[b - 1]) for a, b in ticks]
    return {"status": status, "limit_active": [any(limited[a:b]) for a, b in ticks]}
