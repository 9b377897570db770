import numpy as np
import pytest
from support.velocity_reference import regular_problem, tight_box

import invariantqp as iq


def decrease(J, s, point, length, x):
    """f(x) = 1/2 |s|^2 - 1/2 |s - Jx|^2 in W = diag(L^2 I, I) at the point."""

    def at(t):
        moved = t[3:] + np.cross(t[:3], point, axis=0)
        return np.concatenate((length * t[:3], moved))

    r = at(s) - at(J) @ x
    return 0.5 * (at(s) @ at(s) - r @ r), at(J), at(s)


def least_squares(J_w, s_w, bounds):
    """The best that any velocity in the box can do, by another solver."""
    quadprog = pytest.importorskip("quadprog")
    m = J_w.shape[1]
    H = J_w.T @ J_w + 1e-12 * np.trace(J_w.T @ J_w) * np.eye(m)
    rows, sides = np.hstack((np.eye(m), -np.eye(m))), np.concatenate((bounds.lower, -np.asarray(bounds.upper)))
    return quadprog.solve_qp(H, J_w.T @ s_w, rows, sides)[0]


@pytest.mark.parametrize("eta", [0.0, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("m", [2, 3, 5, 6, 7])
def test_at_least_the_asked_share_of_what_least_squares_gains(m, eta):
    rng = np.random.default_rng(m)
    acted = 0
    for _ in range(40):
        J, s = rng.normal(size=(6, m)), 3.0 * rng.normal(size=6)
        h = float(rng.uniform(-1.5, 1.5))
        free = np.linalg.pinv(J) @ s
        bounds = tight_box(rng, m, free)
        solution = iq.solve_velocity(J, s, form=h, bounds=bounds, guard=iq.Guard(fraction=eta))
        own = iq.systems.centre(J, s)
        f, J_w, s_w = decrease(J, s, *own, solution.velocity)
        # Near a singularity least squares is damped as the law is, and has that much less to gain.
        mu = np.sort(np.linalg.eigvalsh(J_w.T @ J_w))
        regular = mu[-min(m, 6)] >= 1e-4 * mu[-1]
        metric = iq.CarriedMetric(np.diag([own.length**2] * 3 + [1.0] * 3), iq.transform(translation=own.point))
        damped = iq.solve_velocity(J, s, form=metric, bounds=bounds, guard=False).velocity
        best = decrease(J, s, *own, least_squares(J_w, s_w, bounds) if regular else damped)[0]
        assert f >= eta * best - 1e-6 * best
        assert ((bounds.lower <= solution.velocity) & (solution.velocity <= bounds.upper)).all()
        assert (solution.status == "guarded") == (solution.guard > 0.0)
        acted += solution.guard > 0.0
        plain = iq.solve_velocity(J, s, form=h, bounds=bounds, guard=False)
        assert plain.guard == 0.0
        if solution.guard == 0.0:
            np.testing.assert_array_equal(plain.velocity, solution.velocity)
        else:
            assert decrease(J, s, *own, plain.velocity)[0] < eta * best + 1e-6 * best
            assert f <= eta * best + 1e-6 * best or solution.guard == 1.0  # the smallest share that does it
            assert "descent guard" in solution.reason
    assert acted >= (5 if m < 6 or eta > 0.8 else 1)


def test_without_it_the_h_law_can_go_uphill():
    rng = np.random.default_rng(0)
    uphill = 0
    for _ in range(100):
        J, s = rng.normal(size=(6, 4)), rng.normal(size=6)
        own = iq.systems.centre(J, s)
        plain = iq.solve_velocity(J, s, form=0.3, guard=False)
        uphill += decrease(J, s, *own, plain.velocity)[0] < 0.0
        assert decrease(J, s, *own, iq.solve_velocity(J, s, form=0.3).velocity)[0] > 0.0
    assert uphill > 10


@pytest.mark.parametrize("m", range(1, 9))
def test_a_twist_that_can_be_met_is_met_exactly(m):
    rng = np.random.default_rng(40 + m)
    for _ in range(20):
        J, _, h = regular_problem(rng, m)
        s = J @ rng.normal(size=m)
        solution = iq.solve_velocity(J, s, form=h, guard=iq.Guard(fraction=1.0))
        assert (solution.status, solution.guard) == ("ok", 0.0)
        assert np.linalg.norm(solution.residual) <= 1e-10 * np.linalg.norm(s) * np.linalg.cond(J)


def test_it_measures_where_it_is_told():
    rng = np.random.default_rng(6)
    changed = 0
    for _ in range(30):
        J, s = rng.normal(size=(6, 4)), rng.normal(size=6)
        point = rng.normal(size=3)
        solution = iq.solve_velocity(J, s, form=0.2, guard=iq.Guard(fraction=0.9, point=point, length=0.3))
        f, J_w, s_w = decrease(J, s, point, 0.3, solution.velocity)
        best = decrease(J, s, point, 0.3, np.linalg.lstsq(J_w, s_w, rcond=None)[0])[0]
        assert f >= 0.9 * best - 1e-6 * best
        changed += solution.guard > 0.0
    assert changed > 5


def test_it_keeps_exact_rows():
    rng = np.random.default_rng(7)
    acted = 0
    for _ in range(40):
        J, s, h = regular_problem(rng, 5)
        solution = iq.solve_velocity(J, s, form=h, exact=iq.ExactRows(J[3:], s[3:]), guard=iq.Guard(fraction=1.0))
        np.testing.assert_allclose(J[3:] @ solution.velocity, s[3:], atol=1e-11)
        acted += solution.guard > 0.0
    assert acted > 5


def test_its_share_is_continuous():
    rng = np.random.default_rng(8)
    J, s = rng.normal(size=(6, 4)), rng.normal(size=6)
    direction = rng.normal(size=6)
    path = [iq.solve_velocity(J, s + t * direction, form=0.3) for t in np.linspace(-1.0, 1.0, 2001)]
    shares = np.array([p.guard for p in path])
    assert shares.max() > 0.0
    steps = np.linalg.norm(np.diff([p.velocity for p in path], axis=0), axis=1)
    assert steps.max() < 50.0 * np.median(steps) + 1e-9
