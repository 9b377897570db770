from functools import cache

import numpy as np
import pytest
import qpsolvers
from support.repeats import repeats
from support.velocity_reference import limited_minimum, regular_problem, tight_box

import invariantqp as iq
from invariantqp.velocity import backends
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.qp import Cone, Polytope, Quadratic, minimise
from invariantqp.velocity.solve import solve

# Relative to the largest joint velocity. A solver only says which limits are near; the numbers are ours.
AGREEMENT = 1e-11
INSTALLED = sorted({"daqp", "osqp", *qpsolvers.available_solvers})


class Solver:
    """A back end that does what it is told."""

    name = "custom"

    def __init__(self, answer):
        self.answer = answer
        self.calls = 0

    def solve(self, qp):
        self.calls += 1
        return self.answer(qp)


def limited(seed, *, m=7, opened=0.0, rows=False):
    """Arguments of a problem whose limits bind; some sides left open, rows on the linear part."""
    rng = np.random.default_rng(seed)
    J, s, h = regular_problem(rng, m)
    free = iq.solve_velocity(J, s, form=h).velocity
    bounds = tight_box(rng, m, free)
    lower, upper = np.array(bounds.lower), np.array(bounds.upper)
    lower[rng.random(m) < opened] = -np.inf
    upper[rng.random(m) < opened] = np.inf
    if lower[0] == -np.inf and upper[0] == np.inf:
        lower[0] = -0.1
    exact = iq.ExactRows(J[3:], 0.05 * s[3:]) if rows else None
    return (J, s), {"form": h, "bounds": iq.Bounds(lower, upper), "exact": exact, "guard": False}


@pytest.mark.parametrize("rows", [False, True], ids=["box", "rows"])
@pytest.mark.parametrize("opened", [0.0, 0.3], ids=["closed", "half-open"])
@pytest.mark.parametrize("name", INSTALLED)
def test_every_back_end_agrees_with_daqp(name, opened, rows):
    own = 0
    for seed in range(8):
        arguments, options = limited(seed, opened=opened, rows=rows)
        reference = iq.solve_velocity(*arguments, **options)
        solution = iq.solve_velocity(*arguments, **options, backend=name)
        size = np.abs(reference.velocity).max()
        assert np.abs(solution.velocity - reference.velocity).max() <= AGREEMENT * size
        assert solution.method == reference.method
        if solution.status == reference.status:
            own += 1
        else:  # a solver that gives up is replaced, and that is told
            assert solution.status == "degraded"
            assert solution.reason.startswith(f"{name}: ")
    assert own >= (8 if name in {"daqp", "quadprog", "osqp", "clarabel"} else 4)


TROUBLES = {
    "raises": (lambda _: 1 / 0, "ZeroDivisionError"),
    "nan": (lambda qp: np.full(len(qp.c), np.nan), "answer that is not finite"),
    "infinite": (lambda qp: np.full(len(qp.c), np.inf), "answer that is not finite"),
    "infeasible": (lambda qp: np.full(len(qp.c), 50.0), "outside its scaled bounds"),
    "none": (lambda _: None, "shape ()"),
    "too short": (lambda qp: qp.c[1:], "shape (6,), not (7,)"),
    "a column": (lambda qp: np.zeros((len(qp.c), 1)), "shape (7, 1)"),
    "words": (lambda _: "optimal", "ValueError"),
}


@pytest.mark.parametrize("rows", [False, True], ids=["box", "rows"])
@pytest.mark.parametrize("case", TROUBLES)
def test_a_solver_that_fails_is_replaced_and_the_status_says_so(case, rows):
    answer, said = TROUBLES[case]
    arguments, options = limited(3, rows=rows)
    solver = Solver(answer)
    options |= {"guard": True, "engine": "python"}
    reference = iq.solve_velocity(*arguments, **options)
    solution = iq.solve_velocity(*arguments, **options, backend=solver)
    assert solver.calls >= 1
    assert solution.status == "degraded"
    assert solution.backend == "daqp"
    assert rows or said in solution.reason
    assert solution.reason.count("solved by daqp") == 1
    np.testing.assert_array_equal(solution.velocity, reference.velocity)


def broken(self, qp):
    raise RuntimeError("licence expired")


@pytest.mark.parametrize("rows", [False, True], ids=["box", "rows"])
@pytest.mark.parametrize("guard", [False, True])
def test_when_every_solver_fails_least_squares_alone_answers(monkeypatch, guard, rows):
    for seed in range(5):
        arguments, options = limited(seed, rows=rows)
        options["guard"] = guard
        reference = iq.solve_velocity(*arguments, **options)
        with monkeypatch.context() as patch:
            patch.setattr(backends.Daqp, "solve", broken)
            solution = iq.solve_velocity(*arguments, **options, backend=Solver(lambda _: 1 / 0))
        assert (solution.method, solution.status) == ("qp", "degraded")
        for name in ("custom: ZeroDivisionError", "daqp: RuntimeError: licence expired"):
            assert rows or name in solution.reason
        assert solution.backend == "least distance"
        size = np.abs(reference.velocity).max()
        np.testing.assert_allclose(solution.velocity, reference.velocity, rtol=0.0, atol=1e-8 * size)


def test_numbers_beyond_any_scale_are_answered_by_standing_still():
    """As near to rest as the bounds allow: outside its position limits a joint has to come back."""
    J = 1e200 * np.random.default_rng(0).normal(size=(6, 3))
    demand = Demand(J, 1e200 * np.ones(6), np.eye(6), np.full(3, 0.2), np.full(3, 0.3))
    with np.errstate(all="ignore"):
        solution = solve(VelocityLaw(), demand)
    assert (solution.method, solution.status) == ("hold", "held")
    assert solution.reason
    np.testing.assert_array_equal(solution.velocity, [0.2] * 3)


def test_no_solver_sees_an_indefinite_matrix_or_large_numbers():
    seen = []

    def watch(qp):
        seen.append(qp)
        return backends.Daqp().solve(qp)

    for seed in range(30):
        arguments, options = limited(seed, m=1 + seed % 8, opened=0.2)
        options["bounds"] = iq.Bounds(1e-4 * options["bounds"].lower, 1e-4 * options["bounds"].upper)
        iq.solve_velocity(*arguments, **options, backend=Solver(watch))
    assert len(seen) >= 25
    for qp in seen:
        assert np.linalg.eigvalsh(qp.H).min() > 0.0
        assert np.abs(qp.H).max() == pytest.approx(1.0)
        assert max(qp.lower.max(), -qp.upper.min()) == pytest.approx(1.0)  # how far outside the free optimum is


def test_daqp_meets_a_limit_that_hardly_cuts_the_optimum():
    qp = backends.BoxQP(np.eye(2), np.ones(2), np.zeros(2), np.array([1.0 - 1e-8, 5.0]), None)
    np.testing.assert_allclose(backends.Daqp().solve(qp), [1.0 - 1e-8, 1.0], rtol=0.0, atol=1e-10)


def test_names_of_back_ends():
    with pytest.raises(iq.errors.UnknownName, match=r"unknown QP back end 'dapq'; did you mean daqp") as caught:
        iq.solve_velocity(np.ones((6, 1)), np.ones(6), backend="dapq")
    assert "daqp" in caught.value.near
    with pytest.raises(iq.BadInput, match="backend: found int"):
        iq.solve_velocity(np.ones((6, 1)), np.ones(6), backend=3)


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
