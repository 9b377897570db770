"""The adjoint of a linear map between two spaces that each carry a symmetric form.

    <x, A* y>_M = <A x, y>_N for all x, y       A* = M^-1 A'N       J^{*h} = M^-1 J'Q_h

It takes the place of the transpose wherever lengths and angles are measured by other forms than the identity: twists by
Q_h, joint velocities by a joint metric, wrenches by Q_h^-1.

Reference: [DS] (2.12), (2.13), (2.14).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import pitch_form

# A form whose condition number is above this has no inverse that can be told from rounding.
LARGEST_CONDITION = 1e14


def form_adjoint(A: ArrayLike, domain: ArrayLike, codomain: ArrayLike) -> Array:
    """A* = M^-1 A'N, the adjoint of a map from a space with the form M to one with the form N.

    (A*)* = A, and (A B)* = B* A* where the forms between A and B are the same.

    Args:
        A: (n, m) matrix of the map.
        domain: (m, m) symmetric and not singular, M; it need not be definite.
        codomain: (n, n) symmetric, N.

    Returns:
        (m, n) matrix.

    Raises:
        BadInput: shapes, NaN, a form that is not symmetric, a singular M.

    Reference: [DS] (2.12), (2.13).
    """
    a = arrays.array(A, "A", "a matrix")
    if a.ndim != 2:
        raise BadInput("A", f"shape {a.shape}", "shape (n, m)")
    n, m = a.shape
    M, N = arrays.symmetric(domain, m, "domain"), arrays.symmetric(codomain, n, "codomain")
    if not np.linalg.cond(M) <= LARGEST_CONDITION:
        raise BadInput("domain", "a singular form", "one that pairs no vector to zero with all others")
    return np.asarray(np.linalg.solve(M, arrays.matrix(a, (n, m), "A").T.dot(N)))


def h_adjoint(J: ArrayLike, h: float, *, joint_metric: ArrayLike | None = None) -> Array:
    """J^{*h} = M^-1 J'Q_h, the adjoint of a Jacobian: x'M (J^{*h} s) = (J x)'Q_h s.

    Q_h s is the wrench that pairs with twists as Q_h does, so J'Q_h s are the torques that it asks of the joints.

    Args:
        J: (6, m) joint twists as columns.
        h: pitch [length/rad], or inf for half the Killing form.
        joint_metric: (m, m) or (m,) positive definite metric M on joint velocities; None is the identity.

    Returns:
        (m, 6) matrix; the adjoint of Ad J, in another frame, is J^{*h} Ad^-1.

    Raises:
        BadInput: shapes, NaN, a metric that is not positive definite.

    Reference: [DS] (2.14).
    """
    twists = arrays.columns(J)
    images: Array = twists.T.dot(pitch_form(h))
    if joint_metric is None:
        return images
    M = arrays.positive_definite(joint_metric, twists.shape[1], "joint_metric")
    return np.asarray(np.linalg.solve(M, images))
