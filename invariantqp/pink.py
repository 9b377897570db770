"""Pink's frame task with a metric that no choice of tool frame can change; a Pink program changes in one line.

    minimise 1/2 (dq - dq*)'H(dq - dq*),   H = V diag(sqrt(mu^2 + lambda^2)) V',   J'Q_h J = V diag(mu) V'

dq* is the displacement of this library's own law without limits, descent guard included; H weighs departures from it
where a limit is active or another task competes. Pink's limits, barriers and other tasks stay as they are.

Reference: Caron et al., Pink (pin-pink); [DS] Sect. 6.2.
"""

from __future__ import annotations

from math import hypot, isinf
from typing import Any

import numpy as np

from invariantqp.control.own_form import own_form
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.robots.models import chain_to
from invariantqp.robots.pink import Configuration, FrameTask
from invariantqp.robots.pinocchio import ANGULAR_FIRST, placement
from invariantqp.systems.centre import centre, measured
from invariantqp.velocity.damping import Damping, PaperLambda, Selective, damping_of
from invariantqp.velocity.forms import CarriedMetric, Form, PitchForm, form_of
from invariantqp.velocity.guard import Guard
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.request import guard_of
from invariantqp.velocity.solve import solve
from invariantqp.velocity.tick import QUIET_SHARE

__all__ = ["InvariantFrameTask"]

# The cost of a joint direction that does not move the frame, relative to max|mu|: a thousandth of what a posture task
# with Pink's usual cost of 1e-3 gives it, and enough for DAQP where there is no such task.
NULL_WEIGHT = 1e-9
# Enough for a UR5 to stand still at a target three metres out of reach, where without it (as with Pink's own task) the
# arm oscillates at full speed; at an error of 5 cm it takes less than a thousandth from any motion that is
# not damped for another reason.
LM_DAMPING = 1e-3


class InvariantFrameTask(FrameTask):  # type: ignore[misc]
    """Regulate the pose of a frame of the robot; the place of the frame on its link changes no joint velocity.

    Attributes:
        form: how twists are measured; None before the first configuration if the task is to choose it for the arm.
        form_reason: why this form was chosen, in words.
        cost: [cost]/[m].
        damping: the policy near singularities.
        guard: the descent guard, or None.
    """

    form: Form | None
    form_reason: str
    cost: float
    damping: Damping
    guard: Guard | None

    def __init__(
        self,
        frame: str,
        h: Form | float | None = None,
        *,
        cost: float = 1.0,
        damping: Damping | float | None = None,
        guard: Guard | bool = True,
        gain: float = 1.0,
        lm_damping: float = LM_DAMPING,
    ) -> None:
        """A task like `pink.FrameTask(frame, position_cost, orientation_cost, lm_damping, gain)`.

        Args:
            frame: name of the frame.
            h: pitch [length/rad], or a form in the world frame: PitchForm, CarriedMetric ("tool" is this frame),
                Complement. None is what `Controller` takes for the joints that move the frame.
            cost: weight against other tasks, Pink's position_cost [cost]/[m]; with a pitch form a radian costs as much
                as |h| metres, with the other forms what the form itself says.
            damping: as in `invariantqp.solve_velocity`; `Selective` has its speed for a step [rad], and no lm_damping.
            guard: as in `invariantqp.solve_velocity`; it does not see Pink's limits.
            gain: share of the error removed in a step, in [0, 1].
            lm_damping: more damping the larger the error, lambda / max|mu| = lm_damping |s|_W^2 / |J|_W^2, W at the
                arm's own point. It vanishes with the error; 0 is none.

        Raises:
            BadInput: numbers out of range, or something that is no form.
        """
        if not isinstance(frame, str):
            raise BadInput("frame", excerpt(frame), "a frame's name")
        self.form = None if h is None else form_of(h, np.eye(6))
        self.form_reason = "" if h is None else "as asked"
        self.damping = damping_of(damping)
        self.guard = guard_of(guard)
        share = arrays.not_negative(gain, "gain", "a share of the error")
        if share > 1.0:
            raise BadInput("gain", f"{share:g}", "a share of the error, from 0 to 1", "A larger gain overshoots.")
        super().__init__(frame, 1.0, 1.0, arrays.not_negative(lm_damping, "lm_damping", "a scale"), share)
        self.cost = arrays.not_negative(cost, "cost", "a weight")  # one number: no frame's axes are preferred
        self._model: Any = None
        self._moving = np.empty(0, dtype=np.intp)

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
        form = self._form(configuration)
        pose = configuration.get_transform_frame_to_world(self.frame)
        carry = pose.action[ANGULAR_FIRST]  # from the frame, linear part first, to the world, angular part first
        J = carry.dot(configuration.get_frame_jacobian(self.frame)[:, self._moving])
        s = arrays.twist(carry.dot(self.gain * self.compute_error(configuration)), "target")
        point = None
        if isinstance(form, CarriedMetric) and form.follows_tool:
            form, point = form.at(pose.homogeneous), pose.translation  # the guard measures where the form does
        none = np.full(len(self._moving), np.inf)
        demand = Demand(arrays.columns(J, "configuration"), s, -none, none, anchor=point)
        # A displacement is a velocity held for one unit of time.
        law = VelocityLaw(form=form, damping=self._damping(J, s), guard=self.guard, dt=1.0)
        own, _ = law.build(demand).convex.qp(NULL_WEIGHT)
        H = np.zeros((configuration.model.nv, configuration.model.nv))
        H[np.ix_(self._moving, self._moving)] = self.cost**2 * _per_metre(form) * own
        wanted = np.zeros(len(H))
        wanted[self._moving] = solve(law, demand).velocity
        return H, -H.dot(wanted)

    def _damping(self, J: Array, s: Array) -> Damping:
        """The policy, with more damping for a larger error."""
        share = self.lm_damping * _error_share(J, s)
        if share <= QUIET_SHARE or isinstance(self.damping, (Selective, PaperLambda)):
            return self.damping
        return lambda smallest, largest: hypot(self.damping(smallest, largest), share * largest)

    def _form(self, configuration: Configuration) -> Form:
        """The form; for a new model, also which joints move the frame."""
        form = self.form
        if form is None or configuration.model is not self._model:
            chain, self._moving = chain_to(configuration.model, self.frame)
            if form is None:
                form, self.form_reason = own_form(chain)
                self.form = form
            self._model = configuration.model
        return form

    def __repr__(self) -> str:
        measured_by = "the arm's own form" if self.form is None else self.form.describe()
        return f"InvariantFrameTask({self.frame!r}, {measured_by}, cost={self.cost:g}, gain={self.gain:g})"


def _per_metre(form: Form) -> float:
    """The factor from the form's unit to squared metres: s'Q_h s gives a radian 2 |h|, and h^2 is wanted."""
    return 0.5 * (abs(form.h) or 1.0) if isinstance(form, PitchForm) else 1.0


def _error_share(J: Array, s: Array) -> float:
    """|s|_W^2 / |J|_W^2; the length of W is 1 where all axes meet, and 0 where no joint turns."""
    point, length = centre(J, s)
    length = 0.0 if isinf(length) else length or 1.0
    twists, wanted = measured(J, point, length), measured(s, point, length)
    return float(wanted.dot(wanted) / np.vdot(twists, twists))
