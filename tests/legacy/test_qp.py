"""The quadratic program: its optimum in rational numbers, limits without a point, speed limits."""

from functools import cache

import numpy as np
import pytest
import qpsolvers
from support.repeats import repeats
from support.velocity_reference import limited_minimum

from invariantqp.legacy.qp import Polytope, Quadratic, minimise
from invariantqp.velocity import backends
from invariantqp.velocity.limits import Cone

INSTALLED = sorted({"daqp", "osqp", *qpsolvers.available_solvers})


def random_limits(rng, n):
    """Small whole numbers: K and its inverse T, a centre, and k rows with limits; many of them degenerate."""
    K = np.eye(n, dtype=int)
    for i, j in zip(*np.triu_indices(n, 1), strict=True):
        K[i, j] = rng.integers(-2, 3)
    K = K[rng.permutation(n)]
    T = np.rint(np.linalg.inv(K)).astype(int)
    k = int(rng.integers(1, 7))
    A = rng.integers(-2, 3, size=(k, n))
    centre = rng.integers(-4, 5, n)
    some = rng.integers(-2, 3, n)  # a point inside, often at a limit
    room = rng.integers(0, 3, size=(2, k))
    lower, upper = A @ some - room[0], A @ some + room[1]
    kind = rng.integers(8, size=k)
    for i in range(k):
        j = rng.integers(k)
        if kind[i] == 0:  # the same row, or its opposite, once more
            sign = rng.choice((-1, 1))
            A[i] = sign * A[j]
            lower[i], upper[i] = (lower[j], upper[j]) if sign > 0 else (-upper[j], -lower[j])
        elif kind[i] == 1:
            A[i], lower[i], upper[i] = 0, -1, 1
        elif kind[i] == 2:  # through the optimum without limits
            upper[i] = max(A[i] @ centre, upper[i])
    low, high = lower.astype(float), upper.astype(float)
    low[rng.random(k) < 0.2], high[rng.random(k) < 0.2] = -np.inf, np.inf
    return K, T, centre, A, low, high


@cache
def exact_problems():
    rng = np.random.default_rng(30)
    problems = [random_limits(rng, int(rng.integers(1, 5))) for _ in range(repeats(300, 150))]
    return [(*problem, np.array(exact_answer(*problem), float)) for problem in problems]


def exact_answer(K, T, centre, A, low, high):
    return limited_minimum(T.tolist(), centre.tolist(), A.tolist(), low.tolist(), high.tolist())


@pytest.mark.cases(3)
@pytest.mark.parametrize("name", INSTALLED)
def test_the_optimum_of_random_and_degenerate_limits_in_rational_numbers(name):
    """Equal, opposite and zero rows, limits without room, limits at the optimum; rows of any scale."""
    rng, backend, active = np.random.default_rng(30), backends.backend_of(name), 0
    problems = exact_problems()[: None if name == "daqp" else repeats(60, 30)]
    for K, T, centre, A, low, high, exact in problems:
        scale = 2.0 ** rng.integers(-20, 21, len(A))
        limits = Polytope(scale[:, None] * A, scale * low, scale * high)
        found = minimise(backend, Quadratic(K.astype(float), T.astype(float), centre.astype(float)), limits)
        size = 1.0 + np.abs(exact).max() + np.abs(centre).max()
        np.testing.assert_allclose(found.z, exact, rtol=0.0, atol=1e-13 * size)
        y = scale * found.multipliers
        assert np.abs(K.T @ (K @ (found.z - centre)) + A.T @ y).max() < 1e-11 * size
        value, near = A @ found.z, 1e-11 * size
        assert (value[y > 0.0] >= high[y > 0.0] - near).all()
        assert (value[y < 0.0] <= low[y < 0.0] + near).all()
        active += y.any()
    assert active > len(problems) / 2


@pytest.mark.parametrize("name", INSTALLED)
def test_limits_without_a_point_are_infeasible(name):
    rng, backend = np.random.default_rng(31), backends.backend_of(name)
    for _ in range(20):
        K, T, centre, A, low, high = random_limits(rng, int(rng.integers(1, 5)))
        row = rng.integers(-2, 3, K.shape[0])
        A, low, high = np.vstack((A, row, row)), np.append(low, (1.0, -9.0)), np.append(high, (9.0, 0.5))
        with pytest.raises(backends.SolverFailure) as caught:
            minimise(backend, Quadratic(K.astype(float), T.astype(float), centre.astype(float)), Polytope(A, low, high))
        assert caught.value.infeasible


def test_an_optimum_at_the_speed_limit_meets_its_equations():
    """K'K (z - z*) + A'y + nu J'v = 0 with nu >= 0: sufficient for a convex problem."""
    rng, slow, both = np.random.default_rng(32), 0, 0
    for _ in range(100):
        n = int(rng.integers(2, 6))
        K, J, start = rng.normal(size=(n, n)), rng.normal(size=(3, n)), 0.1 * rng.normal(size=3)
        centre, A, room = 3.0 * rng.normal(size=n), rng.normal(size=(4, n)), rng.uniform(0.1, 2.0, 4)
        cone = Cone(J, rng.uniform(0.3, 2.0), start)
        found = minimise(backends.Daqp(), Quadratic(K, np.linalg.inv(K), centre), Polytope(A, -room, room), cone)
        size, (z, y, nu) = np.linalg.norm(K) ** 2 * np.linalg.norm(centre), (found.z, found.multipliers, found.nu)
        accuracy = 1e-10 * size
        assert nu >= 0.0
        assert np.abs(K.T @ (K @ (z - centre)) + A.T @ y + nu * J.T @ cone.velocity(z)).max() < accuracy
        assert cone.speed(z) <= cone.limit * (1.0 + 1e-9)
        assert nu == 0.0 or cone.speed(z) == pytest.approx(cone.limit, rel=1e-12)
        value = A @ z
        assert (np.abs(value) <= room + 1e-9).all()
        np.testing.assert_allclose(value[y != 0.0], np.copysign(room, y)[y != 0.0], atol=1e-10)
        slow, both = slow + (nu > 0.0), both + (nu > 0.0 and y.any())
    assert slow > 15
    assert both > 5


def test_a_speed_limit_between_two_others_is_met():
    """Where no price leaves but one limit active until the speed is nearly the right one: the price is halved in on."""
    one, J = np.eye(1), np.array([[1.0], [0.0], [0.0]])
    limits, cone = Polytope(one, np.array([1.0 - 2e-4]), np.array([1.0])), Cone(J, 1.0 - 1e-4, np.zeros(3))
    found = minimise(backends.Daqp(), Quadratic(one, one, np.array([50.0])), limits, cone)
    np.testing.assert_allclose(found.z, [1.0 - 1e-4], rtol=1e-12)
    assert not found.multipliers.any()
