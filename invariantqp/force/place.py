"""Sizes at the place of contact: loads about it, the way out, and how fast a twist moves it."""

from __future__ import annotations

from math import acos, degrees, inf, sqrt

import numpy as np

from invariantqp.errors import BadInput
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.systems.contacts import Contact

TINY = float(np.finfo(float).tiny)


def load_at(wrench: Array, *places: Array) -> tuple[float, float]:
    """|f|, and |m| about that of the places where it is least: a handle is held far from its hinge."""
    a, b, c, u, v, w = wrench.tolist()
    least = inf
    for place in places:
        x, y, z = place.tolist()
        i, j, k = a - y * w + z * v, b - z * u + x * w, c - x * v + y * u
        least = min(least, i * i + j * j + k * k)
    return sqrt(u * u + v * v + w * w), sqrt(least)


def weakest(parts: Array, felt: Array, exert: Array) -> tuple[float, float] | None:
    """The press that is felt and wanted, of several the one of which least is felt, in the unit of the smallest.

    Args:
        parts: (n, 6) from a wrench to its n presses; n = 0 for a contact that cannot be lost.
        felt: (6,) wrench.
        exert: (6,) wrench that is wanted.
    """
    if not len(parts):
        return None
    if len(parts) == 1:
        return float(parts[0].dot(felt)), float(parts[0].dot(exert))
    here, wanted = parts.dot(felt), parts.dot(exert)
    pressed = wanted > 0.0
    if not pressed.any():
        return float(here.min()), 0.0
    least = float(wanted[pressed].min())
    return least * float((here[pressed] / wanted[pressed]).min()), least


def way_out(contact: Contact) -> Array:
    """(3,) the direction in which the place of contact is left, base frame; zero where it cannot be."""
    if contact.kind.out is None:
        return np.zeros(3)
    out = velocity_at(contact.adjoint.dot(np.asarray(contact.kind.out)), contact.point)
    return out / max(sqrt(out.dot(out)), TINY)


def require_same_side(before: Array | None, out: Array) -> None:
    """Refuse a way out (3,) that has turned by more than a right angle since the last tick, None in the air.

    Such a normal presses where it should let go, and a retreat along it goes on pressing.

    Raises:
        BadInput: it has.
    """
    if before is not None and out.dot(before) < 0.0:
        turned = f"a normal that turned by {degrees(acos(max(-1.0, out.dot(before)))):.0f} degrees within a tick"
        remedy = "Check the function that gives it; to press on another surface, `reset` first."
        raise BadInput("contact", turned, "the outward normal of the surface that is pressed", remedy)


def speed_at(contact: Contact, twist: Array, size: float) -> float:
    """How fast a twist moves the place of contact, turning counted by the contact's size [length/s]."""
    v, w = velocity_at(twist, contact.point), size * twist[:3]
    return max(sqrt(max(v.dot(v), w.dot(w))), TINY)


def moved_between(before: Array | None, now: Array, point: Array) -> Array:
    """(3,) how far the tool's point that is now at `point` (3,) has come, for its (4, 4) poses; None is no motion."""
    if before is None:
        return np.zeros(3)
    back: Array = before[:3, :3].dot(now[:3, :3].T.dot(point - now[:3, 3])) + before[:3, 3]
    return point - back
