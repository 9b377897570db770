"""One tick of the law: convex problems, stage by stage; each stage is a function of what the stage before it returned.

    minimise over z   1/2 |A (origin + B z) - a b|^2 + 1/2 |z - z_p|_Lambda^2     inside the limits,   x = T y,
                                                                                               y = origin(a) + B z

T makes the joint metric the identity; B and the origin describe the velocities that meet the exact rows at the share a
of their speed (`exact`): rows, twist and posture slow down together.

    free          the optimum without limits, where that is inside them; otherwise:
    give way      rows that contradict the box, and a tool speed that contradicts both, are relaxed by the least
    share         exact rows slow down along their direction where limits require it           2 QPs, with exact rows
    pace          the chase of a target slows down before limits bend it                       1 or 2 convex problems
    minimise      the optimum inside the limits                                                1 QP
    calm          once more, with damping that grows with the residual (`damping.calm`)        1 QP
    guard         with a form: least squares inside the same limits is blended in where the form does not descend

Two more QPs find what position limits alone leave of the chase where they are active; a form's guard does pace,
minimise and calm for least squares, too. A pace is the root of what does not fall with it, one QP a trial, which the
compiled core finds by one; a tool speed that is active solves each QP two or three times, for the multiplier.

Continuity. Each answer is the optimum of a strictly convex problem whose data are continuous in (J, s, limits).
Contradictions are reported (`troubles`). Only `SolverFailure` is raised, where no velocity was found at all.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.geometry.se3 import norm
from invariantqp.legacy.attempted import attempted
from invariantqp.legacy.damping import CALM, Damping, calm, worth
from invariantqp.legacy.exact import (
    REGULARISATION,
    Nearest,
    Reduction,
    Share,
    fixed_beside,
    nearest_to_demand,
    reduce,
    share_of,
)
from invariantqp.legacy.law import Demand, VelocityLaw
from invariantqp.legacy.objective import NULL_RATIO, Objective, Spectrum, convexified, least_squares, spectrum_of
from invariantqp.legacy.qp import PRODUCT_ROUNDING, Optimum, Polytope, Quadratic, cone_on, largest_pace, minimise
from invariantqp.velocity.backends import Backend, Daqp, SolverFailure
from invariantqp.velocity.forms import PitchForm
from invariantqp.velocity.guard import Guard
from invariantqp.velocity.limits import Cone, LimitRows
from invariantqp.velocity.reasons import Code, Reason, row_name

# The joint speed of a task, as a share of the fastest, at which half of the posture is followed. Measured
# (`examples/14_defaults.py`): the smaller it is, the more suddenly the posture sets in where a motion begins or ends;
# the larger, the nearer to their limits joints come where a path goes past one. With positions read to 2e-5 rad an arm
# that stays moves by less than 0.1 deg in ten seconds.
POSTURE_PACE = 0.01
# What gave way is given this share more, so that the next problem has an interior; the tool's least speed likewise.
WIDENING = 1e-7
FASTER = 1e-4


class Problem(NamedTuple):
    """The problem of one tick, for any share of the exact rows' speed, in coordinates y."""

    demand: Demand
    A: Array  # (6, m) measured joint twists on y
    wanted: Array  # (6,) measured twist
    attempt: Array  # (6,) measured twist that is attempted, which differs from `wanted` with a form
    ahead: Array | None  # (6,) likewise without the chase; None where there is none
    posture: Array | None  # (m,) y wanted where the twist leaves joints free, or None
    reduction: Reduction  # the velocities that meet the exact rows
    damping: Damping  # the policy
    spectrum: Spectrum | None  # of A B; None for [DS]'s problem made convex, with this pitch:
    pitch: float
    J: Array  # (6, m) joint twists on y, for that problem
    worth: float = 1.0  # whether it is worth it to move the joints, `damping.worth`; a twist by itself always is

    def objective(self, share: float) -> Objective:
        """The objective in z at a share of the speed."""
        origin, basis = self.reduction.origin(share), self.reduction.basis
        posture = None if self.posture is None else (share * self.posture - origin).dot(basis)
        if self.spectrum is None:
            s = share * self.demand.s - self.J.dot(origin)
            return convexified(self.J.dot(basis), s, self.pitch, posture, self.damping)
        fixed = self.A.dot(origin)
        ahead = None if self.ahead is None else share * self.ahead - fixed
        return least_squares(self.spectrum, share * self.attempt - fixed, posture, self.damping, ahead)

    def on(self, reduction: Reduction) -> Problem:
        """The same for velocities of which less is free."""
        if self.spectrum is None or reduction.basis is self.reduction.basis:
            return self._replace(reduction=reduction)
        spectrum = spectrum_of(self.A.dot(reduction.basis), self.spectrum.largest)
        return self._replace(reduction=reduction, spectrum=spectrum)

    def possible(self) -> Array:
        """(6,) the part of the measured twist that the joints can do at all, beside the exact rows.

        Of six joints and more it is all of it.
        """
        rows = self.demand.exact is not None
        if self.spectrum is None or not (rows or self.A.shape[1] < 6):
            return self.wanted
        U, sigma, _, largest = self.spectrum
        fixed = self.A.dot(self.reduction.full)
        U = U[:, : len(sigma)][:, sigma > NULL_RATIO * largest]
        possible: Array = fixed + U.dot((self.wanted - fixed).dot(U))
        return possible


class Limits(NamedTuple):
    """The limits on y or z, after contradictions gave way (`troubles` says which), and a velocity inside them."""

    polytope: Polytope
    position: Polytope  # without the limits of velocity and acceleration
    cone: Cone | None
    inside: Array
    troubles: tuple[Reason, ...] = ()

    def on(self, origin: Array, basis: Array, inside: Array) -> Limits:
        """The same on what is left, y = origin + basis z; `inside` is a y."""
        polytope, value = self.polytope.on(origin, basis, inside), self.polytope.A.dot(origin)
        position = polytope._replace(lower=self.position.lower - value, upper=self.position.upper - value)
        cone = None if self.cone is None else cone_on(self.cone, origin, basis)
        return Limits(polytope, position, cone, (inside - origin).dot(basis), self.troubles)

    def beside(self, nearest: Nearest) -> Limits:
        """Those that do not keep exact rows from being nearer to their demand."""
        polytope, position = self.polytope.without(nearest.limits), self.position.without(nearest.limits)
        return self._replace(polytope=polytope, position=position, cone=None if nearest.cone else self.cone)


class Room(NamedTuple):
    """What is left to minimise over: the velocities y = origin + basis z at a share of the exact rows' speed."""

    share: Share
    reduction: Reduction
    origin: Array  # (m,)
    basis: Array  # (m, n)
    limits: Limits  # on z

    def velocity(self, z: Array) -> Array:
        """(m,) y of z."""
        y: Array = self.origin + self.basis.dot(z)
        return y

    def coordinates(self, y: Array) -> Array:
        """(n,) z of y."""
        z: Array = (y - self.origin).dot(self.basis)
        return z

    def narrowed(self, z: Array, basis: Array) -> Room:
        """The velocities that differ from that of z by basis (n, k) times what is left."""
        limits = self.limits.on(z, basis, z)
        return self._replace(origin=self.velocity(z), basis=self.basis.dot(basis), limits=limits)

    def nearest(self, backend: Backend, cost: Quadratic) -> Optimum:
        """The optimum inside all limits."""
        return minimise(backend, cost, self.limits.polytope, self.limits.cone, self.limits.inside)


class Answer(NamedTuple):
    """A velocity inside the limits, and how it came about."""

    y: Array  # (m,) the velocity, in the joints' own metric
    room: Room
    objective: Objective  # what was minimised last
    found: Optimum | None  # the optimum of the QP; None where no limit is active
    slowed: Array  # (m,) the part of the chase, as a velocity y, that limits slow down; zero where they do not
    pace: float  # share of the chase that is left, 1 where limits do not slow it down
    blended: float  # share of least squares that the guard blended in
    troubles: tuple[Reason, ...]  # what is not as demanded

    @property
    def bound(self) -> Optimum | None:
        """The optimum where limits are active in it, or slow the chase down; None where none are."""
        found = self.found
        active = found is not None and (found.nu > 0.0 or bool(found.multipliers.any()) or self.pace < 1.0)
        return found if active else None


def answered(law: VelocityLaw, problem: Problem) -> Answer:
    """The answer, with or without active limits.

    Raises:
        SolverFailure: no velocity was found.
    """
    demand, reduction = problem.demand, problem.reduction
    objective = problem.objective(1.0)
    y = reduction.full + reduction.basis.dot(objective.centre())
    whole = not reduction.contradicts and reduction.excess(demand.held) == 0.0
    if whole and demand.allows(y if law.to_joint is None else law.to_joint.dot(y)):
        room = room_of(reduction, Limits(*limits_of(law, demand), y), Share(1.0, y))
        first = Answer(y, room, objective, None, np.zeros(len(y)), 1.0, 0.0, ())
    else:
        room = room_within(law, demand, reduction)
        if demand.exact is not None:
            problem = problem.on(room.reduction)
            objective = problem.objective(room.share.value)
        first = _chasing(law, problem, room, objective)
    mu = _calm(law, problem, first.y + first.slowed, first.objective.speed(room.coordinates(first.y)))
    answer = _calmed(law, first, mu)
    if law.guard is None or problem.attempt is problem.wanted:
        return answer
    ahead = None if demand.chase is None else demand.root.dot(demand.chase.ahead)
    plain = problem._replace(attempt=problem.wanted, ahead=ahead)
    best = _calmed(law, _chasing(law, plain, room, plain.objective(room.share.value)), mu)
    return _guarded(law.guard, problem, answer, best, mu)


def _calm(law: VelocityLaw, problem: Problem, y: Array, speed: float) -> float:
    """mu, the damping for what a velocity y (m,) leaves of the twist; `speed` is that of y, as `calm` has it."""
    if law.dt == 0.0 or problem.spectrum is None:
        return 0.0
    factor = CALM * problem.reduction.bend / problem.worth
    return calm(problem.A, problem.wanted, problem.A.dot(y), speed, law.dt + problem.demand.held, factor)


def posed(law: VelocityLaw, demand: Demand, damping: Damping) -> Problem:
    """The problem of one tick."""
    T, m = law.to_joint, demand.J.shape[1]
    J = demand.J if T is None else demand.J.dot(T)
    A, wanted = demand.root.dot(J), demand.root.dot(demand.s)
    posture = demand.posture if law.from_joint is None or demand.posture is None else law.from_joint.dot(demand.posture)
    ahead = None if demand.chase is None else demand.root.dot(demand.chase.ahead)
    reduction = Reduction.without_rows(m)
    if demand.exact is not None:
        reduction = reduce(demand.exact.on(T), demand.root, demand.row_rank, demand.s)
    problem = Problem(demand, A, wanted, wanted, ahead, posture, reduction, damping, None, 0.0, J)
    if isinstance(law.form, PitchForm) and law.form.convexified:
        return problem._replace(ahead=None, pitch=law.form.h)
    whole = spectrum_of(A)
    free = whole if demand.exact is None else spectrum_of(A.dot(reduction.basis), whole.largest)
    problem = problem._replace(spectrum=free)
    chase = demand.chase
    if chase is not None and demand.fastest is not None and law.dt > 0.0:
        moves = demand.root.dot(demand.J)
        problem = problem._replace(worth=worth(moves, wanted, chase.lower, chase.upper, demand.fastest))
    if posture is not None and demand.fastest is not None:
        problem = problem._replace(posture=_unhurried(law, problem, _followed(law, problem) * posture))
    if law.form is None:
        return problem
    fraction = None if law.guard is None else law.guard.fraction
    inverse_root = np.asarray(np.linalg.inv(demand.root), np.float64)
    if ahead is not None:
        ahead = attempted(law.form, inverse_root, whole, ahead, damping, fraction)
    return problem._replace(attempt=attempted(law.form, inverse_root, whole, wanted, damping, fraction), ahead=ahead)


def _followed(law: VelocityLaw, problem: Problem) -> float:
    """The share of the posture that is followed: t^2 / (t^2 + POSTURE_PACE^2), t the joint speed that the task needs.

    t is a share of the joints' fastest. Of a chase d counts (1 - slack^2 / |d|^2) d, and nothing within its slack. So a
    task at rest leaves the joints at rest, and the noise of measured positions, which the chase follows, does not move
    them.
    """
    demand, reduction = problem.demand, problem.reduction
    s, chase = demand.s, demand.chase
    if chase is not None:
        size = norm(demand.root.dot(s - chase.ahead))
        share = 0.0 if size <= chase.slack else 1.0 - (chase.slack / size) ** 2
        s = chase.ahead + share * (s - chase.ahead)
        if demand.exact is not None and chase.rows_ahead is not None:
            demands = chase.rows_ahead + share * (demand.exact.b - chase.rows_ahead)
            reduction = reduction._replace(full=demands.dot(reduction.inverse))
    b = demand.root.dot(s)
    needed = problem._replace(attempt=b, ahead=None, posture=None, reduction=reduction).objective(1.0)
    y = reduction.full + reduction.basis.dot(needed.centre())
    x = y if law.to_joint is None else law.to_joint.dot(y)
    t = float((np.abs(x) / np.asarray(demand.fastest)).max())
    return t * t / (t * t + POSTURE_PACE * POSTURE_PACE)


def _unhurried(law: VelocityLaw, problem: Problem, posture: Array) -> Array:
    """The posture (m,) on y, so that it changes what joints do beside the twist by at most `change` in a tick.

        w = y_p - y_before,   d = V diag(lambda^2 / (sigma^2 + lambda^2)) V'w       what of w the joints follow
        y_before + w / max(1, |d_j| / change_j)

    So joints that a posture sets in motion, stops or turns another way do not jump, also where damping leaves a weak
    direction to it; what moves the tool well is as it was.
    """
    demand, spectrum = problem.demand, problem.spectrum
    if demand.before is None or demand.change is None or spectrum is None:
        return posture
    before = demand.before if law.from_joint is None else law.from_joint.dot(demand.before)
    V, way = problem.reduction.basis.dot(spectrum.Vt.T), posture - before
    d = V.dot(spectrum.led(problem.damping) * way.dot(V))
    x = d if law.to_joint is None else law.to_joint.dot(d)
    return np.asarray(before + way / max(1.0, float((np.abs(x) / demand.change).max())))


def limits_of(law: VelocityLaw, demand: Demand) -> tuple[Polytope, Polytope, Cone | None]:
    """The limits on y: all but the tool's speed; without those of velocity and acceleration; the tool's speed."""
    boxes = [(demand.lower, demand.upper)]
    boxes += [boxes[0] if demand.chase is None else (demand.chase.lower, demand.chase.upper)]
    m = len(demand.lower)
    rows = LimitRows.none(m) if demand.rows is None else demand.rows
    limits, position = (Polytope.of(*box, rows) for box in boxes)
    T, cone = law.to_joint, demand.cone
    if T is None:
        return limits, position, cone
    still = np.zeros(m)
    return limits.on(still, T), position.on(still, T), None if cone is None else cone_on(cone, still, T)


def room_within(law: VelocityLaw, demand: Demand, reduction: Reduction) -> Room:
    """The velocities at the share of the exact rows' speed that the limits allow, after contradictions gave way."""
    limits = _given_way(law, demand)
    nearest = nearest_to_demand(reduction, limits.polytope, limits.cone, limits.inside, law.backend)
    if nearest.beside:
        reduction = fixed_beside(reduction, limits.polytope, limits.cone, nearest)
        limits, share = limits.beside(nearest), Share(nearest.share, nearest.inside)
    else:
        share = share_of(reduction, limits.polytope, limits.cone, nearest.inside, law.dt, law.backend, demand.held)
    return room_of(reduction, limits, share)


def room_of(reduction: Reduction, limits: Limits, share: Share) -> Room:
    """The velocities inside the limits at a share of the exact rows' speed."""
    origin, basis = reduction.origin(share.value), reduction.basis
    return Room(share, reduction, origin, basis, limits.on(origin, basis, share.velocity))


def _chasing(law: VelocityLaw, problem: Problem, room: Room, objective: Objective) -> Answer:
    """The velocity inside the limits: position limits bend the chase of a target, all others slow it down first.

        z*(p)     the optimum without limits for the twist whose chase has the pace p in [0, 1]
        K, z+(p)  the same calmed, for what z*(1) leaves of the twist
        z1, z0    nearest to z+(1) and z+(0) inside the position limits and rows
        P(delta)  p of the minimum of 1/2 |K (z - z0 - p (z1 - z0))|^2 + delta |K (z1 - z0)| (1 - p) over z inside all
                  limits and p
        p         P(|ahead| + slack P(|ahead| + slack))
        z         nearest to z*(p) inside all limits: least squares of that twist

    So limits may take away delta along the chase, as least squares has it; what is more slows the chase down, in all
    its directions alike. A slow chase takes longer, so it may miss the less, or the tool would be led the farther off.
    What will be calmed does not slow it: out of reach, the speed of a stretched arm towards its target keeps nothing
    else back. P is part of the minimum of one convex function, so the answer is continuous in all data.
    """
    chase, (polytope, position, cone, inside, _) = problem.demand.chase, room.limits
    if chase is None or objective.still is None:
        return _nearest(law, room, objective)
    whole, unchased = objective.centre(), objective.paced(0.0).centre()
    mu = _calm(law, problem, room.velocity(whole), 0.0)
    calmed = objective.calmed(mu)
    cost = calmed.quadratic()
    found = minimise(law.backend, cost, position, None, inside)
    if polytope.allows(found.z) and (cone is None or cone.allows(found.z, NEGLIGIBLE)):
        return _answer(room, objective, found) if mu == 0.0 else _nearest(law, room, objective)
    start = minimise(law.backend, calmed.paced(0.0).quadratic(), position, None, inside).z
    way = found.z - start
    if norm(cost.K.dot(way)) <= NULL_RATIO * norm(cost.K.dot(found.z)):
        return _nearest(law, room, objective)
    ahead = norm(problem.demand.root.dot(chase.ahead)) * room.share.value
    pace = 1.0
    for _ in range(2):
        pace = largest_pace(cost, start, way, ahead + pace * chase.slack, polytope, cone, inside)
        if pace in (0.0, 1.0):
            break
    slowed = room.basis.dot((1.0 - pace) * (whole - unchased))
    return _nearest(law, room, objective.paced(pace))._replace(slowed=slowed, pace=pace)


def _nearest(law: VelocityLaw, room: Room, objective: Objective) -> Answer:
    """The optimum inside all limits."""
    return _answer(room, objective, room.nearest(law.backend, objective.quadratic()))


def _answer(room: Room, objective: Objective, found: Optimum) -> Answer:
    """The answer for an optimum in z."""
    trouble: tuple[Reason, ...] = ()
    if found.trouble:
        trouble = (Reason(Code.SOLVER, words=f"{found.trouble}; solved by {found.backend}"),)
    y = room.velocity(found.z)
    return Answer(y, room, objective, found, np.zeros(len(y)), 1.0, 0.0, (*room.limits.troubles, *trouble))


def _calmed(law: VelocityLaw, answer: Answer, mu: float) -> Answer:
    """The answer once more, at its pace, with 1/2 mu |z|^2 added."""
    if mu == 0.0:
        return answer
    again = _nearest(law, answer.room, answer.objective.calmed(mu))
    return again._replace(slowed=answer.slowed, pace=answer.pace)


def _guarded(guard: Guard, problem: Problem, answer: Answer, best: Answer, mu: float) -> Answer:
    """The answer of a form, with least squares blended in where limits keep it from reducing the error enough.

        f(y) = 1/2 |b|^2 - 1/2 |b - A y|^2 - 1/2 mu |y|^2
        keep y_f where f(y_f) >= eta f(y_W);   else y = (1 - t) y_f + t y_W, the smallest t that reaches eta f(y_W)

    y_W, the `best`, is the least-squares velocity inside the same limits. The blend stays inside them (they are
    convex), is continuous in the data, as independent of the frame as y_f, and y_f wherever that meets the twist.

    Proof of descent, where y_W gains at all: along the segment f is a concave quadratic, f(y_f) < eta f(y_W) <= f(y_W)
    at its ends, so it takes the value eta f(y_W) at a t in (0, 1]; hence f(y) >= eta f(y_W) > 0 for the velocity
    returned. Where standing still is allowed f(y_W) >= f(0) = 0: the error never grows to first order.
    """
    t = blend(problem.A, answer.room.share.value * problem.wanted, mu, answer.y, best.y, guard.fraction)
    if t == 0.0:
        return answer
    return answer._replace(y=(1.0 - t) * answer.y + t * best.y, blended=t)


def blend(A: Array, b: Array, mu: float, y_f: Array, y_W: Array, fraction: float) -> float:
    """The smallest t in [0, 1] at which (1 - t) y_f + t y_W decreases the error enough; eta is the fraction.

    A (6, m) and b (6,) are the joint twists and the wanted twist in the measure, mu is from `calm`.
    """

    def decrease(y: Array) -> float:
        r = b - A.dot(y)
        return 0.5 * float(b.dot(b) - r.dot(r) - mu * y.dot(y))

    best = decrease(y_W)
    # With exact rows even y_W may increase the error; it may then be exceeded by (1 - eta) of that increase.
    missing = (fraction * best if best > 0.0 else (2.0 - fraction) * best) - decrease(y_f)
    achieved = A.dot(y_f)
    size, terms = max(norm(b), norm(achieved)), sqrt(float(np.vdot(A, A))) * norm(y_f)
    if missing <= PRODUCT_ROUNDING * size * max(size, terms):
        return 0.0
    d = y_W - y_f
    step = A.dot(d)
    slope = float(step.dot(b - achieved) - mu * y_f.dot(d))
    curvature = float(step.dot(step) + mu * d.dot(d))
    discriminant = slope * slope - 2.0 * curvature * missing
    root = slope + sqrt(discriminant) if discriminant > 0.0 else slope
    return min(2.0 * missing / root if root > 0.0 else inf, 1.0)


def _given_way(law: VelocityLaw, demand: Demand) -> Limits:
    """The limits; those that contradict others are relaxed by the least that is necessary.

    Rows give way to the box, by the least sum of squares, and the tool's speed to both. No velocity limit ever does.
    """
    troubles: tuple[Reason, ...] = ()
    x = np.minimum(np.maximum(np.zeros(len(demand.lower)), demand.lower), demand.upper)
    if demand.rows is not None and not demand.rows.allow(x):
        rows, x, troubles = _rows_given_way(demand.rows, demand.lower, demand.upper, law.to_joint)
        demand = demand._replace(rows=rows)
    polytope, position, cone = limits_of(law, demand)
    y = x if law.from_joint is None else law.from_joint.dot(x)
    if cone is not None and not cone.allows(y):
        m = len(x)
        weight = np.sqrt(REGULARISATION) * (float(np.linalg.norm(cone.J)) or 1.0)
        slowest = Quadratic.diagonal(np.full(m, weight), np.zeros(m)).plus(cone.J, -cone.start)(1.0)
        y = minimise(Daqp(), slowest, polytope, None, y).z
        least = cone.speed(y)
        if least > cone.limit:
            troubles += (Reason(Code.TOOL_FASTER, numbers=(least, cone.limit)),)
            cone = cone._replace(limit=least * (1.0 + FASTER))
    return Limits(polytope, position, cone, y, troubles)


def _rows_given_way(
    rows: LimitRows, lower: Array, upper: Array, to_joint: Array | None
) -> tuple[LimitRows, Array, tuple[Reason, ...]]:
    """The rows, moved by the least for which the box contains a velocity; the least such velocity (m,); what moved.

        minimise |t|^2   over   lower <= N y - t <= upper,   x = T y in the box;   then |y|^2

    N are the rows on y at length one: neither the scale of a row nor a unit decides which of them gives way. Rows that
    some velocity in the box satisfies never do: so the least velocity inside all limits is tried first.

    Raises:
        SolverFailure: none was found.
    """
    k, m = rows.C.shape
    T = np.eye(m) if to_joint is None else to_joint
    shortest, still = Quadratic.diagonal(np.ones(m), np.zeros(m)), np.zeros(m)
    try:  # where some velocity meets all
        least = minimise(Daqp(), shortest, Polytope.of(lower, upper, rows).on(still, T)).z
        x = np.asarray(np.clip(T.dot(least), lower, upper))
        if (np.abs(rows.excess(x)) <= PRODUCT_ROUNDING * np.linalg.norm(rows.C, axis=1) * norm(x)).all():
            return rows, x, ()
    except SolverFailure:
        pass
    N = rows.C.dot(T)
    lengths = np.linalg.norm(N, axis=1)
    lengths[lengths == 0.0] = 1.0
    apart = np.block([[T, np.zeros((m, k))], [N / lengths[:, None], -np.eye(k)]])
    limits = Polytope(apart, np.append(lower, rows.lower / lengths), np.append(upper, rows.upper / lengths))
    root, z = np.append(np.full(m, np.sqrt(REGULARISATION)), np.ones(k)), np.zeros(m + k)
    for _ in range(2):
        z[m:] = 0.0
        found = minimise(Daqp(), Quadratic.diagonal(root, z), limits)
        z = found.z.copy()
    t, size = z[m:], np.abs(z[m:]).max()
    moved: NDArray[np.bool_] = np.abs(t) > NEGLIGIBLE * np.linalg.norm(z)
    t = lengths * np.where(moved, t + np.sign(t) * WIDENING * size, 0.0)
    wider = LimitRows(rows.C, rows.lower + np.minimum(t, 0.0), rows.upper + np.maximum(t, 0.0))
    least = minimise(Daqp(), shortest, Polytope.of(lower, upper, wider).on(still, T), None, z[:m]).z
    x = np.asarray(np.clip(T.dot(least), lower, upper))
    if not moved.any():
        return wider, x, ()
    pulls = np.abs(found.multipliers[:m]) * np.linalg.norm(T, axis=1) > NEGLIGIBLE * size
    share = np.round(np.abs(z[m:]) / size, 9)  # rows alike but for rounding keep their order
    worst = sorted(np.flatnonzero(moved).tolist(), key=lambda i: -share[i])
    names, by = tuple(row_name(i, rows.names) for i in worst), tuple((lengths * np.abs(z[m:]))[worst].tolist())
    return wider, x, (Reason(Code.ROWS_CONTRADICT, tuple(np.flatnonzero(pulls).tolist()), names, by),)
