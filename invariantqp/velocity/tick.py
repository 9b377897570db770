"""The slow path of a tick: a limit is met, or the twist is not.

    a bound met            -> min (z - z*)'H(z - z*) inside the bounds; exact rows slowed down where they do not fit
    the twist not met      -> residual damping, so that a loop is still where its target is out of reach; descent guard

Trouble is a status with a reason, never an exception.
"""

from __future__ import annotations

from dataclasses import replace
from math import hypot, sqrt

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.convexify import Convexified
from invariantqp.velocity.damping import Adaptive, Fixed
from invariantqp.velocity.exact import Reduction
from invariantqp.velocity.forms import gram_data
from invariantqp.velocity.guard import Guard, Scene
from invariantqp.velocity.law import Demand, Problem, VelocityLaw, assemble
from invariantqp.velocity.limits.rows import Polytope, named, polytope
from invariantqp.velocity.qp.backends import SolverFailure, minimise
from invariantqp.velocity.qp.feasible import relaxed, share_in_cone, slowest
from invariantqp.velocity.qp.prices import ACTIVE_TOLERANCE, prices
from invariantqp.velocity.qp.tangents import Cut, minimise_in_cone, with_plane
from invariantqp.velocity.solution import VelocitySolution, clipped, damping_reason, held

# Given away of the largest feasible scale, so that the slowed-down problem has an interior for a solver to find; the
# next one where it finds none.
SCALE_MARGINS = (1e-9, 1e-7, 1e-5)
# A speed limit that has to give way is moved by this share more than it must, to leave a solver an inside; the next one
# where it finds none.
WIDER_CONES = (1e-6, 1e-4, 1e-2)
# Residual damping mu = this dt |s - Jx|_W |J|_W: enough to stop every arm tried from rattling at a target out of reach.
RESIDUAL_DAMPING = 0.5
# Residual damping below this share of |J|_W^2 changes no digit that matters (its square, over what is damped anyway).
QUIET_SHARE = 1e-6
# Rows that cannot be met by more than this, relative, are reported as unmet.
UNMET_TOLERANCE = 1e-9


class Tick:
    """The slow path of one tick: bounds, scaling, guard, failures. Lives for one call."""

    def __init__(self, law: VelocityLaw, demand: Demand) -> None:
        self.law = law
        self.asked = demand
        self.demand: Demand = demand  # becomes slower, or loses its rows, where limits ask for it
        self.scale: float = 1.0
        self.backend: str = ""
        self.troubles: list[str] = []
        self.held_by: str = ""  # the limits that slow the exact rows down
        self.priced: tuple[Array, Array, Array, Polytope] | None = None  # the law's own QP, solved last

    def solution(self, problem: Problem, x: Array) -> VelocitySolution:
        """From the unconstrained optimum x to a velocity that may be commanded."""
        if not np.isfinite(x).all():
            return held(self.asked, "the unconstrained solution overflowed: the input is out of any scale")
        method = "damped" if problem.convex.damping > 0.0 else "closed-form"
        if not self.demand.allows(x):
            method = "qp"
            try:
                x, problem = self._bounded(problem)
            except SolverFailure as failure:
                return held(self.asked, f"no velocity found: {failure}")
        try:
            x, blend = self._guarded(problem, x)
        except SolverFailure as failure:
            blend = 0.0
            if not (failure.infeasible and self.scale < 1.0):  # slowed to the edge: there is no room to do better in
                self.troubles.append(f"neither guarded nor quiet: {failure}")
        x, active = clipped(self.asked, self._settled(x))
        costs = None if self.priced is None else prices(*self.priced)
        m, k = len(x), 0 if self.asked.rows is None else len(np.asarray(self.asked.rows.C))
        if problem.reduction.unmet > UNMET_TOLERANCE:
            self.troubles.append(f"{problem.reduction.unmet:.1e} of the exact rows is beyond these joints")
        return VelocitySolution(
            velocity=x,
            method=method,
            status=self._status(blend),
            reason=self._reason(problem.convex, blend, active),
            active=active,
            residual=self.asked.s - self.asked.J.dot(x),
            scale=self.scale,
            damping=problem.convex.damping,
            guard=blend,
            backend=self.backend,
            multipliers=None if costs is None else costs[:m],
            row_multipliers=None if costs is None or not k else costs[m : m + k],
        )

    def _status(self, blend: float) -> str:
        if self.troubles:
            return "degraded"
        if self.scale < 1.0:
            return "scaled"
        return "guarded" if blend > 0.0 else "ok"

    def _reason(self, convex: Convexified, blend: float, active: tuple[int, ...]) -> str:
        said = [self.law.note, *self.troubles] if self.law.note else list(self.troubles)
        if self.scale < 1.0:
            by = f" (held by {self.held_by})" if self.held_by else ""
            said.append(f"limits allow {self.scale:.3g} of the exact rows' speed{by}")
        if blend > 0.0:
            said.append(f"descent guard: {blend:.3g} of least squares blended in")
        if convex.damping > 0.0:
            said.append(damping_reason(convex))
        if active:
            said.append(f"at the limits of {named(list(active), len(self.asked.lower))}")
        return "; ".join(said)

    def _bounded(self, problem: Problem) -> tuple[Array, Problem]:
        """The optimum inside the limits; rows give way to the box, exact rows that do not fit are slowed down."""
        try:
            return self._minimised(problem), problem
        except SolverFailure as failure:
            demand = self.demand
            if not failure.infeasible or (demand.exact is None and demand.rows is None and demand.cone is None):
                raise
        x = self._given_way(problem)
        if x is not None:
            return x, problem
        demand = self.demand
        share = share_in_cone(problem.reduction, polytope(demand.lower, demand.upper, demand.rows), demand.cone)
        count = len(demand.lower) + (0 if demand.rows is None else len(np.asarray(demand.rows.C)))
        planes = "the tool's speed" if max(share.held_by, default=-1) >= count else ""
        said = named([i for i in share.held_by if i < count], len(demand.lower))
        self.held_by = " and ".join(filter(None, (said, planes)))
        if share.alpha is None:
            by = f" ({self.held_by})" if self.held_by else ""
            self.troubles.append(f"the limits{by} leave no velocity along the exact rows, not even zero; rows dropped")
            self.scale, self.held_by = 0.0, ""
            self.demand = demand._replace(exact=None, anchor=None)
            problem = self.law.build(self.demand)
            return self._minimised(problem), problem
        return self._slowed(demand, share.alpha, SCALE_MARGINS)

    def _given_way(self, problem: Problem) -> Array | None:
        """The optimum with rows, then the cone, moved by the least it takes; None where exact rows are in the way."""
        demand = self.demand
        widths = [demand]
        if demand.rows is not None:
            way = relaxed(demand.rows, demand.lower, demand.upper)
            if way.violation.any():
                m = len(demand.lower)
                by = ", ".join(f"row {i} by {abs(way.violation[i]):.3g}" for i in np.flatnonzero(way.violation))
                joints = named([i for i in way.held_by if i < m], m)
                whom = f"the bounds of {joints}" if joints else "each other"
                self.troubles.append(f"rows contradict {whom}: {by} over")
                widths = [demand._replace(rows=way.widened(margin)) for margin in SCALE_MARGINS]
        cone = demand.cone
        if cone is not None:
            least = slowest(cone, polytope(demand.lower, demand.upper, widths[-1].rows))
            if least > cone.limit:
                self.troubles.append(f"the tool's speed is {least:.3g}, not {cone.limit:.3g}: other limits ask for it")
                widths = [
                    w._replace(cone=cone._replace(limit=least * (1.0 + wider)))
                    for w, wider in zip((*widths, *[widths[-1]] * 2), WIDER_CONES, strict=False)
                ]
        failure: SolverFailure | None = None
        for self.demand in widths:
            try:
                return self._minimised(problem)
            except SolverFailure as trouble:
                failure = trouble
        if demand.exact is None and failure is not None:
            raise failure
        return None

    def _slowed(self, demand: Demand, alpha: float, margins: tuple[float, ...]) -> tuple[Array, Problem]:
        """The optimum at the share alpha of the demanded speed, but for the first margin that a solver can do with."""
        self.scale = alpha * (1.0 - margins[0])
        self.demand = demand.slowed(self.scale)
        problem = self.law.build(self.demand)
        try:
            return self._minimised(problem), problem
        except SolverFailure as failure:
            if not failure.infeasible or len(margins) == 1:
                raise
        return self._slowed(demand, alpha, margins[1:])

    def _minimised(self, problem: Problem, *, priced: bool = True) -> Array:
        H, c = problem.convex.qp()
        solved, limits = self._solved(H, c, problem.reduction)
        if priced:
            self.priced = (H, c, solved.z, limits)
        self.backend = solved.backend
        said = f"{solved.trouble}; solved by {solved.backend}"
        if solved.trouble and said not in self.troubles:  # the guard's QP may fail as the law's did
            self.troubles.append(said)
        return problem.reduction.joint(solved.z)

    def _solved(self, H: Array, c: Array, reduction: Reduction) -> Cut:
        """The optimum on z inside box, rows and cone, and the polytope it was found in."""
        demand, backend = self.demand, self.law.backend
        limits, cone = polytope(demand.lower, demand.upper, demand.rows, reduction), demand.cone
        if cone is None:
            return Cut(minimise(backend, H, c, limits), limits)
        if reduction.basis is not None:
            cone = cone.on(reduction.origin, reduction.basis)
        trouble = ""
        if cone.program is not None and len(c):
            try:
                solved = cone.program.minimise(H, c, limits, cone.J, cone.start, cone.limit)
                return Cut(solved, with_plane(limits, cone, solved.z) if solved.z.any() else limits)
            except SolverFailure as failure:
                if failure.infeasible:
                    raise
                trouble = str(failure)
        cut = minimise_in_cone(backend, H, c, limits, cone)
        return cut._replace(solved=cut.solved._replace(trouble="; ".join(filter(None, (trouble, cut.solved.trouble)))))

    def _guarded(self, problem: Problem, x: Array) -> tuple[Array, float]:
        """The velocity that neither climbs nor rattles where the twist is missed, and the guard's share of it."""
        guard, dt = self.law.guard, self.law.dt
        if guard is None and dt == 0.0:
            return x, 0.0
        demand = self.demand
        scene = (guard or Guard()).scene(demand.J, demand.s, demand.anchor)
        size = float(np.vdot(scene.J, scene.J))
        # A velocity held for dt turns J by about dt |J x|: what is missed comes back as a step that long.
        missed = scene.missed(x)
        quiet = RESIDUAL_DAMPING * dt * missed * sqrt(size)
        if quiet > QUIET_SHARE * size:
            scene = replace(scene, damping=quiet)
            if demand.posture is not None:  # a posture is for joints the task leaves free, not for a task that is stuck
                self.demand = demand._replace(posture=scene.met_share(missed) * demand.posture)
            x = self._calmed(problem, quiet / size)
        if guard is None or scene.surely_enough(scene.decrease(x)):
            return x, 0.0
        best = self._least_squares(scene, problem)
        t = scene.blend(x, best)
        return (x, 0.0) if t == 0.0 else ((1.0 - t) * x + t * best, t)

    def _calmed(self, problem: Problem, share: float) -> Array:
        """The form's own optimum with a share of max|mu| added to its damping."""
        extra = share * problem.convex.largest
        data = self.law.form.gram_data(self.demand.J, self.demand.s)
        calmed = assemble(data, problem.reduction, self.demand, Fixed(hypot(problem.convex.damping, extra)))
        return self._inside(calmed)

    def _least_squares(self, scene: Scene, problem: Problem) -> Array:
        """What least squares in W does inside the same bounds, with the same exact rows."""
        data = gram_data(scene.J, scene.J, scene.s, 1.0)
        if scene.damping > 0.0:
            metric = np.eye(len(data.g)) if self.law.metric is None else self.law.metric
            data = data._replace(G=data.G + scene.damping * metric)
        problem = assemble(data, problem.reduction, self.demand, Adaptive())
        if scene.damping > 0.0:  # a null direction, too, costs what a joint velocity does: limits may make it matter
            mu = problem.convex.mu.copy()
            mu[problem.convex.null] = scene.damping
            problem = problem._replace(convex=problem.convex._replace(mu=mu))
        return self._inside(problem, priced=False)

    def _inside(self, problem: Problem, *, priced: bool = True) -> Array:
        """The problem's optimum inside the limits."""
        x = problem.unconstrained()
        if not self.demand.allows(x):
            return self._minimised(problem, priced=priced)
        if priced:
            self.priced = None
        return x

    def _settled(self, x: Array) -> Array:
        """The velocity shortened by what rounding is over rows and cone, where standing still is inside them."""
        rows, cone = self.demand.rows, self.demand.cone
        share = 1.0 if rows is None else rows.share(x)
        if cone is not None:
            share = min(share, cone.limit / max(cone.limit, cone.speed(x)))
        return share * x if 1.0 > share > 1.0 - ACTIVE_TOLERANCE else x
