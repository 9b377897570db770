"""The quadratic forms on twists that are invariant under rigid motions: the pencil Q_h = Q_0 - 2h diag(I, 0).

    s'Q_h s = 2 (omega.v - h omega.omega)          Q_h = [[-2h I, I], [I, 0]]      Q_h^-1 = [[0, I], [I, 2h I]]

Q_h is indefinite, signature (3, 3), for every finite h; Q_inf = -2 diag(I, 0), half the Killing form, is degenerate.
The factor 1/2 of [DS] (2.6) is left out, as in its own Examples 1 and 4, its Sect. 6.3 and its remark on Q_inf.

Reference: [DS] Theorem 2.1, (2.6), Sect. 6.3.
"""

from __future__ import annotations

from math import isinf

import numpy as np

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import SWAPPED


def invariant_form(alpha: float, beta: float) -> Array:
    """The general member of the pencil, [[-2 alpha I, beta I], [beta I, 0]]; Q_h is alpha = h, beta = 1.

    It is (6, 6), symmetric and invariant: Ad' Q Ad = Q for every rigid motion. alpha is a length, beta has no unit.

    Reference: [DS] Theorem 2.1.
    """
    a, b = arrays.number(alpha, "alpha"), arrays.number(beta, "beta")
    Q = np.diag([-2.0 * a, -2.0 * a, -2.0 * a, 0.0, 0.0, 0.0])
    Q[np.arange(6), SWAPPED] = b
    return Q


def pitch_form(h: float) -> Array:
    """Q_h, the (6, 6) invariant form of pitch h [length/rad], +-inf for half the Killing form.

    Its null twists are those of pitch h, and all translations.

    Reference: [DS] (2.6), without its factor 1/2.
    """
    pitch = arrays.number(h, "h", "a pitch, finite or inf", infinite=True)
    return invariant_form(1.0, 0.0) if isinf(pitch) else invariant_form(pitch, 1.0)


def pitch_form_inverse(h: float) -> Array:
    """Q_h^-1, the (6, 6) invariant form on wrenches (m; f) for a finite h [length/rad]: W'Q_h^-1 W = 2 (m.f + h f.f).

    It is invariant under `coadjoint`.

    Reference: [DS] Sect. 6.3.
    """
    return np.asarray(pitch_form(-finite_pitch(h))[SWAPPED][:, SWAPPED])


def finite_pitch(h: float, argument: str = "h") -> float:
    """h as a finite float."""
    pitch = arrays.number(h, argument, "a finite pitch", infinite=True)
    if isinf(pitch):
        remedy = "The Killing form Q_inf is degenerate and has no inverse."
        raise BadInput(argument, str(pitch), "a finite pitch", remedy)
    return pitch
