"""Pink's frame task, measured at one physical point of the tool; a Pink program changes in one line.

    minimise 1/2 (dq - dq*)'H(dq - dq*),   H = A'A + damping,   A = root J
    |root s|^2 = L^2 |omega|^2 + |v at the point|^2

dq* is the displacement of this library's own law without limits; H weighs departures from it where a limit is active or
another task competes. Pink's limits, barriers and other tasks stay as they are.

Reference: Caron et al., Pink (pin-pink); [DS] Sect. 6.2 for pitch forms.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.measure import ToolMeasure
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.robots.models import chain_to
from invariantqp.robots.pink import Configuration, FrameTask
from invariantqp.robots.pinocchio import ANGULAR_FIRST, placement
from invariantqp.velocity.damping import (
    UNLIMITED_CEILING,
    UNLIMITED_THRESHOLD,
    Adaptive,
    Damping,
    PaperLambda,
    damping_of,
)
from invariantqp.velocity.forms import CarriedMetric, Form, form_of
from invariantqp.velocity.guard import Guard
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.objective import Objective
from invariantqp.velocity.posed import posed
from invariantqp.velocity.problem import guard_of
from invariantqp.velocity.solve import solve

__all__ = ["InvariantFrameTask"]

# The cost of a joint direction that does not move the frame, relative to the largest: a few thousandths of what a
# posture task with Pink's usual cost of 1e-3 gives it, and enough for DAQP where there is no such task.
NULL_WEIGHT = 3e-10
# Measured: UR5, Panda and SO-101 come to rest at targets 1.2 and 3 m out of reach from 0.2 on, where without it (as
# with Pink's own task) they oscillate at full speed. Targets in reach are reached within 1 mm in the same number of
# steps inside velocity limits, and in 3.6 instead of 14 on average without limits.
LM_DAMPING = 0.2


class InvariantFrameTask(FrameTask):  # type: ignore[misc]
    """Regulate the pose of a frame of the robot, measured at a physical point: the choice of the frame does not matter.

    Attributes:
        form: what is attempted of a twist that the joints cannot do, or a CarriedMetric; None is least squares at the
            point.
        point: (3,) in the frame [length], or "own".
        cost: [cost]/[m].
        damping: the policy near singularities; None is `Adaptive()`, stronger where a joint has no velocity limit.
        guard: the descent guard of a form, or None.
    """

    form: Form | CarriedMetric | None
    point: Array | str
    cost: float
    damping: Damping | None
    guard: Guard | None

    def __init__(
        self,
        frame: str,
        h: Form | CarriedMetric | float | None = None,
        *,
        cost: float = 1.0,
        damping: Damping | float | None = None,
        guard: Guard | bool = True,
        point: ArrayLike | Literal["own"] | None = None,
        length: float | None = None,
        gain: float = 1.0,
        lm_damping: float = LM_DAMPING,
    ) -> None:
        """A task like `pink.FrameTask(frame, position_cost, orientation_cost, lm_damping, gain)`.

        Args:
            frame: name of the frame.
            h: the `form` of `Controller`, in the world frame.
            cost: weight against other tasks, Pink's position_cost [cost]/[m]; a radian costs as much as L metres.
            damping: as in `invariantqp.Controller`; `Selective` has its speed for a step [rad].
            guard: as in `invariantqp.solve_velocity`; it does not see Pink's limits.
            point: (3,) in the frame, as in `Controller`; None is the frame's origin.
            length: L [length/rad], as in `Controller`.
            gain: share of the error removed in a step, in [0, 1].
            lm_damping: more damping the larger the error, lambda^2 = lm_damping |error|^2 in the measure. It vanishes
                with the error; 0 is none.

        Raises:
            BadInput: numbers out of range, something that is not a form, or `PaperLambda`, which is no quadratic cost.
        """
        if not isinstance(frame, str):
            raise BadInput("frame", excerpt(frame), "a frame's name")
        self.form = form_of(h)
        self.point = "own" if isinstance(point, str) else np.zeros(3)
        if isinstance(point, str) and point != "own":
            raise BadInput("point", repr(point), '"own" or (3,) in the frame')
        if point is not None and not isinstance(point, str):
            self.point = arrays.vector(point, 3, "point")
        self._length = None if length is None else arrays.number(length, "length", "a length", positive=True)
        policy = damping_of(damping, limited=True)
        if isinstance(policy, PaperLambda):
            raise BadInput("damping", "PaperLambda", "a policy that only adds to the cost, such as Adaptive()")
        self.damping = None if damping is None else policy
        self.guard = guard_of(guard)
        share = arrays.not_negative(gain, "gain", "a share of the error")
        if share > 1.0:
            raise BadInput("gain", f"{share:g}", "a share of the error, from 0 to 1", "A larger gain overshoots.")
        super().__init__(frame, 1.0, 1.0, arrays.not_negative(lm_damping, "lm_damping", "a scale"), share)
        self.cost = arrays.not_negative(cost, "cost", "a weight")  # one number: no frame's axes are preferred
        self._model: Any = None
        self._measure: ToolMeasure | None = None
        self._moving = np.empty(0, dtype=np.intp)
        self._limited = False

    def set_target(self, transform_target_to_world: Any) -> None:
        """Set the wanted pose.

        Args:
            transform_target_to_world: a `pinocchio.SE3`, or (4, 4) in the world frame.

        Raises:
            BadInput: no rigid motion with finite numbers.
        """
        super().set_target(placement(transform_target_to_world, "target"))

    def compute_qp_objective(self, configuration: Configuration) -> tuple[Array, Array]:
        """(H, c) of minimise 1/2 dq'H dq + c'dq, dq (nv,) the displacement of a step.

        Raises:
            BadInput: NaN in configuration or target.
            RobotModelError: no joint moves the frame.
            pink.exceptions.TargetNotSet: no target.
        """
        measure, policy = self._measured(configuration)
        pose = configuration.get_transform_frame_to_world(self.frame)
        carry = pose.action[ANGULAR_FIRST]  # from the frame, linear part first, to the world, angular part first
        J = arrays.columns(carry.dot(configuration.get_frame_jacobian(self.frame)[:, self._moving]), "configuration")
        s = arrays.twist(carry.dot(self.gain * self.compute_error(configuration)), "target")
        root = measure.root_for(J, pose)
        none = np.full(len(self._moving), inf)
        demand = Demand(J, s, root, -none, none)
        b = root.dot(s)
        more = self.lm_damping * float(b.dot(b))
        form = None if isinstance(self.form, CarriedMetric) else self.form
        # A displacement is a velocity held for one unit of time; dt = 0, since `lm_damping` replaces `velocity.calm`.
        damping = _Softened(policy, more) if more > 0.0 else policy
        law = VelocityLaw(form=form, damping=damping, guard=self.guard)
        cost = _hessian(posed(law, demand, damping).objective(1.0), more)
        H = np.zeros((configuration.model.nv, configuration.model.nv))
        H[np.ix_(self._moving, self._moving)] = self.cost**2 * cost
        wanted = np.zeros(len(H))
        wanted[self._moving] = solve(law, demand).velocity
        return H, -H.dot(wanted)

    def _measured(self, configuration: Configuration) -> tuple[ToolMeasure, Damping]:
        """The measure and the policy; for a new model, also which joints move the frame."""
        if self._measure is None or configuration.model is not self._model:
            chain, self._moving = chain_to(configuration.model, self.frame)
            carried = self.form if isinstance(self.form, CarriedMetric) else None
            self._measure = ToolMeasure(chain, self.point, self._length, carried)
            self._limited = bool(np.isfinite(chain.velocity_limit).all())
            self._model = configuration.model
        if self.damping is not None:
            return self._measure, self.damping
        return self._measure, Adaptive() if self._limited else Adaptive(UNLIMITED_THRESHOLD, UNLIMITED_CEILING)

    def __repr__(self) -> str:
        form = "least squares" if self.form is None else self.form.describe()
        return f"InvariantFrameTask({self.frame!r}, {form}, cost={self.cost:g}, gain={self.gain:g})"


def _hessian(objective: Objective, more: float) -> Array:
    """(n, n) what departures cost; almost nothing in directions that move nothing, which are left to other tasks."""
    weights = objective.weights.copy()
    if objective.rank:  # 0 for [DS]'s own problem
        weights[objective.rank :] = NULL_WEIGHT * weights.max() + more
    H: Array = (objective.V * weights).dot(objective.V.T)
    return H


@dataclass(frozen=True)
class _Softened:
    """A policy with the same damping added in every direction."""

    policy: Damping
    more: float  # above zero

    @property
    def threshold(self) -> float:
        """Every direction is damped."""
        return inf

    def squares(self, sigma: Array, wanted: Array, largest: float) -> Array:
        """lambda^2 of the policy plus `more`."""
        squares: Array = self.policy.squares(sigma, wanted, largest) + self.more
        return squares
