"""Many twists at once: what is free of limits is solved for all rows together, the rest row by row as a tick is.

    x_i = x_p + J_i'(J_i J_i')^-1 (s_i - J_i x_p)     six joints or more, far from singular
    x_i = V_i diag(1 / mu_i) V_i'g_i                  otherwise, where nothing is damped

A row that meets a limit, needs damping, or whose guard has to act goes through `solve` by itself, so every row is what
`solve_velocity` says of it, to rounding: for maps over joint ranges, and rollouts.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.damping import Damping, damping_of
from invariantqp.velocity.forms import CarriedMetric, Form, PitchForm, form_of
from invariantqp.velocity.free_rows import free_rows
from invariantqp.velocity.guard import Guard
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.limits.box import Bounds
from invariantqp.velocity.qp.backends import Backend, backend_of
from invariantqp.velocity.request import BLIND, UnitsMixed, guard_of, units_mix
from invariantqp.velocity.solution import VelocitySolution
from invariantqp.velocity.solve import solve


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
        slow: {row: solution} of the rows that were solved by themselves.
        note: what every other row's reason says, "" for nothing.
    """

    velocity: Array
    method: NDArray[np.str_]
    status: NDArray[np.str_]
    residual: Array
    scale: Array
    damping: Array
    guard: Array
    slow: dict[int, VelocitySolution]
    note: str = ""

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
        return VelocitySolution(x, str(self.method[i]), str(self.status[i]), self.note, (), r, 1.0, 0.0, 0.0, "")

    @property
    def reason(self) -> list[str]:
        """Why, in words, row by row."""
        return [self.slow[i].reason if i in self.slow else self.note for i in range(len(self))]

    @property
    def active(self) -> list[tuple[int, ...]]:
        """Joints at a bound, row by row."""
        return [self.slow[i].active if i in self.slow else () for i in range(len(self))]


def solve_velocities(
    J: ArrayLike,
    twist: ArrayLike,
    *,
    form: Form | float | None = None,
    damping: Damping | float | None = None,
    bounds: Bounds | tuple[ArrayLike, ArrayLike] | None = None,
    joint_metric: ArrayLike | None = None,
    backend: Backend | str = "daqp",
    guard: Guard | bool = True,
    posture: ArrayLike | None = None,
) -> VelocitySolutions:
    """`solve_velocity` for N Jacobians and twists at once; rows that meet no limit cost a few microseconds each.

    Exact rows, limit rows and tool-speed limits are for `solve_velocity`, one row at a time. With fewer than six joints
    and no form named, each row's own form is looked for by itself, which takes as long as `solve_velocity`.

    Args:
        J: (N, 6, m) joint twists (omega; v) as columns, each in any frame.
        twist: (N, 6) wanted twists in the frames of J; (6,) is the same for all.
        form: as in `solve_velocity`; None is each row's own.
        damping: as in `solve_velocity`.
        bounds: one Bounds for all rows, or (lower, upper) arrays of shape (N, m).
        joint_metric: as in `solve_velocity`.
        backend: as in `solve_velocity`.
        guard: as in `solve_velocity`.
        posture: (m,) or (N, m) joint velocity wanted where the twist leaves joints free.

    Returns:
        VelocitySolutions: velocity (N, m) inside the bounds, with method and status of every row.

    Raises:
        BadInput: NaN, shapes that do not fit (the row is named), crossed bounds.
        UnknownName: no such back end.
    """
    twists = _stack(J)
    n, _, m = twists.shape
    s = _rows(twist, (n, 6), "twist", "one twist a Jacobian")
    lower, upper = _box(bounds, n, m)
    metric = None if joint_metric is None else arrays.positive_definite(joint_metric, m, "joint_metric")
    wanted = None if posture is None else _rows(posture, (n, m), "posture", "one joint velocity a Jacobian")
    if metric is None and any(units_mix(row) for row in _mixed(twists)):
        warnings.warn(UnitsMixed.ADVICE, UnitsMixed, stacklevel=2)
    fixed = None if form is None else form_of(form, np.empty((6, 0)))
    law = VelocityLaw(
        form=fixed or PitchForm(1.0),
        damping=damping_of(damping),
        guard=guard_of(guard),
        metric=metric,
        backend=backend_of(backend),
    )
    done, x = free_rows(law, twists, s, (lower, upper), wanted, own_form=fixed is None)
    residual = s - np.einsum("nij,nj->ni", twists, x)
    method, status = np.full(n, "closed-form", dtype="U11"), np.full(n, "ok", dtype="U8")
    scale, lambdas, blends = np.ones(n), np.zeros(n), np.zeros(n)
    slow: dict[int, VelocitySolution] = {}
    for i in np.flatnonzero(~done).tolist():
        row = twists[i], s[i], lower[i], upper[i]
        solution = solve(
            law if fixed is not None else _own_law(law, row[0], row[1]),
            Demand(*row, posture=None if wanted is None else wanted[i]),
        )
        slow[i] = solution
        x[i], residual[i], method[i], status[i] = (
            solution.velocity,
            solution.residual,
            solution.method,
            solution.status,
        )
        scale[i], lambdas[i], blends[i] = solution.scale, solution.damping, solution.guard
    return VelocitySolutions(x, method, status, residual, scale, lambdas, blends, slow, law.note)


def _own_law(law: VelocityLaw, J: Array, s: Array) -> VelocityLaw:
    own = form_of(None, J, s)
    return replace(law, form=own, note=BLIND if isinstance(own, CarriedMetric) else "")


def _stack(J: ArrayLike) -> Array:
    expected = "shape (N, 6, m), m >= 1: joint twists as columns, angular part first"
    a = arrays.array(J, "J", expected)
    if a.ndim != 3 or a.shape[1] != 6 or a.shape[2] == 0:
        remedy = "One Jacobian is for solve_velocity." if a.ndim == 2 else ""
        raise BadInput("J", f"shape {a.shape}", expected, remedy)
    return _finite(a, "J")


def _rows(value: ArrayLike, shape: tuple[int, int], argument: str, expected: str) -> Array:
    a = arrays.array(value, argument, f"shape {shape}, {expected}")
    if a.shape == shape[1:]:
        a = np.broadcast_to(a, shape)
    if a.shape != shape:
        raise BadInput(argument, f"shape {a.shape}", f"shape {shape}, {expected}, or {shape[1:]} for all")
    return _finite(a, argument)


def _finite(a: Array, argument: str) -> Array:
    if not np.isfinite(a).all():
        row = int(np.argwhere(~np.isfinite(a))[0][0])
        raise BadInput(argument, f"NaN or infinity in row {row}", "finite numbers", "Check where it was computed.")
    return a


def _box(bounds: Bounds | tuple[ArrayLike, ArrayLike] | None, n: int, m: int) -> tuple[Array, Array]:
    if bounds is None:
        return np.full((n, m), -np.inf), np.full((n, m), np.inf)
    if isinstance(bounds, Bounds):
        lower, upper = np.asarray(bounds.lower), np.asarray(bounds.upper)
        if len(lower) != m:
            raise BadInput("bounds", f"{len(lower)} limits", f"{m}, one for each column of J")
        return np.broadcast_to(lower, (n, m)), np.broadcast_to(upper, (n, m))
    if not isinstance(bounds, (tuple, list)) or len(bounds) != 2:
        raise BadInput("bounds", type(bounds).__name__, "Bounds(lower, upper), or (lower, upper) of shape (N, m)")
    sides = []
    for name, value in zip(("lower", "upper"), bounds, strict=True):
        a = arrays.array(value, name, f"limits of shape {(n, m)}")
        if a.shape != (n, m):
            raise BadInput(name, f"shape {a.shape}", f"shape {(n, m)}, one row a Jacobian")
        sides.append(a)
    low, high = sides
    wrong = ~(low <= high) | (low == np.inf) | (high == -np.inf)  # NaN is not below anything either
    if wrong.any():
        i, j = (int(k) for k in np.argwhere(wrong)[0])
        found = f"lower {low[i, j]:g} and upper {high[i, j]:g} in row {i}, joint {j}"
        raise BadInput("bounds", found, "lower <= upper, -inf and inf where there is no limit")
    return low, high


def _mixed(twists: Array) -> Array:
    """The rows in which some joint does not turn: the only ones whose units can mix."""
    still = (twists[:, :3] == 0.0).all(axis=1).any(axis=1)
    return np.asarray(twists[still])
