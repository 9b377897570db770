"""mink's frame task with the error at a physical point of the tool, in place of `mink.FrameTask`.

mink's limits and other tasks work as before. `control/frame_cost.py` has the cost and the options.

Reference: Zakka, mink.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.frame_cost import FrameCost, FrameOptions
from invariantqp.extras import optional
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain

with optional("mink", "mink"):
    from mink import SE3, Configuration, FrameTask, Objective

    from invariantqp.robots.mujoco import chain_to  # MuJoCo comes with mink

if TYPE_CHECKING:
    from typing_extensions import Unpack

__all__ = ["InvariantFrameTask"]


class InvariantFrameTask(FrameCost, FrameTask):  # type: ignore[misc]
    """A frame task with the error at a physical point, so that the choice of the frame does not change the motion.

    It replaces `mink.FrameTask`, with its arguments, setters and attributes, and adds those of `FrameCost`: .form,
    .point, .length, .damping, .guard.
    """

    def __init__(
        self,
        frame_name: str | int,
        frame_type: str,
        position_cost: ArrayLike = 1.0,
        orientation_cost: ArrayLike | None = None,
        gain: float = 1.0,
        lm_damping: float = 0.0,
        **options: Unpack[FrameOptions],
    ) -> None:
        """A task with the arguments of `mink.FrameTask`.

        The frame has a name or id, and the type "body", "geom" or "site"; the other arguments are those of
        `invariantqp.pink.InvariantFrameTask`.
        """
        arrays.instance(frame_name, (str, int), "frame_name", "a frame's name or id")
        self._take(orientation_cost, lm_damping, gain, **options)
        super().__init__(frame_name, frame_type, position_cost, orientation_cost, gain, lm_damping)

    def set_target(self, transform_target_to_world: Any) -> None:
        """Set the target pose, a `mink.SE3` or (4, 4), in the world frame."""
        super().set_target(SE3.from_matrix(arrays.pose(transform_target_to_world, "target")))

    def compute_qp_objective(self, configuration: Configuration) -> Objective:
        """(H, c) of 1/2 dq'H dq + c'dq, see `invariantqp.pink.InvariantFrameTask`."""
        error, J = self.compute_error(configuration), self.compute_jacobian(configuration)
        return Objective(*self._quadratic(configuration, error, J))

    def compute_qp_residual(self, configuration: Configuration) -> None:
        """None, so that mink uses `compute_qp_objective`."""

    def _chain(self, model: Any) -> Chain:
        return chain_to(model, self.frame_name, self.frame_type)[0]

    def _pose(self, configuration: Configuration) -> Array:
        return np.asarray(configuration.get_transform_frame_to_world(self.frame_name, self.frame_type).as_matrix())

    def __repr__(self) -> str:
        return f"InvariantFrameTask({self.frame_name!r}, {self.frame_type!r}, {self._described()})"
