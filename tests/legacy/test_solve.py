"""A tick that cannot be computed."""

import numpy as np

from invariantqp.legacy.law import Demand, VelocityLaw
from invariantqp.legacy.solve import solve


def test_numbers_beyond_any_scale_are_answered_by_standing_still():
    """As near to rest as the bounds allow: outside its position limits a joint has to come back."""
    J = 1e200 * np.random.default_rng(0).normal(size=(6, 3))
    demand = Demand(J, 1e200 * np.ones(6), np.eye(6), np.full(3, 0.2), np.full(3, 0.3))
    with np.errstate(all="ignore"):
        solution = solve(VelocityLaw(), demand)
    assert (solution.method, solution.status) == ("hold", "held")
    assert solution.reason
    np.testing.assert_array_equal(solution.velocity, [0.2] * 3)
