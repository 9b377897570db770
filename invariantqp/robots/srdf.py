"""Pairs of links that may touch, by what describes a robot: an SRDF lists them, an MJCF excludes them.

<disable_collisions link1="hand" link2="finger" reason="Adjacent"/>
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from invariantqp.errors import RobotModelError
from invariantqp.robots.chain import Chain
from invariantqp.robots.links import Link
from invariantqp.robots.urdf import read_xml

Exclusions = dict[frozenset[str], str]


def excluded(robot: Chain, file: str | PathLike[str] | None = None) -> Exclusions:
    """Pairs of links that a robot's own description excludes, and those of an SRDF file; each with its reason.

    Raises:
        RobotModelError: a file that cannot be read, or no SRDF.
    """
    found: Exclusions = {}
    for link in robot.links:
        found.update({frozenset((link.name, other)): reason for other, reason in link.excludes})
    return found if file is None else {**found, **disabled(Path(file))}


def excluding(links: tuple[Link, ...], pairs: Exclusions) -> tuple[Link, ...]:
    """Links that know of the pairs that may touch."""
    made = []
    for link in links:
        others = tuple((*(pair - {link.name}), reason) for pair, reason in pairs.items() if link.name in pair)
        made.append(link._replace(excludes=link.excludes + tuple(other for other in others if len(other) == 2)))
    return tuple(made)


def disabled(file: Path) -> Exclusions:
    """The pairs of an SRDF.

    Raises:
        RobotModelError: a file that cannot be read, or no SRDF.
    """
    name, root = read_xml(file)
    if root.tag != "robot":
        raise RobotModelError(f"{name}: found <{root.tag}>; expected the <robot> of an SRDF")
    return {
        frozenset((pair.get("link1", ""), pair.get("link2", ""))): ": ".join(
            filter(None, ("by the SRDF", pair.get("reason")))
        )
        for pair in root.findall("disable_collisions")
    }
