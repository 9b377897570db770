"""Exact demands on the joint velocity, C y = e, eliminated before anything is minimised: y = a y0 + B z.

    y0 = C'(C C')^-1 e,    C B = 0,    B'B = I,    0 <= a <= 1 the share of the demanded speed

What is left is a problem in z alone; y are coordinates in which the joint metric is the identity. The rows hold by
construction, in their direction, at the share a of their speed that limits allow:

    minimise 1/2 (1 - a)^2 |y0|^2 + 1/2 nu |y|^2   over a in [0, 1] and z,   y = a y0 + B z inside the limits
    nu = EXACT_CALM / 2 dt (1 - a_max + max(0, 1/4 held a_max^2 |y0| effort - 1)) |y0| effort

a_max is the largest share, the solution with nu nearly 0. Where it is below one, the problem is solved again with
nu > 0, which grows with the unmet part of the rows and with the joint motion that the rows need (`Reduction.effort`),
and so it is where that motion, held for longer than a tick, turns the rows by more than themselves. This damps the loop
as `calm` does: joints do not move at full speed for a thousandth of the rows' speed, nor faster than they can brake
before the rows are lost.

Where standing still is outside the limits, as of joints that brake, it may be that no share is inside. Rows then move
as near to {p y0, 0 <= p <= 1} as limits allow; p is their share, and what keeps them from being nearer is fixed as
rows are (`fixed_beside`).

All problems are strictly convex, so share and motion are continuous in limits and demand, but where the rows are beside
their direction and as near to it for many p: there the share jumps as the demand turns past a facet of the limits.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.geometry.linear import rank_of
from invariantqp.geometry.se3 import norm
from invariantqp.legacy.damping import DEVIATION_SHARE
from invariantqp.legacy.qp import EPSILON, Optimum, Polytope, Quadratic, cone_on, minimise, product, svd
from invariantqp.velocity.backends import Backend
from invariantqp.velocity.exact import ROW_TOLERANCE, ExactRows, whitened
from invariantqp.velocity.limits import Cone
from invariantqp.velocity.solution import ACTIVE_TOLERANCE

# Makes problems strictly convex: of the share, around the velocity known to be inside; of what gives way, around rest.
# The share is smaller by this much. Rows that need a motion v give way by this share of v more than necessary, and in
# the second pass, centred at the first one's velocity, by its square.
REGULARISATION = 1e-9
# Measured with 160 random targets on four arms: none oscillates from 0.5 on, some do at 0.15; at 2 some loops that
# arrive with 1 no longer do within eight seconds.
EXACT_CALM = 1.0
# A share above this counts as 1.
WHOLE = 1.0 - 1e-8
# A share below this is found again: it was found beside 1, of which it has the rounding.
FAR_SHARE = 1e-3
# Where limits bind, the share is reduced by this part of 1 - share, so that the next problem has an interior, and what
# holds it still counts as a limit that is met.
INTERIOR = 0.5 * ACTIVE_TOLERANCE


class Reduction(NamedTuple):
    """y = a full + start + B z, a in [0, 1] the share of the demanded speed."""

    full: Array  # (m,) y0, the shortest velocity that meets the rows
    inverse: Array  # (k, m) the same for each demand by itself: of demands e it is e'inverse
    basis: Array  # (m, n) B, orthonormal: the velocities that the rows leave free
    effort: float  # joint speed that the demand needs, relative to the least that a demand of its size could need
    bend: float  # the same for the demand that needs the most joint speed
    unmet: float  # the part of the demand that no velocity can meet here, relative
    beyond: float  # the part that no velocity of this arm can meet anywhere, relative
    start: Array  # (m,) what limits require beside that share; zero where the rows can keep their direction

    @classmethod
    def without_rows(cls, m: int) -> Reduction:
        """Every velocity is free."""
        return cls(np.zeros(m), np.zeros((0, m)), np.eye(m), 1.0, 1.0, 0.0, 0.0, np.zeros(m))

    @property
    def contradicts(self) -> bool:
        """Whether the joints cannot keep the direction of the demand."""
        return self.unmet > NEGLIGIBLE

    def excess(self, held: float, share: float = 1.0) -> float:
        """By how much more than themselves the rows turn while a share of their velocity is held so long [s]."""
        return max(0.0, DEVIATION_SHARE * held * share * share * self.effort * norm(self.full) - 1.0)

    def origin(self, share: float) -> Array:
        """(m,) where z = 0."""
        y: Array = share * self.full + self.start
        return y


class Nearest(NamedTuple):
    """A velocity inside the limits whose rows are nearest to a share of their demand, and what keeps them there."""

    inside: Array  # (m,)
    share: float  # p in [0, 1]
    beside: bool  # whether it moves the rows beside that share: they cannot keep their direction
    limits: NDArray[np.bool_]  # (k,) which limits on y
    cone: bool  # whether the tool's speed does, too


class Share(NamedTuple):
    """The part of the exact rows' speed that the limits allow."""

    value: float  # a in [0, 1]
    velocity: Array  # (m,) a y with that share


def reduce(exact: ExactRows, root: Array, rank: int | None = None, s: Array | None = None) -> Reduction:
    """Solve the rows and find the velocities that they leave free.

    Rows that are parts of the twist are first replaced by orthonormal ones in the measure, and rows beside them made as
    long as all of those together. So neither frame, unit of length nor choice of rows decides which count as dependent.

    Args:
        exact: the rows on y.
        root: (6, 6) of the measure.
        rank: how many independent rows this arm can keep in its best state; None is all.
        s: (6,) the twist of which the demands are parts, if they are: contradictions within its rounding are none.
    """
    M, contrary = whitened(exact, root, s)
    rows, wanted = M.T.dot(exact.A), exact.b.dot(M)
    m = rows.shape[1]
    moves = np.asarray(rows.any(axis=0))  # other joints stay free as they are, and rounding mixes none of them
    U, sigma, some = svd(rows[:, moves])
    Vt = np.zeros((m, m))
    Vt[: len(some), moves] = some
    Vt[len(some) :, ~moves] = np.eye(m - len(some))
    r = rank_of(sigma, ROW_TOLERANCE)
    r = r if rank is None else min(r, rank)
    met = wanted.dot(U[:, :r])
    y = met / sigma[:r]
    full = Vt[:r].T.dot(y)
    lost = wanted.dot(U[:, r:])  # not e - C y, which is rounding of a y that may be large
    basis = Vt[r:].T
    basis = basis - (Vt[:r].T / sigma[:r]).dot(U[:, :r].T.dot(rows.dot(basis)))  # to the digits of small parts
    here = len(lost) if rank is None else rank - r
    whole, part = norm(sigma), norm(met)
    return Reduction(
        full=full,
        inverse=M.dot(U[:, :r] / sigma[:r]).dot(Vt[:r]),
        basis=basis,
        effort=whole * norm(y) / part if part > 0.0 else 1.0,
        bend=whole / float(sigma[r - 1]) if r else 1.0,
        unmet=max(_share(lost[:here], wanted), contrary),
        beyond=_share(lost[here:], wanted),
        start=np.zeros(m),
    )


def _share(part: Array, whole: Array) -> float:
    size = norm(whole)
    return norm(part) / size if size > 0.0 else 0.0


def nearest_to_demand(
    reduction: Reduction, limits: Polytope, cone: Cone | None, inside: Array, backend: Backend
) -> Nearest:
    """The velocity inside the limits whose rows are nearest to a share of their demand: nearest to {p y0, 0 <= p <= 1}.

    Of several it has the smallest p where that distance is zero, and the largest where it is not.

    Args:
        reduction: what the rows leave.
        limits: on y.
        cone: likewise, or None.
        inside: (m,) a y inside both.
        backend: the solver asked first.
    """
    full, (m, n) = reduction.full, reduction.basis.shape
    found = Nearest(inside, 0.0, False, np.zeros(len(limits.lower), bool), False)
    if not inside.any() or n == m:
        return found
    length = 0.0 if reduction.contradicts else norm(full)
    length = length if length > NEGLIGIBLE * norm(inside) else 0.0
    line = reduction.basis if length == 0.0 else np.column_stack((reduction.basis, full / length))
    k = line.shape[1]
    V = np.column_stack((line, np.linalg.qr(line, mode="complete")[0][:, k:]))  # then what is beside the line

    def drawn(p: float, loose: int, y: Array) -> Optimum:
        """Nearest to p along the demand, but for the first directions, which are loose; from a y inside.

        The weight of those moves the rows; around the first answer, by its square.
        """
        root, to = np.full(m, sqrt(1.0 + REGULARISATION)), np.zeros(m)
        root[:loose], to[n:k] = sqrt(REGULARISATION), p
        centre = to
        for _ in range(2):
            optimum = minimise(backend, Quadratic(root[:, None] * V.T, V / root, V.dot(centre)), limits, cone, y)
            y = optimum.z
            centre = to + REGULARISATION * (y.dot(V) - to)
            centre[:loose] = y.dot(V[:, :loose])
        return optimum

    optimum = drawn(0.0, k, inside)
    y = optimum.z
    p, rounding = float(y.dot(V[:, n:k]).sum()), NEGLIGIBLE * norm(y)
    if p < -rounding or p > length + rounding:  # before the beginning of the segment, or behind its end
        optimum = drawn(0.0 if p < 0.0 else length, n, y)
    elif length > 0.0 and norm(y.dot(V[:, k:])) > rounding:
        optimum = drawn(length, k, y)
    y = optimum.z
    along = y.dot(V)
    p = min(max(float(along[n:k].sum()), 0.0), length)
    along[:n], along[n:k] = 0.0, along[n:k] - p
    size = norm(along)  # of what moves the rows beside that share
    found = found._replace(inside=y, share=p / length if length > 0.0 else 0.0)
    if size <= NEGLIGIBLE * norm(y):  # the rows can keep their direction
        return found
    pulls = np.abs(optimum.multipliers) * np.linalg.norm(limits.A, axis=1)
    slowed = cone is not None and optimum.nu * norm(cone.velocity(y).dot(cone.J)) > NEGLIGIBLE * size
    return found._replace(beside=True, limits=pulls > NEGLIGIBLE * size, cone=slowed)


def fixed_beside(reduction: Reduction, limits: Polytope, cone: Cone | None, nearest: Nearest) -> Reduction:
    """The velocities whose rows are as near to their demand as the nearest one's; `limits` and `cone` are on y.

    What keeps the rows from being nearer has one value in all of them inside the limits. So these have no interior, and
    rounding would decide where in them the answer is; they have one beside what is fixed here.
    """
    held = [limits.A[nearest.limits]]
    if cone is not None and nearest.cone:
        held.append(cone.J)
    rows, basis = np.vstack(held), reduction.basis
    if len(rows):
        lengths = np.linalg.norm(rows, axis=1, keepdims=True)
        _, sizes, Vt = svd(product(rows, basis) / np.where(lengths > 0.0, lengths, 1.0))
        basis = basis.dot(Vt[np.count_nonzero(sizes > NEGLIGIBLE) :].T)
    left = nearest.inside - nearest.share * reduction.full
    return reduction._replace(basis=basis, start=left - basis.dot(left.dot(basis)))


def share_of(
    reduction: Reduction,
    limits: Polytope,
    cone: Cone | None,
    inside: Array,
    dt: float,
    backend: Backend,
    held: float = 0.0,
) -> Share:
    """The share of the rows' speed inside the limits on y, calmed for ticks of dt [s].

    Args:
        reduction: what the rows leave.
        limits: on y.
        cone: likewise, or None.
        inside: (m,) a y inside both whose rows have a share of their speed.
        dt: tick [s].
        backend: the solver asked first.
        held: how much longer than that the velocity is held [s].
    """
    if reduction.contradicts:  # the share tends to zero as the joints lose a direction of the rows
        return Share(0.0, inside)
    full, length = reduction.full, norm(reduction.full)
    if length <= NEGLIGIBLE * norm(inside):  # what limits require is what the rows ask for
        return Share(1.0, inside)
    basis = np.column_stack((full / length, reduction.basis))
    n = basis.shape[1]
    still = np.zeros(len(full))
    room = limits.on(still, basis, inside)
    lower, upper, rounding = np.append(room.lower, 0.0), np.append(room.upper, length), np.append(room.rounding, 0.0)
    room = Polytope(np.vstack((room.A, np.eye(1, n))), lower, upper, rounding)
    slow = None if cone is None else cone_on(cone, still, basis)
    first = inside.dot(basis)

    def best(nu: float, aim: float) -> Optimum:
        weights, pull = np.full(n, REGULARISATION + nu), REGULARISATION * first
        weights[0] += 1.0
        pull[0] += aim
        return minimise(backend, Quadratic.diagonal(np.sqrt(weights), pull / weights), room, slow, first)

    found = best(0.0, length)
    possible = min(max(found.z[0] / length, 0.0), 1.0)
    missed = 1.0 - possible + reduction.excess(held, possible)
    nu = 0.5 * EXACT_CALM * (dt + held) * missed * length * reduction.effort
    if nu > REGULARISATION:
        found = best(nu, length)
    elif possible < FAR_SHARE:  # from nearby: beside what is asked for, the limits are rounding
        found = best(0.0, max(found.z[0], 0.0) / FAR_SHARE)
    value, known = (min(max(along / length, 0.0), 1.0) for along in (float(found.z[0]), float(first[0])))
    if first[0] <= NEGLIGIBLE * norm(inside):
        known = 0.0
    if value < EPSILON or value * length <= ACTIVE_TOLERANCE * norm(inside):
        return Share(known, inside)
    velocity = basis.dot(found.z)
    if value >= WHOLE:
        return Share(1.0, velocity)
    given = 1.0 - INTERIOR * (1.0 - value)
    return Share(known + given * (value - known), inside + given * (velocity - inside))
