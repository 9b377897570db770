"""What a pose search needs to know of an arm, computed once: joint limits, whole turns, own point and length, screws.

    q_i and q_i + 2 pi are one pose of a hinge

Where the range of a hinge is a whole turn or more, every angle has an equal one inside it.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

import numpy as np
from attrs import frozen

from invariantqp.control.compiled import compiled_demands
from invariantqp.control.demands import Exact
from invariantqp.engine import core_for
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.screws import HINGE
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot, middle, remembered
from invariantqp.systems.points import centre
from invariantqp.velocity.backends import UNBOUNDED

if TYPE_CHECKING:
    from invariantqp.engine import Arm

# A joint this near its limit, relative to 1 + |q|, is at it: a step to the limit is rounded.
ROUNDING = 1e-14


class JointSpace:
    """The joint limits of an arm, with its turns.

    Attributes:
        middle: (m,) of each joint's range [rad, length].
        lower: (m,) [rad, length], -1e30, the solver's infinity, where there is none.
        upper: (m,).
        whole: (m,) bool, the hinges whose range holds a whole turn.
        turn: (m,) that turn, in units of q; 1 where there is none.
    """

    def __init__(self, robot: Robot) -> None:
        """The joint space of a robot."""
        self.middle: Array = middle(robot)
        self.lower: Array = np.maximum(robot.position_lower, -UNBOUNDED)
        self.upper: Array = np.minimum(robot.position_upper, UNBOUNDED)
        J = robot.jacobian(self.middle)
        speed, drift = np.linalg.norm(J[:3], axis=0), np.linalg.norm(J[3:], axis=0)
        hinge = (speed > 0.0) & (np.abs((J[:3] * J[3:]).sum(axis=0)) <= HINGE * speed * drift)
        self.turn: Array = np.where(hinge, 2.0 * np.pi / np.where(hinge, speed, 1.0), 1.0)
        self.whole: Array = hinge & (self.upper - self.lower >= self.turn)
        self._turning = bool(self.whole.any())
        self._half = np.where(self.whole, 0.5 * self.turn, np.inf)
        self._open = np.where(self.whole, -UNBOUNDED, self.lower), np.where(self.whole, UNBOUNDED, self.upper)

    def steps(self, q: Array, *, turning: bool) -> tuple[Array, Array]:
        """The least and the largest step (m,) from q; with `turning`, half a turn for a hinge that can turn over."""
        if not (turning and self._turning):
            return self.lower - q, self.upper - q
        lower, upper = self._open
        return np.maximum(lower - q, -self._half), np.minimum(upper - q, self._half)

    def inside(self, q: Array) -> Array:
        """q shifted by whole turns into the limits; clipped to them where no turn helps."""
        clipped: Array = np.minimum(np.maximum(q, self.lower), self.upper)
        if not self._turning or clipped.tobytes() == q.tobytes():
            return clipped
        over = np.maximum(np.ceil((q - self.upper) / self.turn), 0.0)
        under = np.maximum(np.ceil((self.lower - q) / self.turn), 0.0)
        q = q + np.where(self.whole, (under - over) * self.turn, 0.0)
        return np.minimum(np.maximum(q, self.lower), self.upper)

    def near(self, q: Array, start: Array) -> Array:
        """The same pose with each joint as near its start as whole turns inside the limits bring it."""
        if not self._turning:
            return q
        wanted = np.round((start - q) / self.turn)
        least, most = np.ceil((self.lower - q) / self.turn), np.floor((self.upper - q) / self.turn)
        turns = np.where(self.whole, np.minimum(np.maximum(wanted, least), most), 0.0)
        return self.inside(q + turns * self.turn)

    def at_limits(self, q: Array) -> tuple[int, ...]:
        """The joints at a limit."""
        room = np.minimum(q - self.lower, self.upper - q)
        return tuple(np.flatnonzero(room <= ROUNDING * (1.0 + np.abs(q))).tolist())


@frozen(eq=False)
class PoseArm:
    """An arm in a pose search."""

    robot: Robot  # the arm
    space: JointSpace  # its joint limits and whole turns
    point: Array  # (3,) in the tool frame [length], the arm's own point in the middle of its range
    length: float  # the arm's own length there [length]
    chain: Chain | None  # the arm as joint screws, None where the compiled core cannot have it
    compiled: Arm | None  # the arm as the core takes it, with its own length; None likewise

    def measured(self, length: float, point: Array, exact: tuple[Exact, ...] = ()) -> Arm | None:
        """The arm as the core takes it, with another length for a radian, another point, and exact demands."""
        return None if self.chain is None else _compiled(self.chain, self.space, point, length, exact)


def pose_arm(robot: Robot) -> PoseArm:
    """The arm, from the middle of its range."""
    return remembered(robot, "pose search", _pose_arm)


def _pose_arm(robot: Robot) -> PoseArm:
    space = JointSpace(robot)
    here = robot.pose(space.middle)
    place, length = centre(robot.jacobian(space.middle))
    length = length if 0.0 < length < inf else 1.0
    point = here[:3, :3].T.dot(place - here[:3, 3])
    chain = robot if type(robot) is Chain else None  # a class of the user's may be no such chain
    core = None if chain is None else core_for(chain.engine)
    if core is None or len(space.middle) > core.MOST_JOINTS:
        chain = None
    compiled = None if chain is None else _compiled(chain, space, point, length)
    return PoseArm(robot, space, point, length, chain, compiled)


def _compiled(
    chain: Chain, space: JointSpace, point: Array, length: float, exact: tuple[Exact, ...] = ()
) -> Arm | None:
    core, wanted = core_for(chain.engine), compiled_demands(exact)
    if core is None or wanted is None or len(wanted) > core.MOST_ROWS:
        return None
    made: Arm = core.Arm(
        screws=chain.screws,
        home=chain.home,
        point=point,
        length=length,
        lower=space.lower,
        upper=space.upper,
        turn=space.turn,
        whole=space.whole.astype(np.float64),
        exact=wanted,
    )
    return made
