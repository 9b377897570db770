import copy
import inspect
import json
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.repeats import repeats
from support.task_files import PEN, content, pen

import invariantqp as iq
from invariantqp.workbench.runs.contactspec import SensorSpec
from invariantqp.workbench.runs.prepare import prepare
from invariantqp.workbench.runs.taskfile import LawSpec, shipped_tasks, task_from

SCREW, ZERO = {"axis": [0.0, 0.0, 1.0]}, [0, 0, 0]
GONE = {"kind": "hold", "duration": 1.0, "begin": 0.5, "end": 0.2}
COMPLEMENTS = {"h": 0.3, "complement": [[0, 0, 0, 0, 0, 1.0]]}
# changes, path of the error, its message, its advice
PROBLEMS = {
    "typo in a section": ({"law__gian": 3.0}, "$.law.gian", "not permitted", "(did you mean 'gain'?)"),
    "typo at the top": ({"robots": {}}, "$.robots", "not permitted", "(did you mean 'robot'?)"),
    "unlike anything": ({"law__zzz": 1}, "$.law.zzz", "not permitted", "(known keys: acceleration_limit, backend, dam"),
    "typo in a path": ({"path__mvoe": [0, 0, 0]}, "$.path.mvoe", "not permitted", "(did you mean 'move'?)"),
    "missing": ({"path__duration": None}, "$.path.duration", "required", "(for example: duration = 4.0)"),
    "no robot": ({"robot": None}, "$.robot", "required", ""),
    "text for a number": ({"law__dt": "0.01"}, "$.law.dt", "valid number", "(for example: dt = 0.001)"),
    "true for a number": ({"law__dt": True}, "$.law.dt", "valid number", "(for example: dt = 0.001)"),
    "negative tick": ({"law__dt": -0.001}, "$.law.dt", "greater than 0", "(for example: dt = 0.001)"),
    "nan tick": ({"law__dt": float("nan")}, "$.law.dt", "finite", "(for example: dt = 0.001)"),
    "infinite duration": ({"path__duration": float("inf")}, "$.path.duration", "finite", "(for example: duration"),
    "two numbers": ({"path__move": [0.1, 0.2]}, "$.path.move[2]", "required", ""),
    "nan in a vector": ({"path__move": [0.1, float("nan"), 0.0]}, "$.path.move[1]", "finite", ""),
    "unknown kind": ({"path__kind": "spiral"}, "$.path", "does not match any of the expected tags", "'circle'"),
    "exact": ({"law__exact": "tool"}, "$.law.exact", "'position'", '(for example: exact = "position")'),
    "guard": ({"law__guard": "yes"}, "$.law.guard", "boolean", ""),
    "damping": ({"law__damping": -1.0}, "$.law.damping", "greater than or equal to 0", "(for example: damping = 0.0)"),
    "start": ({"robot__start": "home"}, "$.robot.start", "valid list", "(for example: start = ["),
    "start nan": ({"robot__start": [float("nan")]}, "$.robot.start[0]", "finite", ""),
    "accept": ({"accept__position_error_mm": 0.0}, "$.accept.position_error_mm", "greater than 0", "= 0.1)"),
    "screw typo": ({"robot__screws": [{**SCREW, "axsi": 1}]}, "$.robot.screws[0].axsi", "", "(did you mean 'axis'?)"),
    "screw speed": ({"robot__screws": [{**SCREW, "speed": 0.0}]}, "$.robot.screws[0].speed", "greater than 0", "= 1.0"),
    "screw end": ({"robot__screws": [{**SCREW, "lower": float("nan")}]}, "$.robot.screws[0].lower", "or inf", ""),
    "an empty name": ({"name": ""}, "$.name", "at least 1 character", '(for example: name = "panda_path")'),
    "an empty source": ({"robot__source": ""}, "$.robot.source", "at least 1 character", 'source = "panda"'),
    "a start beyond any scale": ({"robot__start": [0.0, 1e300]}, "$.robot.start[1]", "less than or equal to", ""),
    "a move beyond any scale": (
        {"path__move": [-1e300, 0, 0]},
        "$.path.move[0]",
        "greater than or equal to",
        "[0.1, 0",
    ),
    "no limit": ({"law__acceleration_limit": "fast"}, "$.law.acceleration_limit", "valid number or", "= 10.0)"),
    "a dead time without end": ({"physics": {"delay": 1e9}}, "$.physics.delay", "less than 10", "= 0.004)"),
    "gone before it comes": ({"path": GONE}, "$.path", "end = 0.2 is not after begin = 0.5", ""),
    "contact typo": (
        pen(contact={"stifness": 1.0}),
        "$.contact.stifness",
        "not permitted",
        "(did you mean 'stiffness'?)",
    ),
    "contact kind": (pen(contact={"kind": "ball"}), "$.contact.kind", "'point'", '(for example: kind = "point")'),
    "no normal": (
        pen(contact={"normal": ZERO}),
        "$.contact.normal",
        "a direction cannot be the zero vector",
        "[0, 0, 1]",
    ),
    "a sized point": (pen(contact={"size": [0.1]}), "$.contact", "size of a point has 0 numbers, not 1", ""),
    "an edge without size": (pen(contact={"kind": "edge"}), "$.contact", "size of an edge has 1 number, not 0", ""),
    "soft": (pen(contact={"stiffness": 0.0}), "$.contact.stiffness", "greater than 0", "= 20000.0)"),
    "no press": ({"contact": PEN["contact"], "force": {}}, "$.force.press", "required", "(for example: press = 5.0)"),
    "force typo": (pen(force={"presss": 5.0}), "$.force.presss", "not permitted", "(did you mean 'press'?)"),
    "two complements": (pen(force=COMPLEMENTS), "$.force", "h and complement both define Z", ""),
    "deadband": (
        pen(sensor={"force_deadband": -1.0}),
        "$.sensor.force_deadband",
        "greater than or equal to 0",
        "= 0.2)",
    ),
    "on_loss": (pen(force={"on_loss": "run"}), "$.force.on_loss", "'approach'", '(for example: on_loss = "hold")'),
    "contact without force": ({"contact": PEN["contact"]}, "$", "[contact] and [force] go together", ""),
    "operator in contact": (pen(operator={}), "$", "[operator] is for a tool that touches nothing", ""),
    "operator plane": ({"operator": {"normal": ZERO}}, "$.operator.normal", "cannot be the zero vector", "[0, 0, 1]"),
    "friction": (pen(physics={"friction": -0.1}), "$.physics.friction", "greater than or equal to 0", "= 0.3)"),
    "seed": (pen(physics={"seed": 1.5}), "$.physics.seed", "valid integer", "(for example: seed = 0)"),
    "referee": (
        {"accept_mujoco": {"force_eror": 1}},
        "$.accept_mujoco.force_eror",
        "",
        "(did you mean 'force_error'?)",
    ),
    "screw path": (
        {"path": {"kind": "screw", "duration": 1.0}},
        "$.path.angle",
        "required",
        "(for example: angle = 0.8)",
    ),
}


def test_a_laws_keys_are_the_controllers_arguments():
    arguments = set(inspect.signature(iq.Controller).parameters)
    for key in LawSpec.model_fields:
        assert key in arguments | {"point", "tool_speed_point"}, key
    sensor = set(inspect.signature(iq.WrenchSensor).parameters)
    assert set(SensorSpec.model_fields) - sensor == {"mount_turn"}


@pytest.mark.parametrize("case", PROBLEMS)
def test_every_error_has_its_path_and_advice(case):
    changes, where, said, right = PROBLEMS[case]
    with pytest.raises(iq.errors.TaskFileError) as caught:
        task_from(content(**changes), "t.toml")
    error = caught.value
    assert error.source == "t.toml"
    problem = next(p for p in error.problems if p.startswith(f"{where}: "))
    assert said in problem
    assert right in problem
    assert problem in str(error)


def test_all_errors_are_listed_at_once():
    with pytest.raises(iq.errors.TaskFileError, match=r"t\.toml: 3 problems\n") as caught:
        task_from(content(law__gian=1.0, path__duration=-1.0, robot__start=None), "t.toml")
    assert len(caught.value.problems) == 3


SEVERAL = {
    "a key, and what the rest has": (
        {"path__mov": [0.1, 0.0, 0.0], "law__dt": 5, "robot__start": [0, -70, 0, -100, 0, 90, 45]},
        ["$.path.mov: extra", "$.path.duration: found 0.05 s, 0.01 ticks", "$.robot.start: found joint 3 "],
    ),
    "a value, a name": (
        {"law__gain": "fast", "robot__source": "pandas", "accept__force_error": -1.0},
        ["$.law.gain: ", "$.accept.force_error: ", "$.robot: unknown robot 'pandas'"],
    ),
    "two of one table, a law of other joints": (
        {"law__damping": -1.0, "law__guard": 3, "law__posture": [0.0]},
        ["$.law.damping: ", "$.law.guard: ", "$.law.posture: found shape (1,)"],
    ),
    "none but with the robot": (
        {"robot__start": [0, -70, 0, -100, 0, 90, 45], "path": {"kind": "joints", "duration": 1, "waypoints": [[0]]}},
        ["$.robot.start: found joint 3 ", "$.path.waypoints[0]: found 1 number"],
    ),
    "a required one": ({"path__duration": "long", "law__gian": 1}, ["$.path.duration: ", "$.law.gian: "]),
    "a table that is none": ({"law": 5, "path__mov": 1}, ["$.path.mov: ", "$.law: "]),
}


@pytest.mark.parametrize("case", SEVERAL)
def test_errors_beside_a_wrong_key_are_listed_with_it(case):
    changes, said = SEVERAL[case]
    with pytest.raises(iq.errors.TaskFileError) as caught:
        prepare(task_from(content(**changes), "t.toml"))
    lines = caught.value.problems
    assert len(lines) == len(said)
    assert all(any(line.startswith(start) for line in lines) for start in said), lines


def test_a_start_for_another_robot_names_the_joints():
    task = task_from(content(robot__start=[0.0]), "t.toml")
    with pytest.raises(
        iq.errors.TaskFileError, match=r"\$\.robot\.start: 1 number \(give 7: panda_joint1, panda_joint2"
    ):
        task.load_robot()


@pytest.mark.parametrize("both", [True, False])
def test_one_of_source_and_screws(both):
    changes = {"robot__screws": [SCREW]} if both else {"robot__source": None}
    said = "both source and screws are given" if both else "neither source nor screws is given"
    with pytest.raises(iq.errors.TaskFileError, match=rf"\$\.robot: {said}; give one of them"):
        task_from(content(**changes), "t.toml")


def test_an_unreadable_task_file_is_refused(tmp_path):
    with pytest.raises(iq.errors.UnknownName, match=r"unknown task 'arm_3rr'; did you mean arm_3r"):
        iq.load_task("arm_3rr")
    with pytest.raises(iq.errors.UnknownName, match="unknown task"):
        iq.load_task(tmp_path)
    broken = tmp_path / "broken.toml"
    broken.write_text('name = "a\n', encoding="utf-8")
    with pytest.raises(iq.errors.TaskFileError, match=r"\$: not TOML"):
        iq.load_task(broken)
    broken.write_bytes(b"name = '\xff'")
    with pytest.raises(iq.errors.TaskFileError, match=r"\$: not TOML"):
        iq.load_task(broken)
    broken.write_text("", encoding="utf-8")
    with pytest.raises(iq.errors.TaskFileError, match=r"\$\.robot: field required"):
        iq.load_task(broken)


def test_a_urdf_beside_the_task_file(tmp_path):
    (tmp_path / "own.urdf").write_text(
        '<robot name="own"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>',
        encoding="utf-8",
    )
    file = tmp_path / "t.toml"
    file.write_text(
        'name = "t"\n[robot]\nsource = "own.urdf"\nstart = [0.2]\n[path]\nkind = "line"\nduration = 1.0\n',
        encoding="utf-8",
    )
    assert iq.load_task(str(file)).load_robot().names == ("j",)


@pytest.mark.parametrize("name", shipped_tasks())
def test_shipped_tasks_have_a_name_a_sentence_and_a_valid_start(name):
    task = iq.load_task(name)
    assert task.name == name
    assert task.about
    robot = task.load_robot()
    start = task.start()
    assert ((robot.position_lower <= start) & (start <= robot.position_upper)).all()
    np.testing.assert_allclose(task.path.along(robot, start)(0.0), robot.pose(start), atol=1e-12)


@pytest.mark.parametrize("given", [None, 3, ["panda_path"], b"panda_path"])
def test_a_task_is_named_by_text_or_a_path(given):
    with pytest.raises(iq.BadInput, match=r"path_or_name: found .*; expected the name of a task, or the path"):
        iq.load_task(given)


@pytest.mark.parametrize("name", ["", ".", "/", "a" * 300, "no\0name"])
def test_an_impossible_file_name_is_an_unknown_task(name):
    with pytest.raises((iq.errors.UnknownName, iq.errors.TaskFileError)):
        iq.load_task(name)


@pytest.mark.parametrize(("duration", "dt"), [(0.001, 0.01), (1e9, 1e-3), (0.05, 1e-12)])
def test_a_run_has_at_least_a_tick_and_not_too_many(duration, dt):
    task = task_from(content(path__duration=duration, law__dt=dt), "t.toml")
    with pytest.raises(iq.BadInput, match=r"path\.duration: found .* ticks; expected 1 to 10000000 ticks of"):
        iq.run_task(task)


def numbers(table, *path):
    """Where the numbers of a decoded file are."""
    for key, value in table.items() if isinstance(table, dict) else enumerate(table):
        if isinstance(value, (dict, list)):
            yield from numbers(value, *path, key)
        elif isinstance(value, float):
            yield (*path, key)


SCREWS = {
    "robot__source": None,
    "robot__start": [0.1, 0.2],
    "robot__screws": [SCREW, {**SCREW, "point": [0.5, 0.0, 0.0]}],
}
FILES = {
    "a line": content(**SCREWS, robot__tool_point=[1.0, 0.0, 0.0], path__turn=[0.0, 0.0, 0.1]),
    "joints": content(**SCREWS, path={"kind": "joints", "duration": 0.05, "waypoints": [[0.2, 0.3]]}),
    "a law": content(law={"dt": 0.002, "form": 0.3, "damping": 0.01, "gain": 20.0, "tool_speed": 0.3}),
    "a pen": content(**pen(contact={"gap": 0.001, "settle": 0.02}, force={"rate": 60.0}, sensor={"mass": 0.1})),
}
ODD = [0.0, -0.0, 1.0, -1.0, 1e-300, 1e-12, 1e-3, 1e3, 1e12, -1e12, 1e300, float("inf"), -float("inf"), float("nan")]


@pytest.mark.parametrize("position", [-1.0, 7.0])
def test_a_start_far_outside_its_limits_is_refused(position):
    """A radian outside its range a joint stood still for the whole run, and its forces were no numbers."""
    file = copy.deepcopy(FILES["a pen"])
    file["robot"]["start"][5] = position
    with pytest.raises(iq.BadInput, match="outside its position range"):
        iq.run_task(task_from(file, "odd"))


@settings(max_examples=repeats(100, 50), deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_odd_numbers_run_or_are_refused(data):
    """Whatever number stands in a file: a run with finite velocities inside limits, or one of our errors."""
    file = copy.deepcopy(FILES[data.draw(st.sampled_from(sorted(FILES)))])
    *parents, last = data.draw(st.sampled_from(list(numbers(file))))
    table = file
    for key in parents:
        table = table[key]
    table[last] = data.draw(st.sampled_from(ODD))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            task = task_from(file, "odd")
            if task.ticks > 200:
                return
            trace = iq.run_task(task)
        except iq.InvariantQPError:
            return
    assert np.isfinite(trace.velocity).all()
    assert json.dumps(trace.as_json(), allow_nan=False)


def test_a_run_may_follow_its_whole_twist_exactly():
    trace = iq.run_task(task_from(content(law__exact="twist"), "t"))
    assert trace.passed
    assert set(trace.statuses) == {"ok"}
    with pytest.raises(iq.BadInput, match="cannot follow a whole twist"):
        iq.run_task(task_from(content(law__exact="twist", robot={"source": "so101", "start": [0.0] * 5}), "t"))
