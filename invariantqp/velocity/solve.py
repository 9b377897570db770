"""One tick of the law: closed form where it exists and no bound is met, otherwise the convex QP with the same optimum.

    no bound met and the twist met            -> closed form, or damped: done
    a bound met                               -> min (z - z*)'H(z - z*) inside the bounds; exact rows scaled if need be
    the twist not met                         -> descent guard

Trouble is a status with a reason, never an exception.
"""

from __future__ import annotations

from dataclasses import replace
from math import hypot, sqrt
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.systems.pseudoinverse import has_pseudoinverse, pseudoinverse
from invariantqp.velocity.backends import SolverFailure, largest_scale, minimise
from invariantqp.velocity.convexify import Convexified, is_singular
from invariantqp.velocity.damping import Adaptive, Fixed, PaperLambda
from invariantqp.velocity.guard import Guard, Scene
from invariantqp.velocity.law import Demand, Problem, VelocityLaw, assemble
from invariantqp.velocity.objective import PitchForm, gram_data
from invariantqp.velocity.paper import paper_velocity
from invariantqp.velocity.regular import regular_velocity

# A twist missed by less than this fraction of itself is met: no guard can find anything to gain there.
MET_TOLERANCE = 1e-9
# A joint this close to its bound, relative to its speed (or 1), is at it: interior-point solvers stop that far inside.
ACTIVE_TOLERANCE = 1e-6
# Below this |mu| ratio an undamped solution is computed from the factored J, which keeps the digits that G lost.
FACTORED_RATIO = 1e-4
# Of the largest feasible scale, so that the slowed-down problem has an interior for a solver to find.
SCALE_MARGIN = 1.0 - 1e-9
# Residual damping mu = this dt |s - Jx|_W |J|_W: enough to stop every arm tried from rattling at a target out of reach.
RESIDUAL_DAMPING = 0.5
# Residual damping below this share of |J|_W^2 changes no digit that matters (its square, over what is damped anyway).
QUIET_SHARE = 1e-6
# Rows that cannot be met by more than this, relative, are reported as unmet.
UNMET_TOLERANCE = 1e-9


class VelocitySolution(NamedTuple):
    """A joint velocity and how it came about. A tuple, because one is made in every tick.

    Attributes:
        velocity: (m,) joint velocity [rad/s, length/s], inside the bounds.
        method: "closed-form" (the undamped stationary point), "damped" (the filter acted), "qp" (a bound did), "hold".
        status: "ok", "scaled" (exact rows slowed down), "guarded" (the descent guard blended in least squares),
            "degraded" (something was not as asked: see the reason), "held" (no usable answer; standing still).
        reason: in words, "" where there is nothing to say.
        active: joints at a bound.
        residual: (6,) s - J x in the frame of J.
        scale: share of the exact rows' speed that was possible, 1 unless scaled.
        damping: lambda used [unit of G].
        guard: t, share of least squares blended in by the guard; 0 when it did not act.
        backend: the solver that answered, "" without one.
    """

    velocity: Array
    method: str
    status: str
    reason: str
    active: tuple[int, ...]
    residual: Array
    scale: float
    damping: float
    guard: float
    backend: str


def solve(law: VelocityLaw, demand: Demand) -> VelocitySolution:
    """The joint velocity for a checked demand."""
    if isinstance(law.damping, PaperLambda):
        return _as_printed(law, law.damping, demand)
    x = regular_velocity(law, demand)
    if x is not None and is_inside(x, demand):
        residual = _missed(demand, x)
        if residual is not None:
            return VelocitySolution(x, "closed-form", "ok", "", (), residual, 1.0, 0.0, 0.0, "")
    problem = law.build(demand)
    convex = problem.convex
    x = problem.unconstrained()
    if convex.damping == 0.0 and convex.smallest < FACTORED_RATIO * convex.largest:
        x = _factored(law, demand, problem, x)
    if problem.reduction.unmet <= UNMET_TOLERANCE and is_inside(x, demand):
        residual = _missed(demand, x)
        if residual is not None:
            damped = convex.damping > 0.0
            method, reason = ("damped", damping_reason(convex)) if damped else ("closed-form", "")
            return VelocitySolution(x, method, "ok", reason, (), residual, 1.0, convex.damping, 0.0, "")
    return _Tick(law, demand).solution(problem, x)


def _as_printed(law: VelocityLaw, damping: PaperLambda, demand: Demand) -> VelocitySolution:
    """[DS]'s own formula, clipped to the bounds; exact rows are beyond it."""
    tick = _Tick(law, demand)
    if demand.exact is not None:
        return tick.held("PaperLambda knows no exact rows; use another damping")
    try:
        x, trouble = paper_velocity(law, damping, demand)
    except np.linalg.LinAlgError:
        return tick.held("G + Lambda is singular: this is the pole of [DS]'s formula")
    clipped, active = tick.clipped(x)
    reasons = [r for r in (trouble, "" if is_inside(x, demand) else "clipped to the bounds") if r]
    status = "degraded" if reasons else "ok"
    size = float(np.abs(np.asarray(damping.matrix)).max())
    residual = demand.s - demand.J.dot(clipped)
    return VelocitySolution(clipped, "damped", status, "; ".join(reasons), active, residual, 1.0, size, 0.0, "")


def _missed(demand: Demand, x: Array) -> Array | None:
    """The residual s - J x where it is rounding; None where the twist is missed."""
    s = demand.s
    residual: Array = s - demand.J.dot(x)
    return residual if residual.dot(residual) <= MET_TOLERANCE**2 * s.dot(s) else None


def is_inside(x: Array, demand: Demand) -> bool:
    """Whether no bound is met: clipping changes no bit."""
    return bool(np.minimum(np.maximum(x, demand.lower), demand.upper).tobytes() == x.tobytes())


def damping_reason(convex: Convexified) -> str:
    """Why lambda is not zero."""
    what = "the form is singular on these joints" if is_singular(convex) else "near a singularity or principal pitch"
    return f"{what}: |mu| ratio {conditioning(convex):.1e}, damped with lambda = {convex.damping:.3g}"


def conditioning(convex: Convexified) -> float:
    """Smallest |mu| over largest: the distance from a singularity or a principal pitch, in [0, 1]."""
    return convex.smallest / convex.largest if convex.largest > 0.0 else 0.0


def _factored(law: VelocityLaw, demand: Demand, problem: Problem, x: Array) -> Array:
    """The undamped closed form from the factored J, where there is one; x otherwise."""
    if demand.exact is not None or not isinstance(law.form, PitchForm) or not has_pseudoinverse(demand.J, law.form.h):
        return x
    accurate: Array = pseudoinverse(demand.J, law.form.h, joint_metric=law.metric).dot(demand.s)
    if demand.posture is None:
        return accurate
    convex, reduction = problem
    null = convex.V.dot(convex.given_up() * reduction.reduced(demand.posture).dot(convex.V))
    return accurate + reduction.joint(null)


class _Tick:
    """The slow path of one tick: bounds, scaling, guard, failures. Lives for one call."""

    def __init__(self, law: VelocityLaw, demand: Demand) -> None:
        self.law = law
        self.asked = demand
        self.demand = demand  # becomes slower, or loses its rows, where limits ask for it
        self.scale = 1.0
        self.backend = ""
        self.troubles: list[str] = []

    def solution(self, problem: Problem, x: Array) -> VelocitySolution:
        """From the unconstrained optimum x to a velocity that may be commanded."""
        if not np.isfinite(x).all():
            return self.held("the unconstrained solution overflowed: the input is out of any scale")
        method = "damped" if problem.convex.damping > 0.0 else "closed-form"
        if not is_inside(x, self.demand):
            method = "qp"
            try:
                x, problem = self._bounded(problem)
            except SolverFailure as failure:
                return self.held(f"no velocity found: {failure}")
        try:
            x, blend = self._guarded(problem, x)
        except SolverFailure as failure:
            self.troubles.append(f"neither guarded nor quiet: {failure}")
            blend = 0.0
        x, active = self.clipped(x)
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
        )

    def _status(self, blend: float) -> str:
        if self.troubles:
            return "degraded"
        if self.scale < 1.0:
            return "scaled"
        return "guarded" if blend > 0.0 else "ok"

    def _reason(self, convex: Convexified, blend: float, active: tuple[int, ...]) -> str:
        said = list(self.troubles)
        if self.scale < 1.0:
            said.append(f"limits allow {self.scale:.3g} of the exact rows' speed")
        if blend > 0.0:
            said.append(f"descent guard: {blend:.3g} of least squares blended in")
        if convex.damping > 0.0:
            said.append(damping_reason(convex))
        if active:
            said.append(f"at the limits of joint{'s' if len(active) > 1 else ''} {', '.join(map(str, active))}")
        return "; ".join(said)

    def _bounded(self, problem: Problem) -> tuple[Array, Problem]:
        """The optimum inside the bounds; exact rows that do not fit are slowed down, largest share first."""
        try:
            return self._minimised(problem), problem
        except SolverFailure as failure:
            if self.demand.exact is None or not failure.infeasible:
                raise
        alpha = largest_scale(problem.reduction, self.demand.lower, self.demand.upper)
        if alpha is None:
            self.troubles.append("the limits leave no velocity along the exact rows, not even zero; rows dropped")
            self.demand = self.demand._replace(exact=None, anchor=None)
        else:
            self.scale = alpha * SCALE_MARGIN
            self.demand = self.demand.slowed(self.scale)
        problem = self.law.build(self.demand)
        return self._minimised(problem), problem

    def _minimised(self, problem: Problem) -> Array:
        H, c = problem.convex.qp()
        solved = minimise(self.law.backend, H, c, problem.reduction, self.demand.lower, self.demand.upper)
        self.backend = solved.backend
        if solved.trouble:
            self.troubles.append(f"{solved.trouble}; solved by {solved.backend}")
        return problem.reduction.joint(solved.z)

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
                share = max(0.0, 1.0 - missed / sqrt(float(scene.s.dot(scene.s))))
                self.demand = demand._replace(posture=share * demand.posture)
            x = self._slowed(problem, quiet / size)
        if guard is None or scene.surely_enough(scene.decrease(x)):
            return x, 0.0
        best = self._least_squares(scene, problem)
        t = scene.blend(x, best)
        return (x, 0.0) if t == 0.0 else ((1.0 - t) * x + t * best, t)

    def _slowed(self, problem: Problem, share: float) -> Array:
        """The form's own optimum with a share of max|mu| added to its damping."""
        extra = share * problem.convex.largest
        data = self.law.form.gram_data(self.demand.J, self.demand.s)
        slowed = assemble(data, problem.reduction, self.demand, Fixed(hypot(problem.convex.damping, extra)))
        return self._inside(slowed)

    def _least_squares(self, scene: Scene, problem: Problem) -> Array:
        """What least squares in W does inside the same bounds, with the same exact rows."""
        data = gram_data(scene.J, scene.J, scene.s, 1.0)
        if scene.damping > 0.0:
            metric = np.eye(len(data.g)) if self.law.metric is None else self.law.metric
            data = data._replace(G=data.G + scene.damping * metric)
        return self._inside(assemble(data, problem.reduction, self.demand, Adaptive()))

    def _inside(self, problem: Problem) -> Array:
        """The problem's optimum inside the bounds."""
        x = problem.unconstrained()
        return x if is_inside(x, self.demand) else self._minimised(problem)

    def clipped(self, x: Array) -> tuple[Array, tuple[int, ...]]:
        """The velocity without rounding past its bounds, and the joints at them."""
        lower, upper = self.asked.lower, self.asked.upper
        x = np.minimum(np.maximum(x, lower), upper)
        margin = ACTIVE_TOLERANCE * np.maximum(1.0, np.abs(x))
        at = (x <= lower + margin) | (x >= upper - margin)
        return x, tuple(np.flatnonzero(at).tolist())

    def held(self, reason: str) -> VelocitySolution:
        x, active = self.clipped(np.zeros(len(self.asked.lower)))
        residual = self.asked.s - self.asked.J.dot(x)
        return VelocitySolution(x, "hold", "held", reason, active, residual, 0.0, 0.0, 0.0, "")
