"""Quadratic programs, solved by established solvers: minimise 1/2 z'Hz - c'z over lower <= Cz <= upper.

DAQP by default, OSQP with a workspace kept between calls, anything else through qpsolvers. The problem comes scaled to
O(1) (`scaling`), because solvers' tolerances are absolute; the answer is checked; a solver's own exception never gets
out. This is the only file that imports a solver.
"""

from __future__ import annotations

import difflib
import warnings
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple, Protocol

import daqp
import numpy as np

from invariantqp.errors import BadInput, InvariantQPError, UnknownName
from invariantqp.extras import require
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.qp.scaling import UNBOUNDED, BoxQP

# After scaling, bounds and H are O(1). An answer may leave its bounds by this much and is clipped; more is a failure.
FEASIBILITY_TOLERANCE = 1e-7
# Far below the feasibility tolerance, above what active-set arithmetic on cond(H) = 1e6 can lose.
DAQP_TOLERANCE = 1e-10
# OSQP stops on absolute residuals; 1e-9 on a scaled problem is 1e-9 of a velocity limit.
OSQP_TOLERANCE = 1e-9
OSQP_ITERATIONS = 20_000
# qpsolvers' defaults leave errors up to 0.3 on ill-conditioned problems; these are what the solvers can be asked for.
TIGHT: dict[str, dict[str, Any]] = {
    "proxqp": {"eps_abs": 1e-10, "eps_rel": 0.0},
    "piqp": {"eps_abs": 1e-10, "eps_rel": 1e-10},
    "clarabel": {"tol_feas": 1e-10, "tol_gap_abs": 1e-10, "tol_gap_rel": 1e-10},
    "highs": {"primal_feasibility_tolerance": 1e-9, "dual_feasibility_tolerance": 1e-9},
    "scs": {"eps_abs": 1e-9, "eps_rel": 1e-9},
}


class SolverFailure(InvariantQPError):
    """A solver did not return a usable answer. Never leaves the library: it becomes a retry, then a status.

    Attributes:
        infeasible: whether the solver says that no point satisfies the bounds.
    """

    def __init__(self, solver: str, reason: str, *, infeasible: bool = False) -> None:
        self.infeasible = infeasible
        super().__init__(f"{solver}: {reason}")


class Backend(Protocol):
    """A solver with a name. `solve` returns z (n,) or raises SolverFailure."""

    @property
    def name(self) -> str:
        """How statuses call it."""
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
            raise SolverFailure(self.name, f"exit flag {flag}", infeasible=flag == -1)
        return np.asarray(z)


@cache
def _upper_triangle(n: int) -> tuple[Any, Any]:
    """Rows and columns of the upper triangle, column by column, as OSQP keeps its values."""
    column, row = np.tril_indices(n)
    return row, column


@dataclass
class Osqp:
    """OSQP with its workspace kept between calls of the same size, warm started; one owner, one loop.

    A run that does not reach its tolerances drops the workspace, so that no failure outlives its tick.

    Attributes:
        name: how statuses call it.
        tolerance: its absolute and relative tolerance, on the scaled problem.
        polishing: whether it solves once more on the active set it guessed.
        warm: whether it starts from its last answer.
    """

    name: str = "osqp"
    tolerance: float = OSQP_TOLERANCE
    polishing: bool = False
    warm: bool = True
    _workspace: Any = field(default=None, init=False, repr=False)
    _shape: tuple[int, int, bool] = field(default=(0, 0, False), init=False, repr=False)

    def __post_init__(self) -> None:
        """Refuse to be made where OSQP is not installed."""
        require("solvers", "osqp")

    def __getstate__(self) -> dict[str, Any]:
        """What a copy or a pickle is made from: the settings, without the workspace, which has one owner."""
        return {**vars(self), "_workspace": None}

    def solve(self, qp: BoxQP) -> Array:
        """The minimiser."""
        import osqp  # 90 ms to import: only when this solver is asked for
        from scipy import sparse

        n = len(qp.c)
        k = n if qp.C is None else len(qp.C)
        row, column = _upper_triangle(n)
        if self._workspace is None or self._shape != (k, n, qp.C is None):
            C = np.eye(n) if qp.C is None else qp.C
            # A dense pattern (explicit zeros kept), so that later values fit the workspace.
            P = sparse.csc_matrix((qp.H[row, column], (row, column)), shape=(n, n))
            A = sparse.csc_matrix((C.T.ravel(), np.tile(np.arange(k), n), np.arange(n + 1) * k), shape=(k, n))
            self._workspace = osqp.OSQP()
            self._shape = (k, n, qp.C is None)
            settings = {"eps_abs": self.tolerance, "eps_rel": self.tolerance, "max_iter": OSQP_ITERATIONS}
            settings |= {"warm_starting": self.warm, "polishing": self.polishing, "verbose": False}
            self._workspace.setup(P, -qp.c, A, qp.lower, qp.upper, **settings)
        else:
            rows = {} if qp.C is None else {"Ax": qp.C.T.ravel()}
            self._workspace.update(Px=qp.H[row, column], q=-qp.c, l=qp.lower, u=qp.upper, **rows)
        result = self._workspace.solve(raise_error=False)
        status = str(result.info.status)
        if status != "solved":
            self._workspace = None
            raise SolverFailure(self.name, status, infeasible="primal infeasible" in status)
        return np.asarray(result.x)


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
            solution = qpsolvers.solve_problem(problem, solver=self.name, **TIGHT.get(self.name, {}))
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
    if backend == "osqp":
        return Osqp()
    require("solvers", "qpsolvers")
    import qpsolvers

    known = sorted({"daqp", "osqp", *qpsolvers.available_solvers})
    if backend not in known:
        raise UnknownName("QP back end", backend, difflib.get_close_matches(backend, known), known)
    return QpSolvers(backend)


def _answer(backend: Backend, qp: BoxQP) -> Array:
    try:
        with np.errstate(all="ignore"):  # what a solver does inside is checked by its answer
            z = np.asarray(backend.solve(qp), dtype=np.float64)
    except SolverFailure:
        raise
    except Exception as error:  # whatever a solver throws becomes a status
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


class Found(NamedTuple):
    """The minimiser z (n,) of the scaled problem, the solver, and what went wrong before ("" if nothing)."""

    z: Array
    backend: str
    trouble: str


def solved(backend: Backend, qp: BoxQP) -> Found:
    """The answer of `backend` or, if it fails, of DAQP.

    Raises:
        SolverFailure: neither found an answer; `.infeasible` when a solver says that there is none.
    """
    try:
        return Found(_answer(backend, qp), backend.name, "")
    except SolverFailure as failure:
        if backend.name == "daqp":
            raise
        first = failure
    try:
        return Found(_answer(Daqp(), qp), "daqp", str(first))
    except SolverFailure as failure:
        infeasible = failure.infeasible or first.infeasible
        raise SolverFailure("every solver", f"{first}; {failure}", infeasible=infeasible) from failure
