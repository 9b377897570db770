"""Exact answers to compare with, each made twice, by formulas and arithmetics that share nothing: 50 digits, fractions.

    least squares   J'(JJ')^-1 s or (J'J)^-1 J's            |  [[I, J'], [J, 0]] or [[I, J], [J', 0]], eliminated
    damped, ridge   J'(JJ' + lambda^2)^-1 s                 |  (J'J + lambda^2) x = J's
    pitch           (J'QJ)^-1 J'Qs                          |  [[Q^-1, J], [J', 0]]
    filter          V diag(mu / (mu^2 + lambda^2)) V'g      |  (G^2 + lambda^2) x = G g
    box             V diag(sqrt(mu^2 + lambda^2)) V'        |  the matrix square root of G^2 + lambda^2
                    active set, certified                   |  least-index pivoting

An answer whose two makings differ by more than 1e-12 is an error, and nothing is compared.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.compare.laws.damped import DLS_DAMPING
from invariantqp.compare.laws.qp_backends import QP_DAMPING
from invariantqp.compare.measure.states import Question
from invariantqp.compare.methods import Problem, Setting
from invariantqp.compare.sweep import NoReference, ReferenceFailure
from invariantqp.errors import MissingExtra
from invariantqp.geometry.arrays import Array

try:
    import mpmath as mp
except ImportError as error:
    raise MissingExtra("mpmath", "compare") from error

from invariantqp.compare.exact.filter import filtered, filtered_box
from invariantqp.compare.exact.linear import Way, number, ridge, ridge_box, stationary, weighted

DIGITS = 50
AGREEMENT = 1e-12


class Reference(NamedTuple):
    """The exact answer x (m,), and by how much, relative to its largest entry, the two ways to it differ."""

    x: Array
    agreement: float


def reference(problem: Problem, asked: Question, setting: Setting) -> Reference:
    """The exact answer to one of the problems.

    Raises:
        NoReference: it has no unique answer here.
        ReferenceFailure: the two ways to it do not agree to 1e-12.
    """
    with mp.workdps(DIGITS):
        first, second = _WAYS[problem]
        try:
            x = [mp.mpf(v) for v in first(asked, setting)]
        except ZeroDivisionError as error:  # what mpmath calls a singular matrix
            raise NoReference(f"{problem}: {error}") from error
        y = [number(v) for v in second(asked, setting)]
        size = max(abs(v) for v in x) or mp.mpf(1)
        agreement = float(max(abs(a - b) for a, b in zip(x, y, strict=True)) / size)
        if not agreement <= AGREEMENT:
            raise ReferenceFailure(f"{problem}: two references differ by {agreement:.1e}, more than {AGREEMENT:g}")
        return Reference(np.array([float(v) for v in x]), agreement)


_WAYS: dict[str, tuple[Way, Way]] = {
    "pitch": stationary("pitch"),
    "least squares": stationary("least squares"),
    "weighted": weighted(),
    "ridge": ridge(QP_DAMPING),
    "damped": ridge(DLS_DAMPING**2),
    "least squares box": ridge_box(QP_DAMPING),
    "damped box": ridge_box(DLS_DAMPING**2),
    "filter": filtered("filter"),
    "adaptive": filtered("adaptive"),
    "inertia": filtered("inertia"),
    "adaptive box": filtered_box("adaptive"),
    "inertia box": filtered_box("inertia"),
}
