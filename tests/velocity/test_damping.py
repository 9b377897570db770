import numpy as np
import pytest
from support.velocity_reference import regular_problem

import invariantqp as iq
from invariantqp.velocity.convexify import convexify


def test_adaptive_damping_is_nothing_until_the_threshold_and_continuous_there():
    policy = iq.velocity.Adaptive(threshold=1e-3, ceiling=1e-2)
    assert policy(1e-3, 1.0) == 0.0
    assert 0.0 < policy(1e-3 * (1 - 1e-9), 1.0) < 1e-10
    assert policy(0.0, 1.0) == 1e-2
    ratios = np.linspace(0.0, 2e-3, 500)
    values = [policy(r, 1.0) for r in ratios]
    assert (np.diff(values) <= 0.0).all()
    assert policy(2e-4 * 7.0, 7.0) == pytest.approx(7.0 * policy(2e-4, 1.0))  # relative: no unit enters


def test_fixed_damping_has_a_floor_only_where_it_must():
    assert iq.velocity.Fixed(0.3)(0.0, 1.0) == 0.3
    assert iq.velocity.Fixed(0.0)(1e-3, 1.0) == 0.0
    assert iq.velocity.Fixed(0.0)(0.0, 2.0) == pytest.approx(2e-8)


BAD = {
    "negative": lambda: iq.velocity.Fixed(-1e-3),
    "nan": lambda: iq.velocity.Fixed(np.nan),
    "infinite": lambda: iq.velocity.Fixed(np.inf),
    "threshold": lambda: iq.velocity.Adaptive(threshold=0.0),
    "ceiling": lambda: iq.velocity.Adaptive(ceiling=-1.0),
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
        mu = np.linalg.eigvalsh(iq.systems.gram_matrix(J, h))
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
        mu = np.abs(np.linalg.eigvalsh(iq.systems.gram_matrix(J, float(h))))
        bound = np.linalg.norm(J.T @ iq.pitch_form(float(h)) @ s) / (2.0 * 0.5e-4 * mu.max())
        assert np.linalg.norm(solution.velocity) <= bound
        largest = max(largest, np.linalg.norm(solution.velocity))
    assert largest > 10.0  # it is a hard case
    assert iq.solve_velocity(J, s, form=float(p), guard=False).method == "damped"
    assert "principal pitch" in iq.solve_velocity(J, s, form=float(p) + 1e-9, guard=False).reason


@pytest.mark.parametrize(
    "policy",
    [
        iq.velocity.Fixed(0.0),
        iq.velocity.Fixed(0.2),
        iq.velocity.Adaptive(0.05, 0.05),
        iq.velocity.Selective(0.4, 0.05, 0.05),
    ],
)
def test_the_closed_loop_never_gains_or_turns_back_in_ten_thousand_states(policy):
    """The eigenvalues of the map from a twist to the twist it gets, J x(s), computed without our spectrum."""
    rng = np.random.default_rng(11)
    low, high = np.inf, -np.inf
    for k in range(10_000):
        m = 1 + k % 6
        J, s = rng.normal(size=(6, m)), rng.normal(size=6)
        if k % 3 == 0:
            J[:, -1] = 1e-4 * J[:, -1] + J[:, 0] * (m > 1)  # near a singularity
        Q = iq.pitch_form(rng.normal())
        G = J.T @ Q @ J
        problem = convexify(G, J.T @ Q @ s, m, policy, None)
        # The filter as a matrix, from one solve a column where it is linear, and as it stands for Selective.
        squared = np.broadcast_to(problem.squared, m)
        X = problem.V @ np.diag(problem.mu / (problem.mu**2 + squared)) @ problem.V.T
        gains = np.linalg.eigvals(X @ G).real
        rounding = 1e-9 + 1e-13 * np.abs(X).max() * np.abs(G).max()  # of the products here, undamped near a singularity
        low, high = min(low, gains.min() + rounding), max(high, gains.max() - rounding)
        missed = np.abs(X @ J.T @ Q @ s - problem.solution()).max()
        assert missed <= 1e-6 * (1.0 + np.abs(problem.solution()).max())
    assert low >= 0.0
    assert high <= 1.0


def test_selective_damping_holds_every_direction_to_its_speed():
    rng = np.random.default_rng(12)
    for _ in range(300):
        J, s = rng.normal(size=(6, 5)), 10.0 * rng.normal(size=6)
        J[:, 4] = J[:, 0] + 1e-5 * J[:, 4]
        G, g = J.T @ iq.pitch_form(0.3) @ J, J.T @ iq.pitch_form(0.3) @ s
        problem = convexify(G, g, 5, iq.velocity.Selective(0.4), None)
        assert np.abs(problem.optimum).max() <= 0.4 * (1.0 + 1e-9)
        slow = convexify(G, 1e-3 * g, 5, iq.velocity.Selective(0.4), None).optimum
        free = np.abs(problem.mu) > 0.1 * np.abs(problem.mu).max()
        np.testing.assert_allclose(slow[free], (1e-3 * g @ problem.V / problem.mu)[free], rtol=1e-9)  # untouched


def test_the_papers_damping_says_what_it_does():
    J = np.column_stack(
        [iq.revolute((0, 0, 1)), iq.revolute((1, 0, 0), (0, 0, 0.4)), iq.revolute((0, 1, 0), (0.3, 0, 0))]
    )
    G = J.T @ iq.pitch_form(0.2) @ J
    pole = -float(np.linalg.eigvalsh(G)[0])
    assert pole > 0.0
    s = np.ones(6)
    near = iq.solve_velocity(J, s, form=0.2, damping=iq.velocity.PaperLambda(1.001 * pole))
    assert near.status == "degraded"
    assert "outside [0, 1]" in near.reason
    np.testing.assert_allclose(
        near.velocity, np.linalg.solve(G + 1.001 * pole * np.eye(3), J.T @ iq.pitch_form(0.2) @ s)
    )
    assert np.abs(near.velocity).max() > 100.0  # the filter stays sane where it blows up
    assert np.abs(iq.solve_velocity(J, s, form=0.2, damping=pole).velocity).max() < 20.0
    exactly = iq.solve_velocity(J, s, form=0.0, damping=iq.velocity.PaperLambda(-(J.T @ iq.pitch_form(0.0) @ J)))
    assert (exactly.status, exactly.method) == ("held", "hold")
    assert "pole" in exactly.reason
    tame = iq.solve_velocity(
        J, s, form=-5.0, damping=iq.velocity.PaperLambda([0.1, 0.1, 0.1])
    )  # G > 0 far below the pitches
    assert (tame.status, tame.reason) == ("ok", "")
    bounded = iq.solve_velocity(
        J, s, form=0.2, damping=iq.velocity.PaperLambda(1.001 * pole), bounds=iq.Bounds([-1, -1, -1], [1, 1, 1])
    )
    assert np.abs(bounded.velocity).max() <= 1.0
    assert "clipped" in bounded.reason
    with pytest.raises(iq.BadInput, match=r"shape \(2, 2\)"):
        iq.solve_velocity(J, s, form=0.2, damping=iq.velocity.PaperLambda(np.eye(2)))
