"""One tick as a convex problem in coordinates in which the joint metric is the identity: x = T y, y = origin(a) + B z.

    minimise over z   1/2 |A B z - (a b - A origin(a))|^2 + 1/2 |z - z_p|_Lambda^2      inside the limits on z

T makes the joint metric the identity; B and the origin describe the velocities that meet the exact rows (`exact`); a is
the share of the demanded speed: rows, twist and posture slow down together.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.attempt import attempted
from invariantqp.velocity.damping import Damping
from invariantqp.velocity.exact import Reduction, reduce
from invariantqp.velocity.forms import PitchForm
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.objective import Objective, Spectrum, least_squares, spectrum_of
from invariantqp.velocity.qp.quadratic import Cone, Polytope
from invariantqp.velocity.stationary import convexified


class Left(NamedTuple):
    """The velocities y = origin + B z that exact rows leave at a share of their speed; every y = z without rows."""

    basis: Array | None  # (m, n) B, or None without rows
    origin: Array  # (m,), then (0,)

    def joint(self, z: Array) -> Array:
        """(m,) y of z."""
        if self.basis is None:
            return z
        y: Array = self.origin + self.basis.dot(z)
        return y

    def free(self, y: Array) -> Array:
        """The z of a y with that share."""
        if self.basis is None:
            return y
        z: Array = (y - self.origin).dot(self.basis)
        return z

    def limits(self, limits: Polytope) -> Polytope:
        """Limits on y as limits on z."""
        return limits if self.basis is None else limits.on(self.origin, self.basis)

    def cone(self, cone: Cone | None) -> Cone | None:
        """A speed limit on y as one on z."""
        return cone if cone is None or self.basis is None else cone.on(self.origin, self.basis)


# Without rows.
EVERY = Left(None, np.empty(0))


class Posed(NamedTuple):
    """The problem of one tick, for any share of the speed."""

    A: Array  # (6, m) measured joint twists on y
    wanted: Array  # (6,) measured twist
    attempt: Array  # (6,) measured twist that is attempted, which differs from `wanted` with a form
    posture: Array | None  # (m,) y wanted where the twist leaves joints free, or None
    reduction: Reduction | None  # the velocities that meet the exact rows, or None without rows
    damping: Damping  # the policy
    spectrum: Spectrum | None  # of A, or of A B where there are exact rows; None for [DS]'s problem made convex
    pitch: float  # h of that problem
    J: Array  # (6, m) joint twists on y, for [DS]'s problem
    s: Array  # (6,) the twist, likewise

    def objective(self, share: float) -> Objective:
        """The objective in z at a share of the speed."""
        left = self.left(share)
        posture = None if self.posture is None else left.free(share * self.posture)
        wanted = share * self.attempt
        if left.basis is not None:
            wanted = wanted - self.A.dot(left.origin)
        if self.spectrum is not None:
            return least_squares(self.spectrum, wanted, posture, self.damping)
        J, s = self.J, share * self.s
        if left.basis is not None:
            J, s = J.dot(left.basis), s - J.dot(left.origin)
        return convexified(J, s, self.pitch, posture, self.damping)

    def slowed(self, whole: Objective, share: float) -> Objective:
        """The objective at a share of the speed, from that at the whole speed."""
        linear = self.spectrum is not None and whole.damping == 0.0 and self.damping.threshold < inf
        if linear and self.reduction is not None and not self.reduction.start.any():
            return whole._replace(optimum=share * whole.optimum)
        return self.objective(share)

    def left(self, share: float) -> Left:
        """What the exact rows leave at a share of the speed."""
        if self.reduction is None:
            return EVERY
        return Left(self.reduction.basis, self.reduction.origin(share))


def posed(law: VelocityLaw, demand: Demand, damping: Damping) -> Posed:
    """The problem of one tick."""
    T = law.to_joint
    J = demand.J if T is None else demand.J.dot(T)
    A, wanted = demand.root.dot(J), demand.root.dot(demand.s)
    posture = demand.posture if law.from_joint is None or demand.posture is None else law.from_joint.dot(demand.posture)
    reduction, attempt = None, wanted
    if demand.exact is not None:
        reduction = reduce(demand.exact.on(T), demand.root, demand.row_rank, demand.s)
    if isinstance(law.form, PitchForm) and law.form.convexified:
        return Posed(A, wanted, attempt, posture, reduction, damping, None, law.form.h, J, demand.s)
    if reduction is None:
        spectrum = spectrum_of(A)
    else:
        spectrum = spectrum_of(A.dot(reduction.basis), float(lapack.dgesdd(A, compute_uv=0)[1][0]))
    if law.form is not None:
        fraction = None if law.guard is None else law.guard.fraction
        inverse_root = np.asarray(np.linalg.inv(demand.root), np.float64)
        attempt = attempted(law.form, inverse_root, A, wanted, damping, fraction)
    return Posed(A, wanted, attempt, posture, reduction, damping, spectrum, 0.0, J, demand.s)


def limits_of(law: VelocityLaw, demand: Demand) -> tuple[Polytope, Cone | None]:
    """The limits on y."""
    lower, upper = demand.lower, demand.upper
    limits = Polytope(None, lower, upper) if demand.rows is None else demand.rows.with_box(lower, upper)
    T = law.to_joint
    if T is None:
        return limits, demand.cone
    nothing = np.zeros(len(lower))
    return limits.on(nothing, T), None if demand.cone is None else demand.cone.on(nothing, T)
