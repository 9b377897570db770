"""The chain of joints from the root of a tree of links to a tool link, as a `Chain`.

    T(0) = T_1 ... T_k,    S_i = Ad(T_1 ... T_i) (a_i; 0) or (0; a_i),    T_i the frame of joint i in that of its parent

Held joints are fixed at zero, or at the limit nearest to zero.
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
from invariantqp.robots.chain import Chain, CoupledJoints, Geometry, Link

# The fewest joints of an arm before its hand, and words in the names of a hand's joints and links.
MIN_ARM_JOINTS = 3
HAND_WORDS = ("finger", "thumb", "knuckle", "jaw", "gripper", "claw")
# Types of joints with one coordinate, and all types of a URDF.
SINGLE_AXIS_TYPES = ("revolute", "continuous", "prismatic")
JOINT_TYPES = (*SINGLE_AXIS_TYPES, "fixed", "floating", "planar")
# Why a joint of a type cannot move in an arm.
NOT_SINGLE = "({}) has no single coordinate; only revolute and prismatic joints are modelled"
# Pairs of links excluded from collision, by an SRDF or an MJCF, with the reason.
Exclusions = dict[frozenset[str], str]


class Mimic(NamedTuple):
    """Position of a mimic joint: ratio times the position of its driver, plus offset."""

    driver: str
    ratio: float
    offset: float


class TreeJoint(NamedTuple):
    """A joint of a tree of links."""

    name: str  # of the joint
    kind: str  # one of `JOINT_TYPES`
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


# Origin and axis of a joint whose pose is not needed.
UNPLACED = np.eye(4), np.array((0.0, 0.0, 1.0))


def chain_to_link(
    joints: Sequence[TreeJoint],
    name: str,
    tool: str | None,
    chosen: Sequence[str] | None,
    parts: dict[str, tuple[Geometry, ...]] | None = None,
    exclusions: Exclusions | None = None,
) -> Chain:
    """The arm from the root of a tree of joints to a link, or to the link of a joint of that name.

    `name` is the robot's in messages, `chosen` the joints that move (None: all), `parts` the links' collision geometry,
    `exclusions` the pairs of links excluded from collision.
    """
    joints = [resolved_mimic(joint, joints) for joint in joints]
    above = {joint.child: joint for joint in joints}
    if len(above) < len(joints):
        raise RobotModelError(f"{name}: a link is moved by two joints; expected a tree of links")
    links = list(dict.fromkeys(link for joint in joints for link in (joint.parent, joint.child)))
    paths = {link: path_to(above, link, name) for link in links}
    tools = default_tools(paths) if tool is None else [tool]
    tool = tools[0]
    if tool not in links:
        tool = next((joint.child for joint in joints if joint.name == tool), tool)
    if tool not in links:
        raise UnknownName("frame", tool, difflib.get_close_matches(tool, links), links)
    path = paths[tool]
    movable = [joint.name for joint in path if joint.kind != "fixed" and not joint.mimics]
    free = {joint.name for joint in joints if joint.kind in SINGLE_AXIS_TYPES and not joint.mimics}
    if orphan := next((joint for joint in path if joint.mimics and joint.mimics.driver not in free), None):
        why = f"mimics {orphan.mimics and orphan.mimics.driver!r}, which is no joint that moves by itself"
        raise RobotModelError(f"{name}: joint {orphan.name!r} {why}")
    moving, at = selected_joints(name, tool, movable, joints, chosen), rest_positions(joints)
    for joint in path:
        if joint.name in moving and joint.kind not in SINGLE_AXIS_TYPES:
            raise not_movable(
                name, joint.name, NOT_SINGLE.format(joint.kind), [one for one in movable if one != joint.name]
            )
    driven = [joint for joint in path if driver_of(joint) in moving]
    made = with_exclusions(_links(paths, path, moving, at, parts or {}), exclusions or {})
    frames = {link.name: link.frame for link in made}
    screws = [ratio_of(joint) * se3.adjoint(frames[joint.child], check=False).dot(joint.screw) for joint in driven]
    coupled = coupled_joints(np.column_stack(screws), [(joint.name, driver_of(joint)) for joint in driven], moving)
    arm = [joint for joint in driven if not joint.mimics]
    lower, upper, speed = zip(*(limits_with_mimics(joint, driven, name) for joint in arm), strict=True)
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
        notes=(*other_tools(tools, paths), *joint_notes(joints, paths, path, moving, at)),
    )


def resolved_mimic(joint: TreeJoint, joints: Sequence[TreeJoint]) -> TreeJoint:
    """The joint with its driver replaced by that driver's own, where the driver is a mimic joint too."""
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
    """The motion of a joint for a unit of its driver."""
    return joint.mimics.ratio if joint.mimics else 1.0


def coupled_joints(
    screws: Array, driven: Sequence[tuple[Hashable, Hashable]], moving: Sequence[Hashable]
) -> CoupledJoints:
    """The k joints `driven`, each (joint, driver), with screws (6, k) for a unit of the driver."""
    joints = [joint for joint, _ in driven]
    return CoupledJoints(screws, tuple(moving.index(driver) for _, driver in driven), tuple(map(joints.index, moving)))


def limits_with_mimics(joint: TreeJoint, driven: Sequence[TreeJoint], name: str) -> tuple[float, float, float]:
    """Lower, upper and velocity limit of a joint that also keep its mimic joints inside their limits.

    Raises:
        RobotModelError: a driver without position limits, or limits that leave no position.
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


def default_tools(paths: dict[str, list[TreeJoint]]) -> list[str]:
    """The link at the end of the longest chain, or the last link before its hand; then those of equal rank.

    A hand begins where the chain branches, after at least three joints and with no more joints beyond than before; the
    last joints also belong to a hand if they or their links are called finger, jaw, ...
    """
    moved = [link for link in paths if paths[link]] or list(paths)[:1]
    most = max(_length(paths[link]) for link in moved)
    return list(dict.fromkeys(_before_hand(paths, link) for link in moved if _length(paths[link]) == most))


def _before_hand(paths: dict[str, list[TreeJoint]], link: str) -> str:
    """A link itself, or the last one before the hand that it belongs to."""
    path = paths[link]
    own = [i for i, joint in enumerate(path) if joint.kind != "fixed" and not joint.mimics]
    arm = len(own)
    for before in range(MIN_ARM_JOINTS, len(own)):
        if len(own) - before <= before and _divides(paths, path[own[before]].parent):
            arm = before
            break
    while arm > MIN_ARM_JOINTS and _of_hand(path[own[arm - 1]]):
        arm -= 1
    return link if arm == len(own) else path[own[arm]].parent


def _divides(paths: dict[str, list[TreeJoint]], link: str) -> bool:
    """Whether several joints stand on a link, or on links that are fixed to it."""
    at = len(paths[link])
    first = {
        next((joint.name for joint in path[at:] if joint.kind != "fixed"), "")
        for path in paths.values()
        if path[:at] == paths[link] and len(path) > at
    }
    return len(first - {""}) > 1


def _of_hand(joint: TreeJoint) -> bool:
    """Whether the names of a joint and its link are those of a hand."""
    link = joint.child.lower().replace("gripper", "")  # a link of this name is a palm
    return any(word in called for called in (joint.name.lower(), link) for word in HAND_WORDS)


def other_tools(tools: Sequence[str], paths: dict[str, list[TreeJoint]]) -> tuple[str, ...]:
    """A note that names other links that may be meant as the tool, at the end of chains of the same length."""
    if len(tools) == 1:
        return ()
    ends = {tuple(joint.name for joint in paths[tool] if joint.kind != "fixed"): tool for tool in reversed(tools)}
    others = arrays.names([tool for tool in ends.values() if tool != tools[0]][::-1], 3)
    return (f"the tool is {tools[0]}; chains as long end at {others}: tool= names another",) if others else ()


def joint_notes(
    joints: Sequence[TreeJoint],
    paths: dict[str, list[TreeJoint]],
    path: Sequence[TreeJoint],
    moving: Sequence[str],
    at: dict[str, float],
) -> tuple[str, ...]:
    """Notes on joints that mimic others, are held at `at` or are left out; `path` leads to the tool."""
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


def selected_joints(
    name: str, tool: str, movable: list[str], joints: Sequence[TreeJoint] | Sequence[str], chosen: Sequence[str] | None
) -> list[str]:
    """The chosen joints among `movable`, those that move the tool, base first; None chooses all."""
    if not movable:
        raise RobotModelError(f"{name}: no joint moves the tool frame {tool!r}; choose a frame beyond the first joint")
    if chosen is None:
        return movable
    drivers = {one.name: driver_of(one) for one in joints if isinstance(one, TreeJoint)}
    known = [*drivers] or [str(one) for one in joints]
    for joint in chosen:
        if joint not in known:
            raise UnknownName("joint", joint, difflib.get_close_matches(joint, known), movable)
        if (driver := drivers.get(joint, joint)) != joint:
            some = f"some of {arrays.names(movable)}"
            raise BadInput("joints", f"{joint!r}, which mimics {driver!r}", some, f"Name {driver!r}.")
        if joint not in movable:
            raise BadInput("joints", f"{joint!r}, which does not move {tool!r}", f"some of {arrays.names(movable)}")
    if not chosen:
        raise BadInput("joints", "none", f"some of {arrays.names(movable)}")
    return [joint for joint in movable if joint in chosen]


def path_to(above: dict[str, TreeJoint], link: str, name: str) -> list[TreeJoint]:
    """The joints from the root to a link, given the parent joint of each link."""
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


def rest_position(joint: TreeJoint) -> float:
    """The position of a held joint: zero, or the limit nearest to zero."""
    return min(max(0.0, joint.lower), joint.upper)


def rest_positions(joints: Sequence[TreeJoint]) -> dict[str, float]:
    """Positions of held joints; mimic joints follow their driver, which counts as zero where there is none."""
    at = {
        joint.name: rest_position(joint) for joint in joints if joint.kind in SINGLE_AXIS_TYPES and joint.mimics is None
    }
    for joint in joints:
        if joint.kind in SINGLE_AXIS_TYPES and joint.mimics is not None:
            at[joint.name] = joint.mimics.ratio * at.get(joint.mimics.driver, 0.0) + joint.mimics.offset
    return at


def _length(path: list[TreeJoint]) -> tuple[int, bool]:
    """The rank of a path: how many joints move by themselves, and whether all can be those of an arm."""
    able = all(joint.kind in (*SINGLE_AXIS_TYPES, "fixed") for joint in path)
    return sum(joint.kind != "fixed" and not joint.mimics for joint in path), able


def _links(
    paths: dict[str, list[TreeJoint]],
    to_tool: list[TreeJoint],
    moving: list[str],
    at: dict[str, float],
    parts: dict[str, tuple[Geometry, ...]],
) -> list[Link]:
    """All links of a tree with the arm's joints at zero.

    Links behind joints that are not on the path to the tool are `unknown`, except those on the arm's last body, such as
    a gripper's fingers, whose joints are taken at rest.
    """
    on_path = {joint.name for joint in to_tool}
    bodies = sum(driver_of(joint) in moving for joint in to_tool)
    made = []
    for name, path in paths.items():
        T, body, unknown = np.eye(4), 0, ""
        for joint in path:
            T = T.dot(joint.origin)
            with_arm = driver_of(joint) in moving
            if joint.kind in SINGLE_AXIS_TYPES and joint.name not in moving:
                T = T.dot(
                    displacement(joint, joint.mimics.offset if with_arm and joint.mimics else at.get(joint.name, 0.0))
                )
            if with_arm and joint.name in on_path:
                body += 1
            elif joint.kind != "fixed" and joint.name not in on_path and (with_arm or body < bodies):
                unknown = unknown or joint.name
        made.append(Link(name, body, T, parts.get(name, ()), unknown))
    return made


def with_exclusions(links: Sequence[Link], exclusions: Exclusions) -> tuple[Link, ...]:
    """The links with their exclusions set."""
    excludes: dict[str, list[tuple[str, str]]] = {}
    for (one, *other), reason in exclusions.items():
        excludes.setdefault(one, []).extend((name, reason) for name in other)
    return tuple(link._replace(excludes=tuple(excludes.get(link.name, ()))) for link in links)


def not_movable(name: str, joint: str, why: str, others: Sequence[str] = ()) -> RobotModelError:
    """The error for a joint that cannot move in an arm; `others` are joints that can."""
    held = (
        f"To hold it still name the others: joints={[*others]}"
        if others
        else "Leave it out of `joints` to hold it still"
    )
    return RobotModelError(f"{name}: joint {joint!r} {why}. {held}, or name another tool.")
