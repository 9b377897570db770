from fractions import Fraction
from typing import get_args

import numpy as np
import pytest
from support.velocity_reference import box_minimum, convex_form

import invariantqp as iq
from invariantqp.compare.exact import box as exact_box
from invariantqp.compare.exact import references
from invariantqp.compare.exact.failure import NoReference, ReferenceFailure
from invariantqp.compare.exact.references import AGREEMENT, reference
from invariantqp.compare.measure.states import SORTS, states
from invariantqp.compare.method import ExactProblem, Question, Setting

PROBLEMS = [p for p in get_args(ExactProblem) if p]
PITCH = 0.4


def question(seed, m, share=0.5):
    rng = np.random.default_rng([seed, m])
    J, s = rng.normal(size=(6, m)), rng.normal(size=6)
    reach = share * np.abs(np.linalg.pinv(J) @ s).max() * rng.uniform(0.7, 1.3, m)
    return Question(J, s, -reach, reach)


@pytest.mark.parametrize("m", [3, 6, 7])
@pytest.mark.parametrize("problem", PROBLEMS)
def test_two_references_made_differently_agree(problem, m):
    found = reference(problem, question(0, m), Setting(m, pitch=PITCH))
    assert found.agreement <= AGREEMENT
    assert found.x.shape == (m,)


@pytest.mark.parametrize("m", [3, 6, 7])
def test_they_are_what_numpy_finds_where_numpy_can(m):
    asked, setting = question(4, m), Setting(m, pitch=PITCH, inertia=np.repeat((0.5, 1.0), 3))
    J, s = asked.J, asked.s
    W = np.diag(setting.inertia)
    expected = {
        "least squares": np.linalg.pinv(J) @ s,
        "pitch": iq.pseudoinverse(J, PITCH) @ s,
        "adaptive": iq.pseudoinverse(J, PITCH) @ s,
        "inertia": np.linalg.pinv(np.sqrt(W) @ J) @ np.sqrt(W) @ s,
        "damped": np.linalg.solve(J.T @ J + 0.05**2 * np.eye(m), J.T @ s),
        "weighted": asked.upper * (np.linalg.pinv(J * asked.upper) @ s),
    }
    for problem, x in expected.items():
        np.testing.assert_allclose(reference(problem, asked, setting).x, x, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("m", [2, 4])
def test_limited_ones_are_the_best_of_every_active_set(m):
    for seed in range(2):
        asked, setting = question(seed, m, share=0.6), Setting(m, pitch=PITCH)
        H, c = convex_form(asked.J, asked.s, PITCH, 0.0)
        found = reference("adaptive box", asked, setting).x
        np.testing.assert_allclose(found, box_minimum(H, c, asked.lower, asked.upper), atol=1e-11)
        H = asked.J.T @ asked.J + 1e-6 * np.eye(m)
        found = reference("least squares box", asked, setting).x
        np.testing.assert_allclose(found, box_minimum(H, asked.J.T @ asked.s, asked.lower, asked.upper), atol=1e-11)


def test_a_singular_arm_is_damped_by_the_rule_in_both():
    rng = np.random.default_rng(3)
    U, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    V, _ = np.linalg.qr(rng.normal(size=(7, 7)))
    J = U * np.geomspace(1.0, 1e-4, 6) @ V[:6]
    s = rng.normal(size=6)
    free = Question(J, s, np.full(7, -np.inf), np.full(7, np.inf))
    reach = np.full(7, 0.8 * np.abs(iq.solve_velocity(J, s, form=PITCH, guard=False).velocity).max())
    asked = free._replace(lower=-reach, upper=reach)
    for problem, question_ in (("adaptive", free), ("adaptive box", asked)):
        bounds = None if problem == "adaptive" else iq.Bounds(asked.lower, asked.upper)
        ours = iq.solve_velocity(J, asked.s, form=PITCH, bounds=bounds, guard=False)
        assert ours.damping > 0.0
        exact = reference(problem, question_, Setting(7, pitch=PITCH)).x
        np.testing.assert_allclose(ours.velocity, exact, atol=1e-8 * np.abs(exact).max())
        assert len(ours.active) == (0 if bounds is None else 1)


def test_references_that_disagree_stop_everything(monkeypatch):
    first, second = references._WAYS["damped"]
    spoilt = lambda asked, setting: [x + Fraction(1, 10**11) for x in second(asked, setting)]  # noqa: E731
    monkeypatch.setitem(references._WAYS, "damped", (first, spoilt))
    with pytest.raises(ReferenceFailure, match="two references differ by"):
        reference("damped", question(0, 6), Setting(6))


def test_an_arm_that_no_pitch_sees_has_no_reference():
    planar = np.column_stack([iq.revolute((0, 0, 1), (x, y, 0.0)) for x, y in ((0, 0), (0.4, 0), (0.6, 0.3))])
    asked = Question(planar, np.ones(6), -np.ones(3), np.ones(3))
    with pytest.raises(NoReference):
        reference("pitch", asked, Setting(3, pitch=PITCH))


def test_an_answer_that_is_not_optimal_is_not_certified():
    H, c = exact_box.mp.eye(2), exact_box.mp.matrix([1, 1])
    with pytest.raises(ReferenceFailure, match="not optimal"):
        exact_box._certify(H, c, [-1, -1], [1, 1], exact_box.mp.matrix([1, 0.5]))
    exact_box._certify(H, c, [-1, -1], [1, 1], exact_box.mp.matrix([1, 1]))


@pytest.mark.parametrize("name", ["panda", "so101"])
def test_states_are_of_the_sort_they_are_called(name):
    robot = iq.load_robot(name)
    setting = Setting(len(robot.names), pitch=0.25)
    for sort in SORTS:
        drawn = states(robot, sort, 4, 0, setting)
        assert len(drawn) == 4
        for state in drawn:
            solution = iq.solve_velocity(
                state.J, state.s, form=0.25, guard=False, bounds=iq.Bounds(state.lower, state.upper)
            )
            sigma = np.linalg.svd(state.J, compute_uv=False)
            if sort == "limited":
                assert solution.method == "qp"
            elif sort == "free":
                assert solution.method == "closed-form"
            else:
                assert sigma[-1] < 2e-2 * sigma[0]
    again = states(robot, "free", 2, 0, setting)
    assert (again[1].J == states(robot, "free", 2, 0, setting)[1].J).all()
    assert (again[1].J != states(robot, "free", 2, 1, setting)[1].J).any()
