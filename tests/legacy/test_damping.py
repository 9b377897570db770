"""Damping: nothing away from singularities, gains in [0, 1] near them, and what the paper's own formula does."""

import numpy as np
import pytest
from support.velocity_reference import UNLIMITED, regular_problem, root_of

import invariantqp as iq
from invariantqp.legacy.damping import Adaptive, Fixed, PaperLambda, Selective, damping_of
from invariantqp.legacy.law import Chase, Demand, VelocityLaw
from invariantqp.legacy.objective import least_squares, spectrum_of
from invariantqp.legacy.problem import problem_of
from invariantqp.legacy.solve import solve


def solve_velocity(J, s, **options):
    return solve(*problem_of(J, s, **options))


def test_adaptive_damping_is_nothing_until_the_threshold_and_continuous_there():
    policy = Adaptive(threshold=1e-3, ceiling=1e-2)
    sigma = np.array([1e-3, 1e-3 * (1 - 1e-9), 0.0])
    at, just_below, zero = np.sqrt(policy.squares(sigma, np.zeros(3), 1.0))
    assert at == 0.0
    assert 0.0 < just_below < 1e-10
    assert zero == pytest.approx(1e-2)
    values = policy.squares(np.linspace(0.0, 2e-3, 500), np.zeros(500), 1.0)
    assert (np.diff(values) <= 0.0).all()
    # Relative: no unit enters.
    far = np.array([1e-3, 3e-4, 0.0])
    np.testing.assert_allclose(policy.squares(7.0 * far, far, 7.0), 49.0 * policy.squares(far, far, 1.0), rtol=1e-12)


def test_where_a_joint_has_no_limit_the_default_is_stronger():
    assert damping_of(None, limited=True) == Adaptive()
    assert damping_of(None, limited=False) == Adaptive(*UNLIMITED)
    assert damping_of(0.3, limited=True) == Fixed(0.3)


BAD = {
    "negative": lambda: Fixed(-1e-3),
    "infinite": lambda: Fixed(np.inf),
    "threshold": lambda: Adaptive(threshold=0.0),
    "ceiling": lambda: Adaptive(ceiling=-1.0),
    "speed": lambda: Selective(speed=0.0),
    "adaptive": lambda: Selective(adaptive=0.1),
    "word": lambda: solve_velocity(np.ones((6, 1)), np.ones(6), damping="much"),
    "paper": lambda: PaperLambda([[0.0, 1.0], [0.0, 0.0]]),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_damping(case):
    with pytest.raises(iq.BadInput, match=r"found .*; expected "):
        BAD[case]()


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    "policy",
    [
        Fixed(0.0),
        Fixed(0.2),
        Adaptive(0.05, 0.05),
        Selective(0.4, Adaptive(0.05, 0.05)),
    ],
)
def test_no_policy_gains_or_turns_back(policy):
    """A direction gets between nothing and all of what is asked of it, in two thousand states near singularities."""
    rng = np.random.default_rng(11)
    for k in range(2000):
        m = 1 + k % 7
        A, b = rng.normal(size=(6, m)), rng.normal(size=6)
        if k % 3 == 0:
            A[:, -1] = 1e-4 * A[:, -1] + A[:, 0] * (m > 1)
        objective = least_squares(spectrum_of(A), b, None, policy)
        pull = objective.V.T @ (A.T @ b)
        sizes = ((A @ objective.V) ** 2).sum(axis=0)
        asked = sizes > 1e-12 * sizes.max()
        gains = sizes[asked] * objective.optimum[asked] / pull[asked]
        assert gains.min() >= 0.0
        assert gains.max() <= 1.0 + 1e-6
        assert (objective.weights > 0.0).all()


def test_selective_damping_holds_every_direction_to_its_speed():
    rng = np.random.default_rng(12)
    for _ in range(300):
        A, b = rng.normal(size=(6, 5)), 10.0 * rng.normal(size=6)
        A[:, 4] = A[:, 0] + 1e-5 * A[:, 4]
        fast = least_squares(spectrum_of(A), b, None, Selective(0.4))
        assert np.abs(fast.optimum).max() <= 0.4 * (1.0 + 1e-9)
        slow = least_squares(spectrum_of(A), 1e-4 * b, None, Selective(0.4))
        U, sigma, _ = np.linalg.svd(A)
        free = sigma > 0.1 * sigma[0]
        np.testing.assert_allclose(np.abs(slow.optimum[free]), np.abs(1e-4 * b @ U[:, :5] / sigma)[free], rtol=1e-9)


def test_a_custom_policy_will_do():
    class Half:
        def squares(self, sigma, wanted, largest):
            return sigma**2

    rng = np.random.default_rng(13)
    J, s = rng.normal(size=(6, 6)), rng.normal(size=6)
    np.testing.assert_allclose(solve_velocity(J, s, damping=Half()).velocity, 0.5 * np.linalg.solve(J, s), rtol=1e-9)


def test_the_papers_own_problem_made_convex_is_its_filtered_stationary_point():
    """x = V mu / (mu^2 + lambda^2) V'g without limits; through a principal pitch it stays bounded."""
    rng = np.random.default_rng(4)
    for damping in (0.0, 0.02, 0.3):
        for m in (2, 4, 6):
            J, s, h = regular_problem(rng, m)
            Q = iq.pitch_form(h)
            mu, V = np.linalg.eigh(J.T @ Q @ J)
            expected = V @ (mu / (mu**2 + damping**2) * (V.T @ (J.T @ Q @ s)))
            form = iq.PitchForm(h, convexified=True)
            solution = solve_velocity(J, s, form=form, damping=damping)
            np.testing.assert_allclose(solution.velocity, expected, atol=1e-9 * np.linalg.norm(expected))
    J, s = rng.normal(size=(6, 3)), rng.normal(size=6)
    p = iq.principal_pitches(J)[1]
    for h in p + np.concatenate((-np.geomspace(1e-1, 1e-14, 50), [0.0], np.geomspace(1e-14, 1e-1, 50))):
        solution = solve_velocity(J, s, form=iq.PitchForm(float(h), convexified=True))
        assert np.abs(solution.velocity).max() < 1e3


def test_the_papers_damping_says_what_it_does():
    J = np.column_stack(
        [iq.revolute((0, 0, 1)), iq.revolute((1, 0, 0), (0, 0, 0.4)), iq.revolute((0, 1, 0), (0.3, 0, 0))]
    )
    Q = iq.pitch_form(0.2)
    G = J.T @ Q @ J
    pole = -float(np.linalg.eigvalsh(G)[0])
    assert pole > 0.0
    s = np.ones(6)

    def printed(Lambda, **options):
        return solve_velocity(J, s, damping=PaperLambda(Lambda), **{"form": 0.2, **options})

    near = printed(1.001 * pole)
    assert near.status == "degraded"
    assert "outside [0, 1]" in near.reason
    np.testing.assert_allclose(near.velocity, np.linalg.solve(G + 1.001 * pole * np.eye(3), J.T @ Q @ s))
    assert np.abs(near.velocity).max() > 100.0  # the filter stays sane where it blows up
    filtered = solve_velocity(J, s, form=iq.PitchForm(0.2, convexified=True), damping=pole)
    assert np.abs(filtered.velocity).max() < 20.0
    exactly = printed(-(J.T @ iq.pitch_form(0.0) @ J), form=0.0)
    assert (exactly.status, exactly.method) == ("held", "hold")
    assert "pole" in exactly.reason
    tame = printed([0.1, 0.1, 0.1], form=-5.0)  # G > 0 far below the pitches
    assert (tame.status, tame.reason) == ("ok", "")
    bounded = printed(1.001 * pole, bounds=([-1, -1, -1], [1, 1, 1]))
    assert np.abs(bounded.velocity).max() <= 1.0
    assert "clipped" in bounded.reason
    for options in (
        {"form": None},
        {"exact": iq.ExactRows([[1.0, 0.0, 0.0]], [0.1])},
        {"rows": iq.limits.LimitRows([[1.0, 0.0, 0.0]], [-1.0], [1.0])},
    ):
        assert printed(0.1, **options).status == "held"
    with pytest.raises(iq.BadInput, match=r"shape \(2, 2\)"):
        printed(np.eye(2))
    posture = printed(0.3, posture=np.ones(3))
    np.testing.assert_allclose(posture.velocity, np.linalg.solve(G + 0.3 * np.eye(3), J.T @ Q @ s + 0.3 * np.ones(3)))
    metric = printed(0.3, joint_metric=[1.0, 2.0, 3.0])
    np.testing.assert_allclose(metric.velocity, np.linalg.solve(G + 0.3 * np.diag([1.0, 2.0, 3.0]), J.T @ Q @ s))


@pytest.mark.parametrize("engine", ["python", "compiled"])
@pytest.mark.parametrize("seed", range(12))
def test_a_loop_damps_what_it_asks_much_of(engine, seed):
    """What it asks slowly of a weak direction it gets; what it asks fast of one is damped as a twist by itself is."""
    rng = np.random.default_rng(seed)
    m, weak = int(rng.integers(6, 9)), 10.0 ** rng.uniform(-3.5, -2.8)
    U, V = (np.linalg.qr(rng.normal(size=(k, k)))[0] for k in (6, m))
    root = root_of(rng.normal(size=3), 0.6)
    sigma = np.array([*rng.uniform(0.2, 1.0, 5), weak])
    A, wide = (U * sigma) @ V[:, :6].T, np.full(m, np.inf)
    strong = rng.normal(size=5)

    def gain(asked, chase):
        """How much is had of what is asked of the weak direction, in joint speeds of the strong ones."""
        wanted = np.append(strong, asked * weak / sigma.max() * np.linalg.norm(strong))
        demand = Demand(np.linalg.solve(root, A), np.linalg.solve(root, U @ wanted), root, -wide, wide, chase=chase)
        had = U.T @ A @ solve(VelocityLaw(engine=engine), demand).velocity
        np.testing.assert_allclose(had[:5], strong, atol=1e-9)
        return had[5] / wanted[5]

    chase = Chase(np.zeros(6), None, -wide, wide, 0.0, apart=True)
    ratio = weak / sigma.max()
    damping = 4e-6 * (1.0 - 1e4 * ratio**2) ** 2 / ratio**2
    assert gain(0.03, None) == pytest.approx(1.0 / (1.0 + damping), rel=1e-6)
    assert gain(0.03, chase) > 0.99
    assert gain(300.0, chase) == pytest.approx(1.0 / (1.0 + damping), rel=2e-4)
