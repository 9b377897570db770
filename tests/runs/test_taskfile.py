import numpy as np
import pytest
from support.task_files import PEN, content, pen

import invariantqp as iq
from invariantqp.runs.taskfile import shipped_tasks, task_from

SCREW = {"axis": [0.0, 0.0, 1.0]}
# what is changed, the path told, what is said, what would be right
PROBLEMS = {
    "typo in a section": ({"law__gian": 3.0}, "$.law.gian", "not permitted", "(did you mean 'gain'?)"),
    "typo at the top": ({"robots": {}}, "$.robots", "not permitted", "(did you mean 'robot'?)"),
    "unlike anything": (
        {"law__zzz": 1},
        "$.law.zzz",
        "not permitted",
        "(known keys: acceleration, backend, damping, dt,",
    ),
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
    "exact": ({"law__exact": "tool"}, "$.law.exact", "'position'", "(for example: exact = position)"),
    "guard": ({"law__guard": "yes"}, "$.law.guard", "boolean", ""),
    "damping": ({"law__damping": -1.0}, "$.law.damping", "greater than or equal to 0", "(for example: damping = 0.0)"),
    "start": ({"robot__start": "home"}, "$.robot.start", "valid list", "(for example: start = ["),
    "start nan": ({"robot__start": [float("nan")]}, "$.robot.start[0]", "finite", ""),
    "accept": ({"accept__position_error_mm": 0.0}, "$.accept.position_error_mm", "greater than 0", "= 0.1)"),
    "screw typo": ({"robot__screws": [{**SCREW, "axsi": 1}]}, "$.robot.screws[0].axsi", "", "(did you mean 'axis'?)"),
    "screw speed": ({"robot__screws": [{**SCREW, "speed": 0.0}]}, "$.robot.screws[0].speed", "greater than 0", "= 1.0"),
}

PROBLEMS |= {
    "contact typo": (
        pen(contact={"stifness": 1.0}),
        "$.contact.stifness",
        "not permitted",
        "(did you mean 'stiffness'?)",
    ),
    "contact kind": (pen(contact={"kind": "ball"}), "$.contact.kind", "'point'", "(for example: kind = point)"),
    "no normal": (pen(contact={"normal": [0, 0, 0]}), "$.contact.normal", "a direction is not zero", "[0.0, 0.0, 1.0]"),
    "a sized point": (pen(contact={"size": [0.1]}), "$.contact", "size of a point is 0 numbers, not 1", ""),
    "an edge without size": (pen(contact={"kind": "edge"}), "$.contact", "size of a edge is 1 numbers, not 0", ""),
    "a round face": (
        pen(contact={"kind": "face", "size": [0.1, 0.1], "radius": 0.3}),
        "$.contact",
        "radius is for a point on a round bar",
        "",
    ),
    "soft": (pen(contact={"stiffness": 0.0}), "$.contact.stiffness", "greater than 0", "= 20000.0)"),
    "no press": ({"contact": PEN["contact"], "force": {}}, "$.force.press", "required", "(for example: press = 5.0)"),
    "force typo": (pen(force={"presss": 5.0}), "$.force.presss", "not permitted", "(did you mean 'press'?)"),
    "form": (pen(force={"form": "h"}), "$.force.form", "'stiffness', 'pitch' or 'complement'", "= stiffness)"),
    "a pitch without its form": (
        pen(force={"pitch": 0.3}),
        "$.force.pitch",
        "go together",
        "(for example: pitch = 0.3)",
    ),
    "a form without its pitch": (pen(force={"form": "pitch"}), "$.force", 'form = "pitch" needs pitch = h', ""),
    "a form without its Z": (pen(force={"form": "complement"}), "$.force", "go together", ""),
    "deadband": (pen(force={"force_deadband": -1.0}), "$.force.force_deadband", "greater than or equal to 0", "= 0.2)"),
    "on_loss": (pen(force={"on_loss": "run"}), "$.force.on_loss", "'approach'", "(for example: on_loss = hold)"),
    "contact without force": ({"contact": PEN["contact"]}, "$", "[contact] and [force] go together", ""),
    "operator in contact": (pen(operator={}), "$", "[operator] is for a tool that touches nothing", ""),
    "operator plane": ({"operator": {"normal": [0, 0, 0]}}, "$.operator.normal", "not zero", "[0.0, 0.0, 1.0]"),
    "friction": (pen(physics={"friction": -0.1}), "$.physics.friction", "greater than or equal to 0", "= 0.3)"),
    "seed": (pen(physics={"seed": 1.5}), "$.physics.seed", "valid integer", "(for example: seed = 0)"),
    "referee": (
        {"accept_mujoco": {"force_eror": 0.1}},
        "$.accept_mujoco.force_eror",
        "not permitted",
        "(did you mean 'force_error'?)",
    ),
    "screw path": (
        {"path": {"kind": "screw", "duration": 1.0}},
        "$.path.angle",
        "required",
        "(for example: angle = 0.8)",
    ),
}


@pytest.mark.parametrize("case", PROBLEMS)
def test_every_problem_has_its_path_and_what_would_be_right(case):
    changes, where, said, right = PROBLEMS[case]
    with pytest.raises(iq.TaskFileError) as caught:
        task_from(content(**changes), "t.toml")
    error = caught.value
    assert error.source == "t.toml"
    problem = next(p for p in error.problems if p.startswith(f"{where}: "))
    assert said in problem
    assert right in problem
    assert problem in str(error)


def test_all_problems_are_told_at_once():
    with pytest.raises(iq.TaskFileError, match=r"t\.toml: 3 problems\n") as caught:
        task_from(content(law__gian=1.0, path__duration=-1.0, robot__start=None), "t.toml")
    assert len(caught.value.problems) == 3


def test_a_start_for_another_robot_names_the_joints():
    task = task_from(content(robot__start=[0.0]), "t.toml")
    with pytest.raises(iq.TaskFileError, match=r"\$\.robot\.start: 1 numbers \(give 7: panda_joint1, panda_joint2"):
        task.load_robot()


@pytest.mark.parametrize("both", [True, False])
def test_one_of_source_and_screws(both):
    changes = {"robot__screws": [SCREW]} if both else {"robot__source": None}
    with pytest.raises(iq.BadInput, match="robot: found both or neither of source and screws; expected one of them"):
        task_from(content(**changes), "t.toml").load_robot()


def test_files_that_are_none(tmp_path):
    with pytest.raises(iq.UnknownName, match=r"unknown task 'arm_3rr'; did you mean arm_3r"):
        iq.load_task("arm_3rr")
    with pytest.raises(iq.UnknownName, match="unknown task"):
        iq.load_task(tmp_path)
    broken = tmp_path / "broken.toml"
    broken.write_text('name = "a\n', encoding="utf-8")
    with pytest.raises(iq.TaskFileError, match=r"\$: not TOML"):
        iq.load_task(broken)
    broken.write_bytes(b"name = '\xff'")
    with pytest.raises(iq.TaskFileError, match=r"\$: not TOML"):
        iq.load_task(broken)
    broken.write_text("", encoding="utf-8")
    with pytest.raises(iq.TaskFileError, match=r"\$\.robot: field required"):
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
def test_shipped_tasks_decode_and_say_what_they_are(name):
    task = iq.load_task(name)
    assert task.name == name
    assert task.about
    robot = task.load_robot()
    start = task.start()
    assert ((robot.position_lower <= start) & (start <= robot.position_upper)).all()
    np.testing.assert_allclose(task.path.along(robot, start)(0.0), robot.pose(start), atol=1e-12)
