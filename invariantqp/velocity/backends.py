"""QP solvers: minimise 1/2 z'Hz - c'z over lower <= Cz <= upper, by DAQP or any solver of qpsolvers.

Problems are scaled to O(1), because solvers' tolerances are absolute. Solutions are checked, and exceptions of solvers
become SolverFailure. This is the only file that imports a solver.
"""

from __future__ import annotations

import difflib
import warnings
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import daqp
import numpy as np

from invariantqp.errors import BadInput, InvariantQPError, UnknownName
from invariantqp.extras import require
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.geometry.sizes import LARGEST

# Stands for infinity in a scaled problem.
UNBOUNDED = LARGEST
# A larger violation of the scaled bounds is a failure.
FEASIBILITY_TOLERANCE = 1e-7
# Far below that, above the rounding of the active-set method for cond(H) = 1e6.
DAQP_TOLERANCE = 1e-10
# Settings of solvers at this tolerance, or this one where they reach no more; defaults leave errors up to 0.3.
TIGHT, REACHED = DAQP_TOLERANCE, NEGLIGIBLE
SETTINGS: dict[str, dict[str, Any]] = {
    "osqp": {"eps_abs": REACHED, "eps_rel": REACHED, "max_iter": 100_000},
    "proxqp": {"eps_abs": TIGHT, "eps_rel": 0.0},
    "piqp": {"eps_abs": TIGHT, "eps_rel": TIGHT},
    "clarabel": {"tol_feas": TIGHT, "tol_gap_abs": TIGHT, "tol_gap_rel": TIGHT},
    "highs": {"primal_feasibility_tolerance": REACHED, "dual_feasibility_tolerance": REACHED},
    "scs": {"eps_abs": REACHED, "eps_rel": REACHED},
}


class BoxQP(NamedTuple):
    """Minimise 1/2 z'Hz - c'z over lower <= Cz <= upper; C = None is the identity. All O(1).

    Attributes:
        H: (n, n) positive definite.
        c: (n,).
        lower: (k,) at least -1e30, which stands for no limit.
        upper: (k,) at most 1e30.
        C: (k, n) rows, or None.
    """

    H: Array
    c: Array
    lower: Array
    upper: Array
    C: Array | None

    @classmethod
    def of(cls, H: Array, c: Array, lower: Array, upper: Array, C: Array | None) -> BoxQP:
        """For limits that may be infinite."""
        return cls(H, c, np.maximum(lower, -UNBOUNDED), np.minimum(upper, UNBOUNDED), C)


class SolverFailure(InvariantQPError):
    """A solver returned no usable solution; raised by `Backend.solve`, and reported as status "held"."""

    def __init__(self, solver: str, reason: str) -> None:
        super().__init__(f"{solver}: {reason}")


class Backend(Protocol):
    """A solver with a name. `solve` returns z (n,) or raises SolverFailure."""

    @property
    def name(self) -> str:
        """The name that solutions report."""
        ...

    def solve(self, qp: BoxQP) -> Array:
        """The minimiser."""
        ...


@dataclass(frozen=True)
class Daqp:
    """DAQP: dual active set, exact to rounding, stateless."""

    name: str = "daqp"

    def solve(self, qp: BoxQP) -> Array:
        """The minimiser."""
        rows = np.empty((0, len(qp.c))) if qp.C is None else qp.C
        z, _, flag, _ = daqp.solve(qp.H, -qp.c, rows, qp.upper, qp.lower, primal_tol=DAQP_TOLERANCE)
        if flag <= 0:
            raise SolverFailure("daqp", f"exit flag {flag}")
        return np.asarray(z)


@dataclass(frozen=True)
class QpSolvers:
    """Any solver that qpsolvers knows and this machine has, at the tightest tolerances it takes."""

    name: str

    def solve(self, qp: BoxQP) -> Array:
        """The minimiser."""
        import qpsolvers
        from scipy import sparse

        H: Any = qp.H
        C: Any = qp.C
        if self.name in qpsolvers.sparse_solvers:
            H = sparse.csc_matrix(H)
            C = None if C is None else sparse.csc_matrix(C)
        below, above = qp.lower > -UNBOUNDED, qp.upper < UNBOUNDED  # not every solver takes 1e30 for infinity
        if C is None:
            lb, ub = np.where(below, qp.lower, -np.inf), np.where(above, qp.upper, np.inf)
            problem = qpsolvers.Problem(H, -qp.c, lb=lb, ub=ub)
        else:
            stack = sparse.vstack if sparse.issparse(C) else np.vstack
            sides = np.concatenate((qp.upper[above], -qp.lower[below]))
            problem = qpsolvers.Problem(H, -qp.c, stack([C[above], -C[below]]), sides)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the solver's status is checked below
            solution = qpsolvers.solve_problem(problem, solver=self.name, **SETTINGS.get(self.name, {}))
        if not solution.found or solution.x is None:
            raise SolverFailure(self.name, "no solution found")
        return np.asarray(solution.x)


def backend_of(backend: Backend | str) -> Backend:
    """The back end of a name, or the given one.

    Raises:
        UnknownName: no solver of that name is installed; the near ones are listed.
        MissingExtra: a solver other than DAQP without the extra `solvers`.
    """
    if not isinstance(backend, str):
        if not hasattr(backend, "solve") or not hasattr(backend, "name"):
            raise BadInput("backend", f"{type(backend).__name__}", "a solver's name or an object with name and solve")
        return backend
    if backend == "daqp":
        return Daqp()
    require("solvers", "osqp" if backend == "osqp" else "qpsolvers")
    import qpsolvers

    known = sorted({"daqp", "osqp", *qpsolvers.available_solvers})
    if backend not in known:
        raise UnknownName("QP back end", backend, difflib.get_close_matches(backend, known), known)
    return QpSolvers(backend)


def solve_checked(backend: Backend, qp: BoxQP) -> Array:
    """The checked solution z (n,) of a back end.

    Raises:
        SolverFailure: an exception of the solver, or a solution of wrong shape, not finite, or outside the bounds.
    """
    try:
        with np.errstate(all="ignore"):  # the solution is checked instead
            z = np.asarray(backend.solve(qp), dtype=np.float64)
    except SolverFailure:
        raise
    except Exception as error:  # becomes a status
        raise SolverFailure(backend.name, f"{type(error).__name__}: {error}") from error
    if z.shape != qp.c.shape:
        raise SolverFailure(backend.name, f"answer of shape {z.shape}, not {qp.c.shape}")
    if not np.isfinite(z).all():
        raise SolverFailure(backend.name, "answer that is not finite")
    value = z if qp.C is None else qp.C.dot(z)
    excess = max(float((qp.lower - value).max()), float((value - qp.upper).max()))
    if excess > FEASIBILITY_TOLERANCE:
        raise SolverFailure(backend.name, f"answer {excess:.2g} outside its scaled bounds")
    return z
