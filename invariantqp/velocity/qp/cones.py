"""A quadratic with a speed limit as the second-order cone it is, by CVXPY with Clarabel: the only file that imports it.

    minimise 1/2 |K z|^2 - c'z   over   lower <= A z <= upper,   |start + J z| <= 1

The problem is written once for each size, in parameters (DPP), and kept: later ticks change numbers only.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from invariantqp.extras import optional
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.qp.backends import SolverFailure
from invariantqp.velocity.qp.scaling import BoxQP

# What Clarabel can be asked for on a problem scaled to O(1).
TIGHT = {"tol_feas": 1e-11, "tol_gap_abs": 1e-12, "tol_gap_rel": 1e-12}
# A limit further away than this many times the unit of z is as good as none.
FAR = 1e6
# Problems kept: a loop has a handful of sizes (with and without exact rows), not more.
KEPT = 8


@dataclass(eq=False)
class Cvxpy:
    """CVXPY as a back end, its problems kept between ticks, one a size; one owner, one loop.

    Raises:
        MissingExtra: CVXPY is not installed.
    """

    name: str = "cvxpy"
    _kept: dict[tuple[int, int], Any] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        with optional("cvxpy", "cvxpy"):
            import cvxpy  # noqa: F401 (is it there?)

    def __getstate__(self) -> dict[str, Any]:
        """What a copy or a pickle is made from: the kept problems have one owner."""
        return {**vars(self), "_kept": {}}

    def solve(self, qp: BoxQP) -> Array:
        """The minimiser, without a speed limit."""
        return self.solve_in_cone(qp, np.zeros((3, len(qp.c))), np.zeros(3))

    def solve_in_cone(self, qp: BoxQP, J: Array, start: Array) -> Array:
        """The minimiser with |start + J z| <= 1.

        Raises:
            SolverFailure: none was found; `.infeasible` where the solver says there is none.
        """
        C = np.eye(len(qp.c)) if qp.C is None else qp.C
        problem, p, z = self._problem(len(qp.c), len(C))
        p["K"].value = np.linalg.cholesky(qp.H).T
        p["c"].value, p["A"].value = qp.c, C
        p["lower"].value, p["upper"].value = np.maximum(qp.lower, -FAR), np.minimum(qp.upper, FAR)
        p["J"].value, p["start"].value = J, start
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # what it thinks of the problem is in its status
            try:
                problem.solve(solver="CLARABEL", warm_start=False, **TIGHT)
            except Exception as error:  # whatever it throws becomes a status
                raise SolverFailure(self.name, f"{type(error).__name__}: {error}") from error
        if z.value is None or not np.isfinite(z.value).all():
            raise SolverFailure(self.name, str(problem.status), infeasible="infeasible" in str(problem.status))
        return np.asarray(z.value)

    def _problem(self, n: int, k: int) -> tuple[Any, dict[str, Any], Any]:
        import cvxpy as cp

        if (n, k) not in self._kept:
            if len(self._kept) >= KEPT:
                self._kept.pop(next(iter(self._kept)))
            shapes = {"K": (n, n), "c": n, "A": (k, n), "lower": k, "upper": k, "J": (3, n), "start": 3}
            p = {name: cp.Parameter(shape, name=name) for name, shape in shapes.items()}
            z = cp.Variable(n)
            cost = 0.5 * cp.sum_squares(p["K"] @ z) - p["c"] @ z
            cone = cp.norm(p["start"] + p["J"] @ z, 2) <= 1.0
            problem = cp.Problem(cp.Minimize(cost), [p["A"] @ z <= p["upper"], p["A"] @ z >= p["lower"], cone])
            self._kept[n, k] = (problem, p, z)
        kept: tuple[Any, dict[str, Any], Any] = self._kept[n, k]
        return kept
