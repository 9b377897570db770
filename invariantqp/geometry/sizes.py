"""Limits of the magnitude of arguments, outside which rounding or overflow would decide; the checks return or raise."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array

# A length above this, in the caller's units, or below one over it, is rounding of a part of the twists that should be
# zero: the rotation of a gantry or the moments of axes that meet in the origin. With velocity limits of 0.1 to 10,
# rounding of a commanded twist of this size costs 1e-11 of them on random joints, 1e-7 at 1e16, and all at 1e23.
LENGTH_LIMIT = 1.0 / arrays.ROUNDING
# Of joint twists and lengths, whose sixth powers and inverses must be finite in float64.
SMALLEST, LARGEST = 1e-30, 1e30
CHANGE_UNIT = "Choose another unit of length."


def bounded_twists(twists: Array, argument: str = "twist") -> Array:
    """Finite commanded twists (..., 6), no entry above `LENGTH_LIMIT`."""
    return _up_to(LENGTH_LIMIT, twists, argument, "Scale it down.")


def bounded_points(points: Array) -> Array:
    """Finite points (..., 3), no entry above `LARGEST`."""
    return _up_to(LARGEST, points, "point", CHANGE_UNIT)


def _up_to(most: float, a: Array, argument: str, remedy: str) -> Array:
    largest = float(np.abs(a).max(initial=0.0))
    if largest > most:
        raise BadInput(argument, f"an entry of size {largest:.3g}", f"entries up to {most:g}", remedy)
    return a


def bounded_length(value: float) -> float:
    """A length from `SMALLEST` to `LARGEST`."""
    length = arrays.number(value, "length", "a length", positive=True)
    if not SMALLEST <= length <= LARGEST:
        raise BadInput("length", f"{length:.3g}", f"a length from {SMALLEST:g} to {LARGEST:g}", CHANGE_UNIT)
    return length


def bounded_jacobian(value: ArrayLike) -> Array:
    """Finite (6, m) joint twists as `arrays.columns`, |J| from `SMALLEST` to `LARGEST` or zero."""
    J = arrays.columns(value)
    _check_size(J, float(np.vdot(J, J)), "J")
    return J


def bounded_system(value: ArrayLike, argument: str) -> Array:
    """Finite (6, m) twists as `arrays.system`, |J| from `SMALLEST` to `LARGEST` or zero."""
    J = arrays.system(value, argument)
    with np.errstate(over="ignore"):
        _check_size(J, float(np.vdot(J, J)), argument)
    return J


def bounded_jacobians(J: Array) -> Array:
    """Finite (N, 6, m) joint twists, each |J| from `SMALLEST` to `LARGEST` or zero."""
    squares = np.einsum("nij,nij->n", J, J)
    for i in np.flatnonzero(~((squares >= SMALLEST**2) & (squares <= LARGEST**2))).tolist():
        _check_size(J[i], float(squares[i]), "J", f" in row {i}")
    return J


def _check_size(J: Array, square: float, argument: str, where: str = "") -> None:
    if not SMALLEST**2 <= square <= LARGEST**2 and J.any():
        expected = f"a largest entry from {SMALLEST:g} to {LARGEST:g}, or all zero"
        raise BadInput(argument, f"a largest entry of {np.abs(J).max():.3g}{where}", expected, CHANGE_UNIT)
