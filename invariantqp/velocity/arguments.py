"""Arguments that all functions and loops of the law have in common: damping, measure and joint metric."""

from __future__ import annotations

from numbers import Real
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, sizes
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.velocity.forms import CarriedMetric, Form
from invariantqp.velocity.measure import length_at, own_point, root_at


def damping_of(damping: object) -> float:
    """lambda, 0 for None.

    Raises:
        BadInput: not a number, below zero, too large.
    """
    if damping is None:
        return 0.0
    if isinstance(damping, bool) or not isinstance(damping, Real):
        remedy = "Without one, velocity limits keep joints slow near a singularity."
        raise BadInput("damping", excerpt(damping), "a number lambda >= 0, or None", remedy)
    value = arrays.not_negative(cast("float", damping), "damping", "lambda")
    if value > sizes.LARGEST:
        raise BadInput("damping", f"{value:.3g}", f"at most {sizes.LARGEST:g}")
    return value


class Measure(NamedTuple):
    """The measure of twists: root (6, 6), its point (3,) and length; and the form, unless it is a CarriedMetric."""

    root: Array
    point: Array
    length: float
    form: Form | None


def measure_of(
    J: Array, s: Array, form: Form | CarriedMetric | None, point: ArrayLike | str | None, length: float | None
) -> Measure:
    """The measure for checked J (6, m) and s (6,).

    Raises:
        BadInput: not a point, or not a positive length.
    """
    if isinstance(point, str) and point != "own":
        raise BadInput("point", excerpt(point), '"own" or (3,) in the frame of J')
    named = point is not None and not isinstance(point, str)
    p = sizes.bounded_points(arrays.vector(point, 3, "point")) if named else own_point(J, s)  # type: ignore[arg-type]
    L = length_at(J, p, s) if length is None else sizes.bounded_length(length)
    if isinstance(form, CarriedMetric):
        return Measure(form.root(), p, L, None)
    return Measure(root_at(p, L), p, L, form)


def metric_of(joint_metric: ArrayLike | None, J: Array, point: Array, length: float) -> Array | None:
    """(m, m) the joint metric, None for the identity.

    Without a `joint_metric`, L units of a prismatic joint count as one radian of a revolute one; also where no joint
    turns, so that the damping of loops does not depend on the unit of length.

    Raises:
        BadInput: not symmetric positive definite.
    """
    if joint_metric is not None:
        return arrays.positive_definite(joint_metric, J.shape[1], "joint_metric")
    slides = prismatic(J, point, length)
    if not slides.any():
        return None
    return np.diag(np.where(slides, 1.0 / (length * length), 1.0))


def prismatic(J: Array, point: Array, length: float) -> NDArray[np.bool_]:
    """(m,) which joints of J (6, m) are prismatic, to rounding of their velocity at the point (3,)."""
    turning, moving = (np.sqrt((part * part).sum(axis=0)) for part in (J[:3], velocity_at(J, point)))
    return np.asarray((turning * length <= NEGLIGIBLE * moving) & (moving > 0.0))
