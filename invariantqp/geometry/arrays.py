"""Array aliases, and one boundary check a kind: finite, of the right shape, float64, or a `BadInput`.

Everything that enters the library passes one of these once; inside it nothing is checked again.
"""

from __future__ import annotations

from math import hypot, isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.errors import BadInput

if TYPE_CHECKING:
    from collections.abc import Sequence

Array = NDArray[np.float64]

# How far R'R may be from I: a pose read from a file with six digits passes, a scaled or sheared one does not.
ROTATION_TOLERANCE = 1e-5
# How far a_ij and a_ji may differ, relative to sqrt(a_ii a_jj): where entries cancel, rounding is all that is left.
SYMMETRY_TOLERANCE = 1e-9


def array(value: ArrayLike, argument: str, expected: str) -> Array:
    """`value` as float64, or `BadInput`."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise BadInput(argument, f"{type(value).__name__} that is not numeric ({error})", expected) from error


def _finite(a: Array, argument: str, expected: str) -> Array:
    # One reduction in the usual case; a square that overflows is looked at again, entry by entry.
    if not isfinite(np.vdot(a, a)) and not np.isfinite(a).all():
        bad = [tuple(int(i) for i in index) for index in np.argwhere(~np.isfinite(a))[:4]]
        where = ", ".join(str(i[0]) if len(i) == 1 else str(i) for i in bad)
        raise BadInput(argument, f"NaN or infinity at index {where}", expected, "Check where it was computed.")
    return a


def vector(value: ArrayLike, size: int | None, argument: str) -> Array:
    """A finite (size,) vector; any length when `size` is None."""
    a = array(value, argument, "numbers")
    if a.ndim != 1 or (size is not None and len(a) != size):
        raise BadInput(argument, f"shape {a.shape}", f"shape ({'n' if size is None else size},)")
    return _finite(a, argument, "finite numbers")


def direction(value: ArrayLike, argument: str) -> Array:
    """The unit (3,) vector along a finite one that is not zero."""
    u = vector(value, 3, argument)
    length = hypot(*u.tolist())  # squares nothing that could overflow or vanish
    if length == 0.0:
        raise BadInput(argument, "the zero vector", "a direction", "Give one of any length but zero.")
    return u / length


def twist(value: ArrayLike, argument: str = "twist") -> Array:
    """A finite (6,) twist (omega; v)."""
    return vector(value, 6, argument)


def columns(value: ArrayLike, argument: str = "J") -> Array:
    """Finite (6, k) columns, k >= 1: twists (a Jacobian, a screw system) or wrenches. A (6,) vector is one column."""
    expected = "six rows, angular part first, one column a twist: shape (6, k), k >= 1"
    a = array(value, argument, expected)
    if a.ndim == 1 and len(a) == 6:
        a = a.reshape(6, 1)
    if a.ndim != 2 or a.shape[0] != 6 or a.shape[1] == 0:
        remedy = "Transpose it." if a.ndim == 2 and a.shape[1] == 6 else ""
        raise BadInput(argument, f"shape {a.shape}", expected, remedy)
    return _finite(a, argument, expected)


def system(value: ArrayLike, argument: str) -> Array:
    """As `columns`, or (6, 0) for the zero system."""
    shape: tuple[int, ...] = getattr(value, "shape", ())
    return np.empty((6, 0)) if shape == (6, 0) else columns(value, argument)


def matrix(value: ArrayLike, shape: tuple[int | None, int], argument: str) -> Array:
    """A finite matrix of the given shape; None leaves the number of rows free."""
    rows = "k" if shape[0] is None else shape[0]
    expected = f"shape ({rows}, {shape[1]})"
    a = array(value, argument, expected)
    if a.ndim != 2 or a.shape[1] != shape[1] or (shape[0] is not None and a.shape[0] != shape[0]):
        raise BadInput(argument, f"shape {a.shape}", expected)
    return _finite(a, argument, expected)


def positive_definite(value: ArrayLike, size: int, argument: str) -> Array:
    """A symmetric positive-definite (size, size) matrix; a (size,) vector is its diagonal."""
    expected = f"a symmetric positive-definite ({size}, {size}) matrix or its {size} diagonal entries"
    a = array(value, argument, expected)
    a = np.diag(a) if a.ndim == 1 else a
    a = matrix(a, (size, size), argument)
    root = np.sqrt(np.abs(np.diag(a)))
    if (np.abs(a - a.T) > SYMMETRY_TOLERANCE * np.outer(root, root)).any():
        raise BadInput(argument, "a matrix that is not symmetric", expected, "Pass (A + A.T) / 2 if that is meant.")
    try:
        np.linalg.cholesky(a)
    except np.linalg.LinAlgError as error:
        lowest = float(np.linalg.eigvalsh(a)[0])
        raise BadInput(argument, f"smallest eigenvalue {lowest:.3g}", expected) from error
    return a


def pose(value: ArrayLike, argument: str = "pose") -> Array:
    """A (4, 4) homogeneous rigid motion: rotation orthonormal with determinant +1, last row (0, 0, 0, 1).

    Anything with a `.homogeneous` attribute (a Pinocchio SE3) is read through it.
    """
    expected = "a (4, 4) homogeneous rigid motion"
    homogeneous: Any = getattr(value, "homogeneous", value)
    a = matrix(homogeneous, (4, 4), argument)
    R = a[:3, :3]
    (a0, a1, a2), (b0, b1, b2), (c0, c1, c2) = R.tolist()
    volume = a0 * (b1 * c2 - b2 * c1) + a1 * (b2 * c0 - b0 * c2) + a2 * (b0 * c1 - b1 * c0)
    if volume < 0.0 or np.abs(R.T.dot(R) - np.eye(3)).max() > ROTATION_TOLERANCE:
        raise BadInput(argument, "an upper-left block that is not a rotation", expected, "Orthonormalise it first.")
    if a[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise BadInput(argument, f"last row {a[3].tolist()}", "last row [0, 0, 0, 1]")
    return a


def number(value: float, argument: str, expected: str = "a finite number", *, positive: bool = False) -> float:
    """A finite (optionally positive) float."""
    try:
        x = float(value)
    except (TypeError, ValueError) as error:
        raise BadInput(argument, f"{value!r}", expected) from error
    if not isfinite(x) or (positive and x <= 0.0):
        raise BadInput(argument, f"{x!r}", f"{expected}{' above zero' if positive else ''}")
    return x


def names(values: Sequence[str], limit: int = 6) -> str:
    """A short human list."""
    shown = ", ".join(values[:limit])
    return shown + (f", ... ({len(values)})" if len(values) > limit else "")
