"""A recording as frames to draw: the tool as it was moved, and the contact that was found on its path."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from invariantqp.force.sensor import WrenchSensor
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.identification.candidate import Candidate
from invariantqp.identification.identify import Identification
from invariantqp.identification.recording import File, seconds
from invariantqp.pictures.charts import FRAMES, ORANGE, SKY, CurveChart, frame_ends
from invariantqp.robots.kinematics import Robot
from invariantqp.robots.load import urdf_of
from invariantqp.view.appearance import Appearance, appearance_of
from invariantqp.view.scenery import MARGIN, Surroundings, patch, tiles
from invariantqp.view.timeline import FORCE, Timeline, arm_in

MOVING = "in the air, or changing"


def timeline_of_recording(
    found: Identification, file: File, sensor: WrenchSensor, robot: Robot | None, source: str | None, title: str
) -> Timeline:
    """A recording as frames: the arm where there is one, the path of the contact, and part of the surface or the axis.

    `source` is what names the robot, `title` that of the page.
    """
    time = seconds(file)
    at = frame_ends(len(time) - 1)
    kinds = "; ".join(
        p.kind or f"undecided ({', '.join(dict.fromkeys(c.kind for c in p.candidates))})" for p in found.segments
    )
    named = {p.start: p.kind or "undecided" for p in found.segments}
    part = max(found.segments, key=lambda p: p.stop - p.start)
    shown = part.candidates[0] if part.candidates else None
    mark = _touching(shown, file.poses[part.start])
    tool = file.poses[at] @ mark
    w = np.array([sensor.wrench(r, pose) for r, pose in zip(file.readings[at], file.poses[at], strict=True)])
    arm = _no_arm(tool) if robot is None or file.q is None else arm_in(robot, file.q[at])
    q = arm["q"]
    timeline = Timeline(
        title=title,
        about=f"A recording: {kinds}.",
        time=time[at],
        appearance=Appearance() if source is None or robot is None else appearance_of(robot, partial(urdf_of, source)),
        wanted=tool,
        speed=np.asarray(np.gradient(q, time[at], axis=0)) if q.size else np.zeros_like(q),
        limit_active=[False] * len(at),
        status=[next((named[p.start] for p in found.segments if p.start <= k < p.stop), MOVING) for k in at.tolist()],
        charts=(),
        surroundings=Surroundings() if shown is None else _surface(shown, file.poses[part.start : part.stop]),
        travel=np.gradient(tool[:, :3, 3], time[at], axis=0),
        force=w[:, 3:],
        recorded=True,
        **{**arm, "tool": tool, "home": arm["home"] @ mark},
    )
    return replace(timeline, charts=(_forces(shown, file.poses[at], w[:, 3:]), *timeline.limit_charts))


def _touching(shown: Candidate | None, pose: Array) -> Array:
    """(4, 4) in the tool frame: where the tool touches, with the tool's axes; its own frame where that is not known."""
    mark = np.eye(4)
    if shown is not None and shown.fixed_to != "tool" and shown.kind not in ("hinge", "screw", "slide", "peg"):
        mark[:3, 3] = np.linalg.inv(pose).dot(np.append(shown.frame(pose)[:3, 3], 1.0))[:3]
    return mark


def _no_arm(tool: Array) -> dict[str, Any]:
    """What a timeline has where poses (k, 4, 4) alone were recorded."""
    empty = {"screws": (6, 0), "places": (0, 3), "q": (len(tool), 0), "limits": (2, 0), "speed_limit": (0,)}
    arm = {name: np.zeros(shape) for name, shape in empty.items()}
    return {"joints": (), "slides": [], "points": tool[:, None, :3, 3], "home": np.eye(4), **arm}


def _forces(shown: Candidate | None, poses: Array, force: Array) -> CurveChart:
    """The force of the tool: along the contact and across it, or its size where no contact is known."""
    title = "force of the tool [N]"
    if shown is None:
        return CurveChart(title, ("size",), np.linalg.norm(force, axis=1)[None], (FORCE,))
    frames = np.array([shown.frame(T) for T in poses])
    local = np.einsum("nji,nj->ni", frames[:, :3, :3], force)
    parts = np.stack((local[:, 2], np.linalg.norm(local[:, :2], axis=1)))
    return CurveChart(title, ("along z of the contact", "across it"), parts, (ORANGE, SKY))


def _surface(c: Candidate, poses: Array) -> Surroundings:
    """Part of a plane or a ball about the path of the contact, or the axis of a joint."""
    frames = np.array([c.frame(T) for T in poses[:: max(1, len(poses) // FRAMES)]])
    path = frames[:, :3, 3]
    middle = path.mean(axis=0)
    travelled = poses[:, :3, 3]
    margin = MARGIN * float(np.linalg.norm(travelled, axis=1).max())
    if c.kind in ("ball", "peg", "hinge", "screw", "slide") or c.fixed_to == "tool":
        half = max(margin, float(np.linalg.norm(path - middle, axis=1).max()))
        along = c.surface[:3, 2] if c.fixed_to != "tool" and c.kind != "ball" else frames[len(frames) // 2, :3, 2]
        half = 0.2 * half if c.kind == "ball" or c.fixed_to == "tool" else half
        return Surroundings(axis=np.stack((middle - half * along, middle + half * along)))
    z = c.surface[:3, 2]
    corners = patch(path, middle, *se3.across(z), margin)
    if c.kind == "sphere" and c.centre is not None and c.radius is not None:
        off = corners - c.centre
        aside = off - (off @ z)[..., None] * z
        depth = np.sqrt(np.maximum(c.radius**2 - (aside**2).sum(axis=-1), 0.0))
        corners = c.centre + aside - np.sign(c.radius) * depth[..., None] * z
    else:
        corners = corners + ((c.surface[:3, 3] - corners) @ z)[..., None] * z
    return Surroundings(tiles(corners))
