"""Files to start from run as they are, and say what every key means."""

import re

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.workbench.runs.newtask import PATHS, TABLES, new_task, well_conditioned_start
from invariantqp.workbench.runs.section import toml
from invariantqp.workbench.runs.taskfile import Task, task_from, tomllib


@pytest.mark.parametrize(
    ("robot", "path", "contact"),
    [
        ("panda", "circle", None),
        ("ur5", "line", None),
        ("so101", "line", "point"),
        ("ur3", "screw", "face"),
        ("panda", "screw", "hinge"),
    ],
)
def test_a_new_task_is_accepted_as_it_is(robot, path, contact):
    task = task_from(tomllib.loads(new_task("mine", robot, path=path, contact=contact)), "mine")
    trace = iq.run_task(task, dt=0.004)
    assert trace.passed, trace.shortfalls


@pytest.mark.cases(2)
@pytest.mark.parametrize("path", PATHS)
def test_what_is_commented_out_may_be_taken_in(path):
    """Each key, with the default or example that stands there, alone."""
    text = new_task("mine", "panda", path=path, contact="point")
    keys = re.findall(r"^# [a-z_]+ = .*$", text, re.MULTILINE)
    assert len(keys) > 30
    for line in keys:
        alone = text.replace(f"\n{line}", f"\n{line[2:]}", 1)
        if line.startswith(("# screws", "# joints", "# joint_metric", "# tool ", "# h =", "# complement", "# size")):
            tomllib.loads(alone)  # for another arm or contact
        elif not (path == "hold" and line.startswith("# end")):
            task_from(tomllib.loads(alone), "mine")


def test_every_key_is_explained():
    for section, header in TABLES.items():
        for name, field in section.model_fields.items():
            assert name == "kind" or field.description, f"{header}.{name}"
    assert {*TABLES.values()} >= {
        name for name, field in Task.model_fields.items() if hasattr(field.annotation, "model_fields")
    }


def test_the_start_is_far_from_singular():
    robot = iq.load_robot("ur5")
    q = well_conditioned_start(robot)
    assert (robot.position_lower < q).all()
    assert (q < robot.position_upper).all()
    assert np.linalg.cond(robot.jacobian(q)) < 20.0  # at the middle of the range the arm is stretched out: 1e16


@pytest.mark.parametrize("value", [True, -0.5, 3, float("inf"), 'say "a"', "tschüß", [[1.0, 2.0], []], {"a": [1.0]}])
def test_values_are_read_as_they_were_written(value):
    assert tomllib.loads(f"key = {toml(value)}")["key"] == value


def test_kinds_that_there_are_not():
    with pytest.raises(iq.BadInput, match=r"path: found 'spiral'; expected .*line"):
        new_task("mine", "panda", path="spiral")
    with pytest.raises(iq.BadInput, match=r"contact: found 'ball'; expected .*point"):
        new_task("mine", "panda", contact="ball")
