"""A run as frames to draw: where everything is in each of a few hundred frames, and the curves beside it.

An arm is drawn as its meshes look, or from its kinematics alone: straight links from joint to joint, each joint along
its axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.screws import turning
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

# No arrow is drawn for a velocity below this, relative to the size of all [1/s], or for a weaker force [N].
REST, WEAK = 2e-4, 0.05
FORCE, TRAVEL = VERMILION, GREEN


@dataclass(frozen=True, eq=False)
class Timeline:
    """A run in k frames; lengths in the robot's unit, base frame."""

    title: str  # the task's name
    about: str  # what it is, and how it went
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
    appearance: Appearance  # its meshes
    wanted: Array  # (k, 4, 4) poses wanted
    q: Array  # (k, m) joint positions
    limits: Array  # (2, m) lower and upper
    speed: Array  # (k, m) joint velocities, the fastest of the ticks since the frame before
    speed_limit: Array  # (m,)
    limit_active: list[bool]  # (k) whether a limit was active in one of those ticks
    status: list[str]  # (k) of the law, the first of those ticks' that is not "ok"
    charts: tuple[CurveChart, ...]  # curves to draw
    surroundings: Surroundings  # what the tool touches
    travel: Array  # (k, 3) velocity of the tool frame's origin [length/s]
    force: Array | None = None  # (k, 3) that the tool exerts [N]; None without contact
    solids: tuple[Solid, ...] = ()  # bodies and obstacles that are kept apart
    recorded: bool = False  # whether it was recorded: no pose was wanted

    @property
    def limit_charts(self) -> list[CurveChart]:
        """Joint positions and velocities by their limits."""
        return limit_charts(self.joints, self.q, self.limits, self.speed, self.speed_limit)

    @property
    def centre(self) -> Array:
        """(3,) the middle of everything that is drawn."""
        low, high = self._box()
        return 0.5 * (low + high)

    @property
    def size(self) -> float:
        """Radius of a ball about the centre that contains everything [length]."""
        low, high = self._box()
        return 0.5 * float(np.linalg.norm(high - low))

    def frame(self, t: float) -> int:
        """The frame nearest to a time [s]."""
        return int(np.abs(self.time - t).argmin())

    @property
    def floor(self) -> float:
        """Height of what is lowest of the arm [length]."""
        return min(float(points[..., 2].min()) for points in (self.points, *(part.vertices for part in self._fixed)))

    @property
    def force_scale(self) -> tuple[float, float]:
        """The weakest force that has an arrow and the one that has the longest [N]."""
        return _scale(np.zeros((1, 3)) if self.force is None else self.force, WEAK)

    @property
    def travel_scale(self) -> tuple[float, float]:
        """The slowest velocity that has an arrow and the one that has the longest [length/s]."""
        return _scale(self.travel, REST * self.size)

    @property
    def _fixed(self) -> list[Part]:
        """Parts that no joint moves."""
        return [part for part in self.appearance.parts if part.joint == 0]

    def _box(self) -> tuple[Array, Array]:
        touched, fixed = self.surroundings.faces.reshape(-1, 3), [part.vertices for part in self._fixed]
        around = [_seen(solid.faces, solid.poses) for solid in self.solids if solid.poses is not None]
        drawn = np.vstack((self.points.reshape(-1, 3), self.wanted[:, :3, 3], touched, *fixed, *around))
        return drawn.min(axis=0), drawn.max(axis=0)


def _seen(faces: Array, poses: Array) -> Array:
    """(n, 3) corners of an obstacle at the beginning, in the middle and at the end of a timeline."""
    corners, some = faces.reshape(-1, 3), poses[[0, len(poses) // 2, -1]]
    return np.vstack([corners.dot(T[:3, :3].T) + T[:3, 3] for T in some])


def _scale(vectors: Array, least: float) -> tuple[float, float]:
    """`least`, and what vectors (k, 3) exceed in one frame of a hundred, or more where that is nearly `least`."""
    return least, max(float(np.percentile(np.linalg.norm(vectors, axis=1), 99)), 10.0 * least)


def timeline_of(trace: Trace) -> Timeline:
    """A run from `run_task` as `FRAMES` frames at most."""
    robot = trace.task.load_robot()
    ends = frame_ends(len(trace.velocity))
    went = "Accepted." if trace.passed else f"Not accepted: {'; '.join(trace.shortfalls)}."
    then = trace.velocity[np.maximum(ends - 1, 0)]
    return replace(
        _timeline(trace.task, robot, trace.time[ends], trace.q[ends], trace.wanted[ends]),
        speed=extremes(trace.velocity, ends),
        about=f"{trace.task.about.removesuffix('.')}. {went}" if trace.task.about else went,
        **states(trace.statuses, trace.limit_active, ends),
        charts=tuple(charts_of(trace, ends)),
        travel=np.array(
            [
                se3.velocity_at(robot.jacobian(q).dot(velocity), robot.pose(q)[:3, 3])
                for q, velocity in zip(trace.q[ends], then, strict=True)
            ]
        ),
        force=None if trace.contact is None else trace.contact.wrench[np.maximum(ends - 1, 0), 3:],
    )


def timeline_before(task: Task) -> Timeline:
    """What is known before a run: the arm at its start and its path, before contact moves it onto a surface."""
    robot = task.load_robot()
    pose = task.path.along(robot, task.start())
    time = np.linspace(0.0, task.settle + task.path.duration, FRAMES)
    wanted = np.array([pose(t) for t in np.maximum(time - task.settle, 0.0).tolist()])
    drawn = _timeline(task, robot, time, np.tile(task.start(), (FRAMES, 1)), wanted)
    return replace(drawn, travel=np.gradient(wanted[:, :3, 3], time, axis=0))


def arm_in(robot: Robot, q: Array) -> dict[str, Any]:
    """What a timeline has of an arm in states q (k, m)."""
    tool, zero = np.array([robot.pose(state) for state in q]), np.zeros(len(robot.names))
    joints, each = [robot.origins(state) for state in q], tuple(range(len(zero)))
    made_of = robot.joints if isinstance(robot, Chain) else CoupledJoints(robot.jacobian(zero), each, each)
    return {
        "joints": robot.names,
        "slides": (turning(robot.jacobian(q[0])) == 0.0).tolist(),
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
    """What a timeline has of the statuses of the ticks and of whether a limit was active in each."""
    ticks = ticks_of(ends)
    status = [next((s for s in statuses[a:b] if s != "ok"), statuses[b - 1]) for a, b in ticks]
    return {"status": status, "limit_active": [any(limited[a:b]) for a, b in ticks]}
