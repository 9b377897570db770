"""The screws of a 2-system as its cylindroid, those of a 3-system as a field of pitches over its directions.

    2-system IA    w(t) = (cos t, sin t, 0),   h(t) = a cos^2 t + b sin^2 t,   z(t) = (b - a) sin t cos t
    3-system IA    w, |w| = 1,   h(w) = a w_x^2 + b w_y^2 + c w_z^2,   axis through w x (a w_x, b w_y, c w_z)
    axes of pitch h in a IA or IIA 3-system    (a-h) x^2 + (b-h) y^2 + (c-h) z^2 + (a-h)(b-h)(c-h) = 0

in the frame of the normal form, with the principal pitches a, b, c. The axes of a 2-system of type IA lie on Plucker's
conoid, the cylindroid; they meet the z axis at right angles, within |a - b| of each other. Those of the other 2-systems
with screws are a plane pencil (IIA), parallel lines in a plane (IB, IIB) or one line (IB with p = 0). A screw is given
by its coefficients in the normal form.

Reference: [DS] Tables 1 and 2, Figure 1. R. S. Ball, A Treatise on the Theory of Screws, 1900, Sect. 13 (cylindroid)
and 173 (pitch quadrics); K. H. Hunt, Kinematic Geometry of Mechanisms, 1978.
"""

from __future__ import annotations

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.se3 import adjoint, inverse
from invariantqp.systems.classification import GibsonHunt, classify
from invariantqp.systems.subspaces import Subspace, as_system


@frozen(eq=False, repr=False, slots=False)
class ScrewFamily(Value):
    """The screws of a 2- or 3-system by their coefficients c in the normal form.

    Attributes:
        type: the Gibson-Hunt type, with its moduli.
        tolerance: that of the type.
        pose: (4, 4) base_from_frame of the normal form's frame.
        basis: (6, k) the columns of the normal form, in the base frame.
    """

    type: GibsonHunt
    tolerance: float
    pose: Array = field(converter=own)
    basis: Array = field(converter=own)

    def screws(self, coefficients: ArrayLike) -> Array:
        """The (6, n) twists of (k, n) or (k,) coefficients, unit in the angular part, or else in the linear."""
        k = self.basis.shape[1]
        c = arrays.array(coefficients, "coefficients", "numbers")
        c = c.reshape(-1, 1) if c.ndim == 1 else c
        if c.ndim != 2 or len(c) != k:
            raise BadInput("coefficients", f"shape {c.shape}", f"shape ({k}, n)")
        sizes = np.linalg.norm(arrays.matrix(c.T, (None, k), "coefficients"), axis=1)
        if not sizes.all():
            raise BadInput("coefficients", "a column of zeros", "non-zero columns, one a screw")
        c = c / sizes
        local = self.type.normal_form.dot(c)
        size = np.linalg.norm(local[:3], axis=0)
        slides = size <= arrays.ROUNDING
        size[slides] = np.linalg.norm(local[3:, slides], axis=0)
        local[:3, slides] = 0.0
        return np.asarray(adjoint(self.pose, check=False).dot(local / size))

    def pitches(self, coefficients: ArrayLike) -> Array:
        """(n,) the pitches [length/rad] of the screws of (k, n) coefficients; inf for translations."""
        s = self.screws(coefficients)
        h = (s[:3] * s[3:]).sum(axis=0)
        return np.asarray(np.where(s[:3].any(axis=0), h, np.inf))

    def axes(self, coefficients: ArrayLike) -> tuple[Array, Array]:
        """The unit directions (3, n) of the axes and points (3, n) on them, NaN for translations.

        The points are those nearest to the origin of `pose`.
        """
        s = self.screws(coefficients)
        w, origin = s[:3], self.pose[:3, 3]
        moment = s[3:] - np.cross(origin, w, axis=0)
        points = origin[:, None] + np.cross(w, moment, axis=0)
        points[:, ~w.any(axis=0)] = np.nan
        return np.where(w.any(axis=0), w, np.nan), points


@frozen(eq=False, repr=False, slots=False)
class Cylindroid(ScrewFamily):
    """The screws of a 2-system by an angle, c = (cos t, sin t); of types IA and IIA the angle of the axis to x."""

    @property
    def length(self) -> float:
        """|a - b| of type IA, along the z axis of `pose`; 0 for axes that meet or coincide, inf for parallel ones."""
        moduli = self.type.moduli
        if self.type.name in {"IA", "IIA"}:
            return float(abs(moduli[0] - moduli[-1]))
        return 0.0 if self.type.name == "IB" and moduli[0] <= self.tolerance else np.inf

    def at(self, angles: ArrayLike) -> Array:
        """The (2, n) coefficients of (n,) angles [rad], for `screws`, `pitches` and `axes`."""
        t = arrays.vector(np.atleast_1d(arrays.array(angles, "angles", "angles (n,)")), None, "angles")
        return np.stack((np.cos(t), np.sin(t)))


@frozen(eq=False, repr=False, slots=False)
class PitchField(ScrewFamily):
    """The screws of a 3-system; of types IA and IIA the coefficients are the axis' direction in the frame `pose`."""

    def quadric(self, h: float) -> Array:
        """(4, 4) symmetric Q of the surface (r; 1)'Q (r; 1) = 0 that the axes of pitch h lie on, types IA and IIA.

        Points r are in the base frame. It is a real hyperboloid for h between the least and the greatest principal
        pitch, and degenerate at a principal pitch.

        Raises:
            BadInput: the system contains translations.
        """
        names = {"IA1": (0, 1, 2), "IA2": (0, 1, 1), "IIA": (0, 0, 0)}
        if self.type.name not in names:
            raise BadInput("J", f"a 3-system of type {self.type}", "one of type IA1, IA2 or IIA, without translations")
        d = np.array([self.type.moduli[i] for i in names[self.type.name]]) - arrays.number(h, "h")
        back = inverse(self.pose, check=False)
        return np.asarray(back.T.dot(np.diag((*d, d.prod()))).dot(back))


def cylindroid(J: ArrayLike | Subspace) -> Cylindroid:
    """The cylindroid of the 2-system that (6, m) twists span: pitch and axis of every screw in it.

    Raises:
        BadInput: the twists span no 2-system.
    """
    return Cylindroid(*_family(J, 2))


def pitch_field(J: ArrayLike | Subspace) -> PitchField:
    """The pitch field of the 3-system that (6, m) twists span: pitch and axis of every screw in it.

    Raises:
        BadInput: the twists span no 3-system.
    """
    return PitchField(*_family(J, 3))


def _family(J: ArrayLike | Subspace, dimension: int) -> tuple[GibsonHunt, float, Array, Array]:
    system = as_system(J)
    if system.dimension != dimension:
        raise BadInput("J", f"a {system.dimension}-system", f"twists that span a {dimension}-system")
    kind = classify(system)
    pose = inverse(kind.motion)
    return kind, system.tolerance, pose, adjoint(pose, check=False).dot(kind.normal_form)
