"""mink's frame task, measured at one physical point of the tool; a mink program changes in one line.

    minimise 1/2 |root (J dq - gain e)|^2 + damping
    |root e|^2 = position_cost^2 |v at the point|^2 + orientation_cost^2 |omega|^2

mink's limits and other tasks stay as they are. `control.frame_cost` has what is computed.

Reference: Zakka, mink.
"""

from __future__ import annotations

from typing import Any, Literal

from numpy.typing import ArrayLike

from invariantqp.control.frame_cost import FrameCost
from invariantqp.extras import optional
from invariantqp.geometry import arrays
from invariantqp.legacy.damping import Damping
from invariantqp.velocity.forms import CarriedMetric, Form
from invariantqp.velocity.guard import Guard

with optional("mink", "mink"):
    from mink import SE3, Configuration, FrameTask, Objective

    from invariantqp.robots.mujoco import chain_to  # MuJoCo comes with mink

__all__ = ["InvariantFrameTask"]


class InvariantFrameTask(FrameCost, FrameTask):  # type: ignore[misc]
    """Regulate the pose of a frame of the robot, measured at a physical point: the choice of the frame does not matter.

    It takes the place of `mink.FrameTask`, with its arguments, setters and attributes. Attributes of its own are those
    of `FrameCost`: .form, .point, .length, .damping, .guard.
    """

    def __init__(
        self,
        frame_name: str | int,
        frame_type: str,
        position_cost: ArrayLike = 1.0,
        orientation_cost: ArrayLike | None = None,
        gain: float = 1.0,
        lm_damping: float = 0.0,
        *,
        form: Form | CarriedMetric | float | None = None,
        point: ArrayLike | Literal["own"] | None = None,
        length: float | None = None,
        damping: Damping | float | None = None,
        guard: Guard | bool = True,
    ) -> None:
        """A task like `mink.FrameTask(frame_name, frame_type, position_cost, orientation_cost, gain, lm_damping)`.

        The frame is named or numbered, and of type "body", "geom" or "site". Costs, gain, damping and what follows are
        those of `invariantqp.pink.InvariantFrameTask`.
        """
        arrays.instance(frame_name, (str, int), "frame_name", "a frame's name or id")
        self._take(orientation_cost, lm_damping, gain, form, point, length, damping, guard)
        super().__init__(frame_name, frame_type, position_cost, orientation_cost, gain, lm_damping)

    def set_target(self, transform_target_to_world: Any) -> None:
        """Set the wanted pose, a `mink.SE3` or (4, 4), in the world frame."""
        super().set_target(SE3.from_matrix(arrays.pose(transform_target_to_world, "target")))

    def compute_qp_objective(self, configuration: Configuration) -> Objective:
        """(H, c) of minimise 1/2 dq'H dq + c'dq, dq (nv,) the displacement of a step, once there is a target."""
        error = self.compute_error(configuration)
        pose = configuration.get_transform_frame_to_world(self.frame_name, self.frame_type).as_matrix()
        model = configuration.model
        J = self.compute_jacobian(configuration)
        return Objective(
            *self._quadratic(model, lambda: chain_to(model, self.frame_name, self.frame_type), pose, J, error)
        )

    def compute_qp_residual(self, configuration: Configuration) -> None:
        """None: mink then asks for the quadratic."""

    def __repr__(self) -> str:
        return f"InvariantFrameTask({self.frame_name!r}, {self.frame_type!r}, {self._described()})"
