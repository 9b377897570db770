"""Follow one path of the tool, whose shape is kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.control.target import Target
from invariantqp.force.control import HybridController
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.paths.follower import Follower
from invariantqp.paths.plan import PathPlan


class PathFollower(Follower):
    """Drives the tool of a controller along one path, whose shape is kept; `step` is one tick.

    A `Follower(controller, keep="shape")` of one path, which may also be a function.
    """

    def __init__(
        self,
        loop: Controller | HybridController,
        path: Callable[[float], ArrayLike | Target] | ArrayLike | Sequence[ArrayLike | Target],
        *,
        end: float = 1.0,
        times: ArrayLike | None = None,
        rate: float | None = None,
        acceleration: float | None = None,
        jerk: float | None = None,
        joint_jerk: ArrayLike | None = None,
        blocked: Literal["stop", "leave"] = "stop",
        tolerance: float | None = None,
        corners: bool = False,
    ) -> None:
        """Fit the path; the joint motion along it is found by `prepare`, or in the first ticks.

        Args:
            loop: a velocity controller, or for a path in contact a hybrid one.
            path: the tool's pose (4, 4) as a function of a parameter in [0, end], or (n, 4, 4) poses on the way. In
                place of poses points (3,) of the tool frame's origin, or `Target`, all with the same left free: that
                follows the posture or moves as little as it can, and neither times nor lengths count it.
            end: of a function's parameter.
            times: (n,) the parameter of poses; None is their number, from 0. A function takes none.
            rate: how fast the parameter is meant to go [1/s], 1 where it is time; None is as fast as limits allow.
            acceleration: of the speed along the path; its unit is that of the parameter over s^2, or with rate=None
                [length/s^2]; None is as much as the joints allow.
            jerk: likewise, over s^3; None is no limit of jerk.
            joint_jerk: (m,) of the joints, or one for all [rad/s^3, length/s^3]; None is no limit.
            blocked: where the arm cannot reach the path: "stop" before it, or "leave" it by the least and rejoin it.
            tolerance: how near its end a tool is that is "done", in the controller's measure [length]; None is 1e-5 of
                the measure's length, the arm's reach. Noise in q needs more.
            corners: whether poses are joined by straight lines, at whose ends the tool stops to turn; otherwise a
                smooth curve leads through them, which swings out where they turn a corner.

        Raises:
            BadInput: not a path, fewer than two poses, times that do not increase or of a function, a path that
                stands still.
        """
        super().__init__(loop, keep="shape", jerk=joint_jerk, blocked=blocked, tolerance=tolerance)
        along: dict[str, Any] = {"end": end, "times": times, "rate": rate, "acceleration": acceleration, "jerk": jerk}
        along["corners"] = arrays.flag(corners, "corners")
        self._path = self._path_input(path, "path", **along)

    @property
    def plan(self) -> PathPlan | None:
        """The joint motion along the path, None before it is found."""
        return self._driven_path("plan").plan

    def pose(self, place: float) -> Array | Target:
        """(4, 4) the path's pose at a place, as solutions tell it; a `Target` where the path leaves something free.

        Raises:
            BadInput: not a number.
        """
        return self._driven_path("place").given.pose(arrays.number(place, "place", "the path's parameter"))
