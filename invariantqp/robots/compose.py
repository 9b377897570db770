"""Chains from chains: an arm on a rail, a mobile base or another arm, and one arm's tool relative to another's.

With T = exp(s_1 q_1) ... exp(s_m q_m) T_0:

    a stands on b     screws  (b_1, ..., b_n, Ad(B_0) a_1, ..., Ad(B_0) a_m)                         T_0 = B_0 A_0
    a relative to b   screws  (-Ad(B_0^-1) b_n, ..., -Ad(B_0^-1) b_1, Ad(B_0^-1) a_1, ...)      T_0 = B_0^-1 A_0

since B^-1 A = B_0^-1 exp(-b_n p_n) ... exp(-b_1 p_1) exp(a_1 q_1) ... A_0.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Any

import numpy as np
from attrs import evolve
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.screws import prismatic, revolute
from invariantqp.robots.chain import LIMITS, Chain, CoupledJoints, Link

A_CHAIN = "a Chain, such as load_robot returns"
# Attributes of a chain with one entry for each joint, besides screws and names.
PER_JOINT = (*LIMITS, "places")


def rail(axis: ArrayLike, lower: float = -inf, upper: float = inf, speed: float = inf, *, name: str = "rail") -> Chain:
    """A slide along an axis (3,) that carries an arm, with position limits [length] and a velocity limit [length/s]."""
    arrays.instance(name, str, "name", "text")
    screw = prismatic(arrays.direction(axis, "axis"))
    low, high = arrays.number(lower, "lower", infinite=True), arrays.number(upper, "upper", infinite=True)
    if low > high:
        raise BadInput("lower", f"{low:g}, above the upper limit {high:g}", "lower <= upper")
    most = arrays.number(speed, "speed", positive=True, infinite=True)
    return Chain(screw[:, None], np.eye(4), [name], low, high, most, tool=f"{name}_carriage")


def mobile_base(speed: float = inf, turn_speed: float = inf, *, name: str = "base") -> Chain:
    """An omnidirectional base: joints NAME_x, NAME_y [length] and NAME_turn [rad], about z.

    `speed` is the velocity limit along x, and along y [length/s], `turn_speed` that of the turn [rad/s].
    """
    arrays.instance(name, str, "name", "text")
    x, y, z = np.eye(3)
    screws = np.column_stack((prismatic(x), prismatic(y), revolute(z)))
    slide = arrays.number(speed, "speed", positive=True, infinite=True)
    limits = [slide, slide, arrays.number(turn_speed, "turn_speed", positive=True, infinite=True)]
    names = [f"{name}_{part}" for part in ("x", "y", "turn")]
    return Chain(screws, np.eye(4), names, velocity_limit=limits, tool=name)


def stand_on(base: Chain | ArrayLike, arm: Chain) -> Chain:
    """An arm whose base frame is the tool frame of another chain, or at a (4, 4) pose in a new base frame.

    The base's joints come first; the tool is the arm's. No two joints may have one name.
    """
    arrays.instance(arm, Chain, "arm", A_CHAIN)
    if isinstance(base, Chain):
        below, first = base.home, [base]
    else:
        below, first = arrays.pose(base, "base"), []
    return _chain([*first, _with_base_at(arm, below)], below.dot(arm.home), arm.tool)


def relative(arm: Chain, other: Chain) -> Chain:
    """The chain from the tool of one arm to the tool of another with the same base frame.

    Its pose is that of `arm`'s tool in the frame of `other`'s tool; its joint twists, in that frame, are

        J = (-Ad(B^-1) J_other, Ad(B^-1) J_arm),    B the pose of the other's tool, with the other's columns reversed,

    so that J x is the relative twist, q = (q_other[::-1], q_arm). Place the arms by `stand_on` or `load_robot(base=)`
    first. Names of the other's joints that both arms have get the prefix "other/", as often as needed.
    """
    arrays.instance(arm, Chain, "arm", A_CHAIN)
    arrays.instance(other, Chain, "other", A_CHAIN)
    back = se3.inverse(other.home, check=False)
    names = list(_unique_names(arm.names, other.names, "other/").values())
    moved = _with_base_at(other, back)
    n, k = len(names), len(moved.joints.coordinates)
    links = tuple(link._replace(body=k - link.body) for link in _renamed(moved.links, arm.links, "other/"))
    coupled = moved.coupled and CoupledJoints(
        -moved.coupled.screws[:, ::-1],
        tuple(n - 1 - i for i in moved.coupled.coordinates[::-1]),
        tuple(k - 1 - i for i in moved.coupled.drivers[::-1]),
    )
    limits = {name: getattr(moved, name)[::-1] for name in PER_JOINT}
    screws = -moved.screws[:, ::-1]
    reverse = evolve(moved, screws=screws, home=np.eye(4), names=names[::-1], links=links, coupled=coupled, **limits)
    return _chain([reverse, _with_base_at(arm, back)], back.dot(arm.home), arm.tool)


def _with_base_at(arm: Chain, place: Array) -> Chain:
    """The same joints with their base frame at a (4, 4) pose in a new one."""
    A = se3.adjoint(place, check=False)
    return evolve(
        arm,
        screws=A.dot(arm.screws),
        home=place.dot(arm.home),
        places=arm.places.dot(place[:3, :3].T) + place[:3, 3],
        links=tuple(link._replace(frame=place.dot(link.frame)) for link in arm.links),
        coupled=arm.coupled and arm.coupled._replace(screws=A.dot(arm.coupled.screws)),
    )


def _chain(parts: Sequence[Chain], home: Array, tool: str) -> Chain:
    """The joints of all parts in series; their screws are in one base frame."""
    names = [name for part in parts for name in part.names]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise BadInput("base", f"a joint {twice!r} that the arm has too", "joints with names of their own")
    joined: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in PER_JOINT}
    links: tuple[Link, ...] = ()
    first = 0
    for part in parts:
        links += tuple(link._replace(body=link.body + first) for link in _renamed(part.links, links, "arm/"))
        first += len(part.joints.coordinates)
    notes = tuple(note for part in parts for note in part.notes)
    more: dict[str, Any] = {"links": links, "coupled": _coupled(parts), "notes": notes}
    return Chain(np.hstack([part.screws for part in parts]), home, names, tool=tool, **more, **joined)


def _coupled(parts: Sequence[Chain]) -> CoupledJoints | None:
    """All joints of the parts, where there are mimic joints; else None."""
    if all(part.coupled is None for part in parts):
        return None
    coordinates: list[int] = []
    drivers: list[int] = []
    for part in parts:
        m, k = len(drivers), len(coordinates)
        coordinates += [m + i for i in part.joints.coordinates]
        drivers += [k + i for i in part.joints.drivers]
    return CoupledJoints(np.hstack([part.joints.screws for part in parts]), tuple(coordinates), tuple(drivers))


def _renamed(links: tuple[Link, ...], taken: tuple[Link, ...], prefix: str) -> tuple[Link, ...]:
    """Links, and their exclusions, under names that no link of `taken` has."""
    new = _unique_names([link.name for link in taken], [link.name for link in links], prefix)
    return tuple(
        link._replace(name=new[link.name], excludes=tuple((new.get(name, name), why) for name, why in link.excludes))
        for link in links
    )


def _unique_names(taken: Sequence[str], names: Sequence[str], prefix: str) -> dict[str, str]:
    """A name for each of `names` that is not taken: with a prefix, as often as needed."""
    new: dict[str, str] = {}
    for name in names:
        free = name
        while free in taken or free in new.values():
            free = prefix + free
        new[name] = free
    return new
