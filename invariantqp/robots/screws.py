"""The joint screws of a robot: all that there is to an arm whose joints have one coordinate each.

    T(q) = exp(q_1 S_1) ... exp(q_m S_m) T(0),     S = J(0)

Reference: Brockett 1984, the product of exponentials.
"""

from __future__ import annotations

from math import isfinite

import numpy as np

from invariantqp.errors import InvariantQPError
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot, joint_limits, remembered

# Poses and joint twists of the chain may differ from the robot's by this, relative to the largest entry.
ROUNDING = 1e-12
# Where both are compared: shares of the joint ranges, no two joints alike.
STATES = 2
GOLDEN = 0.5 * (5.0**0.5 - 1.0)


def chain_of(robot: Robot) -> Chain | None:
    """The chain of joint screws that is this robot; None for one that is no such chain, or that may change.

    Only the frozen robots of this library never change; the chain is compared with them in several states.
    """
    return remembered(robot, "chain", _chain) if isinstance(robot, Compared) else None


def _chain(robot: Robot) -> Chain | None:
    m = len(robot.names)
    still = np.zeros(m)
    try:
        limits = joint_limits(m, robot.position_lower, robot.position_upper, robot.velocity_limit)
        chain = Chain(robot.jacobian(still), robot.pose(still), robot.names, *limits)
    except InvariantQPError:  # a joint that moves nothing
        return None
    return chain if all(_agree(chain, robot, q) for q in _states(chain)) else None


def _states(chain: Chain) -> list[Array]:
    """Joint positions in the ranges."""
    lower = [low if isfinite(low) else -1.0 for low in chain.position_lower.tolist()]
    upper = [high if isfinite(high) else 1.0 for high in chain.position_upper.tolist()]
    shares = (GOLDEN * np.arange(1, STATES * len(lower) + 1)) % 1.0
    low, high = np.minimum(lower, upper), np.maximum(lower, upper)
    return list(low + shares.reshape(STATES, -1) * (high - low))


def _agree(chain: Chain, robot: Robot, q: Array) -> bool:
    """Whether both have the same pose and joint twists."""
    seen = chain.sight(q, chain.target(robot.pose(q)))
    pairs = ((seen.pose, robot.pose(q)), (seen.J, robot.jacobian(q)))
    return all(bool(np.abs(a - b).max() <= ROUNDING * np.abs(b).max()) for a, b in pairs)
