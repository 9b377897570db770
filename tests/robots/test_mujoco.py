"""MuJoCo's models: the poses are MuJoCo's own."""

import mujoco
import numpy as np
import pytest

import invariantqp as iq

MJCF = """<mujoco><compiler angle="degree"/><worldbody>
<body name="trunk" pos="0 0 0.3"><freejoint name="float"/><geom size="0.1"/>
  <body name="cart" pos="0.1 0 0" euler="10 20 30"><joint name="rail" type="slide" axis="1 1 0" range="0.2 1"/>
    <geom size="0.1"/>
    <body name="upper" pos="0 0 0.2"><joint name="swing" axis="0 1 0" pos="0 0 0.05" range="-90 100"/>
      <joint name="turn" axis="0 0 1" ref="20"/><geom size="0.1"/>
      <body name="hand" pos="0.3 0 0"><geom size="0.1"/><site name="tip" pos="0 0 0.1" euler="0 90 0"/>
        <body name="ball"><joint name="ball" type="ball"/><geom size="0.1"/></body></body></body></body></body>
</worldbody></mujoco>"""
JOINTS = ["rail", "swing", "turn"]


@pytest.mark.parametrize("tool", ["tip", "hand"])
@pytest.mark.parametrize("given", ["text", "file", "model"])
def test_an_arm_of_a_model_agrees_with_mujoco(tmp_path, tool, given):
    model = mujoco.MjModel.from_xml_string(MJCF)
    file = tmp_path / "arm.xml"
    file.write_text(MJCF, encoding="utf-8")
    arm = iq.load_robot(
        {"text": MJCF, "file": file, "model": model}[given], tool=tool, joints=JOINTS, velocity_limit=np.inf
    )
    assert (arm.names, arm.tool) == (tuple(JOINTS), tool)
    np.testing.assert_allclose(arm.position_lower, [0.2, -np.pi / 2, -np.inf])
    assert np.isinf(arm.velocity_limit).all()
    data, q = mujoco.MjData(model), np.array([0.4, 0.7, -1.1])
    data.qpos[[model.joint(name).qposadr[0] for name in JOINTS]] = q
    mujoco.mj_forward(model, data)
    place = data.site(tool) if tool == "tip" else data.body(tool)
    np.testing.assert_allclose(arm.pose(q), iq.transform(place.xmat.reshape(3, 3), place.xpos), atol=1e-14)
    linear, angular = np.zeros((2, 3, model.nv))
    mujoco.mj_jac(model, data, linear, angular, np.zeros(3), model.body("hand").id)
    dofs = [model.joint(name).dofadr[0] for name in JOINTS]
    np.testing.assert_allclose(arm.jacobian(q), np.vstack((angular, linear))[:, dofs], atol=1e-14)


def test_a_held_joint_rests_at_the_limit_nearest_to_zero():
    whole, part = (iq.load_robot(MJCF, "hand", joints, velocity_limit=np.inf) for joints in (JOINTS, JOINTS[1:]))
    np.testing.assert_allclose(part.pose([0.1, 0.2]), whole.pose([0.2, 0.1, 0.2]), atol=1e-15)


COUPLED = MJCF.replace("</worldbody>", '</worldbody><equality><joint joint1="turn" joint2="swing"/></equality>')
REFUSED = {
    "free": (MJCF, "hand", None, "joint 'float' has no single coordinate"),
    "ball": (MJCF, "ball", ["ball"], "joint 'ball' has no single coordinate"),
    "coupled": (COUPLED, "hand", JOINTS, "'turn', which mimics 'swing'"),
    "no such frame": (MJCF, "tipp", None, "unknown frame 'tipp'; did you mean tip"),
    "world": (MJCF, "world", None, "no joint moves the tool frame 'world'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_an_invalid_arm_is_refused_with_the_reason(case):
    source, tool, joints, said = REFUSED[case]
    with pytest.raises(iq.InvariantQPError, match=said):
        iq.load_robot(source, tool, joints)


def test_without_a_tool_the_longest_chain_is_meant():
    with pytest.raises(iq.errors.RobotModelError, match="float"):
        iq.load_robot(MJCF)
    assert iq.load_robot(MJCF, joints=JOINTS, velocity_limit=np.inf).tool == "ball"


def test_bodies_without_names():
    text = """<mujoco><worldbody><body><joint axis="0 0 1"/><geom size=".05"/>
    <body pos=".4 0 0"><joint axis="0 1 0"/><geom size=".05"/></body></body></worldbody></mujoco>"""
    arm = iq.load_robot(text, velocity_limit=[2.0, np.inf])
    assert arm.velocity_limit.tolist() == [2.0, np.inf]
    assert arm.names == ("unnamed joint 0", "unnamed joint 1")
    np.testing.assert_allclose(arm.pose(np.zeros(2))[:3, 3], [0.4, 0.0, 0.0])


def test_joints_without_velocity_limits_give_one_warning():
    with pytest.warns(UserWarning, match=r"no velocity limit for rail, swing, turn: .*velocity_limit=\[") as told:
        arm = iq.load_robot(MJCF, "tip", JOINTS)
    assert len(told) == 1
    assert told[0].filename == __file__
    assert np.isinf(arm.velocity_limit).all()
