"""Exact answers, each computed twice: by one formula in 50 digits, and by another one in rational numbers.

                    in 50 digits                            |  in rational numbers
    least squares   J'(JJ')^-1 s or (J'J)^-1 J's            |  [[I, J'], [J, 0]] or [[I, J], [J', 0]], eliminated
    damped          J'(JJ' + lambda^2)^-1 s                 |  (J'J + lambda^2) x = J's
    ridge           active-set method                       |  least-index pivoting; the same for limits met
    law             see `exact.law`

If the two differ by more than 1e-12, that is an error and nothing is compared. Posture and exact rows are left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.compare.exact import NoReference, ReferenceFailure
from invariantqp.compare.laws.linear import DLS_DAMPING
from invariantqp.compare.laws.quadratic import FIXED_WEIGHT
from invariantqp.compare.method import Question, Setting
from invariantqp.errors import MissingExtra
from invariantqp.geometry.arrays import Array

try:
    import mpmath as mp
except ImportError as error:
    raise MissingExtra("mpmath", "compare") from error

from invariantqp.compare.exact.law import shipped
from invariantqp.compare.exact.linear import Way, number, ridge, ridge_box, shortest

# Digits of the first computation.
DIGITS = 50
# The largest relative difference between the two: far below any error of float64 that is reported.
AGREEMENT = 1e-12
# Least squares has no unique answer at limits; this weight makes it the shortest one, to rounding.
TIE = 1e-14


class Reference(NamedTuple):
    """An exact answer.

    Attributes:
        x: (m,) the joint velocity.
        agreement: the largest difference between the two computations, relative to the largest entry of x.
    """

    x: Array
    agreement: float


def reference(problem: str, question: Question, setting: Setting, *, limited: bool) -> Reference:
    """The exact answer to a question.

    Args:
        problem: which problem, as `Method.problem` names it.
        question: J, s and the bounds, all of them finite; without posture and exact rows.
        setting: gives what the problem depends on besides.
        limited: whether limits are met; a method that clips then answers for the same problem inside the limits.

    Returns:
        The answer, and how well the two computations of it agree.

    Raises:
        NoReference: the problem has no unique answer in this state.
        ReferenceFailure: the two computations differ by more than 1e-12.
    """
    with mp.workdps(DIGITS):
        first, second = (_LIMITED if limited else _FREE)[problem]
        try:
            x = [mp.mpf(v) for v in first(question, setting)]
        except ZeroDivisionError as error:  # mpmath raises it for a singular matrix
            raise NoReference(f"{problem}: {error}") from error
        y = [number(v) for v in second(question, setting)]
        size = max(abs(v) for v in x) or mp.mpf(1)
        agreement = float(max(abs(a - b) for a, b in zip(x, y, strict=True)) / size)
        if not agreement <= AGREEMENT:
            raise ReferenceFailure(f"{problem}: two references differ by {agreement:.1e}, more than {AGREEMENT:g}")
        return Reference(np.array([float(v) for v in x]), agreement)


# The two ways to the answer of each problem.
_ALWAYS: dict[str, tuple[Way, Way]] = {"law": shipped(), "ridge": ridge_box(FIXED_WEIGHT)}
_FREE = {**_ALWAYS, "least squares": shortest(), "damped": ridge(DLS_DAMPING**2)}
_LIMITED = {**_ALWAYS, "least squares": ridge_box(TIE), "damped": ridge_box(DLS_DAMPING**2)}
