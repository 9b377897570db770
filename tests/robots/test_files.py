"""Robot files as users bring them: read, or refused with what was found and what helps."""

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.robots.load import urdf_of

JOINT = """<joint name="{name}" type="{kind}"><parent link="{above}"/><child link="{below}"/><origin xyz="0 0 0.2"/>
<axis xyz="{axis}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""


def urdf(*rows, axis="0 1 0"):
    """The text of a URDF with joints (name, link above, link below, kind)."""
    links = dict.fromkeys(link for _, above, below, _ in rows for link in (above, below))
    joints = (JOINT.format(name=n, above=a, below=b, kind=k, axis=axis) for n, a, b, k in rows)
    tags = "".join(f'<link name="{link}"/>' for link in links)
    return f'<robot name="r">{tags}{"".join(joints)}</robot>'


def serial(count, *more):
    """An arm of so many joints j1, j2, ... on links l0, l1, ..., and more rows."""
    return urdf(*((f"j{i + 1}", f"l{i}", f"l{i + 1}", "revolute") for i in range(count)), *more)


HANDS = {
    "two fingers on a fixed palm": (
        serial(6, ("p", "l6", "palm", "fixed"), ("a", "palm", "f1", "prismatic"), ("b", "palm", "f2", "prismatic")),
        "palm",
        6,
    ),
    "a jaw": (serial(5, ("gripper", "l5", "moving_jaw", "revolute")), "l5", 5),
    "a palm called gripper": (serial(4, ("roll", "l4", "gripper", "revolute")), "gripper", 5),
    "fingers of three joints": (
        serial(
            7,
            *((f"{f}{i}", "l7" if i == 0 else f"{f}l{i - 1}", f"{f}l{i}", "revolute") for f in "ab" for i in range(3)),
        ),
        "l7",
        7,
    ),
    "two arms on a torso": (
        urdf(
            ("torso", "l0", "chest", "revolute"),
            *(
                (f"{s}{i}", "chest" if i == 0 else f"{s}l{i - 1}", f"{s}l{i}", "revolute")
                for s in "LR"
                for i in range(6)
            ),
        ),
        "Ll5",
        7,
    ),
    "two arms on a torso of three joints": (
        serial(
            3,
            *((f"{s}{i}", "l3" if i == 0 else f"{s}l{i - 1}", f"{s}l{i}", "revolute") for s in "LR" for i in range(6)),
        ),
        "Ll5",
        9,
    ),
    "a finger alone": (urdf(*((f"finger{i}", f"l{i}", f"l{i + 1}", "revolute") for i in range(3))), "l3", 3),
}


@pytest.mark.parametrize("case", HANDS)
def test_the_usual_tool_is_the_last_link_before_a_hand(case):
    text, tool, joints = HANDS[case]
    robot = iq.load_robot(text)
    assert (robot.tool, len(robot.names)) == (tool, joints)
    others = [note for note in robot.notes if "chains as long" in note]
    assert bool(others) == case.startswith("two arms")
    left_out = [note for note in robot.notes if "left out" in note]
    assert bool(left_out) == (case in ("two fingers on a fixed palm", "a jaw", "fingers of three joints"))


@pytest.mark.parametrize(
    ("name", "tool"), [("panda", "panda_hand"), ("so101", "gripper_link"), ("tiago", "hand_palm_link")]
)
def test_the_usual_tool_of_arms_with_hands(name, tool):
    assert iq.load_robot(urdf_of(name)).tool == tool


def test_an_undeclared_prefix_is_read():
    text = serial(2).replace("<limit", '<limit drake:acceleration="2.5"')
    assert iq.load_robot(text) == iq.load_robot(serial(2))
    tagged = serial(2).replace("</robot>", "<gazebo:plugin x='1'/></robot>")
    assert iq.load_robot(tagged) == iq.load_robot(serial(2))


XACRO = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="a.xacro"/></robot>'


def test_a_xacro_file_is_refused_with_the_command_that_expands_it(tmp_path):
    file = tmp_path / "arm.urdf.xacro"
    for text in (XACRO, serial(2).replace("0 0 0.2", "0 0 ${length}")):
        file.write_text(text)
        with pytest.raises(iq.errors.RobotModelError, match=r"a xacro file.*xacro arm.urdf.xacro > arm.urdf"):
            iq.load_robot(file)
    expanded = serial(2).replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"')
    assert len(iq.load_robot(expanded).names) == 2


def test_a_part_of_an_mjcf_is_refused_with_the_files_that_include_it(tmp_path):
    part, scene = tmp_path / "arm" / "part.xml", tmp_path / "scene.xml"
    part.parent.mkdir()
    part.write_text("<mujocoinclude><body><joint axis='0 0 1'/></body></mujocoinclude>")
    scene.write_text('<mujoco><worldbody/><include file="arm/part.xml"/></mujoco>')
    (tmp_path / "other.xml").write_text('<mujoco><include file="arm/another_part.xml"/></mujoco>')
    with pytest.raises(iq.errors.RobotModelError, match=r"part of an MJCF.*Load a file that includes it: scene.xml$"):
        iq.load_robot(part)
    part.write_text("<mujoco><worldbody><geom material='steel' size='1'/></worldbody></mujoco>")
    with pytest.raises(
        iq.errors.RobotModelError, match=r"cannot make a model of it \(.*\). If it is a part.*scene.xml"
    ):
        iq.load_robot(part)


@pytest.mark.parametrize("limit", ['lower="0" upper="0"', "", 'lower="0.3" upper="0.3"'])
def test_joints_with_equal_limits_give_a_warning(limit):
    text = serial(3).replace('lower="-1" upper="1"', limit, 1)
    with pytest.warns(UserWarning, match=r"j1 cannot move.*with_limits.*joints=\[\.\.\.\]"):
        iq.load_robot(text)


@pytest.mark.parametrize("call", [
    lambda robot, q: robot.pose(q),
    lambda robot, q: robot.jacobian(q),
    lambda robot, q: iq.Controller(robot, dt=0.01).step(q, np.eye(4)),
    lambda robot, q: iq.solve_pose(robot, robot.home, q0=q),
])  # fmt: skip
def test_a_wrong_number_of_positions_names_the_joints(call):
    robot = iq.load_robot(serial(3))
    with pytest.raises(iq.BadInput, match=r"found shape \(4,\); expected \(3,\): j1, j2, j3. load_robot\(.*joints="):
        call(robot, np.zeros(4))


def test_a_free_joint_is_refused_with_the_others_that_can_move():
    text = """<mujoco><worldbody><body><freejoint name="base"/><geom size=".1"/>
    <body name="a"><joint name="hip" axis="0 1 0"/><geom size=".1"/></body></body></worldbody></mujoco>"""
    with pytest.raises(iq.errors.RobotModelError, match=r"'base' has no single coordinate.*joints=\['hip'\]"):
        iq.load_robot(text)
