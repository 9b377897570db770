"""The states in which single solves are compared: without active limits, with active limits, and near a singularity.

Joint positions are uniformly distributed over the joint range and twists are random; one seed determines them all.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from invariantqp.compare.method import Method, Question, Setting
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.systems.gram import gram_matrix
from invariantqp.velocity.damping import Adaptive
from invariantqp.velocity.measure import root_at
from invariantqp.velocity.objective import least_squares, spectrum_of

SORTS = ("free", "limited", "singular")
# Standard deviation of each component of the wanted twists [rad/s, m/s].
TWIST = 0.3
# Smallest |mu| over largest, and singular value over largest, above which no law damps: far from singularities and
# from principal pitches.
REGULAR = 1e-3
# Velocity bounds as multiples of the largest joint speed of the closed forms: never active, and active.
WIDE, NARROW = 10.0, 0.7
# The bounds of each joint are multiplied by a random factor from this range, since real joints differ.
UNEVEN = (0.7, 1.3)
# Distance from a singularity, as powers of ten of a radian.
NEAREST, FARTHEST = -4.0, -1.5
# A joint without limits has this range in either direction [rad].
TURN = np.pi


class SolveState(NamedTuple):
    """One state, and the twist that is wanted in it.

    Attributes:
        J: (6, m) joint twists in the base frame.
        s: (6,) wanted twist in the base frame.
        to_tool: (6, 6) adjoint matrix that takes both to the tool frame.
        lower: (m,) least joint velocities.
        upper: (m,) largest joint velocities.
    """

    J: Array
    s: Array
    to_tool: Array
    lower: Array
    upper: Array

    def question(self, method: Method) -> Question:
        """The question for a method, in its frame."""
        if method.frame == "base":
            return Question(self.J, self.s, self.lower, self.upper)
        return Question(self.to_tool.dot(self.J), self.to_tool.dot(self.s), self.lower, self.upper)


def joint_range(robot: Robot) -> tuple[Array, Array]:
    """The range (lower, upper) of random joint positions."""
    lower = np.where(np.isfinite(robot.position_lower), robot.position_lower, -TURN)
    return lower, np.where(np.isfinite(robot.position_upper), robot.position_upper, TURN)


def states(robot: Robot, kind: str, count: int, seed: int, setting: Setting) -> list[SolveState]:
    """Random states of one sort; fewer than `count` if regular states are too rare.

    Args:
        robot: the arm.
        kind: one of SORTS.
        count: how many.
        seed: seed of positions and twists.
        setting: gives the pitch and the point for which states are regular.
    """
    rng = np.random.default_rng([seed, SORTS.index(kind)])
    low, high = joint_range(robot)
    found: list[SolveState] = []
    for _ in range(200 * count):
        if len(found) == count:
            break
        q = rng.uniform(low, high)
        if kind == "singular":
            q = _near_singular(robot, q, rng)
        s_tool = TWIST * rng.standard_normal(6)
        if kind == "singular" or _ratio(robot, q, setting) > REGULAR:
            found.append(_state(robot, q, s_tool, kind, rng.uniform(*UNEVEN, setting.m), setting))
    return found


def _ratio(robot: Robot, q: Array, setting: Setting) -> float:
    """Smallest over largest, of |mu| or of singular values at the point, without the zeros of more than six joints."""
    J = robot.jacobian(q)
    mu = np.sort(np.abs(np.linalg.eigvalsh(gram_matrix(J, setting.pitch))))[-min(setting.m, 6) :]
    A = root_at(setting.point, setting.length).dot(se3.inverse_adjoint(robot.pose(q))).dot(J)
    sigma = np.linalg.svd(A, compute_uv=False)
    return float(min(mu[0] / mu[-1], sigma[-1] / sigma[0]))


def _state(robot: Robot, q: Array, s_tool: Array, kind: str, uneven: Array, setting: Setting) -> SolveState:
    J, pose = robot.jacobian(q), robot.pose(q)
    to_tool, s = se3.adjoint(se3.inverse(pose)), se3.adjoint(pose).dot(s_tool)
    Q = gram_matrix(np.eye(6), setting.pitch)
    stationary = np.linalg.lstsq(J.T.dot(Q).dot(J), J.T.dot(Q).dot(s), rcond=None)[0]
    root = root_at(setting.point, setting.length)
    ours = least_squares(spectrum_of(root.dot(to_tool.dot(J))), root.dot(s_tool), None, Adaptive()).centre()
    answers = (np.linalg.pinv(to_tool.dot(J)).dot(s_tool), stationary, ours)
    sizes = [float(np.abs(x).max()) for x in answers]
    reach = uneven * (NARROW * min(sizes) if kind == "limited" else WIDE * max(sizes))
    return SolveState(J, s, to_tool, -reach, reach)


def _near_singular(robot: Robot, q: Array, rng: np.random.Generator) -> Array:
    """Joint positions close to a singularity, which a minimiser finds from q."""

    def distance(x: Array) -> float:
        sigma = np.linalg.svd(robot.jacobian(x), compute_uv=False)
        return float((sigma[-1] / sigma[0]) ** 2)

    low, high = joint_range(robot)
    singular = minimize(distance, q, method="L-BFGS-B", bounds=list(zip(low, high, strict=True)), tol=1e-14).x
    step = rng.standard_normal(len(q))
    away = singular + 10.0 ** rng.uniform(NEAREST, FARTHEST) * step / np.linalg.norm(step)
    return np.asarray(np.minimum(np.maximum(away, low), high))
