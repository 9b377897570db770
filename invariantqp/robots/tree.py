"""An arm cut out of a tree of links: the chain of joints from its root to a tool link.

    T(0) = T_1 ... T_k,    S_i = Ad(T_1 ... T_i) (a_i; 0) or (0; a_i),    T_i the frame of joint i in that of its parent

Joints that are held contribute a fixed motion: they stand at zero, or at the limit nearest to it.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import numpy as np

from invariantqp.errors import BadInput, RobotModelError, UnknownName
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain, Geometry, Link

# Types of joints with one coordinate, without one, and with several.
MOVING = ("revolute", "continuous", "prismatic")
TYPES = (*MOVING, "fixed", "floating", "planar")
# Why a joint cannot be one of an arm, by its type.
NOT_SINGLE = "({}) has no single coordinate; only revolute and prismatic joints are modelled"
# Pairs of links that may touch, each with its reason: an SRDF lists them, an MJCF excludes them.
Exclusions = dict[frozenset[str], str]


class TreeJoint(NamedTuple):
    """A joint of a tree of links."""

    name: str  # of the joint
    kind: str  # one of `TYPES`
    parent: str  # the link that it stands on
    child: str  # the link that it moves
    origin: Array  # (4, 4) its frame in that of the parent link, at zero
    axis: Array  # (3,) unit vector in its frame
    lower: float = -inf  # position limit [rad, m], -inf where there is none
    upper: float = inf  # likewise, inf
    speed: float = inf  # velocity limit [rad/s, m/s], inf where there is none
    mimics: str = ""  # the joint that it follows, "" for none

    @property
    def screw(self) -> Array:
        """(6,) its unit twist, in its frame."""
        still = np.zeros(3)
        return np.concatenate((still, self.axis) if self.kind == "prismatic" else (self.axis, still))


def chain_to_link(
    joints: Sequence[TreeJoint],
    name: str,
    tool: str | None,
    chosen: Sequence[str] | None,
    parts: dict[str, tuple[Geometry, ...]] | None = None,
    apart: Exclusions | None = None,
) -> Chain:
    """The arm from the root of a tree of joints to a link, or to the joint that moves it; else as in `load_robot`.

    `parts` are the links' collision geometry, `apart` the pairs of links that may touch.
    """
    above = {joint.child: joint for joint in joints}
    if len(above) < len(joints):
        raise RobotModelError(f"{name}: a link is moved by two joints; expected a tree of links")
    links = list(dict.fromkeys(link for joint in joints for link in (joint.parent, joint.child)))
    paths = {link: path_to(above, link, name) for link in links}
    if tool is None:
        tool = max(above, key=lambda link: _length(paths[link]))
    if tool not in links:
        tool = next((joint.child for joint in joints if joint.name == tool), tool)
    if tool not in links:
        raise UnknownName("frame", tool, difflib.get_close_matches(tool, links), links)
    path = paths[tool]
    can = [joint.name for joint in path if joint.kind != "fixed"]
    moving = selected(name, tool, can, [joint.name for joint in joints], chosen)
    arm = [_movable(joint, name) for joint in path if joint.name in moving]
    made = excluding(_links(paths, path, moving, parts or {}), apart or {})
    frames = {link.name: link.frame for link in made}
    return Chain(
        np.column_stack([se3.adjoint(frames[joint.child], check=False).dot(joint.screw) for joint in arm]),
        frames[tool],
        moving,
        [joint.lower for joint in arm],
        [joint.upper for joint in arm],
        [joint.speed for joint in arm],
        tool=tool,
        places=[frames[joint.child][:3, 3] for joint in arm],
        links=made,
    )


def _movable(joint: TreeJoint, name: str) -> TreeJoint:
    """The joint itself, once it is seen to have a coordinate of its own."""
    if joint.kind not in MOVING:
        raise cannot_move(name, joint.name, NOT_SINGLE.format(joint.kind))
    if joint.mimics:
        raise cannot_move(name, joint.name, f"mimics {joint.mimics!r} and has no coordinate of its own")
    return joint


def selected(name: str, tool: str, can: list[str], known: Sequence[str], chosen: Sequence[str] | None) -> list[str]:
    """Those joints that move the tool, `can`, and are chosen, base first; None chooses all. `name` is for messages."""
    if not can:
        raise RobotModelError(f"{name}: no joint moves the tool frame {tool!r}; choose a frame beyond the first joint")
    if chosen is None:
        return can
    for joint in chosen:
        if joint not in known:
            raise UnknownName("joint", joint, difflib.get_close_matches(joint, known), can)
        if joint not in can:
            raise BadInput("joints", f"{joint!r}, which does not move {tool!r}", f"some of {arrays.names(can)}")
    if not chosen:
        raise BadInput("joints", "none", f"some of {arrays.names(can)}")
    return [joint for joint in can if joint in chosen]


def path_to(above: dict[str, TreeJoint], link: str, name: str) -> list[TreeJoint]:
    """The joints from the root to a link, given the joint above each link."""
    path: list[TreeJoint] = []
    while link in above:
        path.append(above[link])
        link = above[link].parent
        if len(path) > len(above):
            raise RobotModelError(f"{name}: links stand on each other in a circle, {link!r} among them")
    return path[::-1]


def displacement(joint: TreeJoint, q: float) -> Array:
    """(4, 4) motion of a joint by q, in its own frame."""
    return se3.exp(q * joint.screw, check=False)


def rest(joint: TreeJoint) -> float:
    """Where a held joint stands: zero, or the limit nearest to it."""
    return min(max(0.0, joint.lower), joint.upper)


def _length(path: list[TreeJoint]) -> tuple[int, bool]:
    """How many joints of their own a path has, and whether all of its joints can be an arm's: of two as long it is."""
    able = all(not joint.mimics and joint.kind in (*MOVING, "fixed") for joint in path)
    return sum(joint.kind != "fixed" and not joint.mimics for joint in path), able


def _links(
    paths: dict[str, list[TreeJoint]],
    to_tool: list[TreeJoint],
    moving: list[str],
    parts: dict[str, tuple[Geometry, ...]],
) -> list[Link]:
    """All links of a tree, the arm's joints at zero.

    Those behind joints off the way to the tool are `unknown`: somebody else moves these. What hangs on the arm's last
    body, a gripper's fingers, is taken to be where its joints rest.
    """
    way = {joint.name for joint in to_tool}
    made = []
    for name, path in paths.items():
        T, body, unknown = np.eye(4), 0, ""
        for joint in path:
            T = T.dot(joint.origin)
            if joint.name in moving:
                body += 1
            elif joint.kind != "fixed":
                T = T.dot(displacement(joint, rest(joint))) if joint.kind in MOVING else T
                if joint.name not in way and body < len(moving):
                    unknown = unknown or joint.name
        made.append(Link(name, body, T, parts.get(name, ()), unknown))
    return made


def excluding(links: Sequence[Link], apart: Exclusions) -> tuple[Link, ...]:
    """Links that know of the pairs that may touch."""
    excludes: dict[str, list[tuple[str, str]]] = {}
    for (one, *other), reason in apart.items():
        excludes.setdefault(one, []).extend((name, reason) for name in other)
    return tuple(link._replace(excludes=tuple(excludes.get(link.name, ()))) for link in links)


def cannot_move(name: str, joint: str, why: str) -> RobotModelError:
    """The error for a joint of a robot that an arm cannot be made of."""
    return RobotModelError(
        f"{name}: joint {joint!r} {why}. Leave it out of `joints` to hold it still, or name another tool."
    )
