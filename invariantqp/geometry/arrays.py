"""The array type and the checks of arguments: each returns a finite float64 array or number, or raises `BadInput`.

Public functions check their arguments here, once; inner functions do not. A float64 array is returned as it is, not
copied.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import hypot, isfinite, isinf, isnan
from operator import index
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.errors import BadInput, excerpt

Array = NDArray[np.float64]
Result = TypeVar("Result")
Word = TypeVar("Word", bound=str)

FLOAT64 = np.dtype(np.float64)
# Kinds of numpy's types of real numbers: signed and unsigned integers, floats; objects ("O") may be numbers.
REAL_KINDS = "iufO"
# Remedies for a quaternion in place of a rotation, for a position, a quaternion or both in place of a pose.
OF_A_QUATERNION = "a quaternion's rotation is scipy's Rotation.from_quat(xyzw).as_matrix()."
MADE_OF_PARTS = f"iq.transform(rotation, position) makes one; {OF_A_QUATERNION}"
SYMMETRIC_PART = "Its symmetric part is (A + A.T) / 2."
LAST_ROW = [0.0, 0.0, 0.0, 1.0]
# Tolerance of R'R - I: a pose from a file with six digits passes, a scaled or sheared one does not.
ROTATION_TOLERANCE = 1e-5
# Larger counts of states, restarts or ticks are typing errors.
LARGEST_COUNT = 10_000_000
# Zero relative to the quantity that a number is compared with, or in units of a robot cell: files have nine digits.
NEGLIGIBLE = 1e-9
# Zero relative to the terms that a number is computed from: factorisations, products and the forward kinematics of a
# dozen joints leave some 1e-15 of them.
ROUNDING = 1e-12


def array(value: ArrayLike, argument: str, expected: str) -> Array:
    """`value` as a float64 array; text, truth values, complex numbers and masked entries are refused, not converted."""
    if type(value) is np.ndarray and value.dtype is FLOAT64:
        return value
    try:
        a = np.asarray(value)
        wrong = _not_real(value, a)
        if not wrong:
            return a.astype(np.float64, copy=False)
    except Exception as error:
        raise BadInput(argument, f"{excerpt(value)}, which is not numeric ({error})", expected) from error
    raise BadInput(argument, wrong, expected)


def _not_real(value: Any, a: NDArray[Any]) -> str:
    """What the value is instead of real numbers; "" if it is real numbers."""
    if value is None:
        return "None"
    if np.ma.is_masked(value):
        return "a masked array with masked entries"
    if a.dtype.kind == "c":
        return "complex numbers"
    return "" if a.dtype.kind in REAL_KINDS else f"{excerpt(value)}, which is not numeric"


def _finite(a: Array, argument: str, expected: str) -> Array:
    # One sum by vdot, which warns of no overflow; entry by entry if it overflows.
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
    # `hypot` is faster than `_finite` for few numbers, and overflows only if a number or their norm does.
    return a if isfinite(hypot(*a.tolist())) else _finite(a, argument, "finite numbers")


def joint_vector(value: ArrayLike, joint_names: Sequence[str], argument: str) -> Array:
    """A finite vector with a number for each joint; an error of the shape names the joints."""
    a = array(value, argument, "numbers")
    if a.shape == (len(joint_names),):
        return vector(a, len(joint_names), argument)
    remedy = "load_robot(..., joints=[...]) chooses which joints move." if a.ndim == 1 else ""
    raise BadInput(argument, f"shape {a.shape}", f"({len(joint_names)},): {names(joint_names)}", remedy)


def direction(value: ArrayLike, argument: str) -> Array:
    """The unit vector (3,) along a finite one that is not zero."""
    a = vector(value, 3, argument)
    length = hypot(*a.tolist())  # without squares that could overflow or underflow
    if length == 0.0:
        raise BadInput(argument, "the zero vector", "a direction", "Any length but zero will do.")
    return a / length


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


def symmetric(value: ArrayLike, size: int, argument: str) -> Array:
    """A finite symmetric (size, size) matrix, with a tolerance relative to its largest entry."""
    a = matrix(value, (size, size), argument)
    if (np.abs(a - a.T) > NEGLIGIBLE * np.abs(a).max(initial=0.0)).any():
        raise BadInput(
            argument, "a matrix that is not symmetric", f"a symmetric ({size}, {size}) matrix", SYMMETRIC_PART
        )
    return a


def positive_definite(value: ArrayLike, size: int, argument: str) -> Array:
    """A symmetric positive-definite (size, size) matrix; a (size,) vector is its diagonal."""
    expected = f"a symmetric positive-definite ({size}, {size}) matrix or its {size} diagonal entries"
    a = array(value, argument, expected)
    a = np.diag(a) if a.shape == (size,) else a
    if a.shape != (size, size):
        raise BadInput(argument, f"shape {a.shape}", expected)
    a = _finite(a, argument, expected)
    root = np.sqrt(np.abs(np.diag(a)))
    if (np.abs(a - a.T) > NEGLIGIBLE * np.outer(root, root)).any():
        raise BadInput(argument, "a matrix that is not symmetric", expected, SYMMETRIC_PART)
    try:
        np.linalg.cholesky(a)
    except np.linalg.LinAlgError as error:
        lowest = float(np.linalg.eigvalsh(a)[0])
        raise BadInput(argument, f"smallest eigenvalue {lowest:.3g}", expected) from error
    return a


def pose_matrix(value: Any) -> Any:
    """The (4, 4) matrix of a pose object: `.homogeneous` (Pinocchio) or `.as_matrix()` (mink, jaxlie, SciPy)."""
    given = getattr(value, "homogeneous", value)
    return given.as_matrix() if callable(getattr(given, "as_matrix", None)) else given


def rotation(value: ArrayLike, argument: str) -> Array:
    """A finite (3, 3) matrix, or a rotation object as of `pose_matrix`; orthonormality is not checked."""
    expected = "shape (3, 3)"
    a = array(pose_matrix(value), argument, expected)
    if a.shape == (3, 3):
        return _finite(a, argument, expected)
    remedy = f"It is a matrix; {OF_A_QUATERNION}" if a.shape == (4,) else ""
    raise BadInput(argument, f"shape {a.shape}", expected, remedy)


def pose(value: ArrayLike, argument: str = "pose") -> Array:
    """A (4, 4) homogeneous rigid motion, or a pose object as of `pose_matrix`."""
    expected = "a (4, 4) homogeneous rigid motion"
    a = array(pose_matrix(value), argument, expected)
    if a.shape != (4, 4):
        remedy = MADE_OF_PARTS if a.shape in {(3,), (4,), (6,), (7,)} else ""
        if a.shape == (3, 4):
            remedy = "Its last row is left out: np.vstack((T, [0, 0, 0, 1])) has it."
        raise BadInput(argument, f"shape {a.shape}", expected, remedy)
    if is_rigid(a):
        return a
    _finite(a, argument, expected)
    if is_rigid(np.vstack((a[:3], LAST_ROW))):
        raise BadInput(argument, f"last row {a[3].tolist()}", "last row [0, 0, 0, 1]")
    raise BadInput(argument, "an upper-left block that is not a rotation", expected, "Orthonormalise it first.")


def orthonormalised(T: Array) -> Array:
    """A (4, 4) rigid motion with the nearest rotation in place of one of few digits, as of float32 or from a text."""
    for _ in range(2):  # Newton steps
        R = T[:3, :3]
        error = R.dot(R.T) - np.eye(3)
        if np.abs(error).max() <= ROUNDING:
            break
        T = T.copy()
        T[:3, :3] = R - 0.5 * error.dot(R)
    return T


def poses(value: Array, argument: str) -> Array:
    """A copy of (n, 4, 4) rigid motions, each as `pose`; an error names the first that is none."""
    R = value[:, :3, :3]
    with np.errstate(invalid="ignore", over="ignore"):  # NaN is no rigid motion
        rigid = np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)).max(initial=0.0) <= ROTATION_TOLERANCE
        rigid = rigid and (np.linalg.det(R) > 0.0).all() and np.isfinite(value[:, :3, 3]).all()
    if not (rigid and (value[:, 3] == np.array(LAST_ROW)).all()):
        for i, T in enumerate(value):
            pose(T, f"{argument}[{i}]")
    return value.copy()


def is_rigid(T: Array) -> bool:
    """Whether a (4, 4) matrix is a finite rigid motion: columns orthonormal and right-handed, last row (0, 0, 0, 1).

    In floats, which are faster than arrays for few numbers.
    """
    (a, b, c, x), (d, e, f, y), (g, h, i, z), last = T.tolist()
    tolerance = ROTATION_TOLERANCE
    return (
        a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) > 0.0
        and -tolerance <= a * a + d * d + g * g - 1.0 <= tolerance
        and -tolerance <= b * b + e * e + h * h - 1.0 <= tolerance
        and -tolerance <= c * c + f * f + i * i - 1.0 <= tolerance
        and -tolerance <= a * b + d * e + g * h <= tolerance
        and -tolerance <= a * c + d * f + g * i <= tolerance
        and -tolerance <= b * c + e * f + h * i <= tolerance
        and isfinite(x)
        and isfinite(y)
        and isfinite(z)
        and last == LAST_ROW
    )


def number(
    value: float, argument: str, expected: str = "a finite number", *, positive: bool = False, infinite: bool = False
) -> float:
    """A float: above zero if `positive`, possibly infinite if `infinite`, never NaN, True or False."""
    x = value if type(value) is float else _as_float(value, argument, expected)
    if isnan(x) or (isinf(x) and not infinite) or (positive and x <= 0.0):
        raise BadInput(argument, f"{x!r}", f"{expected}{' above zero' if positive else ''}")
    return x


def not_negative(value: float, argument: str, expected: str, *, infinite: bool = False) -> float:
    """A float, zero or more, possibly infinite if `infinite`."""
    x = number(value, argument, expected, infinite=infinite)
    if x < 0.0:
        raise BadInput(argument, f"{x:g}", f"{expected}, not below zero")
    return x


def tolerance(value: float) -> float:
    """A relative error: a float above zero and below one."""
    x = number(value, "tolerance", "a relative error", positive=True)
    if x >= 1.0:
        raise BadInput("tolerance", f"{x:g}", "a relative error, below 1")
    return x


def _as_float(value: Any, argument: str, expected: str) -> float:
    try:
        wrong = isinstance(value, (str, bytes, bool, np.bool_)) or np.iscomplexobj(value) or np.ma.is_masked(value)
        x = None if wrong or np.ndim(value) else float(value)
    except Exception as error:
        raise BadInput(argument, excerpt(value), expected) from error
    if x is None:
        raise BadInput(argument, excerpt(value), expected)
    return x


def count(value: int, argument: str, most: int | None = None) -> int:
    """A whole number from zero to `most`."""
    expected = f"a whole number, {'zero or more' if most is None else f'from 0 to {most}'}"
    try:
        whole = -1 if isinstance(value, (bool, np.bool_)) else index(value)
    except TypeError as error:
        raise BadInput(argument, excerpt(value), expected) from error
    if whole < 0 or (most is not None and whole > most):
        raise BadInput(argument, excerpt(value), expected)
    return whole


def choice(value: Word, argument: str, allowed: Sequence[Word]) -> Word:
    """One of the allowed words."""
    if not isinstance(value, str) or value not in allowed:
        raise BadInput(argument, excerpt(value), " or ".join(repr(word) for word in allowed))
    return value


def flag(value: bool, argument: str) -> bool:
    """True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise BadInput(argument, excerpt(value), "True or False")
    return bool(value)


def instance(value: object, kinds: type | tuple[type, ...], argument: str, expected: str) -> None:
    """Raise unless the value is an instance of one of these kinds."""
    if not isinstance(value, kinds):
        raise BadInput(argument, excerpt(value), expected)


def function(value: Callable[..., Result], argument: str, expected: str = "a function") -> Callable[..., Result]:
    """A callable."""
    if not callable(value):
        raise BadInput(argument, excerpt(value), expected)
    return value


def strings(values: Sequence[str], argument: str) -> tuple[str, ...]:
    """A tuple of strings, such as joint names; a single string is refused, not split into its letters."""
    items = sequence(values, argument, "a list of names")
    for value in items:
        if not isinstance(value, str):
            raise BadInput(argument, f"{excerpt(value)} among the names", "a list of names")
    return items


def sequence(values: Iterable[Result], argument: str, expected: str) -> tuple[Result, ...]:
    """A tuple of items; a text is refused, and so is an array of no dimension."""
    try:
        if not isinstance(values, (str, bytes)):
            return tuple(values)
    except TypeError:
        pass
    raise BadInput(argument, excerpt(values), expected)


def names(values: Sequence[str], limit: int = 6) -> str:
    """The first names, separated by commas, for a message."""
    first = ", ".join(values[:limit])
    return first + (f", ... ({len(values)})" if len(values) > limit else "")
