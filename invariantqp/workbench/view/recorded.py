"""A recording as a timeline: the motion of the tool and the contact identified on its path."""

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
from invariantqp.identification.recording_files import RecordingFile
from invariantqp.robots.kinematics import Robot
from invariantqp.robots.load import urdf_of
from invariantqp.workbench.pictures.charts import FRAMES, ORANGE, SKY, CurveChart, frame_ends
from invariantqp.workbench.view.appearance import Appearance, appearance_of
from invariantqp.workbench.view.scenery import MARGIN, Surroundings, patch, tiles
from invariantqp.workbench.view.timeline import FORCE, Timeline, arm_in

MOVING = "in the air, or changing"
# Kinds of contact that are drawn by their axis.
AXES = ("hinge", "screw", "slide", "peg")


def timeline_of_recording(
    identified: Identification,
    file: RecordingFile,
    sensor: WrenchSensor,
    robot: Robot | None,
    source: str | None,
    title: str,
) -> Timeline:
    """The timeline of a recording: the arm if there is one, the path of the contact, and its surface or axis.

    `source` is the robot's name or file, `title` the page's.
    """
    time, segments = file.seconds, identified.segments
    at = frame_ends(len(time) - 1)
    kinds = [p.kind or f"undecided ({', '.join(dict.fromkeys(c.kind for c in p.candidates))})" for p in segments]
    status = np.full(len(at), MOVING, dtype=object)
    for p in segments:
        status[(p.start <= at) & (at < p.stop)] = p.kind or "undecided"
    longest = max(segments, key=lambda p: p.stop - p.start)
    contact = longest.candidates[0] if longest.candidates else None
    touching = _contact_frame(contact, file.poses[longest.start])
    tool = file.poses[at] @ touching
    force = np.array([sensor.wrench(r, T)[3:] for r, T in zip(file.readings[at], file.poses[at], strict=True)])
    arm = _no_arm(tool) if robot is None or file.q is None else arm_in(robot, file.q[at])
    q = arm["q"]
    timeline = Timeline(
        title=title,
        about=f"A recording: {'; '.join(kinds)}.",
        time=time[at],
        appearance=Appearance() if source is None or robot is None else appearance_of(robot, partial(urdf_of, source)),
        wanted=tool,
        speed=np.gradient(q, time[at], axis=0) if q.size else np.zeros_like(q),
        limit_active=[False] * len(at),
        status=status.tolist(),
        charts=(),
        surroundings=_surface(contact, file.poses[longest.start : longest.stop]),
        travel=np.gradient(tool[:, :3, 3], time[at], axis=0),
        force=force,
        recorded=True,
        **{**arm, "tool": tool, "home": arm["home"] @ touching},
    )
    return replace(timeline, charts=(_forces(contact, file.poses[at], force), *timeline.limit_charts))


def _contact_frame(c: Candidate | None, pose: Array) -> Array:
    """(4, 4) frame at the contact point with the tool's axes, in the tool frame; the identity if it is unknown."""
    if c is None or c.fixed_to == "tool" or c.kind in AXES:
        return np.eye(4)
    return se3.transform(translation=se3.inverse(pose).dot(c.frame(pose))[:3, 3])


def _no_arm(tool: Array) -> dict[str, Any]:
    """The arm's attributes of a timeline of poses (k, 4, 4) alone."""
    empty = {"screws": (6, 0), "places": (0, 3), "q": (len(tool), 0), "limits": (2, 0), "speed_limit": (0,)}
    arm = {name: np.zeros(shape) for name, shape in empty.items()}
    none = dict.fromkeys(("joints", "coordinates", "drivers"), ())
    return {**none, "slides": [], "points": tool[:, None, :3, 3], "home": np.eye(4), **arm}


def _forces(c: Candidate | None, poses: Array, force: Array) -> CurveChart:
    """The force of the tool, normal and tangential to the contact, or its size if the contact is unknown."""
    title = "force of the tool [N]"
    if c is None:
        return CurveChart(title, ("size",), np.linalg.norm(force, axis=1)[None], (FORCE,))
    frames = np.array([c.frame(T) for T in poses])
    local = np.einsum("nji,nj->ni", frames[:, :3, :3], force)
    parts = np.stack((local[:, 2], np.linalg.norm(local[:, :2], axis=1)))
    return CurveChart(title, ("along z of the contact", "across it"), parts, (ORANGE, SKY))


def _surface(c: Candidate | None, poses: Array) -> Surroundings:
    """Part of a plane or sphere about the path of the contact, or the axis of a joint."""
    if c is None:
        return Surroundings()
    frames = np.array([c.frame(T) for T in poses[:: max(1, len(poses) // FRAMES)]])
    path = frames[:, :3, 3]
    middle = path.mean(axis=0)
    margin = MARGIN * float(np.linalg.norm(poses[:, :3, 3], axis=1).max())
    in_hand = c.fixed_to == "tool"
    if in_hand or c.kind == "ball" or c.kind in AXES:
        half = max(margin, float(np.linalg.norm(path - middle, axis=1).max()))
        along = c.surface[:3, 2]
        if in_hand or c.kind == "ball":  # no fixed axis: a short line along the contact's
            half, along = 0.2 * half, frames[len(frames) // 2, :3, 2]
        return Surroundings(axis=np.stack((middle - half * along, middle + half * along)))
    z = c.surface[:3, 2]
    corners = patch(path, middle, *se3.perpendicular_axes(z), margin)
    if c.kind == "sphere" and c.centre is not None and c.radius is not None:
        offset = corners - c.centre
        tangential = offset - (offset @ z)[..., None] * z
        depth = np.sqrt(np.maximum(c.radius**2 - (tangential**2).sum(axis=-1), 0.0))
        corners = c.centre + tangential - np.sign(c.radius) * depth[..., None] * z
    else:
        corners = corners + ((c.surface[:3, 3] - corners) @ z)[..., None] * z
    return Surroundings(tiles(corners))
