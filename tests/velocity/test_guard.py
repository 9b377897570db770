"""The guard: beside least squares, a form keeps at least a share of the decrease of the error, and never a growth."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.arms import KINDS, arm
from support.velocity_reference import root_of

import invariantqp as iq

LENGTH = 0.7


def decrease(A, b, x):
    """f(x) = 1/2 |b|^2 - 1/2 |b - A x|^2."""
    r = b - A @ x
    return 0.5 * (b @ b - r @ r)


def forms(rng, J):
    """Forms that may have a projector for these twists, and none."""
    W, missing = rng.normal(size=(6, 6)), 6 - np.linalg.matrix_rank(J)
    given = {"none": None, "pitch": float(rng.uniform(-1.5, 1.5))}
    if missing:
        given["complement"] = iq.Complement(rng.normal(size=(6, missing)))
    return given | {"carried": iq.CarriedMetric(W @ W.T + np.eye(6), np.eye(4))}


@given(
    seed=st.integers(0, 10**9),
    kind=st.sampled_from(KINDS),
    m=st.integers(1, 10),
    eta=st.sampled_from([0.0, 0.5, 0.9, 1.0]),
)
@settings(max_examples=80, deadline=None, derandomize=True)
def test_a_guarded_form_keeps_its_share_of_the_decrease(seed, kind, m, eta):
    """The largest part of the form that does: at eta = 1 it is least squares."""
    rng = np.random.default_rng(seed)
    here = arm(rng, kind, m)
    J, s, p = here.J, rng.normal(size=6), here.point
    options = {"point": p, "length": LENGTH, "joint_metric": np.ones(m), "guard": iq.Guard(eta)}
    A, b = root_of(p, LENGTH) @ J, root_of(p, LENGTH) @ s
    best, rounding = decrease(A, b, iq.solve_velocity(J, s, **options).velocity), 1e-9 * (b @ b)
    for name, form in forms(rng, J).items():
        try:
            solution = iq.solve_velocity(J, s, form=form, **options)
        except iq.NoPseudoinverse:
            assert name == "pitch"
            continue
        if name == "carried":
            root = np.linalg.cholesky(form.matrix).T  # it measures twists itself
            assert decrease(root @ J, root @ s, solution.velocity) >= -1e-9 * ((root @ s) @ (root @ s))
            continue
        f = decrease(A, b, solution.velocity)
        assert f >= eta * best - rounding
        assert (solution.status == "guarded") == (solution.guard > 0.0)
        if solution.guard > 0.0:
            assert name != "none"
            assert f == pytest.approx(eta * best, abs=rounding)
            assert f"descent guard: {solution.guard:.3g} of least squares" in solution.reason


@pytest.mark.parametrize("guard", [True, False])
def test_least_squares_never_increases_the_error_under_limits(guard):
    rng = np.random.default_rng(0)
    for k in range(200):
        m = 1 + k % 10
        here = arm(rng, KINDS[k % len(KINDS)], m)
        J, s, p, reach = here.J, rng.normal(size=6), here.point, rng.uniform(0.0, 1.0, m)
        rows = iq.limits.LimitRows(rng.normal(size=(2, m)), [-0.2, -np.inf], [0.1, 0.3]) if k % 2 else None
        x = iq.solve_velocity(J, s, bounds=(-reach, reach), rows=rows, guard=guard, point=p, length=LENGTH).velocity
        root = root_of(p, LENGTH)
        assert decrease(root @ J, root @ s, x) >= -1e-12 * (root @ s) @ (root @ s)


def test_without_a_guard_a_form_can_increase_the_error():
    """Of a twist that is mostly beyond the joints a projection attempts more than there is to gain."""
    rng = np.random.default_rng(0)
    uphill = 0
    for _ in range(150):
        J, s, p = rng.normal(size=(6, 2)), rng.normal(size=6), rng.normal(size=3)
        A, b = root_of(p, LENGTH) @ J, root_of(p, LENGTH) @ s
        options = {"form": iq.Complement(rng.normal(size=(6, 4))), "point": p, "length": LENGTH}
        uphill += decrease(A, b, iq.solve_velocity(J, s, **options).velocity) < 0.0
        assert decrease(A, b, iq.solve_velocity(J, s, guard=True, **options).velocity) > 0.0
    assert uphill > 5


def test_a_guard_keeps_exact_rows():
    rng = np.random.default_rng(7)
    acted = 0
    for _ in range(60):
        J, s, p = rng.normal(size=(6, 5)), rng.normal(size=6), rng.normal(size=3)
        options = {"form": 0.4, "exact": iq.ExactRows(J[3:], s[3:]), "bounds": (np.full(5, -0.5), np.full(5, 0.5))}
        solution = iq.solve_velocity(J, s, guard=iq.Guard(0.97), point=p, length=LENGTH, **options)
        np.testing.assert_allclose(J[3:] @ solution.velocity, solution.scale * s[3:], atol=1e-11)
        acted += solution.guard > 0.0
    assert acted > 0
