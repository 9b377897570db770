import numpy as np
import pytest
from velocity_reference import regular_problem

import invariantqp as iq


def test_adaptive_damping_is_nothing_until_the_threshold_and_continuous_there():
    policy = iq.Adaptive(threshold=1e-3, ceiling=1e-2)
    assert policy(1e-3, 1.0) == 0.0
    assert 0.0 < policy(1e-3 * (1 - 1e-9), 1.0) < 1e-10
    assert policy(0.0, 1.0) == 1e-2
    ratios = np.linspace(0.0, 2e-3, 500)
    values = [policy(r, 1.0) for r in ratios]
    assert (np.diff(values) <= 0.0).all()
    assert policy(2e-4 * 7.0, 7.0) == pytest.approx(7.0 * policy(2e-4, 1.0))  # relative: no unit enters


def test_fixed_damping_has_a_floor_only_where_it_must():
    assert iq.Fixed(0.3)(0.0, 1.0) == 0.3
    assert iq.Fixed(0.0)(1e-3, 1.0) == 0.0
    assert iq.Fixed(0.0)(0.0, 2.0) == pytest.approx(2e-8)


BAD = {
    "negative": lambda: iq.Fixed(-1e-3),
    "nan": lambda: iq.Fixed(np.nan),
    "infinite": lambda: iq.Fixed(np.inf),
    "threshold": lambda: iq.Adaptive(threshold=0.0),
    "ceiling": lambda: iq.Adaptive(ceiling=-1.0),
    "word": lambda: iq.solve_velocity(np.ones((6, 1)), np.ones(6), damping="much"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_damping(case):
    with pytest.raises(iq.BadInput, match=r"found .*; expected "):
        BAD[case]()


@pytest.mark.parametrize("m", range(1, 9))
@pytest.mark.parametrize("damping", [1e-3, 0.05, 1.0, 30.0])
def test_the_closed_loop_gains_are_in_zero_to_one(m, damping):
    """The map s -> Jx is J V f(mu) V'J'Q_h; its eigenvalues are mu^2 / (mu^2 + lambda^2), and x is bounded."""
    rng = np.random.default_rng(m)
    for _ in range(5):
        J, _, h = regular_problem(rng, m)
        columns = []
        for e in np.eye(6):
            solution = iq.solve_velocity(J, e, form=h, damping=damping, guard=False)
            assert solution.method == "damped"
            assert solution.damping == damping
            columns.append(J @ solution.velocity)
            g = J.T @ iq.pitch_form(h) @ e
            assert np.linalg.norm(solution.velocity) <= np.linalg.norm(g) / (2.0 * damping) * (1.0 + 1e-12)
        gains = np.linalg.eigvals(np.column_stack(columns))
        np.testing.assert_allclose(gains.imag, 0.0, atol=1e-6)
        assert gains.real.min() > -1e-9
        assert gains.real.max() < 1.0 + 1e-9
        mu = np.linalg.eigvalsh(iq.gram_matrix(J, h))
        mu = mu[np.argsort(np.abs(mu))][-min(m, 6) :]
        expected = np.concatenate((np.zeros(6 - len(mu)), mu**2 / (mu**2 + damping**2)))
        np.testing.assert_allclose(np.sort(gains.real), np.sort(expected), atol=1e-7)


def test_through_a_principal_pitch_the_velocity_stays_bounded():
    """[DS]'s Lambda = lambda I has a pole where an eigenvalue passes -lambda; the filter has none."""
    rng = np.random.default_rng(4)
    J, s = rng.normal(size=(6, 3)), rng.normal(size=6)
    p = iq.principal_pitches(J)[1]
    largest = 0.0
    for h in p + np.concatenate((-np.geomspace(1e-1, 1e-14, 200), [0.0], np.geomspace(1e-14, 1e-1, 200))):
        solution = iq.solve_velocity(J, s, form=float(h), guard=False)
        mu = np.abs(np.linalg.eigvalsh(iq.gram_matrix(J, float(h))))
        bound = np.linalg.norm(J.T @ iq.pitch_form(float(h)) @ s) / (2.0 * 0.5e-4 * mu.max())
        assert np.linalg.norm(solution.velocity) <= bound
        largest = max(largest, np.linalg.norm(solution.velocity))
    assert largest > 10.0  # it is a hard case
    assert iq.solve_velocity(J, s, form=float(p), guard=False).method == "damped"
    assert "principal pitch" in iq.solve_velocity(J, s, form=float(p) + 1e-9, guard=False).reason
