"""Whether a matrix X is an h-pseudoinverse of J, by the four conditions that say what one is.

    (hP1) J X J = J     (hP2) X J X = X     (hP3) (J X)^{*h} = J X     (hP4) (X J)* = X J

(hP3) says that Q_h J X is symmetric: J X projects twists on im J along its h-reciprocal. (hP4) says that M X J is
symmetric, with the joint metric M: X J projects joint velocities along the self-motions, at right angles in M. [DS]
prints the h-adjoint in (hP4), which an m x m matrix has not. X is unique.

Reference: [DS] Sect. 2.3, (hP1)-(hP4), after Penrose 1955.
"""

from __future__ import annotations

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.systems.span import length_unit, lengths

# Products of matrices leave some 1e-16 of the product of their sizes; a matrix written with twelve digits passes.
PRODUCT_TOLERANCE = 1e-12


@frozen(eq=False, repr=False, slots=False)
class PenroseConditions(Value):
    """How well X meets the four conditions.

    Attributes:
        residuals: (4,) of (hP1)-(hP4), each relative to the matrix it should equal: |J X J - J| over |J|, ...; lengths
            are measured in the arm's own unit, so no unit enters.
        magnification: |J||X|, by which rounding can be magnified in the products.
        tolerance: the residual that counts as zero where nothing is magnified.
    """

    residuals: Array = field(converter=own)
    magnification: float
    tolerance: float

    @property
    def met(self) -> tuple[bool, bool, bool, bool]:
        """Which of the four conditions X meets, up to rounding."""
        limit = self.tolerance * max(1.0, self.magnification)
        first, second, third, fourth = (self.residuals <= limit).tolist()
        return first, second, third, fourth


def penrose_conditions(
    J: ArrayLike,
    X: ArrayLike,
    h: float,
    *,
    joint_metric: ArrayLike | None = None,
    tolerance: float = PRODUCT_TOLERANCE,
) -> PenroseConditions:
    """Test (hP1)-(hP4): whether X is the h-pseudoinverse of J.

    Args:
        J: (6, m) joint twists as columns.
        X: (m, 6) matrix to test.
        h: finite pitch [length/rad].
        joint_metric: (m, m) or (m,) positive definite metric M on joint velocities; None is the identity.
        tolerance: relative residual that counts as zero, before it is multiplied by |J||X|.

    Returns:
        PenroseConditions; `.met` tells which hold, `.residuals` how well.

    Raises:
        BadInput: shapes, NaN, infinite h, a metric that is not positive definite, a tolerance that is not
            between 0 and 1.

    Reference: [DS] (hP1)-(hP4).
    """
    twists = arrays.columns(J)
    m, unit = twists.shape[1], length_unit(twists)
    inverse = arrays.matrix(X, (m, 6), "X")
    Q = pitch_form(finite_pitch(h) / unit)
    M = np.eye(m) if joint_metric is None else arrays.positive_definite(joint_metric, m, "joint_metric")
    limit = arrays.tolerance(tolerance)
    A, B = twists / lengths(unit), inverse * lengths(unit).T
    on_twists, on_joints = Q.dot(A).dot(B), M.dot(B).dot(A)
    residuals = [
        _relative(A.dot(B).dot(A) - A, A),
        _relative(B.dot(A).dot(B) - B, B),
        _relative(on_twists - on_twists.T, on_twists),
        _relative(on_joints - on_joints.T, on_joints),
    ]
    return PenroseConditions(np.array(residuals), float(np.linalg.norm(A) * np.linalg.norm(B)), limit)


def _relative(difference: Array, whole: Array) -> float:
    size = float(np.linalg.norm(whole))
    return float(np.linalg.norm(difference)) / size if size > 0.0 else 0.0
