"""The cost of a frame's pose error for programs that solve their own QP, measured at a physical point of the frame.

    minimise 1/2 dq'H dq + c'dq,   H = A'A + damping,   c = -A'b,   A = root J,   b = gain root e
    |root e|^2 = position_cost^2 |v at the point|^2 + orientation_cost^2 |omega|^2

What the adapters to Pink and to mink have in common: arguments, setters and the quadratic. Both libraries tell the
error e = log(current^-1 target) and its derivative -Jlog J in the frame. A change of frame carries both like any
twist, so with the point named the quadratic is the same in every frame on the link, also inside limits. With the costs
of a FrameTask and its frame's origin as the point it is the FrameTask's own.

Reference: Caron et al., Pink (pin-pink); Zakka, mink; [DS] Sect. 6.2 for pitch forms.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.control.measure import ToolMeasure, point_of
from invariantqp.engine import Engine, core
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import SWAPPED, adjoint
from invariantqp.legacy.damping import Damping, PaperLambda, damping_of
from invariantqp.legacy.law import Demand, VelocityLaw
from invariantqp.legacy.tick import posed
from invariantqp.robots.chain import Chain
from invariantqp.velocity.forms import CarriedMetric, Form, form_of
from invariantqp.velocity.guard import Guard, guard_of
from invariantqp.velocity.measure import own_point, root_at

# The cost of a joint direction that does not move the frame, relative to the largest: a few thousandths of what a
# posture task with Pink's usual cost of 1e-3 gives it, and enough for DAQP where there is no such task.
NULL_WEIGHT = 3e-10


class FrameCost:
    """The part of a frame task that Pink and mink share; a task inherits from it and from their FrameTask.

    Attributes:
        form: what is attempted of a twist that the joints cannot do, or a CarriedMetric; None is least squares at the
            point.
        point: (3,) in the frame [length], or "own".
        length: L [length/rad] while there is no orientation cost; None is the arm's reach to the point.
        damping: the policy near singularities.
        guard: the descent guard of a form, or None.
        cost: (6,) costs along the axes of the frame: of position [cost/length], then of orientation [cost/rad]. The
            latter are NaN until they are given or a configuration has given the reach.
        gain: share of the error removed in a step.
        lm_damping: mu |dq|^2 is added, mu = lm_damping |b|^2.
        engine: "compiled" for the compiled core where it is installed, "python" for Python alone.
    """

    form: Form | CarriedMetric | None
    point: Array | str
    length: float | None
    damping: Damping
    guard: Guard | None
    cost: Array
    gain: float
    lm_damping: float
    engine: Engine = "compiled"
    _by_length: bool
    _made: VelocityLaw | None = None
    _known: tuple[object, ToolMeasure, NDArray[np.intp]] | None

    def _take(
        self,
        orientation_cost: object,
        lm_damping: float,
        gain: float,
        form: Form | CarriedMetric | float | None,
        point: ArrayLike | Literal["own"] | None,
        length: float | None,
        damping: Damping | float | None,
        guard: Guard | bool,
    ) -> None:
        """Check and keep our own arguments; the library's constructor then sets costs, gain and lm_damping."""
        self.form = form_of(form)
        place = point_of(point)
        self.point = "own" if place is None else place
        self.length = None if length is None else arrays.number(length, "length", "a length", positive=True)
        if orientation_cost is not None and length is not None:
            raise BadInput("orientation_cost", "it and length", "one of them", "Both say what a radian costs.")
        policy = damping_of(0.0 if damping is None else damping, limited=True)
        if isinstance(policy, PaperLambda):
            raise BadInput("damping", "PaperLambda", "a policy that only adds to the cost, such as Adaptive()")
        self.damping = policy
        self.guard = guard_of(guard)
        arrays.not_negative(lm_damping, "lm_damping", "a scale")
        if arrays.not_negative(gain, "gain", "a share of the error") > 1.0:
            raise BadInput("gain", f"{gain:g}", "a share of the error, from 0 to 1", "A larger gain overshoots.")
        self._by_length = orientation_cost is None
        self._known = None

    def set_position_cost(self, position_cost: float | Sequence[float] | Array) -> None:
        """Set what a unit of length costs; what a radian costs follows as long as it was not given.

        Args:
            position_cost: a number, or (3,) along the axes of the frame [cost/length].

        Raises:
            BadInput: negative, NaN, another shape; (3,) where no orientation cost was given.
        """
        costs = _costs(position_cost, "position_cost")
        if self._by_length and np.ptp(costs) > 0.0:
            remedy = "Say orientation_cost too: what a radian costs has no one answer."
            raise BadInput("position_cost", "(3,) without an orientation cost", "a number", remedy)
        self.cost[:3] = costs
        if self._by_length:
            self.cost[3:] = np.nan

    def set_orientation_cost(self, orientation_cost: float | Sequence[float] | Array | None) -> None:
        """Set what a radian costs.

        Args:
            orientation_cost: a number, or (3,) about the axes of the frame [cost/rad]; None is L times what a unit of
                length costs.

        Raises:
            BadInput: negative, NaN, another shape; with a CarriedMetric, which is the whole measure.
        """
        if orientation_cost is None:
            self._by_length = True
            self.set_position_cost(self.cost[:3])
            return
        if isinstance(self.form, CarriedMetric):
            raise BadInput("orientation_cost", "a cost beside a CarriedMetric", "none: it says what a radian costs")
        self.cost[3:] = _costs(orientation_cost, "orientation_cost")
        self._by_length = False

    def _quadratic(
        self,
        model: object,
        moving: Callable[[], tuple[Chain, NDArray[np.intp]]],
        pose: Array,
        jacobian: Array,
        error: Array,
    ) -> tuple[Array, Array]:
        """(H, c) for a state.

        Args:
            model: whose moving joints these are; the reach is measured anew when it is another object.
            moving: the joints that move the frame; called for a model not seen before.
            pose: (4, 4) of the frame in the world.
            jacobian: (6, nv) of the error, in the frame, linear part first: minus what a joint moves it by.
            error: (6,) log(current^-1 target), likewise.
        """
        measure, indices = self._measured(model, moving)
        whole = len(indices) == jacobian.shape[1]
        found = self._by_core(measure, jacobian, error) if whole else None
        if found is not None:
            return found
        H, c = np.zeros((jacobian.shape[1],) * 2), np.zeros(jacobian.shape[1])
        unit = float(self.cost[:3].max()) or float(self.cost[3:].max())
        carry = adjoint(pose, check=False)[:, SWAPPED]
        s = arrays.twist(carry.dot(self.gain * error), "target" if np.isfinite(pose).all() else "configuration")
        J = arrays.columns(-carry.dot(jacobian[:, indices]), "configuration")
        if unit == 0.0:
            return H, c
        root = self._root(measure, J, pose, unit)
        b = root.dot(s)
        more = self.lm_damping * float(b.dot(b))
        moved, pull = self._moved(J, s, root, more)
        H += unit * unit * more * np.eye(len(c))  # joints that do not move the frame, too
        H[np.ix_(indices, indices)] = unit * unit * moved
        c[indices] = unit * unit * pull
        return H, c

    def _by_core(self, measure: ToolMeasure, jacobian: Array, error: Array) -> tuple[Array, Array] | None:
        """(H, c) by the core where all joints move the frame; measured in the frame itself, where the root is fixed."""
        unit = max(self.cost[:3].tolist()) or max(self.cost[3:].tolist())
        fixed = self._law().compiled
        if core is None or fixed is None or measure.carried is not None or measure.point is None or not unit > 0.0:
            return None
        if self.form is not None and not self.cost.all():
            return None  # which Python refuses
        cost = self.cost[SWAPPED] / unit  # angular parts first, as everywhere here
        root = cost[:, None] * root_at(measure.point, 1.0)
        fields = {"gain": self.gain, "unit": unit, "lm_damping": self.lm_damping}
        made: tuple[Array, Array] | None
        made = core.cost(fixed, J=np.asarray(jacobian), s=np.asarray(error), root=root, **fields, of_error=True)
        return made

    def _law(self) -> VelocityLaw:
        """The law of this task, made anew where an attribute was changed."""
        form = None if isinstance(self.form, CarriedMetric) else self.form
        made = self._made
        if made is None or not (
            made.form is form
            and made.damping is self.damping
            and made.guard is self.guard
            and made.engine == self.engine
        ):
            self._made = made = VelocityLaw(form=form, damping=self.damping, guard=self.guard, engine=self.engine)
        return made

    def _moved(self, J: Array, s: Array, root: Array, more: float) -> tuple[Array, Array]:
        """H and c of the joints that move the frame, where a length costs 1; `more` is Pink's damping."""
        law = self._law()
        fixed = law.compiled
        found = None if core is None or fixed is None else core.cost(fixed, J=J, s=s, root=root, more=more)
        if found is not None:
            H, c = found
            return H, c
        m = J.shape[1]
        demand = Demand(J, s, root, np.full(m, -inf), np.full(m, inf))
        objective = posed(law, demand, self.damping).objective(1.0)
        weights = objective.weights + more
        if objective.rank:  # 0 for [DS]'s own problem
            weights[objective.rank :] = NULL_WEIGHT * objective.weights.max() + more
        V = objective.V
        return (V * weights).dot(V.T), -V.dot(objective.weights * objective.optimum)

    def _root(self, measure: ToolMeasure, J: Array, pose: Array, unit: float) -> Array:
        """(6, 6) root of the measure in units of the cost `unit`."""
        if measure.carried is not None:
            return measure.root_for(J, pose)
        point = own_point(J) if measure.point is None else pose[:3, :3].dot(measure.point) + pose[:3, 3]
        axes = np.zeros((6, 6))
        axes[:3, :3] = (self.cost[3:, None] / unit) * pose[:3, :3].T
        axes[3:, 3:] = (self.cost[:3, None] / unit) * pose[:3, :3].T
        if self.form is not None and not self.cost.all():
            raise BadInput("form", "a form beside a cost of zero", "costs above zero", "Leave the form out.")
        return np.asarray(axes.dot(root_at(point, 1.0)))

    def _measured(
        self, model: object, moving: Callable[[], tuple[Chain, NDArray[np.intp]]]
    ) -> tuple[ToolMeasure, NDArray[np.intp]]:
        """The measure and the joints that move the frame; what a radian costs where that follows L."""
        if self._known is None or self._known[0] is not model:
            chain, indices = moving()
            carried = self.form if isinstance(self.form, CarriedMetric) else None
            self._known = model, ToolMeasure(chain, self.point, self.length, carried), indices
        _, measure, indices = self._known
        if self._by_length:
            self.cost[3:] = measure.length * self.cost[:3]
        return measure, indices

    def _described(self) -> str:
        """The arguments in short."""
        form = "least squares" if self.form is None else self.form.describe()
        return ", ".join((form, f"cost={self.cost}", f"lm_damping={self.lm_damping}", f"gain={self.gain}"))


def _costs(value: float | Sequence[float] | Array | None, argument: str) -> Array:
    """(3,) costs, one an axis."""
    costs = arrays.array(value if value is not None else np.nan, argument, "a cost, or (3,) one an axis")
    if costs.shape not in {(), (1,), (3,)} or not (costs >= 0.0).all() or not np.isfinite(costs).all():
        raise BadInput(argument, excerpt(value), "a cost of zero or more, or (3,) one an axis of the frame")
    return np.broadcast_to(costs, 3).copy()
