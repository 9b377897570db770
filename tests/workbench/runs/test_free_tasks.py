"""Tasks whose path leaves something free: the rest is followed, only that is measured, and frames change nothing."""

from functools import cache

import numpy as np
import pytest
from support.arms import READY
from support.task_files import content, pen

import invariantqp as iq
from invariantqp.workbench.runs.taskfile import task_from

TARGETS = ("point", "point and axis", "axis")
POINT, AXIS = (0.0, 0.02, 0.05), (0.6, 0.0, 0.8)
# Of a path of this many joints at least something is free.
SIZES = {"point": 3, "point and axis": 5, "axis": 2}


def task_of(name, target="pose", timing="fixed", **path):
    line = {"kind": "line", "move": [0.0, 0.1, 0.04], "turn": [0.2, 0.0, 0.5], "there_and_back": True}
    path = path if "kind" in path else line
    return task_from(
        {
            "name": "t",
            "robot": {"source": name, "start": list(READY[name])},
            "path": {"duration": 2.0, "timing": timing, "target": target, "tool_axis": AXIS, **path},
            "law": {"dt": 0.004, "acceleration_limit": 10.0, "point": POINT, "posture": False},
            "accept": {"position_error_mm": 0.05, "orientation_error_deg": 0.05},
        },
        "t.toml",
    )


@cache
def way_of_the_whole_pose(name, timing):
    return way(iq.run_task(task_of(name, "pose", timing)))


def places(trace):
    """(n, 3) where the point is after each tick, and (n, 3) where the axis points."""
    poses = np.array([iq.load_robot(trace.task.robot.source).pose(q) for q in trace.q[1:]])
    return poses[:, :3, :3] @ POINT + poses[:, :3, 3], poses[:, :3, :3] @ AXIS


def way(trace):
    """How long the way of the joints is, by the norm that the law keeps small."""
    return np.linalg.norm(np.diff(trace.q, axis=0), axis=1).sum()


@pytest.mark.parametrize("timing", ["fixed", "elastic"])
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("name", ["so101", "ur5", "panda"])
def test_what_counts_is_followed_and_measured_and_nothing_is_turned_for_nothing(name, target, timing):
    trace = iq.run_task(task_of(name, target, timing))
    assert trace.passed, trace.shortfalls
    assert trace.limit_violation <= 1e-9
    here, along = places(trace)
    there = trace.wanted[1:, :3, :3] @ POINT + trace.wanted[1:, :3, 3]
    distance = np.linalg.norm(here - there, axis=1) if "point" in target else np.zeros(len(here))
    wanted = trace.wanted[1:, :3, :3] @ AXIS
    angle = np.linalg.norm(along - wanted, axis=1) if "axis" in target else np.zeros(len(here))
    np.testing.assert_allclose(trace.position_error, distance, atol=1e-12)
    np.testing.assert_allclose(trace.orientation_error, angle, atol=1e-8)
    if len(trace.names) > SIZES[target]:
        assert way(trace) <= way_of_the_whole_pose(name, timing)


@pytest.mark.parametrize("timing", ["fixed", "elastic"])
@pytest.mark.parametrize("target", TARGETS)
def test_another_tool_frame_changes_nothing(target, timing):
    (check,) = iq.workbench.frame_check(task_of("ur5", target, timing))
    assert check.change < 1e-9


def test_a_goal_of_a_point_and_its_axis_is_reached_by_a_jump():
    trace = iq.run_task(task_of("so101", "point and axis", kind="hold", move=[0.02, 0.03, 0.01]))
    assert trace.position_error[-1] < 1e-5
    assert trace.orientation_error[-1] < 1e-4


def test_an_elastic_path_is_as_fast_as_what_counts_of_it():
    spin = {"kind": "line", "move": [0.0, 0.1, 0.0], "turn": [0.0, 0.0, 3.0], "duration": 0.5}
    ticks = {
        target: len(iq.run_task(task_of("ur5", target, "elastic", **spin)).velocity) for target in ("pose", "point")
    }
    assert ticks["point"] <= 130
    assert ticks["pose"] > 2 * ticks["point"]


@pytest.mark.parametrize(
    "more",
    [
        pen(),
        {"operator": {"normal": [0, 0, 1]}},
        {"law": {"form": 0.3}},
        {"law": {"exact": "position"}},
        {"law": {"exact": "twist"}},
    ],
)
def test_keys_that_need_the_whole_pose_are_refused(more):
    with pytest.raises(iq.errors.TaskFileError, match='target = "point" is for a path alone; leave out'):
        task_from(content(path__target="point") | more, "t.toml")


@pytest.mark.parametrize(
    ("key", "value"), [("target", "points"), ("target", None), ("tool_axis", [0, 0, 0]), ("tool_axis", [1, 0])]
)
def test_a_wrong_key_has_its_path(key, value):
    wrong = content()
    wrong["path"][key] = value
    with pytest.raises(iq.errors.TaskFileError, match=rf"\$\.path\.{key}"):
        task_from(wrong, "t.toml")


@pytest.mark.parametrize("target", ["pose", *TARGETS])
def test_a_posture_makes_no_path_late(target):
    task = task_of("panda", target, "elastic", kind="line", move=[0.0, 0.1, 0.04], turn=[0.1, 0.0, 0.2], duration=1.0)
    law = task.law.model_copy(update={"posture": True})
    assert iq.run_task(task.model_copy(update={"law": law})).along.lag[-1] < 0.01  # two ticks of settling
