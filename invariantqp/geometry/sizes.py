"""Sizes that the law can compute with: above and below, an argument is refused before rounding or overflow decides."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array

# A length above this many of the caller's units, or below one over it, is not that of a machine: it is rounding where a
# part of the twists should be zero, the rotation of a gantry or the moments of axes that meet in the origin. The same
# holds of other quantities of a robot cell. Beside velocity limits of 0.1 to 10, rounding of a wanted twist costs 1e-11
# of them at this size on random joints, 1e-7 at 1e16, and all of them at 1e23.
LENGTH_LIMIT = 1e12
# Of joint twists and lengths: their sixth powers, and one over them, have to be numbers that a computer has. A metre is
# 1e-16 light-years and 1e10 atoms.
SMALLEST, LARGEST = 1e-30, 1e30
REMEDY = "Choose another unit of length."


def not_too_fast(twists: Array, argument: str = "twist") -> Array:
    """Finite wanted twists (..., 6), no entry above `LENGTH_LIMIT`."""
    return _up_to(LENGTH_LIMIT, twists, argument, "Scale it down.")


def not_too_far(points: Array) -> Array:
    """Finite points (..., 3), no entry above `LARGEST`."""
    return _up_to(LARGEST, points, "point", REMEDY)


def _up_to(most: float, a: Array, argument: str, remedy: str) -> Array:
    largest = float(np.abs(a).max(initial=0.0))
    if largest > most:
        raise BadInput(argument, f"an entry of size {largest:.3g}", f"entries up to {most:g}", remedy)
    return a


def usual_length(value: float) -> float:
    """A length from `SMALLEST` to `LARGEST`."""
    length = arrays.number(value, "length", "a length", positive=True)
    if not SMALLEST <= length <= LARGEST:
        raise BadInput("length", f"{length:.3g}", f"a length from {SMALLEST:g} to {LARGEST:g}", REMEDY)
    return length


def joint_twists(value: ArrayLike) -> Array:
    """Finite (6, m) joint twists as `arrays.columns`, |J| from `SMALLEST` to `LARGEST` or zero."""
    J = arrays.columns(value)
    _usual(J, float(np.vdot(J, J)), "J")
    return J


def usual_twists(value: ArrayLike, argument: str) -> Array:
    """Finite (6, m) twists as `arrays.system`, of the same sizes."""
    J = arrays.system(value, argument)
    with np.errstate(over="ignore"):
        _usual(J, float(np.vdot(J, J)), argument)
    return J


def usual_rows(J: Array) -> Array:
    """Finite (N, 6, m) joint twists, the same of each."""
    squares = np.einsum("nij,nij->n", J, J)
    for i in np.flatnonzero(~((squares >= SMALLEST**2) & (squares <= LARGEST**2))).tolist():
        _usual(J[i], float(squares[i]), "J", f" in row {i}")
    return J


def _usual(J: Array, square: float, argument: str, where: str = "") -> None:
    if not SMALLEST**2 <= square <= LARGEST**2 and J.any():
        expected = f"a largest entry from {SMALLEST:g} to {LARGEST:g}, or all zero"
        raise BadInput(argument, f"a largest entry of {np.abs(J).max():.3g}{where}", expected, REMEDY)
