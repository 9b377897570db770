"""The states in which single solves are compared: no limit met, limits met, and close to a singularity.

Joint positions are drawn over an arm's whole range, twists at random; all from one seed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from invariantqp.compare.methods import Method, Setting
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.systems.gram import gram_matrix

SORTS = ("free", "limited", "singular")
# Of the twists asked for [rad/s, m/s].
TWIST = 0.3
# |mu| ratio above which a state is far from a singularity and from principal pitches, so that no policy damps it.
REGULAR = 1e-3
# Bounds in units of the largest joint speed that the closed forms ask for: wide, and such that they bind.
WIDE, NARROW = 10.0, 0.7
# Joints are not alike: each one's bounds are that times a factor drawn from this range.
UNEVEN = (0.7, 1.3)
# How far from a singularity, as powers of ten of a radian.
NEAREST, FARTHEST = -4.0, -1.5
# A joint without limits is drawn from a turn.
TURN = np.pi


class Question(NamedTuple):
    """What a method is asked: a twist of joints within bounds, in the frame that it is meant for."""

    J: Array
    s: Array
    lower: Array
    upper: Array


class State(NamedTuple):
    """One state and what is asked of it.

    Attributes:
        J: (6, m) joint twists in the base frame.
        s: (6,) the twist wanted, in the base frame.
        to_tool: (6, 6) the adjoint that takes both to the tool's frame.
        lower: (m,) bounds.
        upper: (m,).
    """

    J: Array
    s: Array
    to_tool: Array
    lower: Array
    upper: Array

    def asked(self, method: Method) -> Question:
        """The question in the frame of a method."""
        if method.frame == "base":
            return Question(self.J, self.s, self.lower, self.upper)
        return Question(self.to_tool.dot(self.J), self.to_tool.dot(self.s), self.lower, self.upper)


def joint_range(robot: Robot) -> tuple[Array, Array]:
    """(lower, upper) joint positions to draw from."""
    lower = np.where(np.isfinite(robot.position_lower), robot.position_lower, -TURN)
    return lower, np.where(np.isfinite(robot.position_upper), robot.position_upper, TURN)


def states(robot: Robot, kind: str, count: int, seed: int, setting: Setting) -> list[State]:
    """`count` states of one kind.

    Args:
        robot: the arm.
        kind: one of SORTS.
        count: how many.
        seed: of positions and twists.
        setting: gives the pitch at which free states are regular.
    """
    rng = np.random.default_rng([seed, SORTS.index(kind)])
    low, high = joint_range(robot)
    found: list[State] = []
    for _ in range(200 * count):
        if len(found) == count:
            break
        q = rng.uniform(low, high)
        if kind == "singular":
            q = _near_singular(robot, q, rng)
        s_tool = TWIST * rng.standard_normal(6)
        if kind == "singular" or _ratio(robot.jacobian(q), setting) > REGULAR:
            found.append(_state(robot, q, s_tool, kind, rng.uniform(*UNEVEN, setting.m), setting))
    return found


def _ratio(J: Array, setting: Setting) -> float:
    """Smallest |mu| over largest, of those that are not zero by count."""
    mu = np.sort(np.abs(np.linalg.eigvalsh(gram_matrix(J, setting.pitch))))[-min(setting.m, 6) :]
    return float(mu[0] / mu[-1])


def _state(robot: Robot, q: Array, s_tool: Array, kind: str, uneven: Array, setting: Setting) -> State:
    J, pose = robot.jacobian(q), robot.pose(q)
    to_tool, s = se3.adjoint(se3.inverse(pose)), se3.adjoint(pose).dot(s_tool)
    Q = gram_matrix(np.eye(6), setting.pitch)
    stationary = np.linalg.lstsq(J.T.dot(Q).dot(J), J.T.dot(Q).dot(s), rcond=None)[0]
    sizes = [float(np.abs(x).max()) for x in (np.linalg.pinv(to_tool.dot(J)).dot(s_tool), stationary)]
    reach = uneven * (NARROW * min(sizes) if kind == "limited" else WIDE * max(sizes))
    return State(J, s, to_tool, -reach, reach)


def _near_singular(robot: Robot, q: Array, rng: np.random.Generator) -> Array:
    """A singularity found downhill from q, left again by a little."""

    def distance(x: Array) -> float:
        sigma = np.linalg.svd(robot.jacobian(x), compute_uv=False)
        return float((sigma[-1] / sigma[0]) ** 2)

    low, high = joint_range(robot)
    singular = minimize(distance, q, method="L-BFGS-B", bounds=list(zip(low, high, strict=True)), tol=1e-14).x
    step = rng.standard_normal(len(q))
    away = singular + 10.0 ** rng.uniform(NEAREST, FARTHEST) * step / np.linalg.norm(step)
    return np.asarray(np.minimum(np.maximum(away, low), high))
