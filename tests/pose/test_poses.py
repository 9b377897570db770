import copy
import pickle

import numpy as np
import pytest
from support.inverse_kinematics import ARMS, NO_LIMIT, random_joints

import invariantqp as iq
from invariantqp.pose.ik import PoseSearch

PANDA = ARMS["panda"]


@pytest.mark.parametrize("name", ["panda", "ur5", "so101"])
def test_along_a_path_each_pose_is_found_from_the_one_before(name):
    robot = ARMS[name]
    ends = 0.4 * random_joints(robot, 2, 30) + 0.6 * 0.5 * (robot.position_lower + robot.position_upper)
    path = np.linspace(*ends, 60)
    found = iq.solve_poses(robot, [robot.pose(q) for q in path], q0=path[0], along=True, restarts=0, **NO_LIMIT)
    assert all(one.success for one in found)
    q = np.array([one.q for one in found])
    assert np.abs(np.diff(q, axis=0)).max() < 3.0 * np.abs(np.diff(path, axis=0)).max()


@pytest.mark.parametrize("name", ["panda", "ur5", "so101"])
def test_out_of_reach_and_back_neighbouring_targets_have_neighbouring_solutions(name):
    robot = ARMS[name]
    q = 0.4 * random_joints(robot, 1, 31)[0] + 0.6 * 0.5 * (robot.position_lower + robot.position_upper)
    place = robot.pose(q)
    away = np.array([*np.zeros(3), *place[:3, 3] / np.linalg.norm(place[:3, 3])])
    reach = np.concatenate((np.arange(0.0, 1.2, 0.02), np.arange(1.2, 0.0, -0.02)))
    path = [iq.exp(far * away) @ place for far in reach]
    found = iq.solve_poses(robot, path, q0=q, along=True, restarts=0, **NO_LIMIT)
    assert not all(one.success for one in found)
    steps = np.abs(np.diff([one.q for one in found], axis=0)).max(axis=1)
    assert (steps > 0.7).sum() <= 1  # rad for 2 cm; stretched out, an elbow turns by half of it
    assert np.median(steps) < 0.1


def test_a_batch_has_the_single_solutions_on_any_number_of_threads():
    targets = [PANDA.pose(q) for q in random_joints(PANDA, 40, 50)]
    starts = random_joints(PANDA, 40, 51)
    single = [iq.solve_pose(PANDA, t, q0=q, **NO_LIMIT) for t, q in zip(targets, starts, strict=True)]
    for jobs in (1, 2, -1):
        assert iq.solve_poses(PANDA, targets, q0=starts, jobs=jobs, **NO_LIMIT) == single
    alike = iq.solve_poses(PANDA, targets, q0=starts[0], jobs=2, **NO_LIMIT)
    assert alike[3] == iq.solve_pose(PANDA, targets[3], q0=starts[0], **NO_LIMIT)
    assert iq.solve_poses(PANDA, targets, jobs=2)[0] == iq.solve_pose(PANDA, targets[0])
    assert iq.solve_poses(PANDA, []) == []


def test_a_search_can_be_copied():
    search, target = PoseSearch(PANDA, exact="position"), PANDA.pose(np.full(7, 0.3))
    for other in (copy.deepcopy(search), pickle.loads(pickle.dumps(search))):
        assert other.solve(target) == search.solve(target)


def test_a_batch_with_a_metric_at_each_target():
    targets, metric = [PANDA.pose(q) for q in random_joints(PANDA, 3, 52)], iq.tool_metric(PANDA)
    for along in (False, True):
        found = iq.solve_poses(PANDA, targets, q0=np.zeros(7), along=along, form=metric, **NO_LIMIT)
        assert all(one.success for one in found)
