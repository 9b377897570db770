"""Two contacts of one tool at once: a pen along the foot of a wall, a peg on the bottom of its hole.

    S = S1 meet S2,    W = (W1 W2)

The tool moves as both allow and presses on both. Reference: [DS] Sect. 6.3; Mason 1981.
"""

from __future__ import annotations

import numpy as np

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.systems.contact_kinds import ContactKind
from invariantqp.systems.contacts import Contact
from invariantqp.systems.span import span
from invariantqp.systems.subspaces import annihilator

# Ways out of unit speed whose sum is slower than this lead nowhere: the tool is between two walls.
NOWHERE = 1e-6


def two_contacts(first: Contact, second: Contact) -> Contact:
    """Two contacts of one tool as one, in the frame of the first.

    Contact is lost when either is, and the nearer of their edges counts. In a loop make it once and put it where the
    tool is with `moved`, or, because that keeps the edge, with `Contact(both.kind, pose, edge)` where there is one.

    Args:
        first: the contact whose place counts for moments and speeds.
        second: the other, in the same base frame.

    Returns:
        Contact: its first constraints are the presses, the first's before the second's; then the other ones.

    Raises:
        BadInput: not contacts, or contacts of which one presses where the other does already.
    """
    for name, contact in (("first", first), ("second", second)):
        if not isinstance(contact, Contact):
            raise BadInput(name, excerpt(contact), "a Contact")
    kind = first.kind
    other = second.kind.relabelled(se3.inverse(second.pose, check=False).dot(first.pose))
    n, k = kind.presses, other.presses
    U, V = np.asarray(kind.constraints), np.asarray(other.constraints)
    W = np.hstack((U[:, :n], V[:, :k], U[:, n:], V[:, k:]))
    if span(W).rank < W.shape[1]:
        found = f"a {kind.name} and a {other.name} with {W.shape[1]} wrenches of rank {span(W).rank}"
        raise BadInput("second", found, "a contact that constrains what the first leaves free")
    S = annihilator(W) if W.shape[1] < 6 else np.zeros((6, 0))
    both = ContactKind(
        f"{kind.name} and {other.name}",
        S,
        W,
        unilateral=n + k > 0,
        out=_way_out(kind.out, other.out, kind.origin),
        origin=kind.origin,
        presses=n + k,
    )
    edges = [contact.edge for contact in (first, second) if contact.edge is not None]
    return Contact(both, first.pose, min(edges, default=None))


def _way_out(first: Array | None, second: Array | None, place: Array) -> Array | None:
    """A twist out of both, from those that lead out of one, of unit speed at a place; None if there is none."""
    if first is None or second is None:
        return None
    out = first + second
    speed = float(np.linalg.norm(se3.velocity_at(out, place)))
    return out / speed if speed > NOWHERE else None
