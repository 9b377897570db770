"""URDFs as Pinocchio reads them, and what is refused in one."""

import numpy as np
import pinocchio as pin
import pytest

import invariantqp as iq
from invariantqp.robots.load import urdf_of
from invariantqp.robots.tree import SINGLE_AXIS_TYPES, chain_to_link, path_to, rest_position
from invariantqp.robots.urdf import joints_of, read_xml

MODELS = urdf_of("panda").parents[2]
ARM = """<robot name="arm"><link name="base"/><link name="tip"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="tip"/><origin rpy="0.1 0.2 0.3" xyz="1 2 3"/>
<axis xyz="0 0 2"/><limit lower="-1" upper="2" effort="1" velocity="3"/></joint></robot>"""


def configuration(model, path, q):
    """Pinocchio's, with the moving joints at q by name and the others of the path where they rest."""
    full = pin.neutral(model)
    for joint in path:
        if joint.kind in SINGLE_AXIS_TYPES:
            i, angle = model.getJointId(joint.name), q.get(joint.name, rest_position(joint))
            full[model.idx_qs[i] :][: model.nqs[i]] = angle if model.nqs[i] == 1 else (np.cos(angle), np.sin(angle))
    return full


def frame_of(model, link):
    return next(i for i, f in enumerate(model.frames) if f.name == link and f.type == pin.FrameType.BODY)


def open_limits(values):
    return np.where(np.abs(values) < 1e9, values, np.copysign(np.inf, values))


def difference(model, joints, link):
    """The largest difference of pose and joint twists from Pinocchio's in a random state; None where nothing moves."""
    path = path_to({joint.child: joint for joint in joints}, link, "")
    moving = [joint.name for joint in path if joint.kind in SINGLE_AXIS_TYPES and not joint.mimics]
    if not moving:
        return None
    arm, data = chain_to_link(joints, "", link, moving), model.createData()
    q = np.random.default_rng(len(link)).uniform(-3.0, 3.0, size=len(moving))
    pin.computeJointJacobians(model, data, configuration(model, path, dict(zip(moving, q, strict=True))))
    ids = [model.getJointId(name) for name in moving]
    J = data.J[[3, 4, 5, 0, 1, 2]][:, [model.idx_vs[i] for i in ids]]
    T = pin.updateFramePlacement(model, data, frame_of(model, link)).homogeneous
    single = [k for k, i in enumerate(ids) if model.nqs[i] == 1]
    at = [model.idx_qs[ids[k]] for k in single]
    np.testing.assert_array_equal(arm.position_lower[single], open_limits(model.lowerPositionLimit[at]))
    np.testing.assert_array_equal(arm.position_upper[single], open_limits(model.upperPositionLimit[at]))
    speed = model.velocityLimit[[model.idx_vs[i] for i in ids]]
    np.testing.assert_array_equal(arm.velocity_limit, np.where(speed > 0.0, open_limits(speed), np.inf))
    return max(np.abs(T - arm.pose(q)).max(), np.abs(J - arm.jacobian(q)).max())


@pytest.mark.cases(13)
@pytest.mark.parametrize("folder", sorted(MODELS.iterdir()), ids=lambda folder: folder.name)
def test_every_arm_of_every_model_agrees_with_pinocchio(folder):
    """To the end of each branch of each URDF of example-robot-data: 585 arms, one joint to 33."""
    for file in folder.rglob("*.urdf"):
        try:
            model = pin.buildModelFromUrdf(str(file))
        except ValueError:  # not for us either: files with macros
            with pytest.raises(iq.errors.RobotModelError):
                iq.load_robot(file)
            continue
        if model.njoints == 1:  # a body without joints
            continue
        joints = joints_of(*read_xml(file))
        ends = {joint.child for joint in joints} - {joint.parent for joint in joints}
        found = [difference(model, joints, link) for link in ends]
        assert max((d for d in found if d is not None), default=0.0) <= 1e-12, file.name


def with_joint(**changed):
    """The arm with other text in its joint."""
    text = ARM
    for old, new in changed.items():
        text = text.replace({"axis": "0 0 2", "kind": "revolute", "xyz": "1 2 3", "lower": 'lower="-1"'}[old], new)
    return text


def with_another(parent, child):
    """The arm and a fixed joint between two links."""
    links = f'<parent link="{parent}"/><child link="{child}"/>'
    return ARM.replace("</joint>", f'</joint><joint name="b" type="fixed">{links}</joint>')


REFUSED = {
    "no direction": (with_joint(axis="0 0 0"), "joint 'turn': an axis of length 0"),
    "words": (with_joint(xyz="1 two 3"), "joint 'turn': xyz='1 two 3'; expected 3 finite numbers"),
    "infinite": (with_joint(xyz="1 inf 3"), "expected 3 finite numbers"),
    "two numbers": (with_joint(xyz="1 2"), "expected 3 finite numbers"),
    "macros": (with_joint(xyz="${a} 0 0"), r"a xacro file.*xacro FILE > FILE.urdf"),
    "an unknown type": (with_joint(kind="ball"), "type 'ball'; expected one of revolute, continuous"),
    "planar": (with_joint(kind="planar"), r"\(planar\) has no single coordinate"),
    "no limits": (ARM.replace("<limit", "<range"), "a revolute joint without <limit>"),
    "crossed limits": (with_joint(lower='lower="5"'), "above the upper one"),
    "a follower": (ARM.replace("<axis", '<mimic joint="other"/><axis'), "'turn' mimics 'other', which is no joint"),
    "two above": (with_another("base", "tip"), "a link is moved by two joints"),
    "one name twice": (with_another("base", "tip").replace('"b"', '"turn"'), "two joints are called 'turn'"),
    "an unknown link": (with_another("c", "tip"), "joint 'b': no <link> is called 'c'"),
    "a circle": (with_another("tip", "base"), "in a circle"),
    "entities": ('<!DOCTYPE robot [<!ENTITY a "aaaa">]>' + ARM, "a <!DOCTYPE>"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_an_invalid_urdf_is_refused_with_the_reason(case):
    text, reason = REFUSED[case]
    with pytest.raises(iq.InvariantQPError, match=reason):
        iq.load_robot(text, tool="tip")


def test_a_document_type_is_refused_in_every_encoding(tmp_path):
    file = tmp_path / "arm.urdf"
    file.write_bytes(("<?xml version='1.0' encoding='utf-16'?>" + REFUSED["entities"][0]).encode("utf-16"))
    with pytest.raises(iq.errors.RobotModelError, match="DOCTYPE"):
        iq.load_robot(file)


def test_a_tool_may_be_named_by_the_joint_that_moves_it():
    assert iq.load_robot(ARM, tool="turn") == iq.load_robot(ARM, tool="tip")


def test_held_joints_are_at_zero_or_the_limit_nearest_to_it():
    text = ARM.replace("</robot>", '<link name="end"/><joint name="slide" type="prismatic">'
                       '<parent link="tip"/><child link="end"/>'
                       '<axis xyz="1 0 0"/><limit lower="0.5" upper="1"/></joint></robot>')  # fmt: skip
    with pytest.warns(UserWarning, match="no velocity limit for slide"):
        whole = iq.load_robot(text, tool="end")
    part = iq.load_robot(text, tool="end", joints=["turn"])
    np.testing.assert_allclose(part.pose([0.3]), whole.pose([0.3, 0.5]), atol=1e-15)
    assert whole.velocity_limit.tolist() == [3.0, np.inf]


def test_limits_in_degrees_give_a_warning():
    text = (
        '<robot><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/><child link="b"/>'
        '<axis xyz="0 0 1"/><limit lower="-170" upper="160" velocity="1"/></joint></robot>'
    )
    with pytest.warns(UserWarning, match="limits: joint 0 may turn to 170 rad, 27.1 turns; are these degrees"):
        iq.load_robot(text)
    iq.load_robot(text.replace("revolute", "prismatic"))
