"""Exact answers to the problems that the methods solve, in 50 digits.

least squares   J'(JJ')^-1 s or (J'J)^-1 J's
damped          J'(JJ' + lambda^2)^-1 s
ridge           active-set method; the same for limits met
law             see `exact.law`

Posture and exact rows are left out. Tests compute all of them again by other formulas in rational numbers.
"""

from __future__ import annotations

import numpy as np

from invariantqp.compare.exact import NoReference
from invariantqp.compare.laws.linear import DLS_DAMPING
from invariantqp.compare.laws.quadratic import FIXED_WEIGHT
from invariantqp.compare.method import Question, Setting
from invariantqp.extras import optional
from invariantqp.geometry.arrays import Array

with optional("compare", "mpmath"):
    import mpmath as mp

from invariantqp.compare.exact.law import shipped
from invariantqp.compare.exact.linear import Way, ridge, ridge_box, shortest

# Digits of the computation.
DIGITS = 50
# Least squares has no unique answer at limits; this weight makes it the shortest one, to rounding.
TIE = 1e-14


def reference(problem: str, question: Question, setting: Setting, *, limited: bool) -> Array:
    """The exact answer (m,) to a question without posture and exact rows, for a problem as `Method.problem` names it.

    Bounds are finite. Where limits are met, `limited`, a method that clips answers for the problem inside the limits.

    Raises:
        NoReference: the problem has no unique answer in this state.
        ReferenceFailure: the optimality conditions do not hold.
    """
    with mp.workdps(DIGITS):
        try:
            x = (_LIMITED if limited else _FREE)[problem](question, setting)
        except ZeroDivisionError as error:  # mpmath raises it for a singular matrix
            raise NoReference(f"{problem}: {error}") from error
        return np.array([float(v) for v in x])


# The way to the answer of each problem.
_ALWAYS: dict[str, Way] = {"law": shipped, "ridge": ridge_box(FIXED_WEIGHT)}
_FREE = {**_ALWAYS, "least squares": shortest, "damped": ridge(DLS_DAMPING**2)}
_LIMITED = {**_ALWAYS, "least squares": ridge_box(TIE), "damped": ridge_box(DLS_DAMPING**2)}
