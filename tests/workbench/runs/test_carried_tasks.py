"""Arms on which no pitch form works: without a form, and with one."""

import numpy as np
import pytest
from support.random_systems import motion
from support.task_files import run_displaced

import invariantqp as iq
from invariantqp.workbench.runs.taskfile import task_from

ARMS = ["planar_3r", "scara"]


@pytest.mark.parametrize("name", ARMS)
def test_a_displaced_tool_frame_changes_nothing(name):
    task = iq.load_task(name)
    offset = motion(np.random.default_rng(4), reach=0.2)
    plain, displaced = iq.run_task(task, dt=0.01), run_displaced(task, offset, dt=0.01)
    assert np.abs(plain.q - displaced.q).max() < 1e-12


@pytest.mark.parametrize("name", ARMS)
def test_arms_without_a_pitch_pass_and_a_pitch_form_there_says_so_and_does_no_harm(name):
    plain, trace = (iq.run_task(iq.load_task(name), form=form, dt=0.005) for form in (None, 0.3))
    assert plain.passed, plain.shortfalls
    assert (set(plain.methods), set(plain.statuses), plain.warnings) == ({"closed-form"}, {"ok"}, [])
    assert any("no pitch form sees all of this arm" in w for w in trace.warnings)
    assert trace.passed
    np.testing.assert_allclose(trace.q, plain.q, atol=1e-9)


def test_without_a_form_the_tool_metric_is_used():
    robot = iq.load_task("planar_3r").load_robot()
    metric = iq.tool_metric(robot)
    reach = 0.4 + 0.35 + 0.15
    np.testing.assert_allclose(metric.matrix, np.diag(np.repeat((reach**2, 1.0), 3)))
    assert metric.follows_tool
    plain, carried = (iq.run_task(iq.load_task("planar_3r"), form=form, dt=0.01) for form in (None, "tool"))
    np.testing.assert_allclose(carried.q, plain.q, atol=1e-12)


def content(**law):
    screws = [{"axis": [0.0, 0.0, 1.0]}, {"axis": [0.0, 0.0, 1.0], "pitch": np.inf}]
    robot = {"screws": screws, "start": [0.0, 0.0]}
    return {"name": "x", "robot": robot, "path": {"kind": "line", "duration": 0.1}, "law": {"dt": 0.01, **law}}


def test_mixed_units_need_no_joint_metric_and_take_one():
    for law in ({}, {"joint_metric": [1.0, 9.0]}):
        assert iq.run_task(task_from(content(**law), "x")).passed
    with pytest.raises(iq.BadInput, match="joint_metric"):
        iq.run_task(task_from(content(joint_metric=[1.0]), "x"))


@pytest.mark.parametrize(
    ("law", "said"),
    [
        ({"form": "carried"}, r'\$\.law\.form: a pitch h in metres per radian or "tool" is expected, not .carried.'),
        ({"length": 0.0}, r"\$\.law\.length"),
        ({"delay": -1.0}, r"\$\.law\.delay"),
        ({"form": True}, r"\$\.law\.form: .* not True"),
        ({"form": float("nan")}, r"\$\.law\.form: .* not nan"),
        ({"joint_metric": [1.0, 0.0]}, r"\$\.law\.joint_metric\[1\]: .*greater than 0"),
        ({"joint_metrics": [1.0, 1.0]}, r"did you mean 'joint_metric'"),
    ],
)
def test_invalid_keys_of_the_law_are_refused(law, said):
    with pytest.raises(iq.errors.TaskFileError, match=said):
        task_from(content(**law), "x")
