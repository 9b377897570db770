"""Joints that mimic others: their screws belong to the column of the joint that drives them."""

import pickle

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from support.arms import numerical_twists

import invariantqp as iq

KINDS = ("revolute", "prismatic")


def arm_text(rng, mimics):
    """A URDF of eight joints base to tip, some of which mimic another: {joint: (driver, ratio, offset)}."""
    text = '<robot name="a"><link name="l0"/>'
    for i in range(8):
        x, y, z, *rpy = rng.uniform(-1.0, 1.0, 6)
        a, b, c = rng.normal(size=3)
        mimic = ""
        if f"j{i}" in mimics:
            driver, ratio, offset = mimics[f"j{i}"]
            mimic = f'<mimic joint="{driver}" multiplier="{ratio}" offset="{offset}"/>'
        text += (
            f'<link name="l{i + 1}"/><joint name="j{i}" type="{rng.choice(KINDS)}"><parent link="l{i}"/>'
            f'<child link="l{i + 1}"/><origin xyz="{x} {y} {z}" rpy="{rpy[0]} {rpy[1]} {rpy[2]}"/>'
            f'<axis xyz="{a} {b} {c}"/><limit lower="-2" upper="2.5" effort="1" velocity="{1 + i}"/>{mimic}</joint>'
        )
    return text + "</robot>"


@pytest.mark.parametrize("seed", range(6))
def test_poses_and_twists_agree_with_pinocchio(seed):
    rng = np.random.default_rng(seed)
    mimics = {"j2": ("j0", -1.0, 0.0), "j4": ("j3", 0.5, 0.2), "j6": ("j0", rng.uniform(-2.0, 2.0), -0.1)}
    text = arm_text(rng, mimics)
    robot = iq.load_robot(text)
    assert robot.names == ("j0", "j1", "j3", "j5", "j7")
    model = pin.buildModelFromXML(text, mimic=True)
    data = model.createData()
    for q in rng.uniform(-1.0, 1.0, (5, 5)):
        pin.framesForwardKinematics(model, data, q)
        there = data.oMf[model.getFrameId("l8")].homogeneous
        np.testing.assert_allclose(robot.pose(q), there, atol=1e-13)
        np.testing.assert_allclose(robot.jacobian(q), numerical_twists(robot, q), atol=1e-7)
    of_model = iq.load_robot(model, "l8", velocity_limit=1.0)
    assert of_model.names == robot.names
    np.testing.assert_allclose(of_model.pose(q), robot.pose(q), atol=1e-13)
    np.testing.assert_allclose(of_model.jacobian(q), robot.jacobian(q), atol=1e-13)
    assert [note.split(":")[0] for note in robot.notes] == [
        f"joint {words}" for words in ("j2 mimics j0", "j4 mimics j3", "j6 mimics j0")
    ]


def test_limits_keep_mimic_joints_inside_theirs():
    rng = np.random.default_rng(0)
    robot = iq.load_robot(arm_text(rng, {"j2": ("j0", -2.0, 0.5), "j4": ("j3", 0.5, 0.2)}))
    # -2 <= -2 q + 0.5 <= 2.5, at 3 / 2; and of j3 its own.
    assert robot.position_lower[0] == pytest.approx(-1.0)
    assert robot.position_upper[0] == pytest.approx(1.25)
    assert robot.velocity_limit[0] == 1.0
    assert robot.position_upper[robot.names.index("j3")] == 2.5
    faster = iq.load_robot(arm_text(rng, {"j1": ("j7", 10.0, 0.0)}))
    assert faster.velocity_limit[-1] == pytest.approx(0.2)


def test_a_mimic_joint_of_a_mimic_joint_follows_the_first_driver():
    one = iq.load_robot(arm_text(np.random.default_rng(1), {"j2": ("j0", -1.5, 0.1), "j4": ("j2", 0.5, 0.2)}))
    two = iq.load_robot(arm_text(np.random.default_rng(1), {"j2": ("j0", -1.5, 0.1), "j4": ("j0", -0.75, 0.25)}))
    q = np.linspace(-0.5, 0.5, 6)
    np.testing.assert_allclose(one.pose(q), two.pose(q), atol=1e-14)


def test_a_mimic_joint_is_held_where_its_held_driver_puts_it():
    text = arm_text(np.random.default_rng(2), {"j4": ("j3", 0.5, 0.2)})
    whole = iq.load_robot(text)
    held = iq.load_robot(text, joints=[name for name in whole.names if name != "j3"])
    q = np.linspace(-0.4, 0.6, len(whole.names))
    q[whole.names.index("j3")] = 0.0
    np.testing.assert_allclose(held.pose(np.delete(q, whole.names.index("j3"))), whole.pose(q), atol=1e-14)
    assert "joint j3 is held at 0" in held.notes
    with pytest.raises(iq.BadInput, match=r"'j4', which mimics 'j3'.*Name 'j3'"):
        iq.load_robot(text, joints=["j4"])


@pytest.fixture(scope="module")
def palletizer():
    """Four joints of a desktop arm whose parallelograms keep the hand level."""
    rows = (
        ("j1", "b", "l1", "0 0 0", "0 0 1", ""),
        ("j2", "l1", "l2", "0 0 0.08", "0 1 0", ""),
        ("p2", "l2", "f", "0 0 0.135", "0 1 0", '<mimic joint="j2" multiplier="-1"/>'),
        ("j3", "f", "l3", "0 0 0", "0 1 0", ""),
        ("p3", "l3", "l4", "0.147 0 0", "0 1 0", '<mimic joint="j3" multiplier="-1"/>'),
        ("j4", "l4", "tool", "0.06 0 0", "0 0 1", ""),
    )
    links = "".join(f'<link name="{name}"/>' for name in ("b", *(row[2] for row in rows)))
    return iq.load_robot(
        f'<robot name="p">{links}'
        + "".join(
            f'<joint name="{name}" type="revolute"><parent link="{above}"/><child link="{below}"/>'
            f'<origin xyz="{xyz}"/><axis xyz="{axis}"/><limit lower="-1.6" upper="1.6" effort="1" velocity="1.5"/>'
            f"{mimic}</joint>"
            for name, above, below, xyz, axis, mimic in rows
        )
        + "</robot>"
    )


def test_a_parallelogram_keeps_the_hand_level_and_is_driven(palletizer):
    q = np.array([0.2, 0.4, 0.3, 0.1])
    np.testing.assert_allclose(palletizer.pose(q)[2, :3], [0.0, 0.0, 1.0], atol=1e-15)
    goal = palletizer.pose(q + np.array([0.3, 0.2, -0.2, 0.4]))
    loop = iq.Controller(palletizer, dt=0.01)
    for _ in range(400):
        q = q + 0.01 * loop.step(q, goal).velocity
    np.testing.assert_allclose(palletizer.pose(q), goal, atol=1e-5)
    found = iq.solve_pose(palletizer, goal)
    np.testing.assert_allclose(palletizer.pose(found.q), goal, atol=1e-5)
    by_definition = iq.Controller(palletizer, dt=0.01, backend="daqp").step(q + 0.1, goal).velocity
    np.testing.assert_allclose(
        iq.Controller(palletizer, dt=0.01).step(q + 0.1, goal).velocity, by_definition, atol=1e-7
    )


def test_a_chain_with_mimic_joints_is_pickled_and_stands_on_a_rail(palletizer):
    assert pickle.loads(pickle.dumps(palletizer)) == palletizer
    q = np.array([0.2, 0.4, 0.3, 0.1])
    on_rail = iq.robots.stand_on(iq.robots.rail([0, 1, 0]), palletizer)
    np.testing.assert_allclose(
        on_rail.pose([0.5, *q]), iq.transform(translation=[0, 0.5, 0]) @ palletizer.pose(q), atol=1e-15
    )
    np.testing.assert_allclose(on_rail.jacobian([0.5, *q]), numerical_twists(on_rail, np.array([0.5, *q])), atol=1e-8)
    offset = iq.exp([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    np.testing.assert_allclose(palletizer.with_tool(offset).pose(q), palletizer.pose(q) @ offset, atol=1e-15)
    assert palletizer.with_limits(velocity_limit=0.1).jacobian(q) == pytest.approx(palletizer.jacobian(q))
    assert palletizer.origins(q).shape == (4, 3)


@pytest.mark.parametrize("seed", range(3))
def test_the_relative_chain_of_two_arms_with_mimic_joints(seed):
    rng = np.random.default_rng(seed)
    arm = iq.load_robot(arm_text(rng, {"j2": ("j0", -1.5, 0.1), "j4": ("j7", 0.5, 0.2)}))
    other = iq.load_robot(arm_text(rng, {"j1": ("j6", 2.0, 0.0), "j5": ("j3", -0.7, -0.1)}))
    both = iq.robots.relative(arm, other)
    for _ in range(3):
        q, p = rng.uniform(-0.8, 0.8, (2, 6))
        at, back = np.append(p[::-1], q), iq.inverse(other.pose(p))
        np.testing.assert_allclose(both.pose(at), back @ arm.pose(q), atol=1e-12)
        np.testing.assert_allclose(both.jacobian(at), numerical_twists(both, at), atol=1e-7)
        origins = np.vstack((other.origins(p)[::-1], arm.origins(q)))
        hinges = both.joints.screws[:3, list(both.joints.drivers)].any(axis=0)  # a slide carries its origin
        np.testing.assert_allclose(both.origins(at)[hinges], origins[hinges] @ back[:3, :3].T + back[:3, 3], atol=1e-12)
        moved, links = both.motions(at), {link.name: link for link in both.links}
        for one, position, prefix in ((arm, q, ""), (other, p, "other/")):
            motions = one.motions(position)
            for link in one.links:
                seen = links.get(prefix + link.name, links.get(f"arm/{link.name}"))
                np.testing.assert_allclose(
                    moved[seen.body] @ seen.frame, back @ motions[link.body] @ link.frame, atol=1e-12
                )
    assert both.notes == other.notes + arm.notes


def test_notes_of_a_pinocchio_model_are_those_of_its_file():
    text = arm_text(np.random.default_rng(4), {"j2": ("j0", -1.5, 0.1)})
    hand = "".join(
        f'<link name="{side}"/><joint name="{side}_slide" type="prismatic"><parent link="l8"/><child link="{side}"/>'
        f'<limit lower="0.1" upper="0.2" effort="1" velocity="1"/>{mimic}</joint>'
        for side, mimic in (("left", ""), ("right", '<mimic joint="left_slide"/>'))
    )
    text = text.replace("</robot>", f"{hand}</robot>")
    model = pin.buildModelFromXML(text, mimic=True)
    for tool, joints in ((None, None), ("left", ["j0", "j3", "left_slide"]), ("l4", ["j0", "j1"]), ("l8", ["j1"])):
        from_file, of_model = (iq.load_robot(source, tool, joints=joints) for source in (text, model))
        assert from_file.notes
        assert of_model.notes == from_file.notes
    bare = pin.Model()
    for i in range(3):
        bare.addJoint(i, pin.JointModelRZ(), pin.SE3.Identity(), f"turn{i}")
    bare.addFrame(pin.Frame("end", 3, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    assert iq.load_robot(bare, "end", joints=["turn0", "turn2"], velocity_limit=1.0).notes == (
        "joint turn1 is held at 0",
    )
    folded = iq.load_robot(pin.buildModelFromXML(text), "l8")
    assert folded.notes == tuple(
        f"joint {side}_slide is left out: it moves what hangs on the tool" for side in ("left", "right")
    )


def test_unsupported_mimic_joints_are_refused(palletizer):
    with pytest.raises(iq.BadInput, match="share a coordinate"):
        _ = palletizer.model
    free = arm_text(np.random.default_rng(3), {"j2": ("j0", 1.0, 0.0)})
    free = free.replace('name="j0" type="prismatic"', 'name="j0" type="continuous"')
    free = free.replace('name="j0" type="revolute"', 'name="j0" type="continuous"')
    with pytest.raises(iq.errors.RobotModelError, match="has no position limits, and 'j2' mimics it"):
        iq.load_robot(free)
    circle = arm_text(np.random.default_rng(3), {"j2": ("j4", 1.0, 0.0), "j4": ("j2", 1.0, 0.0)})
    with pytest.raises(iq.errors.RobotModelError, match="which is no joint that moves by itself"):
        iq.load_robot(circle)


MJCF = """<mujoco><compiler angle="radian"/><worldbody><body name="a">
<joint name="x" axis="0 0 1" ref="0.2" range="-2 2" limited="true"/>
<geom size=".05"/><body name="b" pos=".3 0 0.1"><joint name="y" axis="0 1 0" range="-2 2" limited="true"/>
<geom size=".05"/><body name="c" pos="0 .2 .1"><joint name="z" type="slide" axis="1 1 0" ref="-0.1" range="-2 2"
limited="true"/><geom size=".05"/></body></body></body></worldbody><equality>
<joint joint1="z" joint2="x" polycoef="0.1 -0.5 {} 0 0"/></equality></mujoco>"""


def test_joint_equalities_of_mujoco_are_mimic_joints():
    robot = iq.load_robot(MJCF.format(0), "c", velocity_limit=1.0)
    model = mujoco.MjModel.from_xml_string(MJCF.format(0))
    data = mujoco.MjData(model)
    assert robot.names == ("x", "y")
    for x, y in np.random.default_rng(0).uniform(-1.0, 1.0, (5, 2)):
        data.qpos[:] = x, y, -0.1 + 0.1 - 0.5 * (x - 0.2)
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(robot.pose([x, y])[:3, 3], data.body("c").xpos, atol=1e-14)
        np.testing.assert_allclose(robot.jacobian([x, y]), numerical_twists(robot, np.array([x, y])), atol=1e-8)
    with pytest.raises(iq.errors.RobotModelError, match="'z' is coupled to 'x' by a polynomial that is no line"):
        iq.load_robot(MJCF.format(0.3), "c")
