import numpy as np
import pytest
import qpsolvers
from support.velocity_reference import regular_problem, tight_box

import invariantqp as iq
from invariantqp.velocity import backends

# Relative to the largest joint velocity. A solver only says which limits are near; the numbers are ours.
AGREEMENT = 1e-11
INSTALLED = sorted({"daqp", "osqp", *qpsolvers.available_solvers})


class Solver:
    """A back end with a given solution."""

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
    return (J, s), {"form": h, "bounds": iq.Bounds(lower, upper), "exact": exact}


@pytest.mark.parametrize("rows", [False, True], ids=["box", "rows"])
@pytest.mark.parametrize("opened", [0.0, 0.3], ids=["closed", "half-open"])
@pytest.mark.parametrize("name", INSTALLED)
def test_every_back_end_agrees_with_the_engine(name, opened, rows):
    held = 0
    for seed in range(8):
        arguments, options = limited(seed, opened=opened, rows=rows)
        reference = iq.solve_velocity(*arguments, **options)
        solution = iq.solve_velocity(*arguments, **options, backend=name)
        if solution.status == "held":  # a solver that gives up
            held += 1
            continue
        size = np.abs(reference.velocity).max()
        assert np.abs(solution.velocity - reference.velocity).max() <= AGREEMENT * size
        assert (solution.method, solution.status) == (reference.method, reference.status)
        assert (reference.backend, solution.backend) == (("engine", name) if solution.method == "qp" else ("", ""))
    assert held <= (0 if name in {"daqp", "quadprog", "osqp", "clarabel"} else 4)


TROUBLES = {
    "raises": (lambda _: 1 / 0, "ZeroDivisionError"),
    "nan": (lambda qp: np.full(len(qp.c), np.nan), "answer that is not finite"),
    "infinite": (lambda qp: np.full(len(qp.c), np.inf), "answer that is not finite"),
    "infeasible": (lambda qp: np.full(len(qp.c), 50.0), "answer "),
    "none": (lambda _: None, "answer of shape ()"),
    "too short": (lambda qp: qp.c[1:], "answer of shape ("),
    "a column": (lambda qp: np.zeros((len(qp.c), 1)), "answer of shape ("),
    "words": (lambda _: "optimal", "ValueError"),
}


@pytest.mark.parametrize("rows", [False, True], ids=["box", "rows"])
@pytest.mark.parametrize("case", TROUBLES)
def test_a_failing_solver_is_named_and_the_status_is_held(case, rows):
    answer, said = TROUBLES[case]
    arguments, options = limited(3, rows=rows)
    solver = Solver(answer)
    solution = iq.solve_velocity(*arguments, **options, backend=solver)
    assert solver.calls >= 1
    assert (solution.method, solution.status, solution.backend) == ("hold", "held", "")
    assert f"custom: {said}" in solution.reason
    np.testing.assert_array_equal(solution.velocity, np.zeros(7))


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


def test_daqp_keeps_a_limit_close_to_the_optimum():
    qp = backends.BoxQP(np.eye(2), np.ones(2), np.zeros(2), np.array([1.0 - 1e-8, 5.0]), None)
    np.testing.assert_allclose(backends.Daqp().solve(qp), [1.0 - 1e-8, 1.0], rtol=0.0, atol=1e-10)


def test_names_of_back_ends():
    with pytest.raises(iq.errors.UnknownName, match=r"unknown QP back end 'dapq'; did you mean daqp") as caught:
        iq.solve_velocity(np.ones((6, 1)), np.ones(6), backend="dapq")
    assert "daqp" in caught.value.near
    with pytest.raises(iq.BadInput, match="backend: found int"):
        iq.solve_velocity(np.ones((6, 1)), np.ones(6), backend=3)
