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
from invariantqp.compare.registry import methods

PROBLEMS = [p for p in get_args(ExactProblem) if p]
PITCH = 0.4
POINT, LENGTH = np.array([0.1, -0.2, 0.3]), 0.7


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
    asked = question(4, m, share=1e6)
    setting = Setting(m, pitch=PITCH, inertia=np.repeat((0.5, 1.0), 3), point=POINT, length=LENGTH)
    J, s = asked.J, asked.s
    W, root = np.diag(setting.inertia), measure()
    expected = {
        "least squares": np.linalg.pinv(J) @ s,
        "pitch": iq.pseudoinverse(J, PITCH) @ s,
        "convexified": iq.pseudoinverse(J, PITCH) @ s,
        "measured": np.linalg.pinv(root @ J) @ root @ s,
        "inertia": np.linalg.pinv(np.sqrt(W) @ J) @ np.sqrt(W) @ s,
        "damped": np.linalg.solve(J.T @ J + 0.05**2 * np.eye(m), J.T @ s),
        "weighted": asked.upper * (np.linalg.pinv(J * asked.upper) @ s),
    }
    for problem, x in expected.items():
        np.testing.assert_allclose(reference(problem, asked, setting).x, x, rtol=1e-8, atol=1e-10)


def measure():
    """The root of L^2 |omega|^2 + |v + omega x p|^2, written out."""
    turned = np.array([np.r_[LENGTH * e[:3], e[3:] + np.cross(e[:3], POINT)] for e in np.eye(6)])
    return turned.T


@pytest.mark.parametrize("m", [2, 4])
def test_limited_ones_are_the_best_of_every_active_set(m):
    for seed in range(2):
        asked, setting = question(seed, m, share=0.6), Setting(m, pitch=PITCH, point=POINT, length=LENGTH)
        A, b = measure() @ asked.J, measure() @ asked.s
        problems = {
            "convexified": convex_form(asked.J, asked.s, PITCH, 0.0),
            "measured": (A.T @ A, A.T @ b),
            "least squares box": (asked.J.T @ asked.J + 1e-6 * np.eye(m), asked.J.T @ asked.s),
        }
        for problem, (H, c) in problems.items():
            found = reference(problem, asked, setting).x
            np.testing.assert_allclose(found, box_minimum(H, c, asked.lower, asked.upper), atol=1e-11)


@pytest.mark.parametrize("last", [1e-2, 5e-4, 1e-6, 0.0], ids=lambda x: f"sigma {x:g}")
@pytest.mark.parametrize("share", [0.8, 1e6], ids=["limited", "free"])
def test_our_law_is_its_reference_to_rounding_damping_and_calm_included(share, last):
    rng = np.random.default_rng(3)
    U, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    V, _ = np.linalg.qr(rng.normal(size=(7, 7)))
    J, s = np.linalg.solve(measure(), U * np.r_[np.geomspace(1.0, 0.1, 5), last] @ V[:6]), rng.normal(size=6)
    setting = Setting(7, dt=0.01, point=POINT, length=LENGTH)
    free = iq.solve_velocity(J, s, point=POINT, length=LENGTH, damping=iq.velocity.Adaptive()).velocity
    reach = np.full(7, share * np.abs(free).max())
    asked = Question(J, s, -reach, reach)
    x = methods()["invariantqp"].make(setting)(*asked)
    exact = reference("law", asked, setting).x
    # No further off than ten times what rounding moves of the exact answer: an SVD rounds relative to the whole of J.
    rounded = asked._replace(J=J + np.finfo(float).eps * np.linalg.norm(J) * rng.normal(size=J.shape))
    moved = np.abs(reference("law", rounded, setting).x - exact).max()
    np.testing.assert_allclose(x, exact, rtol=0.0, atol=10.0 * moved + 1e-14 * np.abs(exact).max())
    uncalmed = reference("measured", asked, setting).x
    if last < 1e-3 and share < 1.0:  # the residual adds damping, in the reference too
        assert np.abs(exact - uncalmed).max() > 1e-6 * np.abs(exact).max()


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
    setting = Setting(len(robot.names), pitch=0.25, length=0.8)
    for sort in SORTS:
        drawn = states(robot, sort, 4, 0, setting)
        assert len(drawn) == 4
        for state in drawn:
            point = (np.linalg.inv(state.to_tool) @ np.eye(6))[3:, :3]  # [p]x R, with R the tool's axes
            axes = np.linalg.inv(state.to_tool)[:3, :3]
            cross = point @ axes.T
            solution = iq.solve_velocity(
                state.J,
                state.s,
                point=[cross[2, 1], cross[0, 2], cross[1, 0]],
                length=0.8,
                bounds=iq.Bounds(state.lower, state.upper),
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
