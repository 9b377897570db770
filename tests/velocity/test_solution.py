"""Statuses: one enum for all loops, whose members are their own words."""

import json
import pickle
from copy import deepcopy

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.velocity.solution import VelocitySolution


@pytest.mark.parametrize("status", iq.Status)
def test_a_status_is_its_string(status):
    word = status.value
    assert status == word
    assert {word: 1}[status] == 1
    assert (str(status), f"{status}", f"{status:>9}", repr(status)) == (word, word, f"{word:>9}", repr(word))
    assert json.dumps({status: status}) == f'{{"{word}": "{word}"}}'
    assert pickle.loads(pickle.dumps(status)) is deepcopy(status) is iq.Status(word) is status
    assert np.array([status]).tolist() == [word]


def test_solutions_pickle_and_have_status_members():
    robot = iq.load_robot("ur5e")
    q = np.full(6, 0.4)
    J, s = robot.jacobian(q), np.ones(6)
    bounds = np.full(J.shape[1], -0.1), np.full(J.shape[1], 0.1)
    solutions = [iq.solve_velocity(J, s, bounds=bounds), iq.Controller(robot, dt=0.01).follow(q, s)]
    solutions += iq.solve_velocities(J[None], s[None], bounds=(bounds[0][None], bounds[1][None]))
    for solution in solutions:
        assert type(solution.status) is iq.Status
        again = pickle.loads(pickle.dumps(solution))
        assert type(again) is VelocitySolution
        assert again == solution
        assert again.status is solution.status
