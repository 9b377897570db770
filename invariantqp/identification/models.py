"""Kinds of contact as constraints c(C) = 0 on the relative pose C = A^-1 X B.

    point   z = 0                              a point of the tool on a plane
    sphere  z + k |p|^2 / 2 = 0                a point on a sphere of curvature k
    line    z = 0, (R x)_z = 0                 an edge of the tool on a plane
    face    z = 0, (R z)_xy = 0                a face of the tool on a plane
    ball    p = 0
    peg     p_xy = 0, (R z)_xy = 0
    hinge   peg, and z = 0
    screw   peg, and z = h angle
    slide   p_xy = 0, R = 1

X is the tool pose, A the contact's base frame and B its tool frame; p and R are those of C. A point or an edge that is
fixed to the base, on a surface that is fixed to the tool, is the same constraint on X^-1.

A free rotation transmits no moment: the wrench (m; f) in B has m = 0 for a point and a sphere, m_x = 0 for a line.
These rows determine the tip if the tool never turns.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.identification.se3_batch import rotation_vectors, skew


class Rows(NamedTuple):
    """Constraint values at n poses, and their derivatives."""

    values: Array  # (n, r)
    by_twist: Array  # (n, r, 6) with respect to a twist of C in the contact's base frame
    by_parameters: Array  # (n, r, e) with respect to the curvature or pitch


class Model(NamedTuple):
    """A kind of contact: its degrees of freedom, its constraints, and what they leave undetermined."""

    kind: str
    freedoms: int
    rows: Callable[[Array, Array, Array], Rows]  # of poses C, parameters, and the accumulated rotation about z of B
    # Twists of A, of B and of both together that change no constraint, as indices: a plane turns about its normal and
    # slides in itself, a point turns.
    gauge: tuple[tuple[int, ...], tuple[int, ...], tuple[tuple[int, int], ...]]
    determined_by: dict[str, list[int]]  # entries of the twists of A and B in which "axis", "normal", "point" vary
    free_moments: tuple[int, ...] = ()  # moments in the contact's tool frame that are zero
    parameter_count: int = 0  # 1 with a curvature or pitch
    is_unilateral: bool = False  # pressed, never pulled
    is_reversible: bool = False  # the surface may be fixed to the base or to the tool


def _height(C: Array) -> tuple[Array, Array]:
    x, y, z = C[:, 0, 3], C[:, 1, 3], C[:, 2, 3]
    zero, one = np.zeros_like(x), np.ones_like(x)
    return z[:, None], np.stack((y, -x, zero, zero, zero, one), axis=-1)[:, None]


def _position(C: Array, rows: slice) -> tuple[Array, Array]:
    p = C[:, :3, 3]
    by_twist = np.concatenate((-skew(p), np.broadcast_to(np.eye(3), (len(C), 3, 3))), axis=-1)
    return p[:, rows], by_twist[:, rows]


def _tilt(C: Array, column: int, rows: slice) -> tuple[Array, Array]:
    u = C[:, :3, column]
    by_twist = np.concatenate((-skew(u), np.zeros((len(C), 3, 3))), axis=-1)
    return u[:, rows], by_twist[:, rows]


def _rows(*parts: tuple[Array, Array]) -> Rows:
    values = np.concatenate([part[0] for part in parts], axis=1)
    by_twist = np.concatenate([part[1] for part in parts], axis=1)
    return Rows(values, by_twist, np.zeros((*values.shape, 0)))


def _sphere(C: Array, parameters: Array, _: Array) -> Rows:
    (z, by_twist), p, k = _height(C), C[:, :3, 3], parameters[0]
    half = 0.5 * (p * p).sum(axis=1)[:, None]
    by_twist = by_twist.copy()
    by_twist[:, 0, 3:] += k * p  # a rotation about the origin changes no distance from it
    return Rows(z + k * half, by_twist, half[..., None])


def _hinge(C: Array) -> Rows:
    return _rows(_position(C, slice(0, 3)), _tilt(C, 2, slice(2)))


def angles(C: Array, accumulated: Array) -> Array:
    """(n,) unwrapped angles about z, relative to the middle sample; `accumulated` (n,) counts the whole turns."""
    within, middle = np.arctan2(C[:, 1, 0] - C[:, 0, 1], C[:, 0, 0] + C[:, 1, 1]), len(C) // 2
    whole: Array = np.round((accumulated - accumulated[middle] + within[middle] - within) / (2.0 * np.pi))
    return within + 2.0 * np.pi * whole


def _screw(C: Array, parameters: Array, accumulated: Array) -> Rows:
    rows, angle = _hinge(C), angles(C, accumulated)
    values, by_twist, by_pitch = rows.values.copy(), rows.by_twist.copy(), np.zeros((len(C), 5, 1))
    values[:, 2] -= parameters[0] * angle
    by_twist[:, 2, 2] -= parameters[0]
    by_pitch[:, 2, 0] = -angle
    return Rows(values, by_twist, by_pitch)


def _slide(C: Array) -> Rows:
    by_twist = np.broadcast_to(np.eye(3, 6), (len(C), 3, 6))
    return _rows(_position(C, slice(2)), (rotation_vectors(C[:, :3, :3]), by_twist))


def _face(C: Array, column: int = 2, rows: slice = slice(2)) -> Rows:
    return _rows(_height(C), _tilt(C, column, rows))


_TURNS, _IN_PLANE, _JOINTLY = (0, 1, 2), (2, 3, 4), ((5, 5),)
_AXIS: dict[str, list[int]] = {"axis": [0, 1], "point": [3, 4]}
_TIP: dict[str, list[int]] = {"normal": [0, 1], "point": [9, 10, 11]}
_EDGE: dict[str, list[int]] = {"normal": [0, 1], "point": [10, 11], "axis": [7, 8]}

MODELS: dict[str, Model] = {
    model.kind: model
    for model in (
        Model("slide", 1, lambda C, *_: _slide(C), ((5,), (5,), ((2, 2), (3, 3), (4, 4))), {"axis": [0, 1]}),
        Model("hinge", 1, lambda C, *_: _hinge(C), ((2,), (2,), _JOINTLY), _AXIS),
        Model("screw", 1, _screw, ((), (), _JOINTLY), _AXIS, parameter_count=1),
        Model(
            "peg", 2, lambda C, *_: _rows(_position(C, slice(2)), _tilt(C, 2, slice(2))), ((2, 5), (2, 5), ()), _AXIS
        ),
        Model("ball", 3, lambda C, *_: _rows(_position(C, slice(3))), (_TURNS, _TURNS, ()), {"point": [3, 4, 5]}),
        Model("face", 3, lambda C, *_: _face(C), (_IN_PLANE, _IN_PLANE, _JOINTLY), {"normal": [0, 1]}, (), 0, True),
        Model("line", 4, lambda C, *_: _face(C, 0, slice(2, 3)), (_IN_PLANE, (0, 3), ()), _EDGE, (0,), 0, True, True),
        Model("point", 5, lambda C, *_: _rows(_height(C)), (_IN_PLANE, _TURNS, ()), _TIP, _TURNS, 0, True, True),
        Model("sphere", 5, _sphere, ((), _TURNS, ()), {"point": [9, 10, 11]}, _TURNS, 1, True, True),
    )
}


def gauge(kind: str, parameters: Array) -> Array:
    """(12 + e, g) basis of the small changes of A, B and the parameters that change no constraint."""
    of_base, of_tool, jointly = MODELS[kind].gauge
    E = np.eye(12 + len(parameters))
    columns = [E[i] for i in of_base] + [E[6 + i] for i in of_tool] + [E[i] + E[6 + j] for i, j in jointly]
    if kind == "screw":
        columns += [E[2] + parameters[0] * E[5], E[8] + parameters[0] * E[11]]
    if kind == "sphere":  # rotations about the centre, at -1/k on z
        k = parameters[0]
        columns += [E[2], k * E[0] - E[4], k * E[1] + E[3]]
    return np.stack(columns, axis=1)
