"""Pink's frame task, measured at one physical point of the tool; a Pink program changes in one line.

Pink's limits, barriers and other tasks stay as they are. `control/frame_cost.py` has the cost and the options.

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
        **options: Unpack[FrameOptions],
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
            options: form, point, length, damping, guard, see `FrameOptions`.

        Raises:
            BadInput: numbers out of range, something that is not a form, two arguments that both say what a radian
                costs.
        """
        arrays.instance(frame, str, "frame", "a frame's name")
        self._take(orientation_cost, lm_damping, gain, **options)
        super().__init__(frame, position_cost, orientation_cost, lm_damping, gain)

    def set_target(self, transform_target_to_world: Any) -> None:
        """Set the wanted pose, a `pinocchio.SE3` or (4, 4), in the world frame."""
        super().set_target(pin.SE3(arrays.pose(transform_target_to_world, "target")))

    def compute_qp_objective(self, configuration: Configuration) -> tuple[Array, Array]:
        """(H, c) of minimise 1/2 dq'H dq + c'dq, dq (nv,) the displacement of a step, once there is a target.

        Raises:
            NoPseudoinverse: the form has no projector for this arm here, and no damping is given.
        """
        return self._quadratic(configuration, self.compute_error(configuration), self.compute_jacobian(configuration))

    def _chain(self, model: Any) -> Chain:
        return chain_to(model, self.frame)[0]

    def _pose(self, configuration: Configuration) -> Array:
        return np.asarray(configuration.get_transform_frame_to_world(self.frame).homogeneous)

    def __repr__(self) -> str:
        return f"InvariantFrameTask({self.frame!r}, {self._described()})"
