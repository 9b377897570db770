"""No arm is left out: planar, parallel, concurrent, sliding, near-singular, blind to every h, written with rounding."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.arms import KINDS, arm
from support.velocity_reference import root_of

import invariantqp as iq

X, Y, Z = np.eye(3)
FORMS = {"none": None, "pitch": 0.3, "own length": "own length", "complement": "complement"}


def form_for(name, rng, J):
    if name == "complement":
        return iq.Complement(rng.normal(size=(6, max(1, 6 - J.shape[1]))))
    if name == "own length":
        length = iq.systems.centre(J).length
        return length if np.isfinite(length) else 0.0
    return FORMS[name]


@pytest.mark.cases(4)
@pytest.mark.parametrize("kind", KINDS)
@given(
    seed=st.integers(0, 10**9),
    m=st.integers(1, 12),
    form=st.sampled_from(sorted(FORMS)),
    bounds=st.booleans(),
    point=st.booleans(),
)
@settings(max_examples=40, deadline=None, derandomize=True)
def test_an_achievable_twist_is_achieved(kind, seed, m, form, bounds, point):
    rng = np.random.default_rng(seed)
    here = arm(rng, kind, m)
    J = here.J
    s = J @ rng.normal(size=m)
    bounds = (np.full(m, -1e6), np.full(m, 1e6)) if bounds else None
    options = {"bounds": bounds, "point": here.point if point else None, "length": 1.0}
    try:
        solution = iq.solve_velocity(J, s, form=form_for(form, rng, J), **options)
    except (iq.NoPseudoinverse, iq.BadInput):
        assert form != "none"
        return
    root = root_of(here.point if point else iq.systems.centre(J, s).point, 1.0)
    assert np.linalg.norm(root @ solution.residual) <= 1e-9 * np.linalg.norm(root @ s)
    assert (solution.status, solution.method) == ("ok", "closed-form")
    assert np.isfinite(solution.velocity).all()


NAMED_ARMS = {
    "hinge": [(X + 2 * Y + 3 * Z, (0.3, 0.1, 0.5))],
    "pan-tilt": [(Z, (0.3, 0.1, 0.5)), (Y, (0.3, 0.1, 0.5))],
    "spherical wrist": [(Z, (0.3, 0.1, 0.5)), (Y, (0.3, 0.1, 0.5)), (X + Y, (0.3, 0.1, 0.5))],
    "planar": [(Z, (0.0, 0.0, 0.0)), (Z, (0.4, 0.0, 0.0)), (Z, (0.7, 0.2, 0.0))],
    "planar snake": [(Z, (0.1 * k, 0.05 * k * k, 0.0)) for k in range(7)],
    "yaw and three pitches": [(Z, (0, 0, 0)), (Y, (0, 0, 0.3)), (Y, (0.3, 0, 0.3)), (Y, (0.6, 0, 0.3))],
    "hinge twice": [(Z, (0.2, 0.0, 0.0)), (Z, (0.2, 0.0, 0.0)), (X, (0.0, 0.0, 0.1))],
}


@pytest.mark.parametrize("name", NAMED_ARMS)
@pytest.mark.parametrize("rounded", [0.0, 3e-6], ids=["exact", "written with four digits"])
def test_achievable_twists_are_achieved_with_every_form(name, rounded):
    """Guarded and not; tilts of a few 1e-6 are what rpy = "3.1416" makes of axes."""
    rng = np.random.default_rng(7)
    axes = [(u + rounded * rng.normal(size=3), p) for u, p in NAMED_ARMS[name]]
    J = np.column_stack([iq.revolute(u, p) for u, p in axes])
    m = J.shape[1]
    for form in (None, 0.0, 0.32, -1.5, iq.Complement(rng.normal(size=(6, max(1, 6 - m))))):
        for options in ({}, {"guard": True}, {"bounds": (np.full(m, -9.0), np.full(m, 9.0))}):
            x = rng.uniform(-1.0, 1.0, m)
            s = J @ x
            try:
                solution = iq.solve_velocity(J, s, form=form, point=(0.5, 0.2, 0.4), **options)
            except (iq.NoPseudoinverse, iq.BadInput):
                assert form is not None
                continue
            assert np.linalg.norm(solution.residual) <= 1e-9 * np.linalg.norm(s)
            assert np.linalg.norm(solution.velocity) <= 2.0 * np.linalg.norm(x)
            assert solution.status == "ok"


def test_a_hinge_rests_for_an_unachievable_twist_and_reports_it():
    J = iq.revolute([1, 2, 3], [0.3, 0.1, 0.5])[:, None]
    solution = iq.solve_velocity(J, [0, 0, 0, 0.1, 0.2, 0.3])
    assert abs(solution.velocity[0]) < 1e-12
    assert solution.status == "limited"
    assert "no velocity reduces the error" in solution.reason


@pytest.mark.parametrize("offset", [1e-3, 1e-6, 1e-9, 0.0])
@pytest.mark.parametrize("form", [None, 0.3])
def test_nearly_concurrent_axes_do_not_turn_faster_with_a_named_point(offset, form):
    J = np.column_stack(
        [iq.revolute(Z, [0, 0, 0.5]), iq.revolute(Y, [offset, 0, 0.5]), iq.revolute(X, [0, offset, 0.5])]
    )
    solution = iq.solve_velocity(J, [0, 0, 0.5, 0, 0.1, 0], form=form, point=(0, 0, 0.7))
    assert np.abs(solution.velocity).max() < 1.0


def test_the_tool_straight_down_misses_nothing():
    """An SO-101's everyday pose, with transversals next to infinity: pitch forms lose rounding, times their condition.

    At infinity there is no pitch form.
    """
    robot = iq.load_robot("so101")
    J = robot.jacobian([-0.69, 0.25, 0.12, 1.2, 2.26])
    s = J @ [0.3, 0.6, -1.2, 0.2, 0.6]
    for form in (None, 0.32, -0.05):
        solution = iq.solve_velocity(J, s, form=form)
        lost = 1e-14 if form is None else 1e-16 * np.linalg.cond(iq.systems.gram_matrix(J, form))
        assert np.linalg.norm(solution.residual) <= lost * np.linalg.norm(s)
        assert solution.status == "ok"


def test_a_prismatic_joint_counts_the_same_in_metres_and_millimetres():
    """Two hinges, a slide, two hinges: with no metric told, and with one told in each unit."""
    rng = np.random.default_rng(3)
    axes = [(Z, (0, 0, 0)), (Y, (0, 0, 0.3)), None, (X, (0.4, 0, 0.5)), (Y, (0.5, 0, 0.5))]
    J = np.column_stack([iq.se3.prismatic((1, 0, 1)) if a is None else iq.revolute(*a) for a in axes])
    s, in_mm = rng.normal(size=6), np.repeat((1.0, 1e3), 3)
    J_mm = in_mm[:, None] * J
    J_mm[:, 2] = J[:, 2]  # a millimetre a second
    to_mm = np.array([1.0, 1.0, 1e3, 1.0, 1.0])
    for metric in (None, np.array([1.0, 2.0, 30.0, 1.0, 0.5])):
        told = None if metric is None else metric / to_mm**2
        bounds = np.array([0.5, 0.3, 0.1, 0.4, 0.6])
        x = iq.solve_velocity(J, s, joint_metric=metric, bounds=(-bounds, bounds), point=(0.6, 0, 0.4))
        y = iq.solve_velocity(
            J_mm, in_mm * s, joint_metric=told, bounds=(-bounds * to_mm, bounds * to_mm), point=(600, 0, 400)
        )
        np.testing.assert_allclose(y.velocity / to_mm, x.velocity, rtol=1e-10, atol=1e-12)
