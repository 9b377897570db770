"""The cost of a frame task, on arrays: the law's own quadratic, the same in every frame and unit, and it descends."""

from math import inf

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import invariantqp as iq
from invariantqp.engine import law
from invariantqp.geometry.se3 import SWAPPED
from invariantqp.velocity import definition
from invariantqp.velocity.measure import root_at

FREE = 1e-10  # cost of what does not move the frame, as a share of |A|^2
COSTS = np.array([1.5, 1.5, 0.7, 0.3, 0.7, 0.4])


def drawn(rng, m, kind):
    """Derivative (6, m) of an error, linear part first."""
    J = rng.normal(size=(6, m))
    if kind == "dependent" and m > 1:
        J[:, -1] = 2.0 * J[:, 0]
    if kind == "planar":
        J[2:5] = 0.0
    return J


def tick(J, error, root, **options):
    """The law's tick of the same, as the definition has it."""
    m, wide = J.shape[1], np.full(J.shape[1], inf)
    limits = {"lower": -wide, "upper": wide, "position_lower": -wide, "position_upper": wide}
    fields = {"J": -J[SWAPPED], "root": root, "feedforward": error[SWAPPED], "error": np.zeros(6)}
    return definition.Tick(**fields, **limits, **{"last_velocity": None, **options}), m


def root_of(costs, point):
    return costs[SWAPPED][:, None] * root_at(np.asarray(point), 1.0)


FORMS = {
    "least squares": ({}, {}),
    "damped": ({"damping": 0.3}, {"damping": 0.3}),
    "pitch": ({"form": ("pitch", 0.4)}, {"form": iq.PitchForm(0.4)}),
    "pitch, guarded": ({"form": ("pitch", 0.4), "guard": 0.5}, {"form": iq.PitchForm(0.4), "guard": 0.5}),
    "pitch, damped": ({"form": ("pitch", -0.2), "damping": 0.2}, {"form": iq.PitchForm(-0.2), "damping": 0.2}),
}


@pytest.mark.parametrize("kind", ["regular", "dependent", "planar"])
@pytest.mark.parametrize("name", FORMS)
def test_it_is_the_objective_of_the_law(name, kind):
    rng = np.random.default_rng(0)
    ours, theirs = FORMS[name]
    for m in (1, 3, 5, 6, 7, 9, 30):
        if kind == "planar" and (m < 3 or name in {"pitch", "pitch, guarded"}):
            continue  # a planar arm has no pseudoinverse of a pitch form
        J, error, point = drawn(rng, m, kind), rng.normal(size=6), rng.normal(size=3)
        root = root_of(COSTS, point)
        H, c = law.frame_cost(J, error, costs=COSTS, point=point, lm_damping=0.1, gain=0.6, **ours)
        posed, _ = tick(J, 0.6 * error, root, **theirs)
        problem = definition.objective(posed, np.eye(m), 1.0)
        A = posed.root @ posed.J
        _, sigma, Vt = np.linalg.svd(A)
        still = Vt[np.count_nonzero(sigma > 1e-9 * sigma[0]) :]
        size, b = np.vdot(A, A), posed.root @ posed.feedforward
        wanted = problem.H + (FREE - definition.NULL_WEIGHT) * size * still.T @ still + 0.1 * b.dot(b) * np.eye(m)
        np.testing.assert_allclose(H, wanted, rtol=0.0, atol=1e-12 * size)
        np.testing.assert_allclose(c, -(problem.f + problem.e), rtol=0.0, atol=1e-10 * np.abs(c).max())


def test_joints_that_do_not_move_the_frame_change_nothing_and_cost_lm_damping_alone():
    rng = np.random.default_rng(1)
    J, error = rng.normal(size=(6, 7)), rng.normal(size=6)
    wide, moving = np.zeros((6, 300)), rng.choice(300, 7, replace=False)
    wide[:, np.sort(moving)] = J
    options = {"costs": COSTS, "point": np.zeros(3), "lm_damping": 0.2}
    (H, c), (G, d) = (law.frame_cost(any_J, error, **options) for any_J in (J, wide))
    np.testing.assert_array_equal(G[np.ix_(np.sort(moving), np.sort(moving))], H)
    np.testing.assert_array_equal(d[np.sort(moving)], c)
    others = np.delete(np.arange(300), moving)
    assert not d[others].any()
    b = COSTS * error
    np.testing.assert_allclose(G[np.ix_(others, others)], 0.2 * b.dot(b) * np.eye(293))
    assert not G[np.ix_(others, np.sort(moving))].any()
    assert not law.frame_cost(np.zeros((6, 4)), error, costs=COSTS)[0].any()
    law.frame_cost(rng.normal(size=(6, 64)), error, costs=COSTS, form=("pitch", 0.1))
    with pytest.raises(ValueError, match="65 joints that move the frame, expected at most 64"):
        law.frame_cost(rng.normal(size=(6, 65)), error, costs=COSTS)


@pytest.mark.parametrize("name", FORMS)
@pytest.mark.parametrize("m", [5, 6, 7])
def test_neither_the_frame_on_the_link_nor_the_unit_of_length_changes_the_answer(name, m):
    rng = np.random.default_rng(2)
    options, costs = FORMS[name][0], np.repeat((2.0, 0.7), 3)
    for _ in range(10):
        J, error, point = rng.normal(size=(6, m)), rng.normal(size=6), rng.normal(size=3)
        x = np.linalg.solve(*law.frame_cost(J, error, costs=costs, point=point, **options))
        pose = iq.transform(Rotation.random(random_state=int(rng.integers(1000))).as_matrix(), rng.normal(size=3))
        carry = iq.adjoint(pose)[np.ix_(SWAPPED, SWAPPED)]
        there = (pose @ [*point, 1.0])[:3]
        moved = law.frame_cost(carry @ J, carry @ error, costs=costs, point=there, **options)
        np.testing.assert_allclose(np.linalg.solve(*moved), x, rtol=0.0, atol=1e-6 * np.abs(x).max())
        unit = np.repeat((1000.0, 1.0), 3)  # millimetres
        longer = dict(options)  # A, which costs measure, has no length in it
        if "form" in options:
            longer |= {"form": ("pitch", 1000.0 * options["form"][1]), "damping": 1000.0 * options.get("damping", 0.0)}
        scaled = law.frame_cost(unit[:, None] * J, unit * error, costs=costs / unit, point=1000.0 * point, **longer)
        np.testing.assert_allclose(np.linalg.solve(*scaled), x, rtol=0.0, atol=1e-6 * np.abs(x).max())


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9, 1.0])
def test_with_a_guard_a_step_closes_at_least_its_share_of_what_least_squares_closes(share):
    rng = np.random.default_rng(3)
    least, bare = inf, inf
    for _ in range(200):
        J, error = rng.normal(size=(6, 5)), rng.normal(size=6)
        root = root_of(COSTS, np.zeros(3))
        closed = []
        for options in ({}, {"form": ("pitch", 0.4), "guard": share}, {"form": ("pitch", 0.4)}):
            x = np.linalg.solve(*law.frame_cost(J, error, costs=COSTS, point=np.zeros(3), **options))  # (H, c): -dq
            before, after = root @ error[SWAPPED], root @ (error[SWAPPED] - J[SWAPPED] @ x)
            closed.append(before.dot(before) - after.dot(after))
        least, bare = min(least, closed[1] / closed[0]), min(bare, closed[2] / closed[0])
    assert least > share - 1e-9
    assert bare < 0.0


def test_the_arms_own_point_is_the_same_wherever_the_frame_is():
    rng = np.random.default_rng(4)
    J, error, carry = rng.normal(size=(6, 6)), rng.normal(size=6), iq.adjoint(iq.exp(rng.normal(size=6)))
    carry = carry[np.ix_(SWAPPED, SWAPPED)]
    costs = np.repeat((1.0, 0.5), 3)
    one, other = (law.frame_cost(A @ J, A @ error, costs=costs) for A in (np.eye(6), carry))
    for given, found in zip(one, other, strict=True):
        np.testing.assert_allclose(found, given, rtol=1e-9, atol=1e-9)


def test_a_form_without_a_projector_needs_a_damping():
    J = drawn(np.random.default_rng(5), 3, "planar")
    with pytest.raises(ArithmeticError, match="no projector"):
        law.frame_cost(J, np.ones(6), costs=COSTS, form=("pitch", 0.4))
    H, c = law.frame_cost(J, np.ones(6), costs=COSTS, form=("pitch", 0.4), damping=0.1)
    assert np.isfinite(np.linalg.solve(H, c)).all()
