"""Pink's frame task, measured at one physical point of the tool; a Pink program changes in one line.

    minimise 1/2 |root (J dq - gain e)|^2 + damping
    |root e|^2 = position_cost^2 |v at the point|^2 + orientation_cost^2 |omega|^2

Pink's limits, barriers and other tasks stay as they are. `control.frame_cost` has what is computed.

Reference: Caron et al., Pink (pin-pink).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

from numpy.typing import ArrayLike

from invariantqp.control.frame_cost import FrameCost
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array

from invariantqp.robots.pink import Configuration, FrameTask  # isort: skip (it names the extra that brings both)
from invariantqp.legacy.damping import Damping
from invariantqp.robots.models import chain_to
from invariantqp.robots.pinocchio import pin
from invariantqp.velocity.forms import CarriedMetric, Form
from invariantqp.velocity.guard import Guard

__all__ = ["InvariantFrameTask"]


class InvariantFrameTask(FrameCost, FrameTask):  # type: ignore[misc]
    """Regulate the pose of a frame of the robot, measured at a physical point: the choice of the frame does not matter.

    It takes the place of `pink.FrameTask`, with its arguments, setters and attributes. Attributes of its own are those
    of `FrameCost`: .form, .point, .length, .damping, .guard.
    """

    def __init__(
        self,
        frame: str,
        position_cost: float | Sequence[float] | Array = 1.0,
        orientation_cost: float | Sequence[float] | Array | None = None,
        lm_damping: float = 0.0,
        gain: float = 1.0,
        *,
        form: Form | CarriedMetric | float | None = None,
        point: ArrayLike | Literal["own"] | None = None,
        length: float | None = None,
        damping: Damping | float | None = None,
        guard: Guard | bool = True,
    ) -> None:
        """A task like `pink.FrameTask(frame, position_cost, orientation_cost, lm_damping, gain)`.

        Args:
            frame: name of the frame.
            position_cost: what an error of position costs [cost/m]; (3,) is along each axis of the frame, which then is
                part of what is asked for. 0 leaves the position free.
            orientation_cost: likewise [cost/rad]; None is L position_cost, a radian costs as much as L metres. Told, it
                says L = orientation_cost / position_cost.
            lm_damping: Pink's damping of large errors, mu = lm_damping |gain error|^2 in the measure. With 1 arms
                come to rest at targets out of reach, where with 0 they oscillate at their velocity limits.
            gain: share of the error removed in a step, in [0, 1].
            form: the `form` of `Controller`, in the world frame.
            point: (3,) in the frame, as in `Controller`; None is the frame's origin, where Pink measures; "own" is the
                arm's own point.
            length: L [length/rad] instead of an orientation cost; None is the arm's reach to the point.
            damping: more damping near singularities, as in `invariantqp.Controller`; None is none, which leaves joint
                speeds to the velocity limits. `Selective` has its speed for a step [rad].
            guard: as in `invariantqp.Controller`; it does not see Pink's limits.

        Raises:
            BadInput: numbers out of range, something that is not a form, two arguments that both say what a radian
                costs, or `PaperLambda`, which is no quadratic cost.
        """
        arrays.instance(frame, str, "frame", "a frame's name")
        self._take(orientation_cost, lm_damping, gain, form, point, length, damping, guard)
        super().__init__(frame, position_cost, orientation_cost, lm_damping, gain)

    def set_target(self, transform_target_to_world: Any) -> None:
        """Set the wanted pose, a `pinocchio.SE3` or (4, 4), in the world frame."""
        super().set_target(pin.SE3(arrays.pose(transform_target_to_world, "target")))

    def compute_qp_objective(self, configuration: Configuration) -> tuple[Array, Array]:
        """(H, c) of minimise 1/2 dq'H dq + c'dq, dq (nv,) the displacement of a step, once there is a target."""
        error = self.compute_error(configuration)
        pose = configuration.get_transform_frame_to_world(self.frame).homogeneous
        model = configuration.model
        return self._quadratic(
            model, lambda: chain_to(model, self.frame), pose, self.compute_jacobian(configuration), error
        )

    def __repr__(self) -> str:
        return f"InvariantFrameTask({self.frame!r}, {self._described()})"
