"""A speed limit as the second-order cone it is, by CVXPY with Clarabel: the only file that imports cvxpy.

    minimise 1/2 |U z|^2 - c'z   over   lower <= A z <= upper,   |start + J z| <= limit,     H = U'U

The problem is written once for each size, in parameters (DPP), and kept: later ticks change numbers only.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from invariantqp.errors import MissingExtra
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.limits.rows import Polytope
from invariantqp.velocity.qp.backends import Solved, SolverFailure
from invariantqp.velocity.qp.boxqp import BoxQP

# What Clarabel can be asked for on a problem scaled to O(1).
TIGHT = {"tol_feas": 1e-11, "tol_gap_abs": 1e-12, "tol_gap_rel": 1e-12}
# A limit further away than this many times the unit of z is as good as none.
FAR = 1e6
# Problems kept: a loop has a handful of sizes (with and without exact rows), not more.
KEPT = 8


def _need_cvxpy() -> None:
    try:
        import cvxpy  # noqa: F401 (is it there?)
    except ImportError as error:
        raise MissingExtra("cvxpy", "cvxpy") from error


@dataclass(eq=False)
class ConeProgram:
    """CVXPY problems kept between ticks, one a size; one owner, one loop.

    Raises:
        MissingExtra: CVXPY is not installed.
    """

    _kept: dict[tuple[int, int], Any] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        _need_cvxpy()

    def __getstate__(self) -> dict[str, Any]:
        """What a copy or a pickle is made from: the kept problems have one owner."""
        return {**vars(self), "_kept": {}}

    def minimise(self, H: Array, c: Array, limits: Polytope, J: Array, start: Array, limit: float) -> Solved:
        """The optimum.

        Raises:
            SolverFailure: none was found; `.infeasible` where the solver says there is none.
        """
        size = float(np.abs(H).max())
        U = np.linalg.cholesky(H / size).T
        steepest = float(np.abs(J).max())
        # z in units of what the speed allows, or where it allows anything, of what it would be without limits.
        unit = limit / steepest if steepest > 0.0 else float(np.abs(np.linalg.solve(H, c)).max()) or 1.0
        A = np.eye(len(c)) if limits.A is None else limits.A
        reach = np.maximum(np.abs(A).max(axis=1), np.finfo(float).tiny)
        problem, p, z = self._problem(len(c), len(A))
        p["U"].value = U
        p["c"].value = c / (size * unit)
        p["A"].value = A / reach[:, None]
        p["lower"].value = np.maximum(limits.lower / (reach * unit), -FAR)
        p["upper"].value = np.minimum(limits.upper / (reach * unit), FAR)
        p["J"].value = J * (unit / limit)
        p["start"].value = start / limit
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what it thinks of the problem is in its status
            try:
                problem.solve(solver="CLARABEL", warm_start=False, **TIGHT)
            except Exception as error:  # whatever it throws becomes a status
                raise SolverFailure("cvxpy", f"{type(error).__name__}: {error}") from error
        if z.value is None or not np.isfinite(z.value).all():
            raise SolverFailure("cvxpy", str(problem.status), infeasible="infeasible" in str(problem.status))
        return Solved(unit * np.asarray(z.value), "cvxpy", "")

    def _problem(self, n: int, k: int) -> tuple[Any, dict[str, Any], Any]:
        import cvxpy as cp

        if (n, k) not in self._kept:
            if len(self._kept) >= KEPT:
                self._kept.pop(next(iter(self._kept)))
            shapes = {"U": (n, n), "c": n, "A": (k, n), "lower": k, "upper": k, "J": (3, n), "start": 3}
            p = {name: cp.Parameter(shape, name=name) for name, shape in shapes.items()}
            z = cp.Variable(n)
            cost = 0.5 * cp.sum_squares(p["U"] @ z) - p["c"] @ z
            cone = cp.norm(p["start"] + p["J"] @ z, 2) <= 1.0
            problem = cp.Problem(cp.Minimize(cost), [p["A"] @ z <= p["upper"], p["A"] @ z >= p["lower"], cone])
            self._kept[n, k] = (problem, p, z)
        kept: tuple[Any, dict[str, Any], Any] = self._kept[n, k]
        return kept


@dataclass(eq=False)
class Cvxpy:
    """CVXPY as a back end for problems without a cone, kept as `ConeProgram` keeps its own.

    Raises:
        MissingExtra: CVXPY is not installed.
    """

    name: str = "cvxpy"
    _kept: dict[tuple[int, int], Any] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        _need_cvxpy()

    def __getstate__(self) -> dict[str, Any]:
        """What a copy or a pickle is made from: the kept problems have one owner."""
        return {**vars(self), "_kept": {}}

    def solve(self, qp: BoxQP) -> Array:
        """The minimiser."""
        C = np.eye(len(qp.c)) if qp.C is None else qp.C
        problem, p, z = self._problem(len(qp.c), len(C))
        p["U"].value = np.linalg.cholesky(qp.H).T
        p["c"].value, p["C"].value = qp.c, C
        p["lower"].value, p["upper"].value = np.maximum(qp.lower, -FAR), np.minimum(qp.upper, FAR)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what it thinks of the problem is in its status
            problem.solve(solver="CLARABEL", warm_start=False, **TIGHT)
        if z.value is None:
            raise SolverFailure(self.name, str(problem.status), infeasible="infeasible" in str(problem.status))
        return np.asarray(z.value)

    def _problem(self, n: int, k: int) -> tuple[Any, dict[str, Any], Any]:
        import cvxpy as cp

        if (n, k) not in self._kept:
            if len(self._kept) >= KEPT:
                self._kept.pop(next(iter(self._kept)))
            shapes = {"U": (n, n), "c": n, "C": (k, n), "lower": k, "upper": k}
            p = {name: cp.Parameter(shape, name=name) for name, shape in shapes.items()}
            z = cp.Variable(n)
            cost = 0.5 * cp.sum_squares(p["U"] @ z) - p["c"] @ z
            problem = cp.Problem(cp.Minimize(cost), [p["C"] @ z <= p["upper"], p["C"] @ z >= p["lower"]])
            self._kept[n, k] = (problem, p, z)
        kept: tuple[Any, dict[str, Any], Any] = self._kept[n, k]
        return kept
