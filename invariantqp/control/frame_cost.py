"""The quadratic cost of a frame's error for libraries that solve their own QP, measured at a physical point.

    minimise 1/2 dq'H dq + c'dq,   H = A'A + mu I,   c = -A'b,   A = R J,   b = gain R e
    |R e|^2 = position_cost^2 |v at the point|^2 + orientation_cost^2 |omega|^2
    mu = (damping position_cost)^2 + lm_damping |b|^2

H and c are those of the law in `velocity/definition.py` for a twist by itself, computed by `core/frame_cost.hpp`. A
form replaces them as it does there: H = G + mu I, c = -G x_h, with the damping in G and x_h instead of mu. Joint
velocities that do not move the frame cost 1e-10 |A|^2, so that H has an inverse.

The adapters to Pink and to mink share these arguments, setters and the quadratic. Both libraries give the error
e = log(current^-1 target) and its derivative -Jlog J in the frame. With a given point the quadratic is the same in
every frame on the link. With the costs of a FrameTask and its frame's origin as the point it is the FrameTask's own.

Reference: Caron et al., Pink (pin-pink); Zakka, mink; [DS] Sect. 6.2 for forms.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import is_
from typing import Any, Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.measure import ToolMeasure, point_of
from invariantqp.engine import law
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import SWAPPED, adjoint, inverse
from invariantqp.robots.chain import Chain
from invariantqp.velocity.arguments import damping_of
from invariantqp.velocity.forms import CarriedMetric, Form, form_of
from invariantqp.velocity.guard import Guard, guard_of
from invariantqp.velocity.problem import form_fields, no_projector


class FrameOptions(TypedDict, total=False):
    """Arguments of a frame task in addition to the library's own.

    form: how a twist beyond the joints is projected, in the world frame: None is least squares at the point; a pitch h
        [length/rad], a PitchForm, a Complement or a definite form, as in `solve_velocity`, while no limit is active. A
        CarriedMetric replaces point, length and orientation cost.
    point: (3,) in the frame; None is the frame's origin, as in the library; "own" is the arm's own point.
    length: L [length/rad] instead of an orientation cost; None is the arm's reach to the point.
    damping: lambda >= 0. Without a form lambda^2 |dq|^2 is added [length]; with a pitch form as in
        `systems.damped_pseudoinverse`. None is 0: near a singularity, joints are then as fast as limits allow.
    guard: True or a `Guard` shortens a form's projection so that the error decreases while no limit is active.
    """

    form: Form | CarriedMetric | float | None
    point: ArrayLike | Literal["own"] | None
    length: float | None
    damping: float | None
    guard: Guard | bool


class FrameCost:
    """Base of the frame tasks for Pink and mink; a task inherits from it and from the library's FrameTask.

    Attributes:
        form: how a twist beyond the joints is projected, or a CarriedMetric; None is least squares at the point.
        point: (3,) in the frame [length], or "own".
        length: L [length/rad], without an orientation cost; None is the arm's reach to the point.
        damping: lambda.
        guard: the descent guard of a form, or None.
        cost: (6,) costs along the axes of the frame: of position [cost/length], then of orientation [cost/rad]; NaN
            until they are given or computed from the reach.
        gain: share of the error removed in a step.
        lm_damping: lm_damping |b|^2 |dq|^2 is added.
    """

    form: Form | CarriedMetric | None
    point: Array | str
    length: float | None
    damping: float
    guard: Guard | None
    cost: Array
    gain: float
    lm_damping: float
    _by_length: bool
    _measured: tuple[tuple[object, object, object], float]  # (model, point, length), and the length

    def _take(
        self,
        orientation_cost: object,
        lm_damping: float,
        gain: float,
        *,
        form: Form | CarriedMetric | float | None = None,
        point: ArrayLike | Literal["own"] | None = None,
        length: float | None = None,
        damping: float | None = None,
        guard: Guard | bool = True,
    ) -> None:
        """Check and store these arguments; the library's constructor then sets costs, gain and lm_damping."""
        self.form = form_of(form)
        if not isinstance(self.form, CarriedMetric):
            form_fields(self.form)
        place = point_of(point)
        self.point = "own" if place is None else place
        self.length = None if length is None else arrays.number(length, "length", "a length", positive=True)
        if orientation_cost is not None and length is not None:
            raise BadInput("orientation_cost", "it and length", "one of them", "Both say what a radian costs.")
        self.damping = damping_of(damping)
        self.guard = guard_of(guard)
        arrays.not_negative(lm_damping, "lm_damping", "a scale")
        if arrays.not_negative(gain, "gain", "a share of the error") > 1.0:
            raise BadInput("gain", f"{gain:g}", "a share of the error, from 0 to 1", "A larger gain overshoots.")
        self._by_length = orientation_cost is None
        self._measured = (None, None, None), 0.0

    def set_position_cost(self, position_cost: float | Sequence[float] | Array) -> None:
        """Set the position cost; the orientation cost follows unless it was given.

        Args:
            position_cost: a number, or (3,) along the axes of the frame [cost/length].

        Raises:
            BadInput: negative, NaN, another shape; (3,) without an orientation cost.
        """
        costs = _costs(position_cost, "position_cost")
        if self._by_length and np.ptp(costs) > 0.0:
            remedy = "Give orientation_cost too."
            raise BadInput("position_cost", "(3,) without an orientation cost", "a number", remedy)
        self.cost[:3] = costs
        if self._by_length:
            self.cost[3:] = np.nan

    def set_orientation_cost(self, orientation_cost: float | Sequence[float] | Array | None) -> None:
        """Set the orientation cost.

        Args:
            orientation_cost: a number, or (3,) about the axes of the frame [cost/rad]; None is L times the position
                cost.

        Raises:
            BadInput: negative, NaN, another shape; a cost with a CarriedMetric.
        """
        if orientation_cost is None:
            self._by_length = True
            self.set_position_cost(self.cost[:3])
            return
        if isinstance(self.form, CarriedMetric):
            raise BadInput("orientation_cost", "a cost with a CarriedMetric", "none: the metric includes it")
        self.cost[3:] = _costs(orientation_cost, "orientation_cost")
        self._by_length = False

    def _chain(self, model: Any) -> Chain:
        """The joints of a model that move the frame."""
        raise NotImplementedError

    def _pose(self, configuration: Any) -> Array:
        """(4, 4) of the frame in the world."""
        raise NotImplementedError

    def _quadratic(self, configuration: Any, error: Array, jacobian: Array) -> tuple[Array, Array]:
        """(H, c) in a configuration.

        Args:
            configuration: the library's.
            error: (6,) log(current^-1 target), in the frame, linear part first.
            jacobian: (6, nv) derivative of the error.
        """
        key = configuration.model, self.point, self.length
        if not all(map(is_, self._measured[0], key)):
            self._measured = key, ToolMeasure(self._chain(key[0]), self.point, self.length).length
        if self._by_length:
            self.cost[3:] = self._measured[1] * self.cost[:3]
        unit = float(self.cost[:3].max()) or float(self.cost[3:].max())
        if unit == 0.0:
            return np.zeros((jacobian.shape[1],) * 2), np.zeros(jacobian.shape[1])
        fields = self._fields(unit, configuration)
        try:
            H, c = law.frame_cost(jacobian, error, gain=self.gain, lm_damping=self.lm_damping, **fields)
        except (ArithmeticError, ValueError) as error_of_engine:
            arrays.twist(error, "target" if np.isfinite(self._pose(configuration)).all() else "configuration")
            J = arrays.columns(-jacobian[SWAPPED], "configuration")
            if isinstance(error_of_engine, ArithmeticError):
                raise no_projector(J, self.form) from None
            raise BadInput("the task", str(error_of_engine), "numbers that can be computed with") from None
        return H, c

    def _fields(self, unit: float, configuration: Any) -> dict[str, Any]:
        """Measure, form, damping and guard as the engine takes them, in the frame; `unit` is the position cost."""
        if isinstance(self.form, CarriedMetric):
            pose = self._pose(configuration)
            root = unit * self.form.root(pose).dot(adjoint(pose, check=False))
            return {"root": root, "damping": unit * self.damping}
        at_point = {"costs": self.cost, "point": None if isinstance(self.point, str) else self.point}
        if self.form is None:
            return at_point | {"damping": unit * self.damping}
        if not self.cost.all():
            raise BadInput("form", "a form with a cost of zero", "costs above zero", "Leave the form out.")
        kind, value = form_fields(self.form)["form"]
        if kind == "complement":
            value = adjoint(inverse(self._pose(configuration), check=False), check=False).dot(value)
        elif kind == "definite":
            carry = adjoint(self._pose(configuration), check=False)
            value = carry.T.dot(value).dot(carry)
        guard = None if self.guard is None else self.guard.fraction
        return at_point | {"form": (kind, value), "damping": self.damping, "guard": guard}

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
