"""A strictly convex quadratic program: a library says which limits are near, least squares on these gives the digits.

    minimise 1/2 |K (z - c)|^2   over   lower <= A z <= upper,   |v_p| <= limit

In e = K (z - c), z = c + T e, this is the point of a convex set nearest to zero. Solvers stop at tolerances of their
own; so one is asked only which limits are near. Non-negative least squares picks those of them that pull, and e is the
shortest on these. The answer depends on solver, frame and unit by rounding times the condition of T = K^-1 alone.

    e + N'y = 0,  N = A T:     y > 0 at an upper limit, y < 0 at a lower one; loosening limit i by d gains |y_i| d

The speed limit of a point is kept by its multiplier: 1/2 nu |v_p|^2 is added, nu >= 0 such that the speed is the limit.

Reference: Lawson and Hanson 1974, ch. 23 (least distance by non-negative least squares).
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack
from scipy.optimize import brentq, nnls

from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.geometry.linear import TINY, rank_of
from invariantqp.geometry.se3 import norm
from invariantqp.velocity.backends import FEASIBILITY_TOLERANCE, Backend, BoxQP, Daqp, SolverFailure, solved
from invariantqp.velocity.limits import Cone, LimitRows
from invariantqp.velocity.solution import ACTIVE_TOLERANCE

EPSILON = float(np.finfo(float).eps)
# What is below this share of the terms of a product is rounding; cosines fade in above it, so that the law has no jump.
PRODUCT_ROUNDING = 1e-13
# The multiplier of a speed limit outweighs the rest by this factor at most.
MOST_SHARE = 1e8
MOST_PRICES = 60
# What an answer is called that no solver gave.
OWN = "least distance"


class Polytope(NamedTuple):
    """lower <= A z <= upper."""

    A: Array  # (k, n) the joints first, then rows
    lower: Array  # (k,), -inf where there is none
    upper: Array  # (k,), inf where there is none
    rounding: Array | float = 0.0  # (k,) how far a value may be outside: rounding of what exact rows fix of it

    @classmethod
    def of(cls, lower: Array, upper: Array, rows: LimitRows) -> Polytope:
        """That of a box (m,) on the joints, and rows."""
        A = np.vstack((np.eye(len(lower)), rows.C))
        return cls(A, np.concatenate((lower, rows.lower)), np.concatenate((upper, rows.upper)))

    def margin(self, *velocities: Array) -> Array:
        """(k,) how far a value may be outside its limit: rounding, where it comes from some z (n,)."""
        speed = sum(norm(z) for z in velocities)
        return np.asarray(self.rounding + NEGLIGIBLE * speed * lengths_of(self.A))

    def allows(self, z: Array, *terms: Array) -> bool:
        """Whether z is inside but for rounding, also that of terms (n,) of which z is the sum."""
        value, margin = self.A.dot(z), self.margin(z, *terms)
        return bool(((value <= self.upper + margin) & (value >= self.lower - margin)).all())

    def without(self, some: NDArray[np.bool_]) -> Polytope:
        """The limits but for some (k,), which are left without bounds."""
        return self._replace(lower=np.where(some, -inf, self.lower), upper=np.where(some, inf, self.upper))

    def on(self, origin: Array, basis: Array, inside: Array | None = None) -> Polytope:
        """The same limits on z, x = origin + basis z; rounding is that of an x `inside`, of the origin by default."""
        value, margin = self.A.dot(origin), self.margin(origin if inside is None else inside)
        return Polytope(product(self.A, basis), self.lower - value, self.upper - value, margin)


def cone_on(cone: Cone, origin: Array, basis: Array) -> Cone:
    """The same cone on z, x = origin + basis z."""
    return Cone(product(cone.J, basis), cone.limit, cone.velocity(origin))


def product(A: Array, B: Array) -> Array:
    """(k, n) A B, zero where it is only rounding.

    Columns of one length are one space, in which rounding chooses the axes: a row has a part in all of it, or none.
    """
    lengths, C = lengths_of(B.T), np.asarray(A.dot(B))
    cosines = C / (lengths_of(A)[:, None] * lengths + TINY)
    if (np.abs(cosines) >= 2.0 * PRODUCT_ROUNDING).all():
        return C
    alike = np.abs(lengths[:, None] - lengths) <= NEGLIGIBLE * lengths
    parts = np.sqrt((cosines * cosines).dot(alike))
    return np.asarray(np.clip(parts / PRODUCT_ROUNDING - 1.0, 0.0, 1.0) * C)


def lengths_of(A: Array) -> Array:
    """(k,) lengths of the rows of A (k, n)."""
    return np.asarray(np.sqrt((A * A).sum(axis=1)))


def svd(A: Array) -> tuple[Array, Array, Array]:
    """U, singular values and V' of A (k, n), both square; of an empty one, too, which LAPACK's own does not take."""
    if not A.size:
        return np.eye(A.shape[0]), np.empty(0), np.eye(A.shape[1])
    U, sizes, Vt, info = lapack.dgesdd(A)
    if info != 0:
        raise np.linalg.LinAlgError(f"dgesdd returned {info}")
    return U, sizes, Vt


class Quadratic(NamedTuple):
    """1/2 |K (z - centre)|^2, with T = K^-1."""

    K: Array  # (n, n)
    T: Array  # (n, n)
    centre: Array  # (n,)

    @classmethod
    def diagonal(cls, root: Array, centre: Array) -> Quadratic:
        """K = diag(root), root (n,)."""
        return cls(np.diag(root), np.diag(1.0 / root), centre)

    @classmethod
    def weighted(cls, root: Array, wanted: Array) -> Quadratic:
        """1/2 |root z - wanted|^2 but for a constant, root (k, n) of full column rank."""
        U, sizes, Vt = svd(root)
        T = Vt.T / sizes
        return cls(sizes[:, None] * Vt, T, T.dot(wanted.dot(U[:, : len(T)])))

    def plus(self, root: Array, wanted: Array) -> Callable[[float], Quadratic]:
        """Of nu, the same with 1/2 nu |root z - wanted|^2 added; with the digits of both, however large nu is."""
        U, sizes, Wt = svd(product(root, self.T))
        r = len(sizes)
        T, K, pull = self.T.dot(Wt.T), Wt.dot(self.K), sizes * (wanted - root.dot(self.centre)).dot(U[:, :r])

        def at(nu: float) -> Quadratic:
            more, step = np.ones(len(K)), np.zeros(len(K))
            more[:r] = np.sqrt(1.0 + nu * sizes * sizes)
            step[:r] = nu * pull / (more[:r] * more[:r])
            return Quadratic(more[:, None] * K, T / more, self.centre + T.dot(step))

        return at


class Optimum(NamedTuple):
    """The minimiser, its multipliers, and how it was found."""

    z: Array  # (n,)
    multipliers: Array  # (k,) y, zero where the limit is not active
    free: Array  # (n, j) a root of the Hessian's inverse on what the active limits leave: free free'
    backend: str = ""  # the solver; "" where none was needed
    trouble: str = ""  # what went wrong on the way, "" for nothing
    nu: float = 0.0  # multiplier of the speed limit, where there is one; 0 where it is not active


def minimise(
    backend: Backend, cost: Quadratic, limits: Polytope, cone: Cone | None = None, inside: Array | None = None
) -> Optimum:
    """The optimum inside limits and cone.

    Args:
        backend: the solver asked first; DAQP stands in for it.
        cost: what is minimised.
        limits: on z; infinite where there is none.
        cone: likewise, or None.
        inside: (n,) a z inside both, but for rounding, where one is known: the answer where no other is found.

    Raises:
        SolverFailure: no answer was found, and none is known; `.infeasible` when a solver says that there is none.
    """
    found = _in_polytope(backend, cost, limits, inside)
    if cone is not None and not cone.allows(found.z, NEGLIGIBLE):
        if cone.J.any():
            priced, counts = cost.plus(cone.J, -cone.start), product(cone.J, cost.T).dot(cost.K)  # J without rounding

            def at(nu: float) -> Optimum:
                """With the price nu; once more in terms of the cost, since that of a large nu has fewer digits."""
                found = _in_polytope(backend, priced(nu), limits, inside)
                pull = cost.K.dot(found.z - cost.centre).dot(cost.K) + nu * cone.velocity(found.z).dot(counts)
                return found._replace(z=found.z - found.free.dot(pull.dot(found.free)), nu=nu)

            found = at_speed_limit(cone, float(np.vdot(cost.K, cost.K)), found, at, inside)
            speed, yields = cone.speed(found.z), cone.velocity(found.z).dot(cone.J).dot(found.free)
            gain = norm(yields)
            if gain > 0.0:  # what is left of its error, at this price
                step = speed * (speed - cone.limit) / gain
                found = found._replace(z=found.z - step * found.free.dot(yields / gain))
        elif inside is None:
            raise SolverFailure("the exact rows", "their only velocity is too fast for the tool", infeasible=True)
    return found if inside is None else found._replace(z=_kept(found.z, limits, cone, inside))


def _kept(z: Array, limits: Polytope, cone: Cone | None, inside: Array) -> Array:
    """The z found, or where that is outside the limits the last one inside on the way there from one that is.

    What is allowed for rounding is that of z, which the cut makes shorter: so it is cut to half of it, and twice.
    """
    for _ in range(2):
        value, margin = limits.A.dot(z), limits.margin(z)
        over = np.maximum(value - limits.upper, limits.lower - value)
        out = over > margin
        if not out.any():
            break
        way, back = np.abs(limits.A[out].dot(z - inside)), (over - 0.5 * margin)[out]
        z = z - np.divide(back, way, out=np.ones(len(way)), where=way > 0.0).clip(0.0, 1.0).max() * (z - inside)
    if cone is None or cone.allows(z, NEGLIGIBLE):
        return z
    v, d = cone.velocity(inside), cone.J.dot(z - inside)
    a, b, c = float(d.dot(d)), float(v.dot(d)), max(cone.limit**2 - float(v.dot(v)), 0.0)
    return inside + (min((sqrt(b * b + a * c) - b) / a, 1.0) if a > 0.0 else 0.0) * (z - inside)


def at_speed_limit(
    cone: Cone, weight: float, found: Optimum, at: Callable[[float], Optimum], inside: Array | None
) -> Optimum:
    """at(nu) for the nu at which the speed of the point, which falls as nu grows, is the limit.

    Where the same limits stay active, v(nu') = (I + (nu' - nu) C)^-1 v(nu), and C = U diag(gains) U' is how the point
    yields to forces there. So each step goes to where the speed would then be the limit, or halves what is left where
    that has been excluded, or steps do not become half as long.

    Args:
        cone: J and the limit.
        weight: |K|^2 of the cost.
        found: at(0), which is too fast.
        at: what is found for nu.
        inside: (n,) a velocity inside all limits, where one is known.

    Raises:
        SolverFailure: not even the largest nu is enough.
    """
    typical = weight / float(np.vdot(cone.J, cone.J))  # the speed weighs as much as all the rest
    halfway, most = sqrt(MOST_SHARE) * typical, MOST_SHARE * typical
    size, low, high, nu, step = float(np.linalg.norm(cone.J)), 0.0, inf, 0.0, inf
    for _ in range(MOST_PRICES):
        v = cone.velocity(found.z)
        over = norm(v) - cone.limit
        if abs(over) <= EPSILON * (cone.limit + size * norm(found.z)):
            break
        if over > 0.0 and nu == most:
            if inside is None or not cone.allows(inside, ACTIVE_TOLERANCE):
                raise SolverFailure("the limits", "no velocity in them is slow enough for the tool", infeasible=True)
            break
        low, high = (nu, high) if over > 0.0 else (low, nu)
        U, sizes, _ = svd(cone.J.dot(found.free))
        ahead = nu + _price(v, U, sizes * sizes, cone.limit, most)
        if ahead > most:  # not while these limits are active
            ahead = next((price for price in (typical, halfway) if price > nu), most)
        if not low < ahead < high or (high < inf and abs(ahead - nu) > 0.5 * step):
            ahead = sqrt(low * high) if low > 0.0 else min(typical, 0.5 * high)
        step = abs(ahead - nu)
        if not low < ahead < high or abs(ahead - nu) <= PRODUCT_ROUNDING * nu:  # rounding of the speed
            break
        nu, found = ahead, at(ahead)
    return found


def _price(v: Array, U: Array, gains: Array, limit: float, most: float) -> float:
    """mu with |(I + mu U diag(gains) U')^-1 v| = limit, v (3,); inf where none up to `most` is enough."""
    along = v.dot(U[:, : len(gains)])
    rest = max(float(v.dot(v) - along.dot(along)), 0.0) if len(along) < 3 else 0.0
    parts = list(zip((along * along).tolist(), gains.tolist(), strict=True))
    least = -1.0 / max(float(gains.max(initial=0.0)), TINY)
    over = np.abs(along) / limit - 1.0
    if (over > most * gains).any():  # of one part alone
        return inf
    fast = over > 0.0
    mu = float((over[fast] / gains[fast]).max(initial=0.0))
    for _ in range(MOST_PRICES):  # Newton on 1 / |v|, which is concave: from below it does not overshoot
        square, slope = rest, 0.0
        for part, gain in parts:
            shrunk = part / (1.0 + mu * gain) ** 2
            square, slope = square + shrunk, slope + shrunk * gain / (1.0 + mu * gain)
        if not slope > 0.0 or mu > most:
            return inf
        step = square / slope * (sqrt(square) / limit - 1.0)
        mu = max(mu + step, 0.5 * (mu + least))
        if abs(step) <= NEGLIGIBLE * abs(mu):  # the next would be its square
            break
    return mu


def _in_polytope(backend: Backend, cost: Quadratic, limits: Polytope, inside: Array | None) -> Optimum:
    """The optimum inside the limits; where they leave hardly more room than rounding, the z that is known."""
    try:
        return _optimum(backend, cost, limits)
    except SolverFailure as failure:
        if inside is None:
            raise
        trouble = "" if failure.infeasible else str(failure)
        return Optimum(inside, np.zeros(len(limits.lower)), np.zeros((len(inside), 0)), OWN, trouble)


def _optimum(backend: Backend, cost: Quadratic, limits: Polytope) -> Optimum:
    value = limits.A.dot(cost.centre)
    outside = np.maximum(limits.lower - value, value - limits.upper)
    outside -= PRODUCT_ROUNDING * lengths_of(limits.A) * np.linalg.norm(cost.centre)
    N = product(limits.A, cost.T)
    lengths = lengths_of(N)
    if (outside > limits.rounding)[lengths == 0.0].any():
        raise SolverFailure("the exact rows", "their only velocity is outside the limits", infeasible=True)
    if (outside[lengths > 0.0] <= 0.0).all():
        return Optimum(cost.centre, np.zeros(len(value)), cost.T)
    moving = (lengths > 0.0).nonzero()[0]
    rows, lower, upper = limits.A[moving], limits.lower[moving], limits.upper[moving]
    N, lengths = N[moving] / lengths[moving, None], lengths[moving]
    low, high = (lower - value[moving]) / lengths, (upper - value[moving]) / lengths
    size = float(np.maximum(low, -high).max())  # how far the optimum without limits is outside
    n, r = len(cost.centre), len(moving)
    G, b = np.vstack((N, -N)), np.append(high, -low) / size  # G e <= b in units of `size`

    def on_pulling(near: NDArray[np.bool_], name: str, trouble: str) -> Optimum:
        """On those of some limits that pull."""
        at = _pulling(G, b, near)
        shortest, left = _split(G[at])
        z, y = cost.centre + size * cost.T.dot(shortest.dot(b[at])), np.zeros(len(b))
        # Once more what is missing, measured in z: at its limits to rounding, whatever the condition of T.
        value = rows.dot(z)
        missing = np.concatenate(((upper - value) / lengths, (value - lower) / lengths))
        z = z + cost.T.dot(shortest.dot(missing[at]))
        e = cost.K.dot(z - cost.centre)
        y[at] = _non_negative(G[at].T, -e)
        return optimum(z - cost.T.dot(left.dot(e.dot(left))), y, left, name, trouble)

    def optimum(z: Array, y: Array, left: Array, name: str, trouble: str) -> Optimum:
        multipliers = np.zeros(len(value))
        multipliers[moving] = (y[:r] - y[r:]) / lengths
        return Optimum(z, multipliers, cost.T.dot(left), name, trouble)

    try:
        z, name, trouble = solved(backend, BoxQP.of(np.eye(n), np.zeros(n), low / size, high / size, N))
    except SolverFailure as failure:  # perhaps of limits that leave no more room than rounding
        found = on_pulling(np.isfinite(b), OWN, "" if type(backend) is Daqp else str(failure))
        if not limits.allows(found.z, found.z - cost.centre):
            raise
        return found
    near = G.dot(z) >= b - FEASIBILITY_TOLERANCE  # as near as an answer may be outside
    found = on_pulling(near, name, trouble)
    if limits.allows(found.z, found.z - cost.centre):
        return found
    y = np.zeros(len(b))  # opposite limits were near, and cannot both be met
    y[near] = size * _non_negative(G[near].T, -z)
    return optimum(cost.centre + size * cost.T.dot(z), y, _split(G[near])[1], name, trouble)


def _split(N: Array) -> tuple[Array, Array]:
    """The pseudoinverse of N (k, n), and an orthonormal basis (n, n - r) of what moves none of its rows."""
    U, sizes, Vt = svd(N)
    r = rank_of(sizes, N.shape[1] * EPSILON)
    return (Vt[:r].T / sizes[:r]).dot(U[:, :r].T), Vt[r:].T


def _pulling(G: Array, b: Array, near: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Those of some limits that are active at the shortest e inside these; they do not depend on each other."""
    some = near.nonzero()[0]
    E = np.vstack((-G[some].T, -b[some]))
    return np.asarray(some[_non_negative(E, np.eye(len(E))[-1]) > 0.0])


def _non_negative(E: Array, f: Array) -> Array:
    """u >= 0 with the least |E u - f|; zero where SciPy does not find it."""
    try:
        return np.asarray(nnls(E, f)[0]) if E.size else np.zeros(E.shape[1])
    except RuntimeError:
        return np.zeros(E.shape[1])


def largest_pace(
    cost: Quadratic, start: Array, way: Array, delta: float, limits: Polytope, cone: Cone | None, inside: Array
) -> float:
    """p of: minimise 1/2 |K (z - start - p way)|^2 + delta |K way| (1 - p)  over z inside the limits and 0 <= p <= 1.

    Its derivative by p does not fall: |K way| times what limits take away along the chase, less delta. It is zero at p.
    """
    along = cost.K.dot(way)
    along = along / norm(along)

    def missed(p: float) -> float:
        centre = start + p * way
        z = minimise(Daqp(), cost._replace(centre=centre), limits, cone, inside).z
        return float(along.dot(cost.K.dot(centre - z))) - delta

    if missed(1.0) <= 0.0:
        return 1.0
    return 0.0 if missed(0.0) >= 0.0 else float(brentq(missed, 0.0, 1.0, xtol=PRODUCT_ROUNDING, disp=False))
