import copy
import pickle

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.pose.ik import PoseSearch
from invariantqp.robots.kinematics import joint_ranges

NO_LIMIT = {"time_limit": np.inf}  # the same in every run, however busy the machine
PANDA = iq.load_robot("panda")


def states(robot, count, seed):
    low, high = joint_ranges(robot)
    return low + np.random.default_rng(seed).random((count, len(low))) * (high - low)


@pytest.mark.parametrize("name", ["panda", "ur5", "so101"])
def test_along_a_path_each_pose_is_found_from_the_one_before(name):
    robot = iq.load_robot(name)
    ends = 0.4 * states(robot, 2, 30) + 0.6 * 0.5 * (robot.position_lower + robot.position_upper)
    way = np.linspace(*ends, 60)
    found = iq.solve_poses(robot, [robot.pose(q) for q in way], q0=way[0], along=True, restarts=0, **NO_LIMIT)
    assert all(one.success for one in found)
    q = np.array([one.q for one in found])
    assert np.abs(np.diff(q, axis=0)).max() < 3.0 * np.abs(np.diff(way, axis=0)).max()


@pytest.mark.parametrize("name", ["panda", "ur5", "so101"])
def test_out_of_reach_and_back_neighbouring_targets_have_neighbouring_answers(name):
    robot = iq.load_robot(name)
    q = 0.4 * states(robot, 1, 31)[0] + 0.6 * 0.5 * (robot.position_lower + robot.position_upper)
    place = robot.pose(q)
    away = np.array([*np.zeros(3), *place[:3, 3] / np.linalg.norm(place[:3, 3])])
    reach = np.concatenate((np.arange(0.0, 1.2, 0.02), np.arange(1.2, 0.0, -0.02)))
    path = [iq.exp(far * away) @ place for far in reach]
    found = iq.solve_poses(robot, path, q0=q, along=True, restarts=0, **NO_LIMIT)
    assert not all(one.success for one in found)
    steps = np.abs(np.diff([one.q for one in found], axis=0)).max(axis=1)
    assert (steps > 0.7).sum() <= 1  # rad for 2 cm; stretched out, an elbow turns by half of it
    assert np.median(steps) < 0.1


def test_a_batch_is_the_single_answers_on_any_number_of_threads():
    targets = [PANDA.pose(q) for q in states(PANDA, 40, 50)]
    starts = states(PANDA, 40, 51)
    single = [iq.solve_pose(PANDA, t, q0=q, **NO_LIMIT) for t, q in zip(targets, starts, strict=True)]
    for jobs in (1, 2, -1):
        assert iq.solve_poses(PANDA, targets, q0=starts, jobs=jobs, **NO_LIMIT) == single
    alike = iq.solve_poses(PANDA, targets, q0=starts[0], jobs=2, **NO_LIMIT)
    assert alike[3] == iq.solve_pose(PANDA, targets[3], q0=starts[0], **NO_LIMIT)
    assert iq.solve_poses(PANDA, targets, jobs=2)[0] == iq.solve_pose(PANDA, targets[0])
    assert iq.solve_poses(PANDA, []) == []


def test_a_copy_of_a_search_is_one():
    search, target = PoseSearch(PANDA, exact="position"), PANDA.pose(np.full(7, 0.3))
    for other in (copy.deepcopy(search), pickle.loads(pickle.dumps(search))):
        assert other.solve(target) == search.solve(target)


def test_a_batch_with_a_metric_at_each_target():
    targets, metric = [PANDA.pose(q) for q in states(PANDA, 3, 52)], iq.tool_metric(PANDA)
    for along in (False, True):
        found = iq.solve_poses(PANDA, targets, q0=np.zeros(7), along=along, form=metric, **NO_LIMIT)
        assert all(one.success for one in found)


T = PANDA.pose(np.zeros(7))
WRONG = {
    "one of many targets": (lambda: iq.solve_poses(PANDA, [T, T * np.nan]), "targets[1]"),
    "starts": (lambda: iq.solve_poses(PANDA, [T, T], q0=np.zeros((3, 7))), "q0"),
    "two numbers among poses": (lambda: iq.solve_poses(PANDA, [T, T[:2, 3]]), "targets[1]"),
    "a path on two": (lambda: iq.solve_poses(PANDA, [T], along=True, jobs=2), "jobs"),
    "starts along a path": (lambda: iq.solve_poses(PANDA, [T], along=True, q0=np.zeros((1, 7))), "q0"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_input_is_named(case):
    call, argument = WRONG[case]
    with pytest.raises(iq.BadInput, match=r": found .*; expected ") as caught:
        call()
    assert caught.value.argument == argument
