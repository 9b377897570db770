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
from invariantqp.geometry.se3 import norm
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


# The joint speed of a task, as a share of the fastest, at which half of the posture is followed. Measured on 144 tight
# tasks of seven-joint arms and on arms that are told to stay (`examples/14_defaults.py`): 0.02 loses more of the tasks,
# and with positions read to 2e-5 rad an arm that stays moves by less than 0.1 deg in ten seconds.
POSTURE_PACE = 0.01

# Without rows.
EVERY = Left(None, np.empty(0))


class Posed(NamedTuple):
    """The problem of one tick, for any share of the speed."""

    A: Array  # (6, m) measured joint twists on y
    wanted: Array  # (6,) measured twist
    attempt: Array  # (6,) measured twist that is attempted, which differs from `wanted` with a form
    ahead: Array | None  # (6,) likewise without the chase; None where there is none
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
        wanted, ahead = share * self.attempt, None if self.ahead is None else share * self.ahead
        if left.basis is not None:
            fixed = self.A.dot(left.origin)
            wanted, ahead = wanted - fixed, None if ahead is None else ahead - fixed
        if self.spectrum is not None:
            return least_squares(self.spectrum, wanted, posture, self.damping, ahead)
        J, s = self.J, share * self.s
        if left.basis is not None:
            J, s = J.dot(left.basis), s - J.dot(left.origin)
        return convexified(J, s, self.pitch, posture, self.damping)

    def slowed(self, whole: Objective, share: float) -> Objective:
        """The objective at a share of the speed, from that at the whole speed."""
        linear = self.spectrum is not None and whole.damping == 0.0 and self.damping.threshold < inf
        if linear and self.reduction is not None and not self.reduction.start.any():
            still = None if whole.still is None else share * whole.still
            return whole._replace(optimum=share * whole.optimum, still=still)
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
    ahead = None if demand.chase is None else demand.root.dot(demand.chase.ahead)
    if demand.exact is not None:
        reduction = reduce(demand.exact.on(T), demand.root, demand.row_rank, demand.s)
    if isinstance(law.form, PitchForm) and law.form.convexified:
        return Posed(A, wanted, attempt, None, posture, reduction, damping, None, law.form.h, J, demand.s)
    if reduction is None:
        spectrum = spectrum_of(A)
    else:
        spectrum = spectrum_of(A.dot(reduction.basis), float(lapack.dgesdd(A, compute_uv=0)[1][0]))
    if posture is not None and demand.fastest is not None:
        posture = _pace(law, demand, A, reduction, spectrum, damping) * posture
    if law.form is not None:
        fraction = None if law.guard is None else law.guard.fraction
        inverse_root = np.asarray(np.linalg.inv(demand.root), np.float64)
        attempt = attempted(law.form, inverse_root, A, wanted, damping, fraction)
        ahead = None if ahead is None else attempted(law.form, inverse_root, A, ahead, damping, fraction)
    return Posed(A, wanted, attempt, ahead, posture, reduction, damping, spectrum, 0.0, J, demand.s)


def _pace(
    law: VelocityLaw, demand: Demand, A: Array, reduction: Reduction | None, spectrum: Spectrum, damping: Damping
) -> float:
    """The share of the posture that is followed: t^2 / (t^2 + POSTURE_PACE^2), t the joint speed that the task needs.

    t is a share of the joints' fastest. Of a chase d counts (1 - slack^2 / |d|^2) d, and nothing within its slack. So a
    task at rest leaves the joints at rest, and the noise of measured positions, which the chase follows, does not move
    them.
    """
    s, exact, T = demand.s, demand.exact, law.to_joint
    if demand.chase is not None:
        chase = demand.chase
        size = norm(demand.root.dot(s - chase.ahead))
        share = 0.0 if size <= chase.slack else 1.0 - (chase.slack / size) ** 2
        s = chase.ahead + share * (s - chase.ahead)
        if exact is not None and chase.rows_ahead is not None:
            exact = exact.demanding(chase.rows_ahead + share * (exact.b - chase.rows_ahead))
    b = demand.root.dot(s)
    if exact is None or reduction is None:
        y = least_squares(spectrum, b, None, damping).centre()
    else:
        full = reduce(exact.on(T), demand.root, demand.row_rank, s).full
        y = full + reduction.basis.dot(least_squares(spectrum, b - A.dot(full), None, damping).centre())
    x = y if T is None else T.dot(y)
    t = float((np.abs(x) / np.asarray(demand.fastest)).max())
    return t * t / (t * t + POSTURE_PACE * POSTURE_PACE)


def limits_of(law: VelocityLaw, demand: Demand) -> tuple[Polytope, Polytope, Cone | None]:
    """The limits on y: all but the tool's speed; without those of velocity and acceleration; the tool's speed."""
    boxes = [(demand.lower, demand.upper)]
    boxes += [boxes[0] if demand.chase is None else (demand.chase.lower, demand.chase.upper)]
    limits, placed = (Polytope(None, *box) if demand.rows is None else demand.rows.with_box(*box) for box in boxes)
    T = law.to_joint
    if T is None:
        return limits, placed, demand.cone
    nothing = np.zeros(len(demand.lower))
    return limits.on(nothing, T), placed.on(nothing, T), None if demand.cone is None else demand.cone.on(nothing, T)
