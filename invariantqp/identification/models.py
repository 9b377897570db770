"""Kinds of contact as constraints c(C) = 0 on whole poses, C = A^-1 X B, the contact's tool frame in its base frame.

    point   z = 0                              a point of the tool on a plane
    sphere  z + k |p|^2 / 2 = 0                on a sphere of curvature k
    line    z = 0, (R x)_z = 0                 an edge of the tool on a plane
    face    z = 0, (R z)_xy = 0                a face of the tool on a plane
    ball    p = 0
    peg     p_xy = 0, (R z)_xy = 0
    hinge   and z = 0;   screw and z = h angle;   slide p_xy = 0, R = 1

X is the pose of the tool, A (base) and B (tool) are looked for, p and R are of C. A point, an edge that is fixed to the
base and a surface that is fixed to the tool are the same of X^-1.

What turns freely resists no turn: the wrench (m; f) in B has m = 0 for a point and a sphere, m_x = 0 for a line. These
rows place the tip where the tool never turns.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.identification.motions import rotation_vectors, skew


class Rows(NamedTuple):
    """Values of constraints at n poses, and how they change."""

    values: Array  # (n, r)
    by_twist: Array  # (n, r, 6) with C moved by a twist in the base frame of the contact
    by_extra: Array  # (n, r, e) with curvature or pitch


class Model(NamedTuple):
    """A kind of contact to be fitted: its name, how many ways it moves, and the constraints."""

    kind: str
    freedoms: int
    rows: Callable[[Array, Array, Array], Rows]  # of poses C, curvature or pitch, and turns about z of B summed up
    # Twists of A, of B and of both that change no constraint, as columns of the identity: a plane turns about its
    # normal and slides in itself, a point turns.
    gauge: tuple[tuple[int, ...], tuple[int, ...], tuple[tuple[int, int], ...]]
    known: dict[str, list[int]]  # which entries of the twists of A and B say how surely something is known
    free_moments: tuple[int, ...] = ()  # moments in the tool frame of the contact that are zero
    extra: int = 0  # how many numbers beside the two frames
    pressed: bool = False  # whether it can be pressed but not pulled
    reversible: bool = False  # whether surface and tip may be exchanged


def _height(C: Array) -> tuple[Array, Array]:
    x, y, z = C[:, 0, 3], C[:, 1, 3], C[:, 2, 3]
    zero, one = np.zeros_like(x), np.ones_like(x)
    return z[:, None], np.stack((y, -x, zero, zero, zero, one), axis=-1)[:, None]


def _place(C: Array, rows: slice) -> tuple[Array, Array]:
    p = C[:, :3, 3]
    along = np.concatenate((-skew(p), np.broadcast_to(np.eye(3), (len(C), 3, 3))), axis=-1)
    return p[:, rows], along[:, rows]


def _tilt(C: Array, column: int, rows: slice) -> tuple[Array, Array]:
    u = C[:, :3, column]
    turned = np.concatenate((-skew(u), np.zeros((len(C), 3, 3))), axis=-1)
    return u[:, rows], turned[:, rows]


def _rows(*parts: tuple[Array, Array]) -> Rows:
    values = np.concatenate([part[0] for part in parts], axis=1)
    by_twist = np.concatenate([part[1] for part in parts], axis=1)
    return Rows(values, by_twist, np.zeros((*values.shape, 0)))


def _sphere(C: Array, extra: Array, _: Array) -> Rows:
    (z, by_twist), p, k = _height(C), C[:, :3, 3], extra[0]
    half = 0.5 * (p * p).sum(axis=1)[:, None]
    by_twist = by_twist.copy()
    by_twist[:, 0, 3:] += k * p  # a turn about the origin changes no distance from it
    return Rows(z + k * half, by_twist, half[..., None])


def _hinge(C: Array) -> Rows:
    return _rows(_place(C, slice(0, 3)), _tilt(C, 2, slice(2)))


def angles(C: Array, turned: Array) -> Array:
    """(n,) about z, with the whole turns that `turned` (n,), summed up from sample to sample, says there were.

    They are counted from the middle sample, where frames A and B are to be turned alike.
    """
    within, middle = np.arctan2(C[:, 1, 0] - C[:, 0, 1], C[:, 0, 0] + C[:, 1, 1]), len(C) // 2
    whole: Array = np.round((turned - turned[middle] + within[middle] - within) / (2.0 * np.pi))
    return within + 2.0 * np.pi * whole


def _screw(C: Array, extra: Array, turned: Array) -> Rows:
    rows, turned = _hinge(C), angles(C, turned)
    values, by_twist, by_pitch = rows.values.copy(), rows.by_twist.copy(), np.zeros((len(C), 5, 1))
    values[:, 2] -= extra[0] * turned
    by_twist[:, 2, 2] -= extra[0]
    by_pitch[:, 2, 0] = -turned
    return Rows(values, by_twist, by_pitch)


def _slide(C: Array) -> Rows:
    turned = np.broadcast_to(np.eye(3, 6), (len(C), 3, 6))
    return _rows(_place(C, slice(2)), (rotation_vectors(C[:, :3, :3]), turned))


_TURNS, _IN_PLANE, _JOINTLY = (0, 1, 2), (2, 3, 4), ((5, 5),)
_AXIS: dict[str, list[int]] = {"axis": [0, 1], "point": [3, 4]}
_TIP: dict[str, list[int]] = {"normal": [0, 1], "point": [9, 10, 11]}
_EDGE: dict[str, list[int]] = {"normal": [0, 1], "point": [10, 11], "axis": [7, 8]}


def _face(C: Array, column: int = 2, rows: slice = slice(2)) -> Rows:
    return _rows(_height(C), _tilt(C, column, rows))


MODELS: dict[str, Model] = {
    model.kind: model
    for model in (
        Model("slide", 1, lambda C, *_: _slide(C), ((5,), (5,), ((2, 2), (3, 3), (4, 4))), {"axis": [0, 1]}),
        Model("hinge", 1, lambda C, *_: _hinge(C), ((2,), (2,), _JOINTLY), _AXIS),
        Model("screw", 1, _screw, ((), (), _JOINTLY), _AXIS, extra=1),
        Model("peg", 2, lambda C, *_: _rows(_place(C, slice(2)), _tilt(C, 2, slice(2))), ((2, 5), (2, 5), ()), _AXIS),
        Model("ball", 3, lambda C, *_: _rows(_place(C, slice(3))), (_TURNS, _TURNS, ()), {"point": [3, 4, 5]}),
        Model("face", 3, lambda C, *_: _face(C), (_IN_PLANE, _IN_PLANE, _JOINTLY), {"normal": [0, 1]}, (), 0, True),
        Model("line", 4, lambda C, *_: _face(C, 0, slice(2, 3)), (_IN_PLANE, (0, 3), ()), _EDGE, (0,), 0, True, True),
        Model("point", 5, lambda C, *_: _rows(_height(C)), (_IN_PLANE, _TURNS, ()), _TIP, _TURNS, 0, True, True),
        Model("sphere", 5, _sphere, ((), _TURNS, ()), {"point": [9, 10, 11]}, _TURNS, 1, True, True),
    )
}


def gauge(kind: str, extra: Array) -> Array:
    """(12 + e, g) small twists of A and B in themselves, beside curvature or pitch, that change no constraint."""
    of_base, of_tool, jointly = MODELS[kind].gauge
    E = np.eye(12 + len(extra))
    columns = [E[i] for i in of_base] + [E[6 + i] for i in of_tool] + [E[i] + E[6 + j] for i, j in jointly]
    if kind == "screw":
        columns += [E[2] + extra[0] * E[5], E[8] + extra[0] * E[11]]
    if kind == "sphere":  # turns about the centre, at -1/k on z
        k = extra[0]
        columns += [E[2], k * E[0] - E[4], k * E[1] + E[3]]
    return np.stack(columns, axis=1)
