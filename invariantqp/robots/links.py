"""The links of an arm: which joints move each, its frame, and what it is made of as far as collisions go.

A chain needs none of it to move its tool. Geometry is read with a description and made into shapes when somebody asks
what must not touch (`bodies.py`); meshes are not opened before that.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from invariantqp.geometry.arrays import Array


class Geometry(NamedTuple):
    """A part of a link."""

    kind: str  # "sphere", "capsule", "cylinder", "box", "plane", "mesh", or "unreadable"
    size: tuple[float, ...]  # radius; radius and length of the straight part, along z; whole edges; a mesh's scale
    pose: Array  # (4, 4) in the link's frame
    mesh: Any = None  # path of its file, or (n, 3) points of which it is the hull; of the unreadable, why


class Link(NamedTuple):
    """A link of an arm."""

    name: str
    body: int  # it is moved by the first so many joints; 0 is the base
    frame: Array  # (4, 4) at q = 0, in the base frame
    parts: tuple[Geometry, ...] = ()
    unknown: str = ""  # the joint that it is behind and that is not one of the arm's: where it is, is not known
    excludes: tuple[tuple[str, str], ...] = ()  # links that its description lets it touch, and why

    def carried(self, place: Array) -> Link:
        """The same link of an arm whose base is at a (4, 4) place."""
        return self._replace(frame=place.dot(self.frame))


def renamed(links: tuple[Link, ...], taken: tuple[Link, ...], prefix: str) -> tuple[Link, ...]:
    """Links under names that others have not: with a prefix where they have."""
    names = {link.name for link in taken}
    made = []
    for link in links:
        name = link.name
        while name in names:
            name = prefix + name
        made.append(link._replace(name=name))
    return tuple(made)
