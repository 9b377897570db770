import pickle

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares, minimize
from scipy.spatial.transform import Rotation
from support.inverse_kinematics import ARMS, NO_LIMIT, fk, is_inside, pose_errors, random_joints
from support.repeats import repeats

import invariantqp as iq
from invariantqp.workbench.runs.frames import random_displacement

PANDA, UR5, SO101 = ARMS["panda"], ARMS["ur5"], ARMS["so101"]


def beyond(robot, seed):
    """A pose that the arm cannot reach: a reachable one, pushed away from the base and turned."""
    target = robot.pose(random_joints(robot, 1, seed)[0])
    target[:3, 3] += 1.2 * target[:3, 3] / np.linalg.norm(target[:3, 3])
    target[:3, :3] = target[:3, :3] @ Rotation.from_rotvec([0.3, 0.2, -0.4]).as_matrix()
    return target


class Recorded:
    """A robot that records where its Jacobian was computed."""

    def __init__(self, robot):
        self._robot = robot
        self.visited = []

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def jacobian(self, q):
        self.visited.append(np.array(q))
        return self._robot.jacobian(q)


NUMBERS = st.floats(-12.5, 12.5)  # two turns from zero; further is refused


@settings(max_examples=repeats(40, 20), deadline=None, derandomize=True)
@given(
    name=st.sampled_from(["panda", "ur5", "kinova", "so101"]),
    start=st.lists(NUMBERS, min_size=7, max_size=7),
    twist=st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6),
    exact=st.sampled_from([None, "position"]),
)
def test_no_iterate_is_outside_the_limits(name, start, twist, exact):
    robot = Recorded(ARMS[name])
    target = iq.exp(twist) @ robot.pose(random_joints(robot, 1, 3)[0])
    found = iq.solve_pose(robot, target, q0=start[: len(robot.names)], exact=exact, restarts=2, **NO_LIMIT)
    assert len(robot.visited) > 1
    assert all(is_inside(robot, q) for q in robot.visited)
    assert is_inside(robot, found.q)
    assert not found.success or max(pose_errors(robot, found.q, target)[: 1 if exact else 2]) <= 1e-6


@pytest.mark.parametrize("name", ARMS)
def test_the_tool_frame_does_not_change_the_solution(name):
    robot = ARMS[name]
    for seed, (q, start) in enumerate(zip(random_joints(robot, 6, 4), random_joints(robot, 6, 5), strict=True)):
        offset = random_displacement(seed)
        target = robot.pose(q)
        here = iq.solve_pose(robot, target, q0=start, **NO_LIMIT)
        there = iq.solve_pose(robot.with_tool(offset), target @ offset, q0=start, **NO_LIMIT)
        np.testing.assert_allclose(there.q, here.q, rtol=0.0, atol=1e-9)
        assert (there.iterations, there.restarts) == (here.iterations, here.restarts)
        assert there.success


def test_a_start_in_degrees_is_refused():
    q = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    target = PANDA.pose(q)
    for solve in (
        lambda q0: iq.solve_pose(PANDA, target, q0=q0),
        lambda q0: iq.solve_poses(PANDA, [target] * 2, q0=[q, q0]),
    ):
        with pytest.raises(iq.BadInput, match=r"q0: found joint 3 \(panda_joint4\): -135 rad is 131.9 outside"):
            solve(np.degrees(q))
        solve(PANDA.position_upper + 6.0)


def test_a_tool_frame_a_hundred_metres_away_meets_its_target():
    far = PANDA.with_tool(iq.transform(translation=[100.0, 0.0, 0.0]))
    for q in random_joints(PANDA, 8, 14):
        assert iq.solve_pose(far, far.pose(q), **NO_LIMIT).success


@pytest.mark.parametrize("name", ["panda", "ur5", "so101"])
def test_the_tool_frame_does_not_change_the_closest_pose(name):
    robot, offset = ARMS[name], random_displacement(7)
    target = beyond(robot, 6)
    here = iq.solve_pose(robot, target, restarts=8, **NO_LIMIT)
    there = iq.solve_pose(robot.with_tool(offset), target @ offset, restarts=8, **NO_LIMIT)
    assert there.error == pytest.approx(here.error, rel=1e-9)
    np.testing.assert_allclose(there.q, here.q, rtol=0.0, atol=1e-5)  # where a minimum is, is the root of what it is
    assert abs(there.position_error - here.position_error) > 1e-3  # what the tool frame does change


def test_the_tool_frame_does_not_change_a_solution_with_an_exact_point():
    offset, point = random_displacement(8), iq.control.ExactPoint([0.0, 0.02, -0.05])
    target = SO101.pose(random_joints(SO101, 1, 25)[0]) @ iq.exp([0.3, 0.5, 0.2, 0.0, 0.0, 0.0])
    here = iq.solve_pose(SO101, target, exact=point, restarts=8, **NO_LIMIT)
    moved = SO101.with_tool(offset)
    point = iq.control.ExactPoint((iq.inverse(offset) @ [*point.point, 1.0])[:3])
    there = iq.solve_pose(moved, target @ offset, exact=point, restarts=8, **NO_LIMIT)
    assert here.success
    assert there.success
    np.testing.assert_allclose(there.q, here.q, rtol=0.0, atol=1e-6)


def own_point_and_length(robot):
    """The arm's own point, in the tool frame, and length, by a 3x3 solve in the middle of its range."""
    mid = 0.5 * (robot.position_lower + robot.position_upper)
    J = robot.jacobian(mid)
    stiff = sum(np.dot(w, w) * np.eye(3) - np.outer(w, w) for w in J[:3].T)
    p = np.linalg.solve(stiff, np.cross(J[:3].T, J[3:].T).sum(axis=0))
    length = np.linalg.norm(J[3:].T + np.cross(J[:3].T, p)) / np.linalg.norm(J[:3])
    return fk(robot, mid).actInv(p), length


def residual(robot, target, point, root):
    """(6,) root (omega; p_d - p) as a function of q, by Pinocchio alone."""
    desired = pin.SE3(target)

    def r(q):
        T = fk(robot, q)
        return root @ np.concatenate((pin.log3(desired.rotation @ T.rotation.T), desired.act(point) - T.act(point)))

    return r


def closest_by_scipy(robot, r, starts):
    bounds = (robot.position_lower, robot.position_upper)
    tight = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14}
    inner = [np.clip(q, bounds[0] + 1e-9, bounds[1] - 1e-9) for q in starts]  # it wants to begin inside
    return min(np.sqrt(2.0 * least_squares(r, q, bounds=bounds, **tight).cost) for q in inner)


def gradient(r, q, h=1e-4):
    """The gradient of |r|^2 / 2, by differences of the fourth order."""
    f = [[0.5 * np.sum(r(q + k * h * e) ** 2) for k in (-2, -1, 1, 2)] for e in np.eye(len(q))]
    return np.array(f) @ np.array([1.0, -8.0, 8.0, -1.0]) / (12.0 * h)


@pytest.mark.cases(1)
@pytest.mark.parametrize("name", ["panda", "ur5", "so101"])
def test_out_of_reach_the_closest_pose_is_the_one_scipy_finds(name):
    robot = ARMS[name]
    target = beyond(robot, 8)
    found = iq.solve_pose(robot, target, **NO_LIMIT)
    point, length = own_point_and_length(robot)
    r = residual(robot, target, point, np.diag(np.repeat((length, 1.0), 3)))
    assert not found.success
    assert found.reason.startswith("out of reach: ")
    assert found.error == pytest.approx(np.linalg.norm(r(found.q)), rel=1e-9)
    assert found.error <= closest_by_scipy(robot, r, [found.q]) * (1.0 + 1e-9)  # SciPy goes no further from there
    free = [i for i in range(len(found.q)) if i not in found.active]
    assert np.abs(gradient(r, found.q)[free]).max() < 1e-7
    elsewhere = closest_by_scipy(robot, r, random_joints(robot, repeats(6, 2), 9))
    assert found.error <= elsewhere * (1.0 + 1e-3)  # nor finds a better place


def test_a_carried_metric_is_minimised():
    target = beyond(PANDA, 10)
    A = np.random.default_rng(11).standard_normal((6, 6))
    W = A @ A.T + np.eye(6)  # turns about different axes count differently, and with translations
    pose = target @ iq.transform(translation=[0.0, 0.1, -0.2])
    found = iq.solve_pose(PANDA, target, form=iq.CarriedMetric(W, pose), **NO_LIMIT)
    root = np.linalg.cholesky(W).T @ np.kron(np.eye(2), pose[:3, :3].T)
    r = residual(PANDA, target, np.array([0.0, 0.1, -0.2]), root)
    assert found.error == pytest.approx(np.linalg.norm(r(found.q)), rel=1e-9)
    assert found.error <= closest_by_scipy(PANDA, r, [found.q]) * (1.0 + 1e-9)
    assert found.error <= closest_by_scipy(PANDA, r, random_joints(PANDA, 1, 12)) * (1.0 + 1e-3)


def test_the_tools_metric_brings_the_tool_nearer_than_the_arms_own():
    target = beyond(PANDA, 13)
    own = iq.solve_pose(PANDA, target, **NO_LIMIT)
    tool = iq.solve_pose(PANDA, target, form=iq.tool_metric(PANDA), **NO_LIMIT)
    assert tool.position_error < own.position_error
    firm = iq.solve_pose(PANDA, target, form=50.0, **NO_LIMIT)  # a radian counts 50 m: orientation first
    assert firm.orientation_error < 1e-3 < own.orientation_error


def test_five_joints_meet_the_position_exactly_and_turn_as_near_as_they_can():
    for seed in range(3):
        target = SO101.pose(random_joints(SO101, 1, 20 + seed)[0])
        target[:3, :3] = Rotation.random(random_state=seed).as_matrix()
        found = iq.solve_pose(SO101, target, exact="position", **NO_LIMIT)
        position, angle = pose_errors(SO101, found.q, target)
        assert found.success
        assert position < 1e-6
        assert angle > 0.1
        assert "the exact demands are met" in found.reason
        desired = pin.SE3(target)
        nearer = minimize(  # from there SciPy finds nothing better
            lambda q, w=desired: np.sum(pin.log3(w.rotation @ fk(SO101, q).rotation.T) ** 2),
            found.q,
            method="SLSQP",
            bounds=list(zip(SO101.position_lower, SO101.position_upper, strict=True)),
            constraints={"type": "eq", "fun": lambda q, w=desired: w.translation - fk(SO101, q).translation},
            options={"ftol": 1e-12},
        )
        assert angle <= np.sqrt(nearer.fun) + 1e-5


@pytest.mark.parametrize("seed", [0, 2, 5, 20, 21])
def test_a_try_that_meets_exact_demands_precedes_one_nearer_in_the_rest(seed):
    rng = np.random.default_rng(seed)
    q, start = rng.uniform(SO101.position_lower, SO101.position_upper, (2, 5))
    target = SO101.pose(q) @ iq.exp([*rng.normal(size=3), 0.0, 0.0, 0.0])
    for q0 in (None, start):
        found = iq.solve_pose(SO101, target, q0=q0, exact="position", restarts=20, **NO_LIMIT)
        assert found.success, found.reason
        assert pose_errors(SO101, found.q, target)[0] < 1e-6


def test_exact_demands_are_met_from_a_start_far_away():
    target = SO101.pose([-1.64, -0.01, -1.52, 0.16, -1.71])
    target[:3, :3] = iq.exp([1.9, 1.2, -1.2, 0.0, 0.0, 0.0])[:3, :3] @ target[:3, :3]
    q0 = [1.24, 1.52, -0.58, 0.23, -2.71]  # no try from elsewhere meets it before it is given up
    assert iq.solve_pose(SO101, target, q0=q0, exact="position", restarts=20, **NO_LIMIT).success


def test_with_exact_demands_the_rest_is_at_a_minimum():
    exact = [iq.control.ExactPlane([0.0, 0.3, 1.0], [0.0, 0.0, 0.1]), iq.control.ExactAxis([0.2, 0.0, 1.0])]
    for seed in (141, 169, 175, 192, 256):
        q, start = np.random.default_rng(seed).uniform(-3.0, 3.0, (2, 6))
        found = iq.solve_pose(UR5, UR5.pose(q), q0=start, exact=exact, **NO_LIMIT)
        again = iq.solve_pose(UR5, UR5.pose(q), q0=found.q, exact=exact, **NO_LIMIT)
        assert found.success
        assert again.error > 0.9 * found.error or found.reason == ""


def test_without_exact_demands_five_joints_trade_position_for_orientation():
    target = SO101.pose(random_joints(SO101, 1, 20)[0])
    target[:3, :3] = Rotation.random(random_state=0).as_matrix()
    free = iq.solve_pose(SO101, target, **NO_LIMIT)
    assert not free.success
    assert free.position_error > 1e-3


def test_an_exact_position_out_of_reach_is_no_success():
    found = iq.solve_pose(SO101, beyond(SO101, 24), exact="position", restarts=4, **NO_LIMIT)
    assert not found.success
    assert found.reason.startswith("out of reach")
    assert is_inside(SO101, found.q)


def test_prismatic_and_helical_joints():
    lift = np.column_stack(
        [
            iq.se3.prismatic([0, 0, 1]),
            iq.revolute([0, 0, 1]),
            iq.revolute([0, 0, 1], [0.5, 0, 0]),
            iq.se3.helical([0, 0, 1], [0.9, 0, 0], 0.05),
        ]
    )
    arm = iq.robots.Chain(lift, iq.transform(translation=[1.0, 0.0, 0.2]), (), -3.0, 3.0)
    q = np.array([0.4, 0.5, -1.0, 2.0])
    found = iq.solve_pose(arm, arm.pose(q), **NO_LIMIT)
    assert found.success
    np.testing.assert_allclose(arm.pose(found.q), arm.pose(q), atol=1e-6)
    gantry = iq.robots.Chain(np.eye(6)[:, 3:], np.eye(4), (), -1.0, 1.0)
    out = iq.solve_pose(gantry, iq.transform(translation=[0.5, -0.5, 2.0]), **NO_LIMIT)
    np.testing.assert_allclose(out.q, [0.5, -0.5, 1.0], atol=1e-9)
    assert out.active == (2,)


def test_a_start_at_the_target_is_the_solution():
    q = random_joints(PANDA, 1, 40)[0]
    found = iq.solve_pose(PANDA, pin.SE3(PANDA.pose(q)), q0=q)
    assert (found.iterations, found.restarts, found.success) == (0, 0, True)
    np.testing.assert_array_equal(found.q, q)


def test_a_search_depends_on_its_seed_alone():
    target = beyond(PANDA, 41)
    first, again = (iq.solve_pose(PANDA, target, seed=3, restarts=5, **NO_LIMIT) for _ in range(2))
    assert first == again
    other = iq.solve_pose(PANDA, target, seed=4, restarts=5, **NO_LIMIT)
    assert other.iterations != first.iterations


def test_solutions_compare_pickle_and_have_a_repr():
    found = iq.solve_pose(PANDA, beyond(PANDA, 41), restarts=2, **NO_LIMIT)
    again = pickle.loads(pickle.dumps(found))
    assert again == found
    assert again != iq.solve_pose(PANDA, beyond(PANDA, 43), restarts=2, **NO_LIMIT)
    assert repr(again) == repr(found)
    assert "\n" not in repr(found)
    with pytest.raises(AttributeError):
        found.q = None


def test_without_restarts_there_is_one_try():
    hard = [iq.solve_pose(PANDA, beyond(PANDA, s), restarts=0, **NO_LIMIT) for s in range(3)]
    assert all(one.restarts == 0 and not one.success for one in hard)
    assert "tries" not in hard[0].reason


def test_a_reason_distinguishes_the_time_limit_from_reach():
    for restarts in (0, 10):
        found = iq.solve_pose(PANDA, beyond(PANDA, 42), time_limit=1e-6, restarts=restarts)
        assert not found.success
        assert found.reason.startswith("time limit reached: ")
        assert found.restarts == 0
