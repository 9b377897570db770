"""Many twists at once: the compiled core has the rows; those that it hands back, or all without it, go one by one.

Each row is the answer of `solve_velocity`, to rounding. For maps over joint ranges, and rollouts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, sizes
from invariantqp.geometry.arrays import Array
from invariantqp.legacy.compiled import Rows, Written, compiled_rows
from invariantqp.legacy.damping import damping_of
from invariantqp.legacy.law import VelocityLaw
from invariantqp.legacy.problem import law_of, problem_of
from invariantqp.legacy.solve import solve
from invariantqp.velocity.arguments import measure_of
from invariantqp.velocity.forms import CarriedMetric, Form, form_of
from invariantqp.velocity.limits import Bounds, bounds_of
from invariantqp.velocity.problem import VelocityOptions, known
from invariantqp.velocity.solution import Status, VelocitySolution

if TYPE_CHECKING:
    from typing_extensions import Unpack


@dataclass(frozen=True, eq=False)
class VelocitySolutions:
    """N answers; `solutions[i]` is the i-th as `solve_velocity` would give it.

    Attributes:
        velocity: (N, m) joint velocities.
        method: (N,) strings, as in VelocitySolution.
        status: (N,) strings.
        residual: (N, 6) s - J x.
        scale: (N,) share of the exact rows' speed, 0 where held.
        damping: (N,) lambda used.
        guard: (N,) share of least squares blended in.
        slow: {row: solution} of the rows for which a velocity and a residual are not all there is to say.
    """

    velocity: Array
    method: NDArray[np.str_]
    status: NDArray[np.str_]
    residual: Array
    scale: Array
    damping: Array
    guard: Array
    slow: Mapping[int, VelocitySolution]

    def __len__(self) -> int:
        return len(self.velocity)

    def __iter__(self) -> Iterator[VelocitySolution]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, row: int) -> VelocitySolution:
        """One row.

        Raises:
            IndexError: there is no such row.
        """
        i = range(len(self))[row]
        if i in self.slow:
            return self.slow[i]
        x, r = self.velocity[i], self.residual[i]
        return VelocitySolution(x, str(self.method[i]), Status(str(self.status[i])), "", (), r, 1.0, 0.0, 0.0, "")

    @property
    def reason(self) -> list[str]:
        """Why, in words, row by row."""
        return [self.slow[i].reason if i in self.slow else "" for i in range(len(self))]

    @property
    def active(self) -> list[tuple[int, ...]]:
        """Joints at a bound, row by row."""
        return [self.slow[i].active if i in self.slow else () for i in range(len(self))]


# Options that are for one twist at a time.
REFUSED = ("exact", "rows", "tool_speed")


def solve_velocities(J: ArrayLike, twist: ArrayLike, **options: Unpack[VelocityOptions]) -> VelocitySolutions:
    """`solve_velocity` for N Jacobians and twists at once; rows that meet no limit cost a few microseconds each.

    Args:
        J: (N, 6, m) joint twists (omega; v) as columns, each in any frame.
        twist: (N, 6) wanted twists in the frames of J; (6,) is the same for all.
        options: see `VelocityOptions`. `bounds` may be (lower, upper) of shape (N, m), `posture` (N, m), `point`
            (N, 3). exact, rows and tool_speed are for `solve_velocity`, one row at a time.

    Returns:
        VelocitySolutions: velocity (N, m) inside the bounds, with method and status of every row.

    Raises:
        BadInput: NaN, shapes that do not fit (the row is named), crossed bounds, an option that is refused.
        UnknownName: no such back end.
    """
    batch = _checked(J, twist, options)
    rows = Rows(batch.written())
    if rows.left:
        batch.check()
    for i in rows.left:
        rows.put(i, batch.solution(i))
    velocity, residual, _, method, status, numbers, _ = rows.written
    scale, damping, guard = numbers.T
    return VelocitySolutions(velocity, method, status, residual, scale, damping, guard, rows)


class _Batch(NamedTuple):
    """The arguments of N rows.

    Shapes and options are checked. Of numbers, the core leaves rows that `check` would refuse.
    """

    laws: tuple[VelocityLaw, VelocityLaw]  # of rows in which all joints have bounds, and of others
    twists: Array  # (N, 6, m)
    s: Array  # (N, 6)
    lower: Array  # (N, m)
    upper: Array  # (N, m)
    posture: Array | None  # (N, m), None where none is given
    points: Array | None  # (N, 3), likewise
    form: Form | CarriedMetric | None
    options: VelocityOptions  # as given

    def written(self) -> Written:
        """The answers to all rows, but for those that are left."""
        n, length = len(self.s), self.options.get("length")
        others = {
            "posture": self.posture,
            "roots": np.broadcast_to(self.form.root(), (n, 6, 6)) if isinstance(self.form, CarriedMetric) else None,
            "points": self.points,
            "lengths": None if length is None else np.full((n, 1), float(length)),
        }
        return compiled_rows(self.laws, self.twists, self.s, (self.lower, self.upper), **others)

    def check(self) -> None:
        """Look at all numbers.

        Raises:
            BadInput: NaN, sizes that cannot be computed with, crossed bounds.
        """
        sizes.usual_rows(_finite(self.twists, "J"))
        sizes.not_too_fast(_finite(self.s, "twist"))
        if self.posture is not None:
            _finite(self.posture, "posture")
        lower, upper = self.lower, self.upper
        wrong = ~(lower <= upper) | (lower == np.inf) | (upper == -np.inf)  # NaN is not below anything either
        if wrong.any():
            i, j = (int(k) for k in np.argwhere(wrong)[0])
            found = f"lower {lower[i, j]:g} and upper {upper[i, j]:g} in row {i}, joint {j}"
            raise BadInput("bounds", found, "lower <= upper, -inf and inf where there is no limit")

    def solution(self, i: int) -> VelocitySolution:
        """Row i by itself."""
        row: VelocityOptions = {**self.options, "bounds": (self.lower[i], self.upper[i])}
        if self.posture is not None:
            row["posture"] = self.posture[i]
        if self.points is not None:
            row["point"] = self.points[i]
        return solve(*problem_of(self.twists[i], self.s[i], **row))


def _checked(J: ArrayLike, twist: ArrayLike, options: VelocityOptions) -> _Batch:
    for name in REFUSED:
        if options.get(name) is not None:
            raise BadInput(name, "given for a batch", "None", "Solve these rows one by one with solve_velocity.")
    twists = _stack(J)
    n, _, m = twists.shape
    s = _rows(twist, (n, 6), "twist", "one twist a Jacobian")
    lower, upper = _box(options.get("bounds"), n, m)
    posture, point, length = options.get("posture"), options.get("point"), options.get("length")
    wanted = None if posture is None else _rows(posture, (n, m), "posture", "one joint velocity a Jacobian")
    form = form_of(options.get("form"))
    points = None if point is None or isinstance(point, str) else _rows(point, (n, 3), "point", "one point a Jacobian")
    if points is not None:
        sizes.not_too_far(_finite(points[: 1 if points.strides[0] == 0 else n], "point"))
    # Checks form, the name of a point, and length; form and a carried metric are the same for all rows.
    where = point if isinstance(point, str) else np.zeros(3)
    first = measure_of(np.eye(6), np.zeros(6), form, where, 1.0 if length is None else length)
    metric = options.get("joint_metric")
    M = None if metric is None else arrays.positive_definite(metric, m, "joint_metric")
    known(options)
    law = law_of(options, first.form, M, limited=True)
    laws = law, replace(law, damping=damping_of(options.get("damping"), limited=False))
    return _Batch(laws, twists, s, lower, upper, wanted, points, form, options)


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
