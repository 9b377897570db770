"""Pose searches for targets that are partial: reached within limits, in any frame and unit."""

import numpy as np
import pytest
from support.arms import arm
from support.inverse_kinematics import ARMS as ALL
from support.inverse_kinematics import NO_LIMIT, assert_refused, is_inside, random_joints

import invariantqp as iq

ARMS = {name: ALL[name] for name in ("so101", "ur5", "panda")}
UR5 = ARMS["ur5"]
Z = np.array([0.0, 0.0, 1.0])


def random_poses(robot, count, seed=0):
    return [robot.pose(q) for q in random_joints(robot, count, seed)]


def parts_of(pose, point, axis):
    there, along = pose[:3, :3] @ point + pose[:3, 3], pose[:3, :3] @ axis
    return [
        iq.Target(there, tool_point=point),
        iq.Target(there, along, tool_point=point, tool_axis=axis),
        iq.Target(axis=along, tool_axis=axis),
    ]


def target_errors(robot, q, target):
    pose, off, angle = robot.pose(q), 0.0, 0.0
    if target.point is not None:
        off = np.linalg.norm(pose[:3, :3] @ target.tool_point + pose[:3, 3] - target.point)
    if target.axis is not None:
        axis = pose[:3, :3] @ target.tool_axis
        angle = np.arctan2(np.linalg.norm(np.cross(axis, target.axis)), axis @ target.axis)
    return off, angle


@pytest.mark.parametrize("name", ARMS)
def test_reachable_partial_targets_are_reached(name):
    robot, rng = ARMS[name], np.random.default_rng(1)
    for pose in random_poses(robot, 40):
        for target in parts_of(pose, 0.1 * rng.normal(size=3), rng.normal(size=3)):
            found = iq.solve_pose(robot, target, **NO_LIMIT)
            assert found.success, found.reason
            np.testing.assert_allclose(
                (found.position_error, found.orientation_error), target_errors(robot, found.q, target), atol=1e-9
            )
            assert max(target_errors(robot, found.q, target)) <= 1e-6
            assert is_inside(robot, found.q)


@pytest.mark.parametrize("name", ARMS)
def test_a_partial_target_moves_joints_less_than_a_whole_pose(name):
    robot = ARMS[name]
    rng, q0 = np.random.default_rng(2), 0.5 * (robot.position_lower + robot.position_upper) + 0.1
    moved = np.zeros(4)
    for _ in range(20):
        pose = robot.pose(q0 + rng.uniform(-0.3, 0.3, len(q0)))
        targets = [pose, *parts_of(pose, np.zeros(3), Z)]
        moved += [np.linalg.norm(iq.solve_pose(robot, one, q0=q0).q - q0) for one in targets]
    assert (moved[1:] <= (1.0 + 1e-6) * moved[0]).all()  # five joints have no turn to spare


def test_base_frame_and_unit_of_length_do_not_matter():
    rng = np.random.default_rng(3)
    made, home, q0 = arm(rng, "general", 6), iq.exp(rng.normal(size=6)), rng.uniform(-1.0, 1.0, 6)
    to, unit = iq.exp(rng.normal(size=6)), 1000.0
    longer = home.copy()
    longer[:3, 3] *= unit
    robot, moved, scaled = (
        iq.robots.Chain(made.J, home),
        iq.robots.Chain(iq.adjoint(to) @ made.J, to @ home),
        iq.robots.Chain(made.in_units(unit).J, longer),
    )
    pose, point, axis = robot.pose(q0 + 0.3), np.array([0.1, -0.05, 0.2]), np.array([0.6, 0.0, 0.8])
    for target in parts_of(pose, point, axis):
        there, along = target.point, target.axis
        elsewhere = iq.Target(
            None if there is None else to[:3, :3] @ there + to[:3, 3],
            None if along is None else to[:3, :3] @ along,
            tool_point=target.tool_point,
            tool_axis=axis,
        )
        larger = iq.Target(
            None if there is None else unit * there, along, tool_point=unit * target.tool_point, tool_axis=axis
        )
        q = iq.solve_pose(robot, target, q0=q0).q
        np.testing.assert_allclose(iq.solve_pose(moved, elsewhere, q0=q0).q, q, atol=1e-7)
        np.testing.assert_allclose(iq.solve_pose(scaled, larger, q0=q0, tolerance=1e-4).q, q, atol=1e-6)


def test_an_axis_turned_round_is_reached():
    robot, q = UR5, np.array([0.0, -1.4, 1.6, -1.8, -1.57, 0.0])
    pose = robot.pose(q)
    for target in (iq.Target(axis=-pose[:3, 2]), iq.Target(pose[:3, 3], -pose[:3, 2])):
        found = iq.solve_pose(robot, target, q0=q)
        assert found.success
        assert max(target_errors(robot, found.q, target)) < 1e-6


def test_out_of_reach_the_closest_is_found():
    robot = ARMS["panda"]
    both = iq.Target([1.6, 0.0, 0.333], [-1.0, 0.0, 0.0])
    found = iq.solve_pose(robot, both, **NO_LIMIT, restarts=5)
    assert not found.success
    np.testing.assert_allclose(
        (found.position_error, found.orientation_error), target_errors(robot, found.q, both), atol=1e-9
    )
    assert found.orientation_error > 0.1
    assert found.reason.startswith("out of reach")
    other = iq.solve_pose(robot, iq.Target([1.6, 0.0, 0.333]), **NO_LIMIT, restarts=5)
    assert other.position_error <= found.position_error + 1e-9
    assert other.orientation_error == 0.0


def test_a_subclass_of_chain_has_the_same_solutions():
    class Mine(iq.robots.Chain):
        """No plain Chain."""

    robot = ARMS["so101"]
    named = ("screws", "home", "names", "position_lower", "position_upper", "velocity_limit")
    own = Mine(**{name: getattr(robot, name) for name in named})
    for target in parts_of(random_poses(robot, 1)[0], np.zeros(3), Z):
        found = [iq.solve_pose(r, target, **NO_LIMIT).q for r in (robot, own)]
        np.testing.assert_allclose(found[0], found[1], atol=1e-9)


@pytest.mark.parametrize("along", [False, True])
def test_many_targets_of_several_kinds(along):
    robot = UR5
    pose = random_poses(robot, 1)[0]
    targets = [pose, pose[:3, 3], *parts_of(pose, np.zeros(3), Z)]
    found = iq.solve_poses(robot, targets, along=along, **NO_LIMIT)
    assert [one.success for one in found] == [True] * 5
    if not along:
        for one, target in zip(found, targets, strict=True):
            np.testing.assert_array_equal(one.q, iq.solve_pose(robot, target, **NO_LIMIT).q)


def test_a_form_and_exact_demands_need_a_pose():
    robot = UR5
    for options in ({"form": 0.3}, {"form": iq.tool_metric(robot)}, {"exact": "position"}):
        assert_refused(lambda given=options: iq.solve_pose(robot, iq.Target(axis=Z), **given), "target")


@pytest.mark.parametrize("target", [[np.nan, 0.0, 0.0], [0.0, 0.0], iq.Target([1e3, 0.0, 0.0]), "point"])
def test_wrong_targets_are_refused(target):
    assert_refused(lambda: iq.solve_pose(UR5, target), "target")
    assert_refused(lambda: iq.solve_poses(UR5, [iq.Target(axis=Z), target]), "targets[1]")
