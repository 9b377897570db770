import mpmath
import numpy as np
import pytest
import qpsolvers
from support.velocity_reference import (
    LIMITED,
    box_minimum,
    least_squares_form,
    quadprog_minimum,
    regular_problem,
    root_of,
    tight_box,
)

import invariantqp as iq
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.qp import backends, quadratic
from invariantqp.velocity.qp.active import face_of
from invariantqp.velocity.qp.polytope import Polytope
from invariantqp.velocity.solve import solve

# Relative to the largest joint velocity. A solver only says which limits are active; the numbers are ours.
AGREEMENT = 1e-9
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


@pytest.mark.parametrize("m", [1, 2, 3, 4])
def test_the_optimum_by_exact_enumeration_of_active_sets(m):
    rng = np.random.default_rng(m)
    hit = 0
    for damping in (None, None, 0.1, 0.5):
        J, s, _ = regular_problem(rng, m)
        p, length = rng.normal(size=3), 0.6
        A, b = root_of(p, length) @ J, root_of(p, length) @ s
        free = np.linalg.lstsq(A, b, rcond=None)[0]
        bounds = tight_box(rng, m, free, share=0.9)
        solution = iq.solve_velocity(J, s, damping=damping, bounds=bounds, point=p, length=length)
        H, c = least_squares_form(A, b, damping=LIMITED if damping is None else damping)
        exact = box_minimum(H, c, bounds.lower, bounds.upper)
        np.testing.assert_allclose(solution.velocity, exact, rtol=0.0, atol=1e-11 * np.linalg.norm(free))
        hit += solution.method == "qp"
    assert hit >= 2


@pytest.mark.parametrize("metric", [False, True], ids=["identity", "joint metric"])
@pytest.mark.parametrize("m", [3, 5, 6, 8])
def test_the_optimum_by_another_solver_on_another_construction(m, metric):
    pytest.importorskip("quadprog")
    rng = np.random.default_rng(10 + m)
    for k in range(20):
        J, s, _ = regular_problem(rng, m)
        p, length, posture = rng.normal(size=3), 0.6, rng.normal(size=m)
        damping = (None, 0.02, 0.3)[k % 3]
        M = rng.normal(size=(m, m))
        M = M @ M.T + 0.5 * np.eye(m) if metric else np.eye(m)
        T = np.linalg.inv(np.linalg.cholesky(M)).T
        A, b = root_of(p, length) @ J @ T, root_of(p, length) @ s
        free = T @ np.linalg.lstsq(A, b, rcond=None)[0]
        bounds = tight_box(rng, m, free)
        solution = iq.solve_velocity(
            J,
            s,
            damping=damping,
            bounds=bounds,
            joint_metric=M if metric else None,
            point=p,
            length=length,
            posture=posture,
        )
        H, c = least_squares_form(A, b, np.linalg.solve(T, posture), LIMITED if damping is None else damping)
        back = np.linalg.inv(T)
        other = quadprog_minimum(back.T @ H @ back, back.T @ c, bounds.lower, bounds.upper)
        # quadprog works on H, which has the square of the condition that ours has.
        np.testing.assert_allclose(solution.velocity, other, rtol=0.0, atol=1e-7 * np.linalg.norm(other))


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
def test_a_solver_that_fails_is_replaced_and_the_status_says_so(case, rows, monkeypatch):
    monkeypatch.setattr("invariantqp.velocity.solve.core", None)
    answer, said = TROUBLES[case]
    arguments, options = limited(3, rows=rows)
    solver = Solver(answer)
    options["guard"] = True
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
def test_when_every_solver_fails_the_active_set_answers_from_inside(monkeypatch, guard, rows):
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


def test_a_kept_workspace_answers_as_a_fresh_one():
    """Sizes change, rows come and go, limits come and go: one Osqp object, sixty ticks."""
    kept = iq.velocity.Osqp()
    worst = 0.0
    for k in range(60):
        arguments, options = limited(k // 3, m=(5, 7, 7)[k % 3], opened=0.3 * (k % 2), rows=k % 5 == 4)
        fresh = iq.solve_velocity(*arguments, **options)
        solution = iq.solve_velocity(*arguments, **options, backend=kept)
        assert solution.status == fresh.status
        worst = max(worst, np.abs(solution.velocity - fresh.velocity).max() / np.abs(fresh.velocity).max())
    assert worst < 1e-6


def test_a_workspace_survives_a_tick_without_an_answer(monkeypatch):
    arguments, options = limited(2)
    reference = iq.solve_velocity(*arguments, **options)
    kept = iq.velocity.Osqp()
    monkeypatch.setattr(backends, "OSQP_ITERATIONS", 1)
    first = iq.solve_velocity(*arguments, **options, backend=kept)
    assert (first.status, first.backend) == ("degraded", "daqp")
    assert "maximum iterations" in first.reason
    monkeypatch.undo()
    second = iq.solve_velocity(*arguments, **options, backend=kept)
    assert (second.status, second.backend) == (reference.status, "osqp") == ("limited", "osqp")
    np.testing.assert_allclose(second.velocity, reference.velocity, atol=1e-6)


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


def test_names_of_back_ends():
    with pytest.raises(iq.errors.UnknownName, match=r"unknown QP back end 'dapq'; did you mean daqp") as caught:
        iq.solve_velocity(np.ones((6, 1)), np.ones(6), backend="dapq")
    assert "daqp" in caught.value.near
    with pytest.raises(iq.BadInput, match="backend: found int"):
        iq.solve_velocity(np.ones((6, 1)), np.ones(6), backend=3)


def test_multipliers_keep_their_digits_where_some_directions_count_much_less_than_others():
    rng = np.random.default_rng(4)
    for _ in range(10):
        N, b = rng.normal(size=(6, 8)) * np.geomspace(1.0, 1e5, 8), rng.normal(size=6)
        face = face_of(N, np.full(6, -np.inf), b, np.ones(6, dtype=np.intp))
        with mpmath.workdps(50):
            exact = mpmath.matrix(N.tolist())
            expected = np.array(mpmath.lu_solve(exact * exact.T, -mpmath.matrix(b.tolist())).tolist(), float).ravel()
        np.testing.assert_allclose(face.multipliers(face.e), expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())


def test_a_search_that_hardly_ends_is_not_begun(monkeypatch):
    """Where many limits are exceeded, the solver is asked at once; where none is, no normals are computed."""
    searched, turned = [], []
    for name, calls in (("face_of", searched), ("_normals", turned)):
        whole = getattr(quadratic, name)
        monkeypatch.setattr(quadratic, name, lambda *a, whole=whole, calls=calls: calls.append(a) or whole(*a))
    problem = quadratic.Quadratic.diagonal(np.ones(7), np.ones(7))
    for exceeded in (0, 1, quadratic.FEW, quadratic.FEW + 1, 7):
        searched.clear(), turned.clear()
        upper = np.where(np.arange(7) < exceeded, 0.5, 2.0)
        found = quadratic.minimise(backends.Daqp(), problem, Polytope(None, -upper, upper))
        np.testing.assert_array_equal(found.z, np.minimum(upper, 1.0))
        few = exceeded <= quadratic.FEW
        assert found.backend == ("" if exceeded == 0 else quadratic.OWN if few else "daqp")
        assert len(searched) == (0 if exceeded == 0 else exceeded + 1 if few else 1)
        assert len(turned) == (exceeded > 0)
