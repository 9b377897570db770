"""Shared control: the robot's twists and the operator's, and neither pushes the other off."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.arms import ready
from support.random_systems import motion

import invariantqp as iq

PLANE = np.eye(6)[:, [3, 4]]  # the operator slides in a plane
DISTANCE = np.eye(6)[:, [5]]  # the robot keeps the distance to it
READY = ready("panda")


@settings(max_examples=80, deadline=None)
@given(seed=st.integers(0, 2**31), k=st.integers(1, 5), less=st.integers(0, 3), by_metric=st.booleans())
def test_neither_leaks_into_the_other(seed, k, less, by_metric):
    rng = np.random.default_rng(seed)
    n = 6 - k - less
    assume(n >= 1)
    S1, S2 = rng.normal(size=(6, k)), rng.normal(size=(6, n))
    rule = {"metric": np.arange(1.0, 7.0)} if by_metric else {"h": 0.4}
    task = iq.control.SharedTask(S1, S2, **({} if less == 0 else rule))
    P1, P2 = task.robot_projector, task.operator_projector
    size = np.abs(P1).max() + np.abs(P2).max()
    assume(size < 1e3)
    atol = 1e-11 * size**2
    np.testing.assert_allclose(P1 @ S2, 0.0, atol=atol)
    np.testing.assert_allclose(P2 @ S1, 0.0, atol=atol)
    np.testing.assert_allclose(P1 @ S1, S1, atol=atol)
    np.testing.assert_allclose(P2 @ S2, S2, atol=atol)
    np.testing.assert_allclose(P1 @ P2, 0.0, atol=atol)
    if less == 0:
        np.testing.assert_allclose(P1 + P2, np.eye(6), atol=atol)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), by_metric=st.booleans())
def test_a_moved_task_is_the_same_task(seed, by_metric):
    rng = np.random.default_rng(seed)
    T = motion(rng)
    A = iq.adjoint(T)
    rule = {"metric": np.arange(1.0, 7.0)} if by_metric else {"h": 0.4}
    task = iq.control.SharedTask(rng.normal(size=(6, 2)), rng.normal(size=(6, 2)), **rule)
    assume(np.abs(task.robot_projector).max() + np.abs(task.operator_projector).max() < 100)
    a, b = rng.normal(size=(2, 6))
    np.testing.assert_allclose(task.moved(T).twist(A @ a, A @ b), A @ task.twist(a, b), atol=1e-8)


def test_a_pitch_alone_shares_everything_out():
    rng = np.random.default_rng(1)
    S = rng.normal(size=(6, 3))
    task = iq.control.SharedTask(S, h=0.4)
    Q = iq.pitch_form(0.4)
    np.testing.assert_allclose(task.robot_projector + task.operator_projector, np.eye(6), atol=1e-12)
    np.testing.assert_allclose(task.robot_projector.T @ Q @ task.operator_projector, 0.0, atol=1e-11)


def test_operator_on_a_plane_and_the_robot_at_its_distance():
    """Nobody turns the tool: what is left over is held at rest."""
    task = iq.control.SharedTask(DISTANCE, PLANE, metric=np.ones(6))
    twist = task.twist([1, 1, 1, 1, 1, 0.5], [2, 2, 2, 0.1, 0.2, 9.0])
    np.testing.assert_allclose(twist, [0, 0, 0, 0.1, 0.2, 0.5], atol=1e-15)


def test_it_drives_an_arm_inside_its_limits():
    robot = iq.load_robot("panda")
    loop, q = iq.Controller(robot, dt=0.001), READY.copy()
    place = robot.pose(q)[:3, 3]
    task = iq.control.SharedTask(DISTANCE, PLANE, metric=np.ones(6)).moved(iq.transform(translation=place))
    J = robot.jacobian(q)
    for _ in range(6):  # a loop sets off softly
        quiet = loop.follow(q, task.twist(np.zeros(6), [0, 0, 0, 0.1, -0.05, 0.3]))
    np.testing.assert_allclose(J @ quiet.velocity, [*np.cross(place, [0.1, -0.05, 0.0]) * 0, 0.1, -0.05, 0], atol=1e-12)
    wild = loop.follow(q, task.twist(np.zeros(6), [0, 0, 0, 30.0, 0.0, 0.0]))
    assert (np.abs(wild.velocity) <= robot.velocity_limit).all()
    assert wild.active


@pytest.mark.parametrize(
    ("make", "error", "said"),
    [
        (lambda: iq.control.SharedTask(PLANE, np.eye(6)[:, [4, 5]], h=0.3), iq.BadInput, "share a twist"),
        (lambda: iq.control.SharedTask(PLANE, DISTANCE), iq.BadInput, "no rule"),
        (lambda: iq.control.SharedTask(PLANE), iq.BadInput, "no rule"),
        (lambda: iq.control.SharedTask(PLANE, DISTANCE, h=0.3), iq.NoProjectors, "IID"),
        (lambda: iq.control.SharedTask(PLANE * np.nan, DISTANCE, h=0.3), iq.BadInput, "NaN"),
        (
            lambda: iq.control.SharedTask(DISTANCE, PLANE, metric=np.ones(6)).twist([np.nan] * 6, [0] * 6),
            iq.BadInput,
            "robot",
        ),
        (lambda: iq.Controller(iq.load_robot("panda"), dt=0.01).follow(READY, [np.nan] * 6), iq.BadInput, "twist"),
    ],
)
def test_bad_arguments_of_shared_control_are_refused(make, error, said):
    with pytest.raises(error, match=said):
        make()
