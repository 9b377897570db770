import warnings

import numpy as np
import pinocchio
import pytest
from support.arms import numerical_twists

import invariantqp as iq
from invariantqp.geometry.se3 import inverse
from invariantqp.robots.kinematics import middle
from invariantqp.robots.load import KNOWN, urdf_of

JOINTS = {
    "panda": 7,
    "ur3": 6,
    "ur5": 6,
    "ur10": 6,
    "xarm7": 7,
    "so100": 5,
    "so101": 5,
    "kinova": 6,
    "z1": 6,
    "tiago": 8,
    "talos": 7,
    **dict.fromkeys(("ur3e", "ur5e", "ur10e", "ur16e", "lite6"), 6),
    **dict.fromkeys(("fr3", "iiwa7", "iiwa14", "gen3"), 7),
}
SLIDER = """<robot name="slider">
  <link name="base"/><link name="cart"/><link name="hook"/><link name="side"/>
  <joint name="rail" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
    <limit lower="-0.5" upper="0.5" effort="1" velocity="0.3"/></joint>
  <joint name="swing" type="revolute"><parent link="cart"/><child link="hook"/>
    <origin xyz="0 0 0.2"/><axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="1" velocity="1.5"/></joint>
  <joint name="other" type="continuous"><parent link="cart"/><child link="side"/><axis xyz="0 0 1"/></joint>
</robot>"""


def urdf(tmp_path, text, name="arm.urdf"):
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    return file


def inside(robot, rng):
    low = np.where(np.isfinite(robot.position_lower), robot.position_lower, -3.0)
    high = np.where(np.isfinite(robot.position_upper), robot.position_upper, 3.0)
    return rng.uniform(low, high)


def test_every_known_robot_is_listed_here():
    assert set(JOINTS) == set(KNOWN)


@pytest.mark.parametrize("name", KNOWN)
def test_a_known_robot_has_limits_and_consistent_kinematics(name):
    robot = iq.load_robot(name)
    m = JOINTS[name]
    assert len(robot.names) == len(set(robot.names)) == m
    for limits in (robot.position_lower, robot.position_upper, robot.velocity_limit):
        assert limits.shape == (m,)
    assert (robot.position_lower < robot.position_upper).all()
    assert (robot.velocity_limit > 0.0).all()
    rng = np.random.default_rng(0)
    for _ in range(3):
        q = inside(robot, rng)
        J, T = robot.jacobian(q), robot.pose(q)
        assert J.shape == (6, m)
        np.testing.assert_allclose(T, iq.transform(T[:3, :3], T[:3, 3]), atol=1e-12)
        np.testing.assert_allclose(J, numerical_twists(robot, q), atol=1e-8)
        assert np.linalg.norm(J, axis=0).min() > 0.0  # every joint modelled moves the tool


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 1e-3, 1.0, 3.0, np.pi - 1e-4, np.pi - 1e-7])
def test_the_error_twist_leads_to_the_target(angle):
    rng = np.random.default_rng(2)
    for robot in (iq.load_robot("panda"), iq.load_robot(np.eye(6), iq.exp([0.1, 0.2, 0.3, 1, 2, 3]))):
        for _ in range(5):
            q = rng.uniform(-1.0, 1.0, size=len(robot.names))
            u = rng.normal(size=3)
            error = np.concatenate((angle * u / np.linalg.norm(u), rng.normal(size=3)))
            wanted = iq.exp(error) @ robot.pose(q)
            error = robot.state(q, robot.target(wanted)).error
            np.testing.assert_allclose(iq.exp(error) @ robot.pose(q), wanted, atol=1e-9)


def test_limits_are_those_of_the_file():
    panda = iq.load_robot("panda")
    assert panda.names[0] == "panda_joint1"
    np.testing.assert_allclose(panda.position_upper[:3], [2.8973, 1.7628, 2.8973])
    np.testing.assert_allclose(panda.velocity_limit[[0, 6]], [2.175, 2.61])
    kinova = iq.load_robot("kinova")
    assert (kinova.position_lower[[0, 3, 5]] == -np.inf).all()
    assert (kinova.position_upper[[0, 3, 5]] == np.inf).all()
    assert np.isfinite(kinova.position_upper[[1, 2, 4]]).all()
    assert np.isfinite(middle(kinova)).all()


def test_the_arm_of_a_humanoid_has_its_own_joints():
    talos = iq.load_robot("talos")
    assert talos.names == tuple(f"arm_left_{i}_joint" for i in range(1, 8))
    whole = iq.load_robot("talos", tool="gripper_left_base_link")
    assert whole.names[:2] == ("torso_1_joint", "torso_2_joint")
    assert len(whole.names) == 9


def test_chosen_joints_come_base_first():
    part = iq.load_robot("panda", joints=["panda_joint4", "panda_joint2"])
    assert part.names == ("panda_joint2", "panda_joint4")  # base first, whatever the order asked
    np.testing.assert_allclose(part.jacobian([0.3, -1.0]), numerical_twists(part, np.array([0.3, -1.0])), atol=1e-8)


@pytest.mark.parametrize("source", ["panda", "so101", "chain"])
def test_a_displaced_tool_is_the_same_arm(source):
    rng = np.random.default_rng(3)
    robot = iq.load_robot(np.eye(6), np.eye(4)) if source == "chain" else iq.load_robot(source)
    X = iq.exp(rng.normal(size=6))
    q = rng.uniform(-0.5, 0.5, size=len(robot.names))
    before = robot.pose(q)
    moved = robot.with_tool(X)
    np.testing.assert_allclose(moved.pose(q), before @ X, atol=1e-12)
    np.testing.assert_allclose(moved.jacobian(q), robot.jacobian(q), atol=1e-12)
    np.testing.assert_allclose(moved.with_tool(inverse(X)).pose(q), before, atol=1e-12)
    np.testing.assert_allclose(robot.pose(q), before)  # the first one is as it was
    assert moved.names == robot.names
    np.testing.assert_array_equal(moved.velocity_limit, robot.velocity_limit)
    wanted = iq.exp(0.3 * rng.normal(size=6)) @ before
    np.testing.assert_allclose(
        moved.state(q, moved.target(wanted @ X)).error, robot.state(q, robot.target(wanted)).error, atol=1e-10
    )


def test_a_urdf_file_with_a_slide(tmp_path):
    robot = iq.load_robot(urdf(tmp_path, SLIDER), tool="hook")
    assert robot.names == ("rail", "swing")
    np.testing.assert_allclose(robot.jacobian([0.1, 0.0])[:, 0], iq.se3.prismatic((1, 0, 0)), atol=1e-15)
    np.testing.assert_allclose(robot.jacobian([0.1, 0.0])[:, 1], iq.revolute((0, 1, 0), (0.1, 0, 0.2)), atol=1e-15)
    assert robot.position_upper.tolist() == [0.5, 2.0]
    with pytest.warns(UserWarning, match="no velocity limit for other"):
        side = iq.load_robot(str(urdf(tmp_path, SLIDER)), tool="side")
    assert side.position_upper.tolist() == [0.5, np.inf]
    assert side.velocity_limit.tolist() == [0.3, np.inf]
    assert repr(robot) == "Chain(screws=<array of shape (6, 2)>, names=('rail', 'swing'))"
    assert robot.tool == "hook"


ORPHAN = SLIDER.replace('<parent link="base"/>', "")
FLOATING = SLIDER.replace('"prismatic"', '"floating"')
FAILING = {
    "typo": (lambda _: iq.load_robot("pandda"), r"unknown robot 'pandda'; did you mean panda"),
    "no file": (lambda d: iq.load_robot(d / "missing.urdf"), "no file at .*missing.urdf"),
    "folder": (iq.load_robot, "is a folder; expected the path of a URDF or MJCF file"),
    "no name": (lambda _: iq.load_robot(""), "unknown robot ''"),
    "not xml": (lambda d: iq.load_robot(urdf(d, "<robot")), r"arm.urdf: not XML \(.*\); expected a URDF <robot>"),
    "not urdf": (lambda d: iq.load_robot(urdf(d, "<sdf/>")), r"found <sdf>, a world or model of Gazebo \(SDF\)"),
    "mujoco": (
        lambda d: iq.load_robot(urdf(d, "<mujoco><worldbody><joint/></worldbody></mujoco>", "arm.xml")),
        "arm.xml: MuJoCo cannot make",
    ),
    "mujoco text": (lambda _: iq.load_robot("<mujoco><worldbody/></mujoco>"), "no joint moves the tool frame 'world'"),
    "part of an mjcf": (lambda _: iq.load_robot("<mujoco/>"), "a part of an MJCF, found <mujoco> without <worldbody>"),
    "included": (lambda _: iq.load_robot("<mujocoinclude/>"), "a part of an MJCF.*Load the file that includes it"),
    "manifest": (lambda _: iq.load_robot("<package/>"), "the manifest of a ROS package"),
    "no xml file": (lambda _: iq.load_robot("scene.xml"), "no file at scene.xml"),
    "name too long": (lambda _: iq.load_robot("x" * 10_000), "unknown robot 'xxx"),
    "text that is cut": (lambda _: iq.load_robot(SLIDER[:-20]), "the URDF text: not XML"),
    "no joints": (lambda d: iq.load_robot(urdf(d, "<robot/>")), "found <robot> without joints, a single body"),
    "no parent": (lambda d: iq.load_robot(urdf(d, ORPHAN)), "joint 'rail': expected a name, and <parent> and <child>"),
    "floating": (lambda d: iq.load_robot(urdf(d, FLOATING)), "only revolute and prismatic joints"),
    "not text": (lambda d: iq.load_robot(urdf(d, "\0\1bad")), "not XML"),
    "frame typo": (lambda _: iq.load_robot("panda", "panda_hand_tpc"), "unknown frame .*; did you mean panda_hand_tcp"),
    "joint typo": (lambda _: iq.load_robot("panda", None, ["panda_joint0"]), "unknown joint .*; did you mean panda_jo"),
    "unmoved": (
        lambda d: iq.load_robot(urdf(d, SLIDER), "base"),
        "no joint moves the tool frame 'base'; choose a frame",
    ),
}


@pytest.mark.parametrize("case", FAILING)
def test_a_robot_that_cannot_be_loaded_is_refused_with_the_reason(tmp_path, case):
    call, message = FAILING[case]
    with pytest.raises(iq.errors.RobotModelError, match=message) as caught:
        call(tmp_path)
    assert isinstance(caught.value, iq.errors.UnknownName) == ("unknown" in message)


def test_an_unknown_name_unlike_all_lists_the_known_ones():
    with pytest.raises(iq.errors.UnknownName, match=r"known: panda, ur3, .*or the path of a URDF or MJCF file"):
        iq.load_robot("qqqq")


BAD = {
    "joint beside": (lambda f: iq.load_robot(f, tool="hook", joints=["other"]), "joints", "does not move 'hook'"),
    "no joints": (lambda f: iq.load_robot(f, tool="hook", joints=[]), "joints", "none"),
    "tool pose": (lambda f: iq.load_robot(f, tool=np.eye(4)), "tool", "ndarray"),
    "screws, no tool": (lambda _: iq.load_robot(np.eye(6)), "tool", "None"),
    "screws, tool name": (lambda _: iq.load_robot(np.eye(6), "hand"), "tool", "'hand'"),
    "nothing": (lambda _: iq.load_robot(None), "source", "None"),
    "a number": (lambda _: iq.load_robot(7.0), "source", "7.0"),
    "an object": (lambda _: iq.load_robot(object()), "source", "object"),
    "a robot": (lambda f: iq.load_robot(iq.load_robot(f)), "source", "Chain(screws="),
    "a letter a joint": (lambda f: iq.load_robot(f, joints="rail"), "joints", "'rail'"),
    "numbered joints": (lambda f: iq.load_robot(f, joints=[1]), "joints", "1 among"),
    "zero screw": (lambda _: iq.robots.Chain([[1, 0]] + [[0, 0]] * 5, np.eye(4)), "screws", "zero twist in column 1"),
    "home": (lambda _: iq.robots.Chain(np.eye(6), np.zeros((4, 4))), "home", "not a rotation"),
    "names": (lambda _: iq.robots.Chain(np.eye(6), np.eye(4), ["a"]), "names", "('a',)"),
    "names twice": (lambda _: iq.robots.Chain(np.eye(6), np.eye(4), ["a"] * 6), "names", "'a'"),
    "crossed": (
        lambda _: iq.robots.Chain(np.eye(6), np.eye(4), (), 1.0, -1.0),
        "position_lower",
        "1 above -1 at joint 0",
    ),
    "empty limits": (lambda _: iq.robots.Chain(np.eye(6), np.eye(4), (), []), "position_lower", "shape (0,)"),
    "no speed": (
        lambda _: iq.robots.Chain(np.eye(6), np.eye(4), velocity_limit=[1, 1, 0, 1, 1, 1]),
        "velocity_limit",
        "0 at",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(tmp_path, case):
    call, argument, found = BAD[case]
    with pytest.raises(iq.BadInput) as caught:
        call(urdf(tmp_path, SLIDER))
    assert caught.value.argument == argument
    assert found in caught.value.found
    assert caught.value.expected


def test_a_missing_extra_is_named(monkeypatch):
    from importlib import metadata

    def missing(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "distribution", missing)
    with pytest.raises(iq.errors.MissingExtra, match="example-robot-data is not installed"):
        iq.load_robot("panda")


def test_loading_a_known_robot_gives_no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        iq.load_robot("tiago")


@pytest.mark.parametrize("lead", ["", "\n  ", "\ufeff", '<?xml version="1.0" encoding="utf-8"?>\n'])
def test_the_text_of_a_urdf_is_the_same_arm(tmp_path, lead):
    text, file = iq.load_robot(lead + SLIDER, tool="hook"), iq.load_robot(urdf(tmp_path, SLIDER), tool="hook")
    assert text == file


def test_a_pinocchio_model_is_the_same_arm():
    arm = iq.load_robot("panda")
    model = pinocchio.buildModelFromUrdf(str(urdf_of("panda")))
    before = model.copy()
    again = iq.load_robot(model, tool="panda_hand_tcp")
    q = np.linspace(-0.5, 0.5, 7)
    assert again.names == arm.names
    np.testing.assert_allclose(again.pose(q), arm.pose(q), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(again.jacobian(q), arm.jacobian(q), rtol=0.0, atol=1e-14)
    np.testing.assert_array_equal(again.position_lower, arm.position_lower)
    part = iq.load_robot(model, tool="panda_hand_tcp", joints=["panda_joint2"])
    assert part.names == ("panda_joint2",)
    np.testing.assert_allclose(part.jacobian([0.4]), numerical_twists(part, np.array([0.4])), atol=1e-8)
    assert model == before  # which is left as it was


@pytest.mark.parametrize("name", ["panda", "so101", "tiago"])
def test_a_robots_pinocchio_model_is_the_same_arm(name):
    arm = iq.load_robot(name)
    again, q = iq.load_robot(arm.model, tool=arm.tool), inside(arm, np.random.default_rng(5))
    assert again.names == arm.names
    assert again.tool == arm.tool
    for attribute in ("position_lower", "position_upper", "velocity_limit"):
        np.testing.assert_array_equal(getattr(again, attribute), getattr(arm, attribute))
    np.testing.assert_allclose(again.pose(q), arm.pose(q), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(again.jacobian(q), arm.jacobian(q), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(again.origins(q), arm.origins(q), rtol=0.0, atol=1e-12)


def test_a_screw_joint_has_a_pinocchio_model():
    screws = [iq.se3.helical((0, 1, 1), (0.1, 0, 0.2), 0.05), iq.se3.prismatic((1, 0, 1)), iq.revolute((1, 0, 0))]
    arm = iq.robots.Chain(np.column_stack(screws), iq.exp([0.1, 0.2, 0.3, 0.5, 0, 0.3]), ["a", "b", "c"])
    again = iq.load_robot(arm.model, tool="tool", velocity_limit=np.inf)
    np.testing.assert_allclose(again.pose([0.7, 0.2, -0.4]), arm.pose([0.7, 0.2, -0.4]), atol=1e-14)
    np.testing.assert_allclose(again.jacobian([0.7, 0.2, -0.4]), arm.jacobian([0.7, 0.2, -0.4]), atol=1e-14)


def test_a_model_with_joints_of_other_kinds():
    """A joint without a single coordinate can be held still, not moved; a continuous one has its angle."""
    floating = pinocchio.buildModelFromXML(FLOATING)
    with pytest.raises(
        iq.errors.RobotModelError, match=r"joint 'rail' \(JointModelFreeFlyer\) has no single coordinate"
    ):
        iq.load_robot(floating, tool="hook")
    assert iq.load_robot(floating, tool="hook", joints=["swing"]).names == ("swing",)
    with pytest.raises(iq.errors.UnknownName, match="unknown frame 'hok'; did you mean hook"):
        iq.load_robot(floating, tool="hok")
    given = {"tool": "side", "velocity_limit": 1.0}
    turned, ours = (iq.load_robot(one, **given) for one in (pinocchio.buildModelFromXML(SLIDER), SLIDER))
    assert turned.position_upper.tolist() == [0.5, np.inf]
    np.testing.assert_allclose(turned.pose([0.1, 2.0]), ours.pose([0.1, 2.0]), atol=1e-15)


def test_a_checked_target_is_used_without_another_check():
    for arm in (iq.load_robot("ur5"), iq.load_robot(np.eye(6), np.eye(4))):
        pose, q = iq.exp(0.1 * np.arange(6.0)), np.full(6, 0.1)
        target = arm.target(pose)
        assert arm.target(target) is target
        before = arm.state(q, target).error
        pose[:] = np.nan  # the target is not the caller's array
        np.testing.assert_array_equal(arm.state(q, target).error, before)
