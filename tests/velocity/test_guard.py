"""Descent: where standing still is allowed the error never grows to first order, whatever form is in use."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.arms import KINDS, arm
from support.velocity_reference import least_squares_form, quadprog_minimum, root_of, tight_box

import invariantqp as iq

LENGTH = 0.7


def decrease(A, b, x):
    """f(x) = 1/2 |b|^2 - 1/2 |b - A x|^2."""
    r = b - A @ x
    return 0.5 * (b @ b - r @ r)


def forms(rng, m):
    W = rng.normal(size=(6, 6))
    return {
        "none": None,
        "pitch": float(rng.uniform(-1.5, 1.5)),
        "complement": iq.Complement(rng.normal(size=(6, max(1, 6 - m)))),
        "carried": iq.CarriedMetric(W @ W.T + np.eye(6), np.eye(4)),
    }


@given(
    seed=st.integers(0, 10**9),
    kind=st.sampled_from(KINDS),
    m=st.integers(1, 10),
    eta=st.sampled_from([0.0, 0.5, 0.9, 1.0]),
    limited=st.booleans(),
    rows=st.booleans(),
)
@settings(max_examples=80, deadline=None, derandomize=True)
def test_the_error_never_grows_and_a_guarded_form_keeps_its_share_of_the_decrease(seed, kind, m, eta, limited, rows):
    rng = np.random.default_rng(seed)
    here = arm(rng, kind, m)
    J, s, p = here.J, rng.normal(size=6), here.point
    reach = rng.uniform(0.0, 1.0, m)
    options = {"point": p, "length": LENGTH, "joint_metric": np.ones(m)}
    options["bounds"] = (-reach, reach) if limited else (np.full(m, -1e6), np.full(m, 1e6))
    if rows:
        options["rows"] = iq.limits.LimitRows(rng.normal(size=(2, m)), [-0.2, -np.inf], [0.1, 0.3])
    A, b = root_of(p, LENGTH) @ J, root_of(p, LENGTH) @ s
    best = decrease(A, b, iq.solve_velocity(J, s, **options).velocity)
    rounding = 1e-9 * (b @ b)
    for name, form in forms(rng, m).items():
        solution = iq.solve_velocity(J, s, form=form, guard=iq.Guard(eta), **options)
        if name == "carried":
            root = np.linalg.cholesky(form.matrix).T  # it measures twists itself
            assert decrease(root @ J, root @ s, solution.velocity) >= -1e-9 * ((root @ s) @ (root @ s))
            continue
        f = decrease(A, b, solution.velocity)
        assert f >= eta * best - rounding
        assert f >= -rounding
        assert (solution.status == "guarded") <= (solution.guard > 0.0)
        assert name != "none" or solution.guard == 0.0


def test_the_best_that_is_asked_for_is_what_another_solver_finds():
    pytest.importorskip("quadprog")
    rng = np.random.default_rng(1)
    acted = 0
    for k in range(90):
        m = (2, 3, 5)[k % 3]
        J, s, p = rng.normal(size=(6, m)), rng.normal(size=6), rng.normal(size=3)
        A, b = root_of(p, LENGTH) @ J, root_of(p, LENGTH) @ s
        bounds = tight_box(rng, m, np.linalg.pinv(A) @ b)
        best = quadprog_minimum(*least_squares_form(A, b), bounds.lower, bounds.upper)
        guarded = iq.solve_velocity(J, s, guard=iq.Guard(0.97), form=0.3, bounds=bounds, point=p, length=LENGTH)
        f = decrease(A, b, guarded.velocity)
        assert f >= 0.97 * decrease(A, b, best) - 1e-9 * (b @ b)
        if guarded.guard > 0.0:
            acted += 1
            # The smallest share that does it.
            assert f == pytest.approx(0.97 * decrease(A, b, best), rel=1e-6)
            assert f"descent guard: {guarded.guard:.3g} of least squares" in guarded.reason
    assert acted >= 3


def test_without_it_a_form_can_go_uphill():
    """Of a twist that is mostly beyond the joints a projection attempts more than there is to gain."""
    rng = np.random.default_rng(0)
    uphill = 0
    for _ in range(150):
        J, s, p = rng.normal(size=(6, 2)), rng.normal(size=6), rng.normal(size=3)
        A, b = root_of(p, LENGTH) @ J, root_of(p, LENGTH) @ s
        options = {"form": iq.Complement(rng.normal(size=(6, 4))), "point": p, "length": LENGTH}
        uphill += decrease(A, b, iq.solve_velocity(J, s, guard=False, **options).velocity) < 0.0
        assert decrease(A, b, iq.solve_velocity(J, s, **options).velocity) > 0.0
    assert uphill > 5


@pytest.mark.parametrize("eta", [0.0, 0.5, 0.9])
def test_where_no_limit_is_met_what_is_attempted_descends_and_nothing_is_blended(eta):
    rng = np.random.default_rng(5)
    shortened = 0
    for _ in range(40):
        J, s, p = rng.normal(size=(6, 2)), rng.normal(size=6), rng.normal(size=3)
        A, b = root_of(p, LENGTH) @ J, root_of(p, LENGTH) @ s
        options = {"form": iq.Complement(rng.normal(size=(6, 4))), "point": p, "length": LENGTH, "damping": 0.0}
        guarded, plain = (iq.solve_velocity(J, s, guard=g, **options) for g in (iq.Guard(eta), False))
        best = decrease(A, b, np.linalg.lstsq(A, b, rcond=None)[0])
        assert guarded.guard == 0.0
        assert decrease(A, b, guarded.velocity) >= eta * best - 1e-12 * (b @ b)
        shortened += bool(decrease(A, b, plain.velocity) < eta * best)
    assert shortened > 2


def test_it_keeps_exact_rows():
    rng = np.random.default_rng(7)
    acted = 0
    for _ in range(60):
        J, s, p = rng.normal(size=(6, 5)), rng.normal(size=6), rng.normal(size=3)
        rows = iq.ExactRows(J[3:], s[3:])
        bounds = (np.full(5, -0.5), np.full(5, 0.5))
        solution = iq.solve_velocity(
            J, s, form=0.4, exact=rows, guard=iq.Guard(0.97), bounds=bounds, point=p, length=LENGTH
        )
        np.testing.assert_allclose(J[3:] @ solution.velocity, solution.scale * s[3:], atol=1e-11)
        acted += solution.guard > 0.0
    assert acted > 0
