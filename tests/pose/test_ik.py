import pickle

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares, minimize
from scipy.spatial.transform import Rotation
from support.repeats import repeats

import invariantqp as iq
from invariantqp.robots.kinematics import joint_ranges
from invariantqp.workbench.runs.frames import random_displacement

ROBOTS = {name: iq.load_robot(name) for name in ("panda", "ur5", "xarm7", "kinova", "so101")}
PANDA, UR5, SO101 = ROBOTS["panda"], ROBOTS["ur5"], ROBOTS["so101"]
NO_LIMIT = {"time_limit": np.inf}  # the same in every run, however busy the machine


def states(robot, count, seed):
    low, high = joint_ranges(robot)
    return low + np.random.default_rng(seed).random((count, len(low))) * (high - low)


def fk(robot, q):
    """The tool pose by Pinocchio alone."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    return data.oMf[robot.model.getFrameId(robot.tool)]


def missed(robot, q, target):
    T, wanted = fk(robot, q), pin.SE3(target)
    return np.linalg.norm(wanted.translation - T.translation), np.linalg.norm(pin.log3(T.rotation.T @ wanted.rotation))


def is_inside(robot, q):
    return bool((robot.position_lower <= q).all() and (q <= robot.position_upper).all())


def beyond(robot, seed):
    """A pose that the arm cannot reach: a reachable one, pushed away from the base and turned."""
    target = robot.pose(states(robot, 1, seed)[0])
    target[:3, 3] += 1.2 * target[:3, 3] / np.linalg.norm(target[:3, 3])
    target[:3, :3] = target[:3, :3] @ Rotation.from_rotvec([0.3, 0.2, -0.4]).as_matrix()
    return target


@pytest.mark.parametrize("name", ROBOTS)
def test_a_reachable_pose_is_reached_inside_the_limits(name):
    robot = ROBOTS[name]
    for q, start in zip(states(robot, 20, 1), states(robot, 20, 2), strict=True):
        target = fk(robot, q).homogeneous
        found = iq.solve_pose(robot, target, q0=start, **NO_LIMIT)
        position, orientation = missed(robot, found.q, target)
        assert (found.success, found.reason) == (True, "")
        assert max(position, orientation) < 1e-6
        assert is_inside(robot, found.q)
        assert found.position_error == pytest.approx(position, abs=1e-12)
        assert found.orientation_error == pytest.approx(orientation, abs=1e-12)


class Watched:
    """A robot that remembers where it was looked at."""

    def __init__(self, robot):
        self._robot = robot
        self.seen = []

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def jacobian(self, q):
        self.seen.append(np.array(q))
        return self._robot.jacobian(q)


NUMBERS = st.floats(-12.5, 12.5)  # two turns from zero; further is refused


@settings(max_examples=repeats(40, 20), deadline=None, derandomize=True)
@given(
    name=st.sampled_from(["panda", "ur5", "kinova", "so101"]),
    start=st.lists(NUMBERS, min_size=7, max_size=7),
    twist=st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6),
    exact=st.sampled_from([None, "position"]),
)
def test_no_state_on_the_way_is_outside_the_limits(name, start, twist, exact):
    robot = Watched(ROBOTS[name])
    target = iq.exp(twist) @ robot.pose(states(robot, 1, 3)[0])
    found = iq.solve_pose(robot, target, q0=start[: len(robot.names)], exact=exact, restarts=2, **NO_LIMIT)
    assert len(robot.seen) > 1
    assert all(is_inside(robot, q) for q in robot.seen)
    assert is_inside(robot, found.q)
    assert not found.success or max(missed(robot, found.q, target)[: 1 if exact else 2]) <= 1e-6


@pytest.mark.parametrize("name", ROBOTS)
def test_where_the_tool_frame_is_changes_nothing(name):
    robot = ROBOTS[name]
    for seed, (q, start) in enumerate(zip(states(robot, 6, 4), states(robot, 6, 5), strict=True)):
        offset = random_displacement(seed)
        target = robot.pose(q)
        here = iq.solve_pose(robot, target, q0=start, **NO_LIMIT)
        there = iq.solve_pose(robot.with_tool(offset), target @ offset, q0=start, **NO_LIMIT)
        np.testing.assert_allclose(there.q, here.q, rtol=0.0, atol=1e-9)
        assert (there.iterations, there.restarts) == (here.iterations, here.restarts)
        assert there.success


def test_a_start_in_degrees_is_refused():
    q = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    for solve in (lambda q0: iq.solve_pose(PANDA, PANDA.pose(q), q0=q0), lambda q0: solved(PANDA, q, q0)):
        with pytest.raises(iq.BadInput, match=r"q0: found joint 3 \(panda_joint4\): -135 rad is 131.9 outside"):
            solve(np.degrees(q))
        solve(PANDA.position_upper + 6.0)


def solved(robot, q, q0):
    """The first of two."""
    return iq.pose.solve_poses(robot, 2 * [robot.pose(q)], q0=[q, q0])[0]


def test_a_tool_frame_a_hundred_metres_away_meets_its_target_too():
    far = PANDA.with_tool(iq.transform(translation=[100.0, 0.0, 0.0]))
    for q in states(PANDA, 8, 14):
        assert iq.solve_pose(far, far.pose(q), **NO_LIMIT).success


@pytest.mark.parametrize("name", ["panda", "ur5", "so101"])
def test_nor_which_pose_is_the_closest(name):
    robot, offset = ROBOTS[name], random_displacement(7)
    target = beyond(robot, 6)
    here = iq.solve_pose(robot, target, restarts=8, **NO_LIMIT)
    there = iq.solve_pose(robot.with_tool(offset), target @ offset, restarts=8, **NO_LIMIT)
    assert there.error == pytest.approx(here.error, rel=1e-9)
    np.testing.assert_allclose(there.q, here.q, rtol=0.0, atol=1e-5)  # where a minimum is, is the root of what it is
    assert abs(there.position_error - here.position_error) > 1e-3  # what the tool frame does change


def test_nor_what_is_met_exactly():
    offset, point = random_displacement(8), iq.control.ExactPoint([0.0, 0.02, -0.05])
    target = SO101.pose(states(SO101, 1, 25)[0]) @ iq.exp([0.3, 0.5, 0.2, 0.0, 0.0, 0.0])
    here = iq.solve_pose(SO101, target, exact=point, restarts=8, **NO_LIMIT)
    moved = SO101.with_tool(offset)
    point = iq.control.ExactPoint((iq.inverse(offset) @ [*point.point, 1.0])[:3])
    there = iq.solve_pose(moved, target @ offset, exact=point, restarts=8, **NO_LIMIT)
    assert here.success
    assert there.success
    np.testing.assert_allclose(there.q, here.q, rtol=0.0, atol=1e-6)


def own_measure(robot):
    """The arm's own point, in the tool frame, and length, by a 3x3 solve in the middle of its range."""
    mid = 0.5 * (robot.position_lower + robot.position_upper)
    J = robot.jacobian(mid)
    stiff = sum(np.dot(w, w) * np.eye(3) - np.outer(w, w) for w in J[:3].T)
    p = np.linalg.solve(stiff, np.cross(J[:3].T, J[3:].T).sum(axis=0))
    length = np.linalg.norm(J[3:].T + np.cross(J[:3].T, p)) / np.linalg.norm(J[:3])
    return fk(robot, mid).actInv(p), length


def rest(robot, target, point, root):
    """(6,) root (omega; p_d - p) as a function of q, by Pinocchio alone."""
    wanted = pin.SE3(target)

    def r(q):
        T = fk(robot, q)
        return root @ np.concatenate((pin.log3(wanted.rotation @ T.rotation.T), wanted.act(point) - T.act(point)))

    return r


def closest_by_scipy(robot, r, starts):
    bounds = (robot.position_lower, robot.position_upper)
    tight = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14}
    inner = [np.clip(q, bounds[0] + 1e-9, bounds[1] - 1e-9) for q in starts]  # it wants to begin inside
    return min(np.sqrt(2.0 * least_squares(r, q, bounds=bounds, **tight).cost) for q in inner)


def slope(r, q, h=1e-4):
    """The gradient of |r|^2 / 2, by differences of the fourth order."""
    f = [[0.5 * np.sum(r(q + k * h * e) ** 2) for k in (-2, -1, 1, 2)] for e in np.eye(len(q))]
    return np.array(f) @ np.array([1.0, -8.0, 8.0, -1.0]) / (12.0 * h)


@pytest.mark.cases(1)
@pytest.mark.parametrize("name", ["panda", "ur5", "so101"])
def test_out_of_reach_the_closest_pose_is_the_one_scipy_finds(name):
    robot = ROBOTS[name]
    target = beyond(robot, 8)
    found = iq.solve_pose(robot, target, **NO_LIMIT)
    point, length = own_measure(robot)
    r = rest(robot, target, point, np.diag(np.repeat((length, 1.0), 3)))
    assert not found.success
    assert found.reason.startswith("out of reach: ")
    assert found.error == pytest.approx(np.linalg.norm(r(found.q)), rel=1e-9)
    assert found.error <= closest_by_scipy(robot, r, [found.q]) * (1.0 + 1e-9)  # SciPy goes no further from there
    free = [i for i in range(len(found.q)) if i not in found.active]
    assert np.abs(slope(r, found.q)[free]).max() < 1e-7
    elsewhere = closest_by_scipy(robot, r, states(robot, repeats(6, 2), 9))
    assert found.error <= elsewhere * (1.0 + 1e-3)  # nor finds a better place


def test_a_metric_of_ones_own_says_what_is_close():
    target = beyond(PANDA, 10)
    A = np.random.default_rng(11).standard_normal((6, 6))
    W = A @ A.T + np.eye(6)  # turns about different axes count differently, and with translations
    pose = target @ iq.transform(translation=[0.0, 0.1, -0.2])
    found = iq.solve_pose(PANDA, target, form=iq.CarriedMetric(W, pose), **NO_LIMIT)
    root = np.linalg.cholesky(W).T @ np.kron(np.eye(2), pose[:3, :3].T)
    r = rest(PANDA, target, np.array([0.0, 0.1, -0.2]), root)
    assert found.error == pytest.approx(np.linalg.norm(r(found.q)), rel=1e-9)
    assert found.error <= closest_by_scipy(PANDA, r, [found.q]) * (1.0 + 1e-9)
    assert found.error <= closest_by_scipy(PANDA, r, states(PANDA, 1, 12)) * (1.0 + 1e-3)


def test_the_tools_metric_brings_the_tool_nearer_than_the_arms_own():
    target = beyond(PANDA, 13)
    own = iq.solve_pose(PANDA, target, **NO_LIMIT)
    tool = iq.solve_pose(PANDA, target, form=iq.tool_metric(PANDA), **NO_LIMIT)
    assert tool.position_error < own.position_error
    firm = iq.solve_pose(PANDA, target, form=50.0, **NO_LIMIT)  # a radian counts 50 m: orientation first
    assert firm.orientation_error < 1e-3 < own.orientation_error


def test_five_joints_meet_the_position_exactly_and_turn_as_near_as_they_can():
    for seed in range(3):
        target = SO101.pose(states(SO101, 1, 20 + seed)[0])
        target[:3, :3] = Rotation.random(random_state=seed).as_matrix()
        found = iq.solve_pose(SO101, target, exact="position", **NO_LIMIT)
        position, angle = missed(SO101, found.q, target)
        assert found.success
        assert position < 1e-6
        assert angle > 0.1
        assert "the exact demands are met" in found.reason
        wanted = pin.SE3(target)
        nearer = minimize(  # from there SciPy finds nothing better
            lambda q, w=wanted: np.sum(pin.log3(w.rotation @ fk(SO101, q).rotation.T) ** 2),
            found.q,
            method="SLSQP",
            bounds=list(zip(SO101.position_lower, SO101.position_upper, strict=True)),
            constraints={"type": "eq", "fun": lambda q, w=wanted: w.translation - fk(SO101, q).translation},
            options={"ftol": 1e-12},
        )
        assert angle <= np.sqrt(nearer.fun) + 1e-5


@pytest.mark.parametrize("seed", [0, 2, 5, 20, 21])
def test_a_try_that_meets_what_is_exact_comes_before_any_nearer_in_the_rest(seed):
    rng = np.random.default_rng(seed)
    q, start = rng.uniform(SO101.position_lower, SO101.position_upper, (2, 5))
    target = SO101.pose(q) @ iq.exp([*rng.normal(size=3), 0.0, 0.0, 0.0])
    for q0 in (None, start):
        found = iq.solve_pose(SO101, target, q0=q0, exact="position", restarts=20, **NO_LIMIT)
        assert found.success, found.reason
        assert missed(SO101, found.q, target)[0] < 1e-6


def test_from_a_start_far_away_what_is_exact_is_met_where_it_can_be():
    target = SO101.pose([-1.64, -0.01, -1.52, 0.16, -1.71])
    target[:3, :3] = iq.exp([1.9, 1.2, -1.2, 0.0, 0.0, 0.0])[:3, :3] @ target[:3, :3]
    q0 = [1.24, 1.52, -0.58, 0.23, -2.71]  # no try from elsewhere meets it before it is given up
    assert iq.solve_pose(SO101, target, q0=q0, exact="position", restarts=20, **NO_LIMIT).success


def test_where_what_is_exact_is_met_no_step_brings_the_rest_nearer():
    exact = [iq.control.ExactPlane([0.0, 0.3, 1.0], [0.0, 0.0, 0.1]), iq.control.ExactAxis([0.2, 0.0, 1.0])]
    for seed in (141, 169, 175, 192, 256):
        q, start = np.random.default_rng(seed).uniform(-3.0, 3.0, (2, 6))
        found = iq.solve_pose(UR5, UR5.pose(q), q0=start, exact=exact, **NO_LIMIT)
        again = iq.solve_pose(UR5, UR5.pose(q), q0=found.q, exact=exact, **NO_LIMIT)
        assert found.success
        assert again.error > 0.9 * found.error or found.reason == ""


def test_without_exact_demands_five_joints_trade_position_for_orientation():
    target = SO101.pose(states(SO101, 1, 20)[0])
    target[:3, :3] = Rotation.random(random_state=0).as_matrix()
    free = iq.solve_pose(SO101, target, **NO_LIMIT)
    assert not free.success
    assert free.position_error > 1e-3


def test_an_exact_axis_leaves_the_turn_about_it_free():
    target = SO101.pose(states(SO101, 1, 23)[0]) @ iq.exp([0.0, 0.0, 0.5, 0.0, 0.0, 0.0])
    found = iq.solve_pose(
        SO101, target, exact=[iq.control.ExactPoint(), iq.control.ExactAxis([0.0, 0.0, 1.0])], **NO_LIMIT
    )
    T = fk(SO101, found.q)
    assert found.success
    np.testing.assert_allclose(T.translation, target[:3, 3], atol=1e-6)
    np.testing.assert_allclose(T.rotation[:, 2], target[:3, 2], atol=1e-6)


def test_an_exact_position_out_of_reach_is_no_success():
    found = iq.solve_pose(SO101, beyond(SO101, 24), exact="position", restarts=4, **NO_LIMIT)
    assert not found.success
    assert found.reason.startswith("out of reach")
    assert is_inside(SO101, found.q)


def test_joints_that_slide_and_screw():
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


def test_a_start_that_is_the_answer_is_the_answer():
    q = states(PANDA, 1, 40)[0]
    found = iq.solve_pose(PANDA, pin.SE3(PANDA.pose(q)), q0=q)
    assert (found.iterations, found.restarts, found.success) == (0, 0, True)
    np.testing.assert_array_equal(found.q, q)


def test_the_seed_decides_and_nothing_else():
    target = beyond(PANDA, 41)
    first, again = (iq.solve_pose(PANDA, target, seed=3, restarts=5, **NO_LIMIT) for _ in range(2))
    assert first == again
    other = iq.solve_pose(PANDA, target, seed=4, restarts=5, **NO_LIMIT)
    assert other.iterations != first.iterations


def test_solutions_compare_pickle_and_show_themselves():
    found = iq.solve_pose(PANDA, beyond(PANDA, 41), restarts=2, **NO_LIMIT)
    again = pickle.loads(pickle.dumps(found))
    assert again == found
    assert again != iq.solve_pose(PANDA, beyond(PANDA, 43), restarts=2, **NO_LIMIT)
    assert repr(again) == repr(found)
    assert "\n" not in repr(found)
    with pytest.raises(AttributeError):
        found.q = None


def test_no_restarts_are_no_restarts():
    hard = [iq.solve_pose(PANDA, beyond(PANDA, s), restarts=0, **NO_LIMIT) for s in range(3)]
    assert all(one.restarts == 0 and not one.success for one in hard)
    assert "tries" not in hard[0].reason


def test_time_that_is_over_is_told_from_reach():
    for restarts in (0, 10):
        found = iq.solve_pose(PANDA, beyond(PANDA, 42), time_limit=1e-6, restarts=restarts)
        assert not found.success
        assert found.reason.startswith("time limit reached: ")
        assert found.restarts == 0


HURT = pin.SE3.Identity()
HURT.translation = np.array([0.0, np.nan, 0.0])
T = PANDA.pose(np.zeros(7))
WRONG = {
    "nan SE3": (lambda: iq.solve_pose(PANDA, HURT), "target"),
    "sheared target": (lambda: iq.solve_pose(PANDA, 1.01 * T), "target"),
    "tolerance": (lambda: iq.solve_pose(PANDA, T, tolerance=0.0), "tolerance"),
    "time": (lambda: iq.solve_pose(PANDA, T, time_limit=-1.0), "time_limit"),
    "restarts": (lambda: iq.solve_pose(PANDA, T, restarts=-1), "restarts"),
    "half a restart": (lambda: iq.solve_pose(PANDA, T, restarts=0.5), "restarts"),
    "seed": (lambda: iq.solve_pose(PANDA, T, seed="a"), "seed"),
    "exact": (lambda: iq.solve_pose(PANDA, T, exact="orientation"), "exact"),
    "exact joints": (lambda: iq.solve_pose(PANDA, T, exact=iq.control.ExactJoints(np.eye(7))), "exact"),
    "h = 0": (lambda: iq.solve_pose(PANDA, T, form=0.0), "form"),
    "complement": (lambda: iq.solve_pose(PANDA, T, form=iq.Complement(np.eye(6)[:, :1])), "form"),
    "word for a form": (lambda: iq.solve_pose(PANDA, T, form="tool"), "form"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_input_is_named(case):
    call, argument = WRONG[case]
    with pytest.raises(iq.BadInput, match=r": found .*; expected ") as caught:
        call()
    assert caught.value.argument == argument
