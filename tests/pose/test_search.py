"""The search of the engine: how far answers are from the start, what it takes, and arms of any size and kind."""

import numpy as np
import pinocchio as pin
import pytest
from support.inverse_kinematics import ARMS, NO_LIMIT, assert_refused, is_inside, pose_errors, random_joints
from support.repeats import repeats

import invariantqp as iq
from invariantqp.robots.kinematics import joint_ranges

PANDA, UR5, SO101 = ARMS["panda"], ARMS["ur5"], ARMS["so101"]
Q = np.array([0.1, -0.4, 0.2, -2.2, 0.1, 1.8, 0.8])
E = iq.control


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("at_limits", [0, 2])
def test_reachable_poses_are_reached_inside_the_limits(name, at_limits):
    robot, count = ARMS[name], repeats(4000, 400)
    limited = np.flatnonzero(np.isfinite(robot.position_lower))
    missed = 0
    for seed, (q, start) in enumerate(zip(random_joints(robot, count, 1), random_joints(robot, count, 2), strict=True)):
        for i in np.random.default_rng(seed).permutation(limited)[:at_limits]:
            q[i] = (robot.position_lower if seed % 2 else robot.position_upper)[i]
        target = robot.pose(q)
        found = iq.solve_pose(robot, target, q0=start if seed % 3 else None, **NO_LIMIT)
        errors = found.position_error, found.orientation_error
        assert errors == pytest.approx(pose_errors(robot, found.q, target), abs=1e-12)
        assert found.success == (max(errors) <= 1.001e-6) == (found.reason == "")
        assert is_inside(robot, found.q)
        missed += not found.success
    assert missed <= (0 if at_limits == 0 else count // 1000)


@pytest.mark.parametrize("name", ARMS)
def test_targets_nearby_have_solutions_nearby_or_are_another_branch(name):
    robot, low, high = ARMS[name], *joint_ranges(ARMS[name])
    rng, jumped, count = np.random.default_rng(3), 0, repeats(500, 200)
    for start in random_joints(robot, count, 4):
        step = rng.normal(size=len(start))
        q = np.clip(start + rng.uniform(0.0, 0.4) * step / np.abs(step).max(), low, high)
        found = iq.solve_pose(robot, robot.pose(q), q0=start, **NO_LIMIT)
        assert found.success
        far = np.abs(found.q - start).max()
        assert found.displacement == pytest.approx(far, abs=1e-12)
        assert found.other_branch or found.restarts == 0
        jumped += far > 1.2
        assert far < 3.0 or found.other_branch
    assert jumped <= count // 100


def test_the_first_try_is_no_other_branch():
    found = iq.solve_pose(PANDA, PANDA.pose(Q + 0.1), q0=Q)
    assert (found.success, found.restarts, found.other_branch) == (True, 0, False)
    assert found.displacement == np.abs(found.q - Q).max()
    middle = 0.5 * (PANDA.position_lower + PANDA.position_upper)
    found = iq.solve_pose(PANDA, PANDA.pose(Q))
    assert found.displacement == pytest.approx(np.abs(found.q - middle).max(), abs=1e-12)


def test_a_restart_is_another_branch():
    jumps = [
        found
        for q, start in zip(random_joints(PANDA, 60, 5), random_joints(PANDA, 60, 6), strict=True)
        if (found := iq.solve_pose(PANDA, PANDA.pose(q), q0=start, **NO_LIMIT)).restarts
    ]
    assert jumps
    assert all(one.other_branch and one.success for one in jumps)


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("kind", ["position", "axis", "plane"])
def test_exact_demands_are_met_in_reach(kind, given):
    exact = {
        "position": "position",
        "axis": [E.ExactPoint(), E.ExactAxis([0.0, 0.0, 1.0])],
        "plane": [E.ExactPlane([0.0, 0.6, 0.8]), E.ExactAxis([1.0, 0.0, 0.0])],
    }[kind]
    rng, count = np.random.default_rng(7), repeats(1000, 150)
    for q, start in zip(random_joints(SO101, count, 8), random_joints(SO101, count, 9), strict=True):
        turn = {"position": rng.normal(size=3), "axis": [0, 0, rng.uniform(-3, 3)], "plane": np.zeros(3)}[kind]
        target = SO101.pose(q) @ iq.exp([*turn, 0, 0, 0])
        found = iq.solve_pose(SO101, target, q0=start if given else None, exact=exact, **NO_LIMIT)
        T = SO101.pose(found.q)
        assert found.success, found.reason
        if kind == "plane":
            assert abs((T - target)[:3, 3] @ [0.0, 0.6, 0.8]) < 2e-6
            np.testing.assert_allclose(T[:3, 0], target[:3, 0], atol=2e-6)
        else:
            np.testing.assert_allclose(T[:3, 3], target[:3, 3], atol=2e-6)
        if kind == "axis":
            np.testing.assert_allclose(T[:3, 2], target[:3, 2], atol=2e-6)


@pytest.mark.parametrize("name", ["panda", "ur5", "so101"])
def test_a_point_is_a_target(name):
    robot = ARMS[name]
    for q, start in zip(random_joints(robot, 20, 10), random_joints(robot, 20, 11), strict=True):
        place = robot.pose(q)[:3, 3]
        found = iq.solve_pose(robot, place, q0=start, **NO_LIMIT)
        assert found.success
        assert found.orientation_error == 0.0
        np.testing.assert_allclose(robot.pose(found.q)[:3, 3], place, atol=1e-6)
        for same in (place.tolist(), iq.Target(place)):
            assert iq.solve_pose(robot, same, q0=start.tolist(), **NO_LIMIT) == found
    far = iq.solve_pose(robot, [3.0, 0.0, 0.0], restarts=2, **NO_LIMIT)
    assert not far.success
    assert far.reason.startswith("out of reach")


def same(one, other):
    """Of two answers whose kinematics are rounded differently."""
    np.testing.assert_allclose(one.q, other.q, rtol=0.0, atol=1e-6)
    assert (one.success, one.restarts, one.other_branch) == (other.success, other.restarts, other.other_branch)


class Users:
    """A robot of the user: names, limits, a pose and a Jacobian."""

    def __init__(self, chain):
        self.names, self._chain = chain.names, chain
        self.position_lower, self.position_upper = chain.position_lower, chain.position_upper

    def pose(self, q):
        return self._chain.pose(q)

    def jacobian(self, q):
        return self._chain.jacobian(q)


@pytest.mark.parametrize("exact", [None, "position", (E.ExactPoint(), E.ExactAxis([0.0, 1.0, 0.0]))])
def test_a_users_robot_has_the_solutions_of_the_same_chain(exact):
    for name in ("panda", "so101"):
        robot = ARMS[name]
        for q, start in zip(random_joints(robot, 4, 12), random_joints(robot, 4, 13), strict=True):
            both = [iq.solve_pose(r, robot.pose(q), q0=start, exact=exact, **NO_LIMIT) for r in (robot, Users(robot))]
            same(*both)
    assert iq.solve_poses(Users(PANDA), [PANDA.pose(Q)] * 2, q0=Q + 0.1, jobs=2)[1].success


class Height:
    """A demand of the user: the tool's height."""

    def rows(self, view):
        return E.ExactPlane([0.0, 0.0, 1.0]).rows(view)


def test_a_users_demand():
    target = PANDA.pose(Q)
    target[:3, 3] *= 1.6  # out of reach but for its height
    theirs = iq.solve_pose(PANDA, target, q0=Q, exact=[Height()], restarts=3, **NO_LIMIT)
    ours = iq.solve_pose(PANDA, target, q0=Q, exact=[E.ExactPlane([0.0, 0.0, 1.0])], restarts=3, **NO_LIMIT)
    same(theirs, ours)


def test_errors_of_a_users_robot_are_raised():
    class Broken(Users):
        def jacobian(self, q):
            if self.broken:
                raise ZeroDivisionError("no Jacobian")
            return super().jacobian(q)

    robot = Broken(PANDA)
    robot.broken = False
    assert iq.solve_pose(robot, PANDA.pose(Q), q0=Q).success
    robot.broken = True
    with pytest.raises(ZeroDivisionError, match="no Jacobian"):
        iq.solve_pose(robot, PANDA.pose(Q), q0=Q)
    robot.jacobian = lambda q: np.zeros((6, 3))
    with pytest.raises(ValueError, match="shape"):
        iq.solve_pose(robot, PANDA.pose(Q), q0=Q)


@pytest.mark.parametrize("m", [1, 2, 3, 9, 16, 30, 64])
def test_chains_of_any_length(m):
    rng = np.random.default_rng(m)
    screws = np.column_stack([iq.revolute(rng.normal(size=3), 0.1 * rng.normal(size=3)) for _ in range(m)])
    arm = iq.robots.Chain(screws, iq.transform(translation=[0.3, 0.1, 0.2]), (), -2.5, 2.5)
    for _ in range(5):
        q = rng.uniform(-2.0, 2.0, m)
        found = iq.solve_pose(arm, arm.pose(q), **NO_LIMIT)
        assert found.success
        found = iq.solve_pose(arm, arm.pose(q), q0=np.clip(q + 0.05, -2.5, 2.5), exact="position", **NO_LIMIT)
        assert found.success
        assert np.linalg.norm((arm.pose(found.q) - arm.pose(q))[:3, 3]) < 1e-6


def test_too_many_joints_are_refused():
    arm = iq.robots.Chain(np.tile(iq.revolute([0, 0, 1.0])[:, None], 65), np.eye(4))
    with pytest.raises(iq.BadInput, match="robot: found 65 joints; expected at most 64"):
        iq.solve_pose(arm, np.eye(4))


def test_lists_and_other_number_types_are_taken():
    target = PANDA.pose(Q)
    found = iq.solve_pose(PANDA, target, q0=Q + 0.1)
    assert iq.solve_pose(PANDA, target.tolist(), q0=(Q + 0.1).tolist()) == found
    assert iq.solve_pose(PANDA, np.asfortranarray(target), q0=np.repeat(Q + 0.1, 2)[::2]) == found
    rough = iq.solve_pose(PANDA, target.astype(np.float32), q0=(Q + 0.1).astype(np.float32))
    assert rough.success
    assert np.abs(rough.q - found.q).max() < 1e-5
    turn = iq.solve_pose(UR5, UR5.pose(np.ones(6)), q0=[1, 1, 1, 1, 1, 2])
    assert turn.success


T = PANDA.pose(Q)
NAN_SE3 = pin.SE3.Identity()
NAN_SE3.translation = np.array([0.0, np.nan, 0.0])
WRONG = {
    "complex": (lambda: iq.solve_pose(PANDA, T.astype(complex)), "target"),
    "texts": (lambda: iq.solve_pose(PANDA, T.astype(str)), "target"),
    "none": (lambda: iq.solve_pose(PANDA, None), "target"),
    "a quaternion": (lambda: iq.solve_pose(PANDA, [1.0, 0.0, 0.0, 0.0]), "target"),
    "a mirror image": (lambda: iq.solve_pose(PANDA, np.diag([1.0, 1.0, -1.0, 1.0])), "target"),
    "a last row": (lambda: iq.solve_pose(PANDA, T + np.eye(4)[3]), "target"),
    "a point of NaN": (lambda: iq.solve_pose(PANDA, [0.3, np.nan, 0.1]), "target"),
    "a point in millimetres": (lambda: iq.solve_pose(PANDA, [300.0, 0.0, 400.0]), "target"),
    "a point and a form": (lambda: iq.solve_pose(PANDA, [0.3, 0.0, 0.4], form=0.3), "target"),
    "a point and a demand": (lambda: iq.solve_pose(PANDA, [0.3, 0.0, 0.4], exact="position"), "target"),
    "a complex start": (lambda: iq.solve_pose(PANDA, T, q0=Q * 1j), "q0"),
    "tolerance in a list": (lambda: iq.solve_pose(PANDA, T, tolerance=[1e-6]), "tolerance"),
    "a name": (lambda: iq.solve_pose("panda", T), "robot"),
    "nan SE3": (lambda: iq.solve_pose(PANDA, NAN_SE3), "target"),
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
    "starts": (lambda: iq.solve_poses(PANDA, [T, T], q0=np.zeros((3, 7))), "q0"),
    "two numbers among poses": (lambda: iq.solve_poses(PANDA, [T, T[:2, 3]]), "targets[1]"),
    "a path on two": (lambda: iq.solve_poses(PANDA, [T], along=True, jobs=2), "jobs"),
    "starts along a path": (lambda: iq.solve_poses(PANDA, [T], along=True, q0=np.zeros((1, 7))), "q0"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_input_is_named(case):
    assert_refused(*WRONG[case])


@pytest.mark.parametrize("exact", [None, [E.ExactPoint(), E.ExactAxis([0.0, 0.0, 1.0])]])
@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_unit_of_length_changes_nothing(scale, exact):
    unit = np.repeat((1.0, scale), 3)[:, None]
    home = PANDA.home.copy()
    home[:3, 3] *= scale
    arm = iq.robots.Chain(PANDA.screws * unit, home, (), PANDA.position_lower, PANDA.position_upper)
    for q, start in zip(random_joints(PANDA, 10, 14), random_joints(PANDA, 10, 15), strict=True):
        here = iq.solve_pose(PANDA, PANDA.pose(q), q0=start, exact=exact, **NO_LIMIT)
        there = iq.solve_pose(arm, arm.pose(q), q0=start, exact=exact, **NO_LIMIT)
        assert (here.restarts, here.success) == (there.restarts, there.success)
        # Beside exact demands free joints come to rest within the tolerance, which is a length as well.
        np.testing.assert_allclose(there.q, here.q, rtol=0.0, atol=1e-4 if exact else 1e-5)
