import numpy as np
import pytest

import invariantqp as iq
from invariantqp.compare.cell import Cell
from invariantqp.compare.measure import dependence
from invariantqp.compare.measure.dependence import Writing, trajectory
from invariantqp.compare.measure.frames import random_displacement
from invariantqp.compare.registry import methods
from invariantqp.runs.taskfile import load_task

ROUNDING = 1e-9


def figures(task, name, seed=0):
    return dependence.dependence(Cell("dependence", task, (name,), seed=seed, quick=True))[name]


@pytest.mark.parametrize("task", ["panda_path", "so101_line", "arm_3r"])
@pytest.mark.parametrize("name", ["invariantqp", "QP, DAQP", "h, factored", "h, damped", "body inertia"])
def test_an_invariant_law_does_not_know_where_frames_are_nor_the_unit_of_length(task, name):
    found = figures(task, name)
    assert found["frame"]["states"] == found["unit"]["states"] == 40
    assert found["frame"]["worst"] < ROUNDING
    assert found["unit"]["worst"] < ROUNDING


def test_moore_penrose_depends_on_both_with_five_joints_and_in_the_median_on_neither_with_seven():
    five, seven = figures("so101_line", "Moore-Penrose, pinv"), figures("panda_path", "Moore-Penrose, pinv")
    for way in ("frame", "unit"):
        assert five[way]["median"] > 1e-2
        assert seven[way]["median"] < ROUNDING
    assert figures("panda_path", "DLS")["frame"]["median"] > 1e-3


def test_the_unit_consistent_inverse_does_not_know_the_unit_but_the_frame():
    found = figures("panda_path", "unit-consistent inverse")
    assert found["unit"]["worst"] < ROUNDING
    assert found["frame"]["median"] > 1e-2


@pytest.mark.parametrize("name", ["Pink", "mink"])
def test_systems_depend_on_frames_as_their_least_squares_do(name):
    theirs, plain = figures("so101_line", name), figures("so101_line", "least-squares QP")
    assert theirs["frame"]["median"] == pytest.approx(plain["frame"]["median"], rel=0.2)
    assert theirs["unit"]["median"] == pytest.approx(plain["unit"]["median"], rel=0.2)


def test_a_change_is_what_numpy_makes_of_the_displaced_jacobian():
    task = load_task("so101_line")
    robot, q, X = task.load_robot(), task.start(), random_displacement(5)
    law = task.law.model_copy(update={"gain": 1.0})
    twist = np.array([0.1, -0.2, 0.3, 0.05, 0.1, -0.1])
    target = iq.exp(twist) @ robot.pose(q)
    answers = []
    for tool in (np.eye(4), X):
        written = Writing(np.eye(4), tool)
        loop, arm = written.loop(methods()["Moore-Penrose, pinv"], robot, law)
        answers.append(loop.step(q, arm.target(written.target(target))).velocity)
        to_tool = iq.adjoint(np.linalg.inv(robot.pose(q) @ tool))
        np.testing.assert_allclose(
            answers[-1], np.linalg.pinv(to_tool @ robot.jacobian(q)) @ to_tool @ twist, atol=1e-9
        )
    assert np.linalg.norm(answers[0] - answers[1]) > 1e-3


def test_what_a_law_does_not_answer_is_left_out(monkeypatch):
    monkeypatch.setattr(dependence, "_answer", lambda *_: None)
    found = figures("ur5_wrist", "DLS")["frame"]
    assert found["median"] is None
    assert (found["states"], found["left_out"]) == (0, 40)


def test_whole_trajectories_of_the_few_that_are_run_twice():
    cell = Cell("trajectory", "so101_line", ("invariantqp",), quick=True)
    ours = trajectory(cell)["invariantqp"]
    theirs = trajectory(Cell("trajectory", "so101_line", ("DLS",), quick=True))["DLS"]
    assert ours["change"] < ROUNDING < 1e-3 < theirs["change"]
