"""The share of exact rows, from its formula, and the calm of loops."""

import numpy as np
import pytest
from support.velocity_reference import largest_share, quadprog_minimum

import invariantqp as iq
from invariantqp.legacy.exact import EXACT_CALM, REGULARISATION, reduce, share_of
from invariantqp.legacy.problem import problem_of
from invariantqp.legacy.qp import Polytope
from invariantqp.legacy.solve import solve
from invariantqp.velocity.backends import Daqp


@pytest.mark.cases(2)
@pytest.mark.parametrize(("dt", "held"), [(0.0, 0.0), (0.01, 0.0), (0.01, 0.5)])
def test_the_share_by_another_solver_from_its_formula(dt, held):
    """The largest share, then once more with what the first one misses, or turns, as the price of motion."""
    pytest.importorskip("quadprog")
    rng = np.random.default_rng(40)
    calmed = 0
    for _ in range(40):
        m = int(rng.integers(4, 8))
        A, b = rng.normal(size=(3, m)) * np.array([1.0, 0.3, 0.05])[:, None], rng.normal(size=3)
        reduction = reduce(iq.ExactRows(A, b), np.eye(6))
        reach = rng.uniform(0.1, 1.0, m) * np.abs(reduction.full).max() * rng.uniform(0.1, 1.5)
        found = share_of(reduction, Polytope(np.eye(m), -reach, reach), None, np.zeros(m), dt, Daqp(), held)

        full = np.linalg.pinv(A) @ b
        size = np.linalg.norm(full)
        null = np.linalg.svd(A)[2][3:].T
        basis = np.column_stack((full / size, null))

        def best(nu, basis=basis, size=size, reach=reach, m=m):
            n = basis.shape[1]
            first = np.eye(n)[0]
            H = np.outer(first, first) + (REGULARISATION + nu) * np.eye(n)
            wide = np.full(n, 1e3 * size)
            return (
                quadprog_minimum(
                    H, size * first, np.where(first, 0.0, -wide), np.where(first, size, wide), basis, -reach, reach
                )[0]
                / size
            )

        possible = best(0.0)
        assert possible == pytest.approx(min(1.0, largest_share(A, b, -reach, reach)), rel=1e-6)
        singular = np.linalg.svd(A, compute_uv=False)
        y, met = np.linalg.lstsq(A, b, rcond=None)[0], b
        effort = np.linalg.norm(singular) * np.linalg.norm(y) / np.linalg.norm(met)
        missed = 1.0 - possible + max(0.0, 0.25 * held * possible**2 * effort * size - 1.0)
        nu = 0.5 * EXACT_CALM * (dt + held) * missed * size * effort
        expected = best(nu) if nu > REGULARISATION else possible
        calmed += expected < possible - 1e-3
        assert found.value == pytest.approx(expected, rel=1e-5, abs=1e-9)
        np.testing.assert_allclose(A @ found.velocity, found.value * b, atol=1e-8 * np.abs(b).max())
        assert (np.abs(found.velocity) <= reach * (1.0 + 1e-9)).all()
    assert calmed >= (5 if dt else 0)


def test_no_joint_is_spent_at_full_speed_for_a_thousandth_of_line_speed():
    """A column that helps the rows by a thousandth of what another does: the loop's calm leaves it alone."""
    A, b = np.array([[1.0, 1e-3, 0.0]]), np.array([10.0])
    options = {"exact": iq.ExactRows(A, b), "bounds": (-np.ones(3), np.ones(3))}
    law = solve(*problem_of(np.vstack((A, np.eye(5, 3))), np.zeros(6), **options))
    assert law.velocity[1] > 0.9  # one question by itself, with no time in it, is answered to the letter
    limits = Polytope(np.eye(3), -np.ones(3), np.ones(3))
    calm = share_of(reduce(iq.ExactRows(A, b), np.eye(6)), limits, None, np.zeros(3), 0.01, Daqp())
    assert calm.value == pytest.approx(0.1, rel=1e-2)
    assert abs(calm.velocity[1]) < 0.5
