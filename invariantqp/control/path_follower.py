"""A tool that stays on its path: where limits bind it is late, not off.

How it drives is in `path_driver`; here is which path, and how fast.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.control.given_path import GivenPath, given_path
from invariantqp.control.path_driver import PathDriver
from invariantqp.control.path_orders import Reversible
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array


class PathFollower(PathDriver, Reversible):
    """Drives the tool of a controller along a path; `step` is one tick.

    Attributes:
        controller: whose law, limits and exact demands hold.
        plan: what the look-ahead found, None before it is found.
    """

    def __init__(
        self,
        controller: Controller,
        path: Callable[[float], ArrayLike] | ArrayLike,
        *,
        end: float = 1.0,
        times: ArrayLike | None = None,
        rate: float | None = None,
        acceleration: float | None = None,
        jerk: float | None = None,
        blocked: Literal["stop", "leave"] = "stop",
        tolerance: float | None = None,
    ) -> None:
        """Fit the path; the joint motion along it is found by `prepare`, or in the first ticks.

        Args:
            controller: a velocity controller.
            path: the tool's pose (4, 4) as a function of a parameter in [0, end], or (n, 4, 4) poses on the way.
            end: of a function's parameter.
            times: (n,) the parameter of poses; None is their number, from 0. A function takes none.
            rate: how fast the parameter is meant to go [1/s], 1 where it is time; None is as fast as limits allow.
            acceleration: of the speed along the path; its unit is that of the parameter over s^2, or with rate=None
                [length/s^2]; None is as much as the joints allow.
            jerk: likewise, over s^3; None is no limit of jerk.
            blocked: where the arm cannot reach the path: "stop" before it, or "leave" it by the least and rejoin it.
            tolerance: how near its end a tool is that is "done", in the controller's measure [length]; None is 1e-5 of
                the measure's length, the arm's reach. Noise in q needs more.

        Raises:
            BadInput: not a path, fewer than two poses, times that do not increase or of a function, a path that
                stands still.
        """
        stops = arrays.choice(blocked, "blocked", ("stop", "leave")) == "stop"
        super().__init__(controller, rate=rate, acceleration=acceleration, jerk=jerk, stops=stops, tolerance=tolerance)
        robot, measure = controller.robot, controller.measure
        self._given: GivenPath = given_path(robot, measure, path, end, times, timed=rate is not None)
        self._path = self._given
        self._goal = robot.target(self._given.curve.pose(0.0))

    def pose(self, place: float) -> Array:
        """(4, 4) the path's pose at a place, as solutions tell it.

        Raises:
            BadInput: not a number.
        """
        return self._given.pose(arrays.number(place, "place", "the path's parameter"))

    def prepare(self, q: ArrayLike) -> None:
        """Find the joint motion along the path now, from joint positions near its start.

        It takes about a tenth of a second, where exact demands are left several times that. Without it the first ticks
        find it, a little in each, while the arm waits.

        Args:
            q: (m,) joint positions [rad, length]; where the path starts out of reach, those from which to approach it,
                at best the nearest, `solve_pose(robot, pose, form=tool_metric(robot)).q`.

        Raises:
            BadInput: NaN, a wrong shape, or positions that cannot be true.
        """
        positions = self.controller.believed(q)
        search = self._search_from(self._given, positions, 0.0)
        while not search.done:
            self._look_on(search)
