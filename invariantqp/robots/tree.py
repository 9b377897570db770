"""An arm cut out of a tree of links: the chain of joints from its root to a tool link.

    T(0) = T_1 ... T_k,    S_i = Ad(T_1 ... T_i) (a_i; 0) or (0; a_i),    T_i the frame of joint i in that of its parent

Joints that are held contribute a fixed motion: they stand at zero, or at the limit nearest to it.
"""

from __future__ import annotations

import difflib
from collections.abc import Hashable, Sequence
from math import inf
from typing import NamedTuple

import numpy as np

from invariantqp.errors import BadInput, RobotModelError, UnknownName
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain, Coupled, Geometry, Link

# Joints of an arm before its hand, at least. What joints and links of hands are called.
FEWEST = 3
HAND = ("finger", "thumb", "knuckle", "jaw", "gripper", "claw")
# Types of joints with one coordinate, without one, and with several.
MOVING = ("revolute", "continuous", "prismatic")
TYPES = (*MOVING, "fixed", "floating", "planar")
# Why a joint cannot be one of an arm, by its type.
NOT_SINGLE = "({}) has no single coordinate; only revolute and prismatic joints are modelled"
# Pairs of links that may touch, each with its reason: an SRDF lists them, an MJCF excludes them.
Exclusions = dict[frozenset[str], str]


class Mimic(NamedTuple):
    """How a joint follows another: position = ratio times that of the driver + offset."""

    driver: str
    ratio: float
    offset: float


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
    mimics: Mimic | None = None  # the joint that it follows

    @property
    def screw(self) -> Array:
        """(6,) its unit twist, in its frame."""
        still = np.zeros(3)
        return np.concatenate((still, self.axis) if self.kind == "prismatic" else (self.axis, still))


# Origin and axis of a joint whose place does not matter.
NOWHERE = np.eye(4), np.array((0.0, 0.0, 1.0))


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
    joints = [followed(joint, joints) for joint in joints]
    above = {joint.child: joint for joint in joints}
    if len(above) < len(joints):
        raise RobotModelError(f"{name}: a link is moved by two joints; expected a tree of links")
    links = list(dict.fromkeys(link for joint in joints for link in (joint.parent, joint.child)))
    paths = {link: path_to(above, link, name) for link in links}
    tools = usual_tools(paths) if tool is None else [tool]
    tool = tools[0]
    if tool not in links:
        tool = next((joint.child for joint in joints if joint.name == tool), tool)
    if tool not in links:
        raise UnknownName("frame", tool, difflib.get_close_matches(tool, links), links)
    path = paths[tool]
    can = [joint.name for joint in path if joint.kind != "fixed" and not joint.mimics]
    free = {joint.name for joint in joints if joint.kind in MOVING and not joint.mimics}
    if lost := next((joint for joint in path if joint.mimics and joint.mimics.driver not in free), None):
        why = f"mimics {lost.mimics and lost.mimics.driver!r}, which is no joint that moves by itself"
        raise RobotModelError(f"{name}: joint {lost.name!r} {why}")
    moving, at = selected(name, tool, can, joints, chosen), resting(joints)
    for joint in path:
        if joint.name in moving and joint.kind not in MOVING:
            raise cannot_move(
                name, joint.name, NOT_SINGLE.format(joint.kind), [one for one in can if one != joint.name]
            )
    driven = [joint for joint in path if driver_of(joint) in moving]
    made = excluding(_links(paths, path, moving, at, parts or {}), apart or {})
    frames = {link.name: link.frame for link in made}
    screws = [ratio_of(joint) * se3.adjoint(frames[joint.child], check=False).dot(joint.screw) for joint in driven]
    coupled = coupled_joints(np.column_stack(screws), [(joint.name, driver_of(joint)) for joint in driven], moving)
    arm = [joint for joint in driven if not joint.mimics]
    lower, upper, speed = zip(*(shared_limits(joint, driven, name) for joint in arm), strict=True)
    return Chain(
        coupled.columns(),
        frames[tool],
        moving,
        lower,
        upper,
        speed,
        tool=tool,
        places=[frames[joint.child][:3, 3] for joint in arm],
        links=made,
        coupled=coupled if len(driven) > len(moving) else None,
        notes=(*also(tools, paths), *notes_of(joints, paths, path, moving, at)),
    )


def followed(joint: TreeJoint, joints: Sequence[TreeJoint]) -> TreeJoint:
    """The joint, with the driver of its driver as its driver where that mimics another."""
    known, mimic, passed = {one.name: one for one in joints}, joint.mimics, {joint.name}
    while mimic is not None and mimic.driver in known and mimic.driver not in passed:
        passed.add(mimic.driver)
        of = known[mimic.driver].mimics
        if of is None:
            break
        mimic = Mimic(of.driver, mimic.ratio * of.ratio, mimic.ratio * of.offset + mimic.offset)
    return joint._replace(mimics=mimic)


def driver_of(joint: TreeJoint) -> str:
    """The joint whose coordinate moves a joint: itself, or the one that it mimics."""
    return joint.mimics.driver if joint.mimics else joint.name


def ratio_of(joint: TreeJoint) -> float:
    """By how much a joint moves for a unit of what drives it."""
    return joint.mimics.ratio if joint.mimics else 1.0


def coupled_joints(screws: Array, driven: Sequence[tuple[Hashable, Hashable]], moving: Sequence[Hashable]) -> Coupled:
    """The k joints that `moving` ones drive, each with its driver, from screws (6, k) for a unit of the driver."""
    joints = [joint for joint, _ in driven]
    return Coupled(screws, tuple(moving.index(driver) for _, driver in driven), tuple(map(joints.index, moving)))


def shared_limits(joint: TreeJoint, driven: Sequence[TreeJoint], name: str) -> tuple[float, float, float]:
    """Position limits and the velocity limit of a joint, inside which those that mimic it are inside theirs.

    Raises:
        RobotModelError: there are none, or the joint is continuous and its turns are not those of what it drives.
    """
    lower, upper, speed = joint.lower, joint.upper, joint.speed
    for other in driven:
        if other.mimics is None or other.mimics.driver != joint.name or other.mimics.ratio == 0.0:
            continue
        if lower == -inf and upper == inf:
            raise RobotModelError(
                f"{name}: joint {joint.name!r} has no position limits, and {other.name!r} mimics it; give it limits"
            )
        ends = sorted((end - other.mimics.offset) / other.mimics.ratio for end in (other.lower, other.upper))
        lower, upper = max(lower, ends[0]), min(upper, ends[1])
        speed = min(speed, other.speed / abs(other.mimics.ratio))
    if lower > upper:
        raise RobotModelError(
            f"{name}: the limits of joint {joint.name!r} and of those that mimic it leave no position"
        )
    return lower, upper, speed


def usual_tools(paths: dict[str, list[TreeJoint]]) -> list[str]:
    """The link that the last joint of the longest chain moves, or the last one before a hand; then those as far away.

    A hand begins where the chain divides into several with joints, after three joints or more and not before more than
    that; and joints at the end are a hand's where they or their links are called fingers, for instance.
    """
    moved = [link for link in paths if paths[link]] or list(paths)[:1]
    most = max(_length(paths[link]) for link in moved)
    return list(dict.fromkeys(_before_hand(paths, link) for link in moved if _length(paths[link]) == most))


def _before_hand(paths: dict[str, list[TreeJoint]], link: str) -> str:
    """A link itself, or the last one before the hand that it belongs to."""
    path = paths[link]
    own = [i for i, joint in enumerate(path) if joint.kind != "fixed" and not joint.mimics]
    arm = len(own)
    for before in range(FEWEST, len(own)):
        if len(own) - before <= before and _divides(paths, path[own[before]].parent):
            arm = before
            break
    while arm > FEWEST and _of_hand(path[own[arm - 1]]):
        arm -= 1
    return link if arm == len(own) else path[own[arm]].parent


def _divides(paths: dict[str, list[TreeJoint]], link: str) -> bool:
    """Whether several joints move what stands on a link, by itself or on links that are fixed to it."""
    at = len(paths[link])
    first = {
        next((joint.name for joint in path[at:] if joint.kind != "fixed"), "")
        for path in paths.values()
        if path[:at] == paths[link] and len(path) > at
    }
    return len(first - {""}) > 1


def _of_hand(joint: TreeJoint) -> bool:
    link = joint.child.lower().replace("gripper", "")  # a link called so is a palm
    return any(word in called for called in (joint.name.lower(), link) for word in HAND)


def also(tools: Sequence[str], paths: dict[str, list[TreeJoint]]) -> tuple[str, ...]:
    """Which other links may be meant as the tool, in words: those at the end of chains as long."""
    if len(tools) == 1:
        return ()
    ends = {tuple(joint.name for joint in paths[tool] if joint.kind != "fixed"): tool for tool in reversed(tools)}
    others = arrays.names([tool for tool in ends.values() if tool != tools[0]][::-1], 3)
    return (f"the tool is {tools[0]}; chains as long end at {others}: tool= names another",) if others else ()


def notes_of(
    joints: Sequence[TreeJoint],
    paths: dict[str, list[TreeJoint]],
    path: Sequence[TreeJoint],
    moving: Sequence[str],
    at: dict[str, float],
) -> tuple[str, ...]:
    """Which joints were held still, coupled or left out, in words; `path` is that of `paths` to the tool."""
    made = []
    for joint in joints:
        if joint.kind == "fixed" or joint.name in moving:
            continue
        if joint in path and driver_of(joint) in moving and joint.mimics:
            made.append(
                f"joint {joint.name} mimics {joint.mimics.driver}: {joint.mimics.ratio:g} times its motion is added"
            )
        elif joint in path:
            made.append(f"joint {joint.name} is held at {at.get(joint.name, 0.0):g}")
        elif path and path[-1] in paths[joint.parent]:
            made.append(f"joint {joint.name} is left out: it moves what hangs on the tool")
    return tuple(made)


def selected(
    name: str, tool: str, can: list[str], joints: Sequence[TreeJoint] | Sequence[str], chosen: Sequence[str] | None
) -> list[str]:
    """Those joints that move the tool, `can`, and are chosen, base first; None chooses all. `name` is for messages."""
    if not can:
        raise RobotModelError(f"{name}: no joint moves the tool frame {tool!r}; choose a frame beyond the first joint")
    if chosen is None:
        return can
    drivers = {one.name: driver_of(one) for one in joints if isinstance(one, TreeJoint)}
    known = [*drivers] or [str(one) for one in joints]
    for joint in chosen:
        if joint not in known:
            raise UnknownName("joint", joint, difflib.get_close_matches(joint, known), can)
        if (driver := drivers.get(joint, joint)) != joint:
            some = f"some of {arrays.names(can)}"
            raise BadInput("joints", f"{joint!r}, which mimics {driver!r}", some, f"Name {driver!r}.")
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


def resting(joints: Sequence[TreeJoint]) -> dict[str, float]:
    """Where held joints stand; those that mimic others where these put them, at zero where there is no such joint."""
    at = {joint.name: rest(joint) for joint in joints if joint.kind in MOVING and joint.mimics is None}
    for joint in joints:
        if joint.kind in MOVING and joint.mimics is not None:
            at[joint.name] = joint.mimics.ratio * at.get(joint.mimics.driver, 0.0) + joint.mimics.offset
    return at


def _length(path: list[TreeJoint]) -> tuple[int, bool]:
    """How many joints of their own a path has, and whether all of its joints can be an arm's: of two as long it is."""
    able = all(joint.kind in (*MOVING, "fixed") for joint in path)
    return sum(joint.kind != "fixed" and not joint.mimics for joint in path), able


def _links(
    paths: dict[str, list[TreeJoint]],
    to_tool: list[TreeJoint],
    moving: list[str],
    at: dict[str, float],
    parts: dict[str, tuple[Geometry, ...]],
) -> list[Link]:
    """All links of a tree, the arm's joints at zero.

    Those behind joints off the way to the tool are `unknown`: somebody else moves these. What hangs on the arm's last
    body, a gripper's fingers, is taken to be where its joints rest.
    """
    way = {joint.name for joint in to_tool}
    bodies = sum(driver_of(joint) in moving for joint in to_tool)
    made = []
    for name, path in paths.items():
        T, body, unknown = np.eye(4), 0, ""
        for joint in path:
            T = T.dot(joint.origin)
            with_arm = driver_of(joint) in moving
            if joint.kind in MOVING and joint.name not in moving:
                T = T.dot(
                    displacement(joint, joint.mimics.offset if with_arm and joint.mimics else at.get(joint.name, 0.0))
                )
            if with_arm and joint.name in way:
                body += 1
            elif joint.kind != "fixed" and joint.name not in way and (with_arm or body < bodies):
                unknown = unknown or joint.name
        made.append(Link(name, body, T, parts.get(name, ()), unknown))
    return made


def excluding(links: Sequence[Link], apart: Exclusions) -> tuple[Link, ...]:
    """Links that know of the pairs that may touch."""
    excludes: dict[str, list[tuple[str, str]]] = {}
    for (one, *other), reason in apart.items():
        excludes.setdefault(one, []).extend((name, reason) for name in other)
    return tuple(link._replace(excludes=tuple(excludes.get(link.name, ()))) for link in links)


def cannot_move(name: str, joint: str, why: str, others: Sequence[str] = ()) -> RobotModelError:
    """The error for a joint of a robot that an arm cannot be made of; `others` can be moved without it."""
    held = (
        f"To hold it still name the others: joints={[*others]}"
        if others
        else "Leave it out of `joints` to hold it still"
    )
    return RobotModelError(f"{name}: joint {joint!r} {why}. {held}, or name another tool.")
