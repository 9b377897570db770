"""A stream of commands, twists or poses, as smooth motion of the tool; a stream that ends stops the arm.

    |d/dt r| <= acceleration,   |d2/dt2 r| <= jerk,     r = root s, the commanded twist in the controller's measure

A twist command is a velocity to hold, a pose command a target to go to. Both are held until the next one, and for
`timeout` at most. Towards a pose that turns on past half a turn from the tool, the tool goes on turning the same way.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.approach import BRAKING_SHARE, same_turn
from invariantqp.control.controller import Controller
from invariantqp.control.tracking import tracking_twist
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.limits import braking_speed
from invariantqp.velocity.solution import Status, VelocitySolution, with_trouble

# The gain towards a pose is at most this share of jerk / acceleration: the tool then comes to rest without overshoot.
CALM_SHARE = 0.3
# A commanded twist below this share of what the acceleration makes in a tick is rest.
AT_REST = 1e-9


class Servo:
    """Drives the tool of a controller by a stream of commands; `step` is one tick.

    Limits and singularities are the controller's business: its solutions tell them. With its `acceleration_limit`
    joints also brake before their position limits.

    Attributes:
        controller: the loop.
        acceleration: of the commanded twist, in the controller's measure [length/s^2].
        jerk: likewise [length/s^3].
        timeout: how long a command holds [s].
        gain: towards a pose [1/s].
        paused: whether the tool is told to stand still.
        twist: (6,) commanded now, base frame.
    """

    def __init__(self, controller: Controller, *, acceleration: float, jerk: float, timeout: float = 0.1) -> None:
        """A servo at rest.

        Args:
            controller: the loop; nobody else may step it.
            acceleration: the largest change of the commanded twist, at the controller's point [length/s^2]; a turn
                counts as much as L, the arm's reach.
            jerk: the largest change of that [length/s^3].
            timeout: how long a command holds without another [s].

        Raises:
            BadInput: not a Controller, or a number that is not positive.
        """
        if not isinstance(controller, Controller):
            raise BadInput("controller", excerpt(controller), "a Controller")
        self.controller = controller
        self.acceleration: float = arrays.number(acceleration, "acceleration", "a limit in length/s^2", positive=True)
        self.jerk: float = arrays.number(jerk, "jerk", "a limit in length/s^3", positive=True)
        self.timeout: float = arrays.number(timeout, "timeout", "seconds", positive=True)
        self.gain: float = min(controller.gain, CALM_SHARE * self.jerk / self.acceleration)
        self.paused: bool = False
        self.twist: Array = np.zeros(6)
        self._rate = np.zeros(6)
        self._command: Any = None
        self._age = 0.0
        self._turn: Array | None = None

    def pause(self) -> None:
        """Come to rest and stay there, whatever is commanded, until `resume`."""
        self.paused = True

    def resume(self) -> None:
        """Follow commands again: the next one, not one from before."""
        self.paused = False
        self._command = self._turn = None

    def step(self, q: ArrayLike, command: Any = None, velocity: ArrayLike | None = None) -> VelocitySolution:
        """One tick: the joint velocity to command until the next.

        Args:
            q: (m,) measured joint positions [rad, length].
            command: what came since the last tick: a (6,) twist of the tool, base frame, or a pose to be at, (4, 4) or
                a `pinocchio.SE3`. None if nothing came.
            velocity: as in `Controller.step`.

        Returns:
            VelocitySolution; "degraded" while the tool slows down because no command comes or it is paused, "held"
            where it stands still for that, or for joint positions that cannot be true.

        Raises:
            BadInput: NaN or wrong shapes; the servo is as it was.
        """
        loop = self.controller
        positions = arrays.vector(q, len(loop.robot.names), "q")
        if loop.wrong(positions):
            self.twist, self._rate, self._age = np.zeros(6), np.zeros(6), self._age + loop.dt
            return loop.rest(positions, "", velocity)
        kept, age = (self._command, self._age + loop.dt) if command is None else (_checked(loop, command), 0.0)
        reason = self._reason(kept, age)
        held, target = (None, None) if kept is None else kept
        sighting = loop.robot.sight(
            positions, loop.robot.target(loop.robot.pose(positions)) if target is None else target
        )
        root = loop.measure.root_for(sighting.J, sighting.pose)
        error, wanted = same_turn(sighting.error, self._turn), np.zeros(6)
        if not reason:
            wanted = self._approach(root, error) if held is None else held
        twist, rate = self._eased(root, wanted)
        if reason and not twist.any():
            solution = loop.rest(positions, reason, velocity, sighting)
        else:
            solution = loop.follow(positions, twist, velocity, sighting=sighting)
        self._command, self._age = kept, age
        self._turn = None if target is None else error[:3].copy()
        # Where limits hold the tool back, it goes on from what it does.
        self.twist = sighting.J.dot(solution.velocity) if solution.active else twist
        self._rate = rate
        return with_trouble(solution, reason) if reason and solution.status is not Status.HELD else solution

    def _reason(self, command: Any, age: float) -> str:
        """Why the tool is to stand still, "" where it is not."""
        if self.paused:
            return "paused"
        if command is None:
            return "no command yet"
        return f"no command for {age:.3g} s" if age > self.timeout else ""

    def _approach(self, root: Array, error: Array) -> Array:
        """(6,) the twist towards a pose, slow enough to brake before it."""
        r = root.dot(error)
        distance = sqrt(float(r.dot(r)))
        share = 1.0 if distance == 0.0 else sqrt(2.0 * BRAKING_SHARE * self.acceleration / distance) / self.gain
        return tracking_twist(error, min(share, 1.0) * self.gain)

    def _eased(self, root: Array, wanted: Array) -> tuple[Array, Array]:
        """The commanded twist of this tick, and its rate, on the way to the wanted one."""
        dt = self.controller.dt
        ahead, rate = root.dot(wanted - self.twist), root.dot(self._rate)
        left = sqrt(float(ahead.dot(ahead)))
        step = self.jerk * dt
        if left <= AT_REST * self.acceleration * dt and sqrt(float(rate.dot(rate))) <= step:
            return wanted, np.zeros(6)
        # The largest rate from which the jerk ends it just as the wanted twist is reached.
        fastest = min(self.acceleration, float(braking_speed(np.array(left), np.array(self.jerk), dt)))
        change = (fastest / left if left > 0.0 else 0.0) * ahead - rate
        size = sqrt(float(change.dot(change)))
        rate = rate + min(1.0, step / size if size > 0.0 else 1.0) * change
        moved = np.linalg.solve(root, rate)
        return self.twist + dt * moved, moved


def _checked(loop: Controller, command: Any) -> tuple[Array | None, Any]:
    """A (6,) twist as an array of its own, or a pose as the robot takes targets; None for the other."""
    given = arrays.array(getattr(command, "homogeneous", command), "command", "a twist (6,) or a pose (4, 4)")
    if given.ndim == 2:
        return None, loop.robot.target(arrays.pose(given, "command"))
    twist = arrays.vector(given, 6, "command").copy()
    if not np.vdot(twist, twist) < inf:  # which warns of no overflow
        raise BadInput("command", "numbers beyond any scale", "a twist [rad/s; length/s]")
    return twist, None
