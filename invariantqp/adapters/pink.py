"""Pink's frame task with the error at a physical point of the tool, in place of `pink.FrameTask`.

Pink's limits, barriers and other tasks work as before. `control/frame_cost.py` has the cost and the options.

Reference: Caron et al., Pink (pin-pink).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from invariantqp.control.frame_cost import FrameCost, FrameOptions
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array

from invariantqp.robots.pink import Configuration, FrameTask  # isort: skip (it names the extra that brings both)
from invariantqp.robots.chain import Chain
from invariantqp.robots.pinocchio import pin
from invariantqp.robots.pinocchio_arms import chain_to

if TYPE_CHECKING:
    from typing_extensions import Unpack

__all__ = ["InvariantFrameTask"]


class InvariantFrameTask(FrameCost, FrameTask):  # type: ignore[misc]
    """A frame task with the error at a physical point, so that the choice of the frame does not change the motion.

    It replaces `pink.FrameTask`, with its arguments, setters and attributes, and adds those of `FrameCost`: .form,
    .point, .length, .damping, .guard.
    """

    def __init__(
        self,
        frame: str,
        position_cost: float | Sequence[float] | Array = 1.0,
        orientation_cost: float | Sequence[float] | Array | None = None,
        lm_damping: float = 0.0,
        gain: float = 1.0,
        **options: Unpack[FrameOptions],
    ) -> None:
        """A task with the arguments of `pink.FrameTask`.

        Args:
            frame: name of the frame.
            position_cost: cost of a position error [cost/m]; (3,) along each axis of the frame, whose choice then
                matters. 0 leaves the position free.
            orientation_cost: cost of an orientation error [cost/rad]; None is L position_cost, with the length L of
                the options. Otherwise L = orientation_cost / position_cost.
            lm_damping: Levenberg-Marquardt damping, mu = lm_damping |gain error|^2. With 1 arms come to rest at targets
                out of reach, with 0 they oscillate at their velocity limits.
            gain: share of the error removed in a step, in [0, 1].
            options: form, point, length, damping, guard, see `FrameOptions`.

        Raises:
            BadInput: numbers out of range, an unknown form, two arguments that both determine L.
        """
        arrays.instance(frame, str, "frame", "a frame's name")
        self._take(orientation_cost, lm_damping, gain, **options)
        super().__init__(frame, position_cost, orientation_cost, lm_damping, gain)

    def set_target(self, transform_target_to_world: Any) -> None:
        """Set the target pose, a `pinocchio.SE3` or (4, 4), in the world frame."""
        super().set_target(pin.SE3(arrays.pose(transform_target_to_world, "target")))

    def compute_qp_objective(self, configuration: Configuration) -> tuple[Array, Array]:
        """(H, c) of 1/2 dq'H dq + c'dq, with the displacement dq (nv,) of a step.

        Raises:
            NoPseudoinverse: the form has no projector at this configuration, and no damping is given.
        """
        return self._quadratic(configuration, self.compute_error(configuration), self.compute_jacobian(configuration))

    def _chain(self, model: Any) -> Chain:
        return chain_to(model, self.frame)[0]

    def _pose(self, configuration: Configuration) -> Array:
        return np.asarray(configuration.get_transform_frame_to_world(self.frame).homogeneous)

    def __repr__(self) -> str:
        return f"InvariantFrameTask({self.frame!r}, {self._described()})"
