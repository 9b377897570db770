"""`solve_velocity` for many twists at once, on all cores: for maps over joint ranges and rollouts."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.engine import law
from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, sizes
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.limits import Bounds, bounds_of
from invariantqp.velocity.problem import (
    METHODS,
    STATUSES,
    VelocityOptions,
    check_joints,
    checked_options,
    solve_velocity,
)
from invariantqp.velocity.solution import VelocitySolution, at_bounds

if TYPE_CHECKING:
    from typing_extensions import Unpack

# Options of a single twist.
UNSUPPORTED = ("exact", "rows", "tool_speed")


@dataclass(frozen=True, eq=False)
class VelocitySolutions:
    """N solutions; `solutions[i]` is the i-th VelocitySolution, solved again when it is read.

    Attributes:
        velocity: (N, m) joint velocities.
        method: (N,) strings, as in VelocitySolution.
        status: (N,) strings.
        residual: (N, 6) s - J x.
        scale: (N,) share of the exact rows' speed, 0 where held.
        damping: (N,) lambda used.
        guard: (N,) share of least squares blended in.
        bounds: (N, m) lower and upper.
        row: solves one row.
    """

    velocity: Array
    method: NDArray[np.str_]
    status: NDArray[np.str_]
    residual: Array
    scale: Array
    damping: Array
    guard: Array
    bounds: tuple[Array, Array]
    row: Callable[[int], VelocitySolution]

    def __len__(self) -> int:
        return len(self.velocity)

    def __iter__(self) -> Iterator[VelocitySolution]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, row: int) -> VelocitySolution:
        """One row.

        Raises:
            IndexError: there is no such row.
        """
        return self.row(range(len(self))[row])

    @property
    def reason(self) -> list[str]:
        """The reason of each row."""
        return [solution.reason for solution in self]

    @property
    def active(self) -> list[tuple[int, ...]]:
        """The joints at a bound in each row."""
        return [tuple(np.flatnonzero(row).tolist()) for row in at_bounds(self.velocity, *self.bounds)]


def solve_velocities(J: ArrayLike, twist: ArrayLike, **options: Unpack[VelocityOptions]) -> VelocitySolutions:
    """`solve_velocity` for N Jacobians and twists at once, on all cores.

    Args:
        J: (N, 6, m) joint twists (omega; v) as columns, each in any frame.
        twist: (N, 6) desired twists in the frames of J; (6,) is the same for all.
        options: see `VelocityOptions`. `bounds` may be (lower, upper) of shape (N, m), `posture` (N, m), `point`
            (N, 3). exact, rows and tool_speed are not supported.

    Returns:
        VelocitySolutions: velocity (N, m) inside the bounds, with method and status of every row.

    Raises:
        BadInput: NaN, shapes that do not fit (the row is named), crossed bounds, an option that is refused.
        NoPseudoinverse: the form has no projector for the twists of some row.
        UnknownName: no such back end.
    """
    for name in UNSUPPORTED:
        if options.get(name) is not None:
            raise BadInput(name, "given for a batch", "None", "Solve these rows one by one with solve_velocity.")
    twists = _stack(J)
    n, _, m = twists.shape
    check_joints(m)
    s = _rows(twist, (n, 6), "twist", "one twist a Jacobian")
    lower, upper = _box(options.get("bounds"), n, m)
    posture, point, metric = options.get("posture"), options.get("point"), options.get("joint_metric")
    length = options.get("length")
    rows: dict[str, Array | None] = {"posture": None, "points": None}
    if posture is not None:
        rows["posture"] = _rows(posture, (n, m), "posture", "one joint velocity a Jacobian")
    if point is not None and not isinstance(point, str):
        rows["points"] = _rows(point, (n, 3), "point", "one point a Jacobian")

    def row(i: int) -> VelocitySolution:
        one: Any = {**options, "bounds": (lower[i], upper[i])}
        one |= {name.removesuffix("s"): value[i] for name, value in rows.items() if value is not None}
        return solve_velocity(twists[i], s[i], **one)

    common: dict[str, Any] = {
        **options,
        "bounds": None,
        "posture": None,
        "point": point if isinstance(point, str) else None,
    }
    fields = checked_options(m, common)
    fields |= {"lower": lower, "upper": upper, "length": None if length is None else sizes.bounded_length(length)}
    fields["metric"] = None if metric is None else arrays.positive_definite(metric, m, "joint_metric")
    if options.get("backend") is None:
        velocity, residual, numbers = law.solve_rows(twists, s, **fields, **rows, threads=cpu_count())
        if (numbers[:, 1] < 0.0).any():
            _check_values(twists, s, lower, upper, rows)
            row(int(np.argmin(numbers[:, 1])))  # raises the error of that row
    else:
        found = [row(i) for i in range(n)]
        velocity, residual = np.array([x.velocity for x in found]), np.array([x.residual for x in found])
        numbers = np.array(
            [(METHODS.index(x.method), STATUSES.index(x.status), x.scale, x.damping, x.guard) for x in found]
        )
    method, status = numbers[:, :2].T.astype(np.intp)
    scale, damping, guard = numbers[:, 2:].T
    words = np.array(METHODS)[method], np.array([str(one) for one in STATUSES])[status]
    return VelocitySolutions(velocity, *words, residual, scale, damping, guard, (lower, upper), row)


def _check_values(J: Array, twist: Array, lower: Array, upper: Array, rows: dict[str, Array | None]) -> None:
    """Check the values of all problems.

    Raises:
        BadInput: NaN, numbers too large or too small, crossed bounds.
    """
    sizes.bounded_jacobians(_finite(J, "J"))
    sizes.bounded_twists(_finite(twist, "twist"))
    if rows["posture"] is not None:
        _finite(rows["posture"], "posture")
    if rows["points"] is not None:
        sizes.bounded_points(_finite(rows["points"], "point"))
    wrong = ~(lower <= upper) | (lower == np.inf) | (upper == -np.inf)  # NaN fails <=
    if wrong.any():
        i, j = (int(k) for k in np.argwhere(wrong)[0])
        found = f"lower {lower[i, j]:g} and upper {upper[i, j]:g} in row {i}, joint {j}"
        raise BadInput("bounds", found, "lower <= upper, -inf and inf where there is no limit")


def _stack(J: ArrayLike) -> Array:
    expected = "shape (N, 6, m), m >= 1: joint twists as columns, angular part first"
    a = arrays.array(J, "J", expected)
    if a.ndim != 3 or a.shape[1] != 6 or a.shape[2] == 0:
        remedy = "One Jacobian is for solve_velocity." if a.ndim == 2 else ""
        raise BadInput("J", f"shape {a.shape}", expected, remedy)
    return a


def _rows(value: ArrayLike, shape: tuple[int, int], argument: str, expected: str) -> Array:
    a = arrays.array(value, argument, f"shape {shape}, {expected}")
    if a.shape not in (shape, shape[1:]):
        raise BadInput(argument, f"shape {a.shape}", f"shape {shape}, {expected}, or {shape[1:]} for all")
    return np.broadcast_to(a.reshape(-1, shape[1]), shape)


def _finite(a: Array, argument: str) -> Array:
    if not np.isfinite(a).all():
        row = int(np.argwhere(~np.isfinite(a))[0][0])
        raise BadInput(argument, f"NaN or infinity in row {row}", "finite numbers", "Check where it was computed.")
    return a


def _box(bounds: Bounds | tuple[ArrayLike, ArrayLike] | None, n: int, m: int) -> tuple[Array, Array]:
    """Lower and upper bounds, (N, m)."""
    if bounds is None or isinstance(bounds, Bounds):
        box = bounds_of(bounds, m)
        return np.broadcast_to(box.lower, (n, m)), np.broadcast_to(box.upper, (n, m))
    if not isinstance(bounds, (tuple, list)) or len(bounds) != 2:
        raise BadInput("bounds", type(bounds).__name__, "Bounds(lower, upper), or (lower, upper) of shape (N, m)")
    low, high = (arrays.array(side, f"bounds[{i}]", f"limits of shape {(n, m)}") for i, side in enumerate(bounds))
    for name, side in (("bounds[0]", low), ("bounds[1]", high)):
        if side.shape != (n, m):
            raise BadInput(name, f"shape {side.shape}", f"shape {(n, m)}, one row a Jacobian")
    return low, high


def cpu_count() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
