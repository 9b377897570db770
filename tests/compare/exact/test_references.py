import numpy as np
import pytest
from support.rational_references import second_reference
from support.velocity_reference import box_minimum

import invariantqp as iq
from invariantqp.compare.exact import ReferenceFailure
from invariantqp.compare.exact import box as exact_box
from invariantqp.compare.exact.references import reference
from invariantqp.compare.measure.solves import SORTS, questions
from invariantqp.compare.method import Question, Setting
from invariantqp.compare.registry import methods

PROBLEMS = sorted({row.problem for row in methods().values()} - {""})
# The largest relative difference between the two: far below any error of float64 that is reported.
AGREEMENT = 1e-12
POINT, LENGTH = np.array([0.1, -0.2, 0.3]), 0.7


def setting(m, dt=0.001):
    return Setting(m, dt, POINT, LENGTH, np.full(m, -np.inf), np.full(m, np.inf))


def question(seed, m, share=0.5):
    rng = np.random.default_rng([seed, m])
    J, s = rng.normal(size=(6, m)), rng.normal(size=6)
    reach = share * np.abs(np.linalg.pinv(J) @ s).max() * rng.uniform(0.7, 1.3, m)
    return Question.plain(J, s, -reach, reach)


@pytest.mark.parametrize("m", [3, 6, 7])
@pytest.mark.parametrize("limited", [False, True])
@pytest.mark.parametrize("problem", PROBLEMS)
def test_two_references_made_differently_agree(problem, m, limited):
    told = question(0, m), setting(m)
    found, again = (way(problem, *told, limited=limited) for way in (reference, second_reference))
    assert np.abs(found - again).max() <= AGREEMENT * np.abs(found).max()
    assert found.shape == (m,)


@pytest.mark.parametrize("sort", SORTS)
def test_they_agree_in_states_of_the_comparison(sort):
    robot = iq.load_robot("panda")
    (asked,) = questions(robot, sort, 1, 0)
    for problem in PROBLEMS:
        limited = sort == "limited"
        found, again = (way(problem, asked, setting(7), limited=limited) for way in (reference, second_reference))
        assert np.abs(found - again).max() <= AGREEMENT * np.abs(found).max()


@pytest.mark.parametrize("m", [3, 6, 7])
def test_they_are_what_numpy_finds_where_numpy_can(m):
    asked = question(4, m, share=1e6)
    J, s, root = asked.J, asked.s, measure()
    expected = {
        "least squares": np.linalg.pinv(J) @ s,
        "damped": np.linalg.solve(J.T @ J + 0.05**2 * np.eye(m), J.T @ s),
        "ridge": np.linalg.solve(J.T @ J + 1e-6 * np.eye(m), J.T @ s),
    }
    if m > 5:  # nothing is missed, so nothing is damped
        expected["law"] = np.linalg.pinv(root @ J) @ root @ s
    for problem, x in expected.items():
        np.testing.assert_allclose(reference(problem, asked, setting(m), limited=False), x, rtol=1e-8, atol=1e-10)


def measure():
    """The root of L^2 |omega|^2 + |v + omega x p|^2, written out."""
    turned = np.array([np.r_[LENGTH * e[:3], e[3:] + np.cross(e[:3], POINT)] for e in np.eye(6)])
    return turned.T


@pytest.mark.parametrize("m", [2, 4])
def test_limited_ones_are_the_best_of_every_active_set(m):
    for seed in range(2):
        asked = question(seed, m, share=0.6)
        H, c = asked.J.T @ asked.J, asked.J.T @ asked.s
        for problem, weight in (("ridge", 1e-6), ("least squares", 1e-14), ("damped", 0.05**2)):
            found = reference(problem, asked, setting(m), limited=True)
            best = box_minimum(H + weight * np.eye(m), c, asked.lower, asked.upper)
            np.testing.assert_allclose(found, best, atol=1e-11)


@pytest.mark.parametrize("last", [1e-2, 5e-4, 1e-6, 0.0], ids=lambda x: f"sigma {x:g}")
@pytest.mark.parametrize("share", [0.8, 1e6], ids=["limited", "free"])
def test_our_law_is_its_reference_to_rounding_damping_and_calm_included(share, last):
    rng = np.random.default_rng(3)
    U, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    V, _ = np.linalg.qr(rng.normal(size=(7, 7)))
    J, s = np.linalg.solve(measure(), U * np.r_[np.geomspace(1.0, 0.1, 5), last] @ V[:6]), rng.normal(size=6)
    told = setting(7, dt=0.01)
    free = iq.solve_velocity(J, s, point=POINT, length=LENGTH, damping=iq.velocity.Adaptive()).velocity
    reach = np.full(7, share * np.abs(free).max())
    asked = Question.plain(J, s, -reach, reach)
    x = methods()["invariantqp"].make(told)(asked)
    exact = reference("law", asked, told, limited=True)
    # No further off than ten times what rounding moves of the exact answer: an SVD rounds relative to the whole of J.
    rounded = asked._replace(J=J + np.finfo(float).eps * np.linalg.norm(J) * rng.normal(size=J.shape))
    moved = np.abs(reference("law", rounded, told, limited=True) - exact).max()
    np.testing.assert_allclose(x, exact, rtol=0.0, atol=10.0 * moved + 1e-14 * np.abs(exact).max())
    slow = reference("law", asked, setting(7, dt=1e-9), limited=True)
    if last < 1e-3 and share < 1.0:  # the residual adds damping, in the reference too
        assert np.abs(exact - slow).max() > 1e-6 * np.abs(exact).max()


def test_an_answer_that_is_not_optimal_is_not_certified():
    H, c = exact_box.mp.eye(2), exact_box.mp.matrix([1, 1])
    with pytest.raises(ReferenceFailure, match="not optimal"):
        exact_box._certify(H, c, [-1, -1], [1, 1], exact_box.mp.matrix([1, 0.5]))
    exact_box._certify(H, c, [-1, -1], [1, 1], exact_box.mp.matrix([1, 1]))


@pytest.mark.parametrize("name", ["panda", "so101"])
def test_states_are_of_the_sort_they_are_called(name):
    robot = iq.load_robot(name)
    for sort in SORTS:
        drawn = questions(robot, sort, 4, 0)
        assert len(drawn) == 4
        for asked in drawn:
            sigma = np.linalg.svd(asked.J, compute_uv=False)
            x = np.linalg.pinv(asked.J) @ asked.s
            assert (np.abs(x) > asked.upper).any() == (sort == "limited")
            assert (sigma[-1] < 1e-2 * sigma[0]) or sort != "singular"
    again = questions(robot, "free", 2, 0)
    assert (again[1].J == questions(robot, "free", 2, 0)[1].J).all()
    assert (again[1].J != questions(robot, "free", 2, 1)[1].J).any()
