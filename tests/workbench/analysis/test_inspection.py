import json
from functools import cache

import numpy as np
import pytest
from support.random_systems import motion

import invariantqp as iq
from invariantqp.robots.kinematics import joint_ranges, middle
from invariantqp.workbench.analysis.recommendation import (
    MAX_NORM,
    MIN_SHARE,
    PARALLEL_TOLERANCE,
    achievable,
    measure_root,
    projector_norms,
    recommend,
    upright_states,
)
from invariantqp.workbench.analysis.survey import spread
from invariantqp.workbench.pictures import inspection as pictured
from invariantqp.workbench.runs.taskfile import load_arm

X, Y, Z = np.eye(3)
# name, joints, rank in the middle, rank of the arm, type in the middle, recommended form
ARMS = [
    ("so101", 5, 5, 5, "h", "tool"),
    ("ur5", 6, 6, 6, "SE3", "pitch"),
    ("panda", 7, 6, 6, "SE3", "pitch"),
    ("scara", 4, 4, 4, "IIC", "tool"),
    ("planar_3r", 3, 3, 3, "IIC", "tool"),
    ("arm_3r", 3, 3, 3, "IB0", "tool"),
]


def five(moved=None):
    """Five joints in no special place: their principal pitch is another in every state."""
    screws = [
        iq.revolute((0, 0, 1), (0, 0, 0)),
        iq.revolute((0, 1, 0.2), (0.05, 0, 0.3)),
        iq.revolute((0.1, 1, 0), (0.3, 0.05, 0.3)),
        iq.revolute((1, 0.1, 0), (0.3, 0, 0.35)),
        iq.se3.helical((0, 0.3, 1), (0.45, 0, 0.3), 0.02),
    ]
    T = np.eye(4) if moved is None else moved
    home = T @ iq.transform(translation=(0.5, 0, 0.3))
    return iq.robots.Chain(iq.adjoint(T) @ np.array(screws).T, home, position_lower=-2.0, position_upper=2.0)


@cache
def inspected(name):
    """What is found of an arm in the middle of its range."""
    return iq.workbench.inspect(five() if name == "five" else load_arm(name), name=name)


def words(found):
    return " ".join((*found.state_words(), *found.range_words(), found.recommended.reason))


@pytest.mark.cases(3)
@pytest.mark.parametrize(("name", "joints", "rank", "attainable", "kind", "form"), ARMS, ids=[a[0] for a in ARMS])
def test_what_is_said_of_known_arms(name, joints, rank, attainable, kind, form):
    robot = load_arm(name)
    found = inspected(name)
    assert len(found.joints) == joints
    assert (found.report.rank, found.survey.attainable_rank, str(found.report.type)) == (rank, attainable, kind)
    assert found.recommended.form == form
    assert found.own_length == pytest.approx(iq.systems.centre(robot.jacobian(middle(robot))).length)
    assert found.recommended.length == pytest.approx(iq.Controller(robot, dt=0.01).measure.length)
    if form == "pitch":
        assert found.recommended.h == pytest.approx(found.recommended.length, rel=0.05)
        regular = [q for q, r in zip(found.survey.q, found.survey.rank, strict=True) if r == attainable]
        assert all(iq.has_pseudoinverse(robot.jacobian(q), found.recommended.h) for q in regular)
    else:
        assert found.recommended.h is None
        assert "Complement(Z)" in found.recommended.reason
    if kind == "IIC":
        assert "No pitch h works: every pitch form is blind to translation along (1, 0, 0)" in words(found)
        assert "no pitch sees translation along (1, 0, 0) and translation along (0, 1, 0)" in words(found)
    assert "nan" not in words(found)
    assert "e-1" not in words(found)


def test_a_singular_middle_is_not_taken_for_the_arm():
    found = inspected("ur5")
    assert found.report.rank == 6
    assert found.where == "in a regular state, since the middle of the joint range is singular"
    singular = iq.workbench.inspect(load_arm("ur5"), q=np.zeros(6))
    assert "That is this state, not the arm: its rank is 6 in 100 % of the range." in singular.state_words()
    regular = iq.workbench.inspect(load_arm("ur5"), q=[0.1, -1.2, 1.6, -0.6, -0.4, 0.3])
    assert (regular.report.rank, regular.recommended.reason) == (6, found.recommended.reason)
    assert "not the arm" not in words(regular)


def test_redundant_joints_are_no_singularity():
    bases = ((0, 0, 0), (0.3, 0, 0), (0.6, 0.1, 0), (0.8, 0.3, 0))
    planar = iq.robots.Chain(np.array([iq.revolute((0, 0, 1), p) for p in bases]).T, np.eye(4))
    assert "the joints are redundant, this is no singularity" in words(iq.workbench.inspect(planar))


def test_arms_without_a_length_of_their_own():
    gantry = iq.robots.Chain(
        np.vstack((np.zeros((3, 3)), np.eye(3))), np.eye(4), position_lower=0.0, position_upper=1.0
    )
    found = iq.workbench.inspect(gantry)
    assert (found.recommended.form, found.recommended.length) == ("tool", 1.0)
    assert found.as_json()["own_length"] is None
    np.testing.assert_array_equal(iq.tool_metric(gantry).matrix, np.eye(6))
    home = iq.transform(translation=(1.0, 2.0, 3.0))
    wrist = iq.robots.Chain(np.array([iq.revolute(a, (1.0, 2.0, 3.0)) for a in np.eye(3)]).T, home)
    found = iq.workbench.inspect(wrist)
    assert (found.recommended.form, found.recommended.h, found.own_length) == ("pitch", 1.0, 0.0)
    assert found.norm < 1.5


def projected(robot, q, length, h):
    """P_h and the best that the joints can do, both measured at the tool."""
    J = robot.jacobian(q)
    root = measure_root(robot.pose(q), length)
    S = iq.systems.screw_system(J)
    P = root @ iq.dual_projectors(S, h=h).motion @ np.linalg.inv(root)
    Q = np.linalg.qr(root @ S)[0]
    return P, Q @ Q.T


@pytest.mark.parametrize("multiple", [1.0, -1.0, 2.5])
def test_the_norm_is_how_many_times_more_a_pitch_misses(multiple):
    rng = np.random.default_rng(0)
    robot, L = five(), 0.57
    for q in spread(robot, 40):
        P, best = projected(robot, q, L, multiple * L)
        root = measure_root(robot.pose(q), L)
        norm = projector_norms(achievable(root @ robot.jacobian(q)), np.linalg.inv(root), [multiple * L])[0]
        assert norm == pytest.approx(np.linalg.norm(P, 2), rel=1e-6)
        s = rng.normal(size=(6, 50))
        missed = np.linalg.norm(s - P @ s, axis=0) / np.linalg.norm(s - best @ s, axis=0)
        assert missed.max() <= norm * (1.0 + 1e-9)
        # The bound is attained by the twist that P turns most.
        worst = np.linalg.svd(np.eye(6) - P)[2][0]
        assert np.linalg.norm(worst - P @ worst) / np.linalg.norm(worst - best @ worst) == pytest.approx(norm, rel=1e-6)


def test_the_recommended_pitch_serves_in_as_many_states_as_it_says():
    robot = five()
    found = iq.workbench.inspect(robot, samples=150)
    h, L = found.recommended.h, found.recommended.length
    served = np.mean([np.linalg.norm(projected(robot, q, L, h)[0], 2) <= MAX_NORM for q in found.survey.q])
    assert f"in {100.0 * served:.3g} % of the states looked at" in found.recommended.reason
    assert MIN_SHARE <= served < 1.0
    assert abs(h) == pytest.approx(L, rel=0.05)


def test_it_gives_way_to_a_principal_pitch_of_its_own_size():
    # Two revolute joints and a helical one, all through the tool: principal pitches 0 and that of the screw.
    def arm_of(pitch):
        screws = [iq.revolute(Z, (0, 0, 0)), iq.se3.helical(X, (0.0, 0.0, 0.0), pitch), iq.revolute(Z, (0.5, 0, 0))]
        return iq.robots.Chain(np.array(screws).T, iq.transform(translation=(1.0, 0, 0)), position_lower=-1.0)

    for pitch in (1.0, -1.0):
        found = recommend(arm_of(pitch), spread(arm_of(pitch), 64))
        assert found.h is None or abs(found.h - pitch) > 0.1


URDF = """<robot name="r"><link name="l0"/>{}</robot>"""
JOINT = """<link name="l{0}"/><joint name="j{0}" type="{1}"><parent link="l{2}"/><child link="l{0}"/>
<origin xyz="{3}" rpy="{4}"/><axis xyz="0 0 1"/><limit lower="{5}" upper="{6}" velocity="2" effort="1"/></joint>"""


def from_urdf(*joints):
    """An arm of (kind, xyz, rpy, lower, upper) joints; a last link of 0.1 along the last joint's x axis is the tool."""
    listed = [JOINT.format(i + 1, kind, i, xyz, rpy, low, high) for i, (kind, xyz, rpy, low, high) in enumerate(joints)]
    tool = (
        f'<link name="tool"/><joint name="t" type="fixed"><parent link="l{len(joints)}"/><child link="tool"/>'
        '<origin xyz="0.1 0 0"/></joint>'
    )
    return iq.load_robot(URDF.format("".join(listed) + tool), "tool")


TURN = ("revolute", "0.3 0 0")
ROUNDED = {
    "scara": from_urdf(
        ("revolute", "0 0 0.4", "0 0 0", -2.5, 2.5),
        (*TURN, "3.1416 0 0", -2.5, 2.5),
        ("prismatic", "0.3 0 0", "0 0 0", 0.0, 0.2),
        ("revolute", "0 0 0", "3.1416 0 0", -3.0, 3.0),
    ),
    "planar": from_urdf(
        ("revolute", "0 0 0", "0 0 0", -2.5, 2.5), (*TURN, "3.1416 0 0", -2.5, 2.5), (*TURN, "3.1416 0 0", -2.5, 2.5)
    ),
    "snake of six": from_urdf(
        ("revolute", "0 0 0", "0 0 0", -2.5, 2.5), *((*TURN, "3.1416 0 0", -2.5, 2.5) for _ in range(5))
    ),
    "yaw and three pitches": from_urdf(
        ("revolute", "0 0 0.3", "0 0 0", -2.5, 2.5),
        ("revolute", "0 0 0", "1.5708 0 0", -1.5, 1.5),
        (*TURN, "3.1416 0 0", -2.5, 2.5),
        (*TURN, "3.1416 0 0", -2.5, 2.5),
    ),
}


STATE = {"scara": [0.3, 0.7, 0.1, -0.5], "planar": [0.3, -0.2, -0.8], "yaw and three pitches": [0.3, -0.1, -0.4, -0.8]}


@pytest.mark.cases(2)
@pytest.mark.parametrize("name", ROUNDED)
def test_what_rounding_in_a_urdf_hides_is_told(name):
    robot = ROUNDED[name]
    found = iq.workbench.inspect(robot, q=STATE.get(name, np.linspace(0.3, -0.8, 6)))
    assert (found.recommended.form, found.recommended.h) == ("tool", None)
    assert found.norm > 1e4
    if name in STATE:  # by its type it is a regular arm with pitches
        assert not found.report.blind_directions.shape[1]
        assert "But no pitch tried is useful here" in words(found)
    # What is said is so: the arm can make that motion, and no pitch form asks for it.
    q, blind = found.recommended.q, found.recommended.blind_twists
    assert f"At q = ({q[0]:.3g}" in found.recommended.reason
    J = robot.jacobian(q)
    root = measure_root(robot.pose(q), found.recommended.length)
    Q = achievable(root @ J)
    for s in (root @ blind).T:
        np.testing.assert_allclose(Q @ (Q.T @ s), s, atol=1e-9)
        for h in (found.recommended.length, -2.0 * found.recommended.length):
            M = iq.PitchForm(h).matrix(np.linalg.inv(root))
            assert np.linalg.norm(Q.T @ M @ s) < np.linalg.norm(M, 2) * np.linalg.norm(s) / MAX_NORM


def test_a_tool_straight_down_leaves_five_joints_no_pitch():
    robot, found = load_arm("so101"), inspected("so101")
    assert (found.report.rank, found.report.blind_directions.shape[1]) == (5, 0)
    assert "0 % of those with the last axis parallel to the first" in found.recommended.reason
    q = found.recommended.q
    across = np.cross(*(robot.jacobian(q)[:3, i] for i in (0, -1)))
    assert np.linalg.norm(across) < PARALLEL_TOLERANCE
    for multiple in (1.0, 4.0):
        with pytest.raises(iq.errors.NoProjectors):
            projected(robot, q, found.recommended.length, multiple * found.recommended.length)
    assert found.recommended.blind_twists.shape == (6, 1)


def test_upright_states_are_inside_the_range_and_upright():
    robot = iq.load_robot("so101")
    q = upright_states(robot, spread(robot, 30))
    assert len(q) > 20
    assert (q >= robot.position_lower).all()
    assert (q <= robot.position_upper).all()
    for state in q:
        w = robot.jacobian(state)[:3]
        assert np.linalg.norm(np.cross(w[:, 0], w[:, -1])) < PARALLEL_TOLERANCE
    assert not len(
        upright_states(load_arm("scara"), spread(load_arm("scara"), 5))
    )  # always upright: no other states than the rest
    slides = iq.robots.Chain(np.vstack((np.zeros((3, 3)), np.eye(3))), np.eye(4))
    assert not len(upright_states(slides, np.zeros((2, 3))))


def test_no_frame_matters():
    T = motion(np.random.default_rng(3))
    plain, moved = inspected("five"), iq.workbench.inspect(five(T))
    assert plain.recommended.h == moved.recommended.h
    assert plain.recommended.length == pytest.approx(moved.recommended.length, rel=1e-9)
    assert plain.norm == pytest.approx(moved.norm, rel=1e-6)
    np.testing.assert_allclose(
        iq.adjoint(T) @ plain.recommended.blind_twists, moved.recommended.blind_twists, atol=1e-6
    )
    np.testing.assert_allclose(plain.survey.pitches, moved.survey.pitches, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(plain.survey.distance, moved.survey.distance, rtol=1e-9)


def test_states_are_spread_evenly_inside_the_range():
    robot = load_arm("panda")
    q = spread(robot, 400)
    low, high = joint_ranges(robot)
    assert (q > low).all()
    assert (q < high).all()
    counts = [np.histogram(x, 10, (a, b))[0] for x, a, b in zip(q.T, low, high, strict=True)]
    assert np.min(counts) > 34
    assert np.max(counts) < 46
    np.testing.assert_array_equal(q, spread(robot, 400))
    # Joints without limits: a turn, or a unit of length.
    free = iq.robots.Chain(np.array([iq.revolute((0, 0, 1), (0, 0, 0)), iq.se3.prismatic((0, 0, 1))]).T, np.eye(4))
    np.testing.assert_allclose(joint_ranges(free), [[-np.pi, -0.5], [np.pi, 0.5]])


@pytest.mark.parametrize("name", [a[0] for a in ARMS])
def test_json_has_the_fixed_keys_and_nothing_json_has_not(name):
    found = json.loads(json.dumps(inspected(name).as_json(), allow_nan=False))
    fixed = {"robot", "tool", "joints", "rank", "gibson_hunt", "admits_pseudoinverse", "principal_pitches"}
    assert fixed | {"blind_directions", "recommended"} <= set(found)
    assert {"form", "h", "reason", "unseen"} <= set(found["recommended"])
    assert (found["robot"], found["samples"]["count"]) == (name, 64)
    assert all(len(direction) == 6 for direction in found["blind_directions"])
    assert found["admits_pseudoinverse"] == (not found["blind_directions"])


def test_bad_input():
    with pytest.raises(iq.BadInput, match="samples"):
        iq.workbench.inspect(five(), samples=0)
    with pytest.raises(iq.errors.UnknownName, match=r"did you mean .*scara"):
        load_arm("scarra")
    with pytest.raises(iq.errors.UnknownName, match="unknown task"):
        load_arm("nowhere.toml")
    with pytest.raises(iq.errors.UnknownName, match="unknown frame"):
        load_arm("so101_line", "nowhere")
    with pytest.raises(iq.BadInput, match="none with joint screws"):
        load_arm("scara", "tool0")


def test_a_task_lends_its_robot_and_another_tool_can_be_named():
    assert len(load_arm("ur5_wrist").names) == 6
    assert len(load_arm("ur5_wrist", "forearm_link").names) == 3


@pytest.fixture
def coarse(monkeypatch):
    """Lines of few points."""
    monkeypatch.setattr(pictured, "SWEEP", 13)


@pytest.mark.parametrize(("name", "said"), [("planar_3r", "no pitch works"), ("ur5", "every pitch works")])
def test_the_picture_says_where_there_are_no_pitches(coarse, tmp_path, name, said):
    robot = load_arm(name)
    file = iq.workbench.pitch_picture(inspected(name), robot, tmp_path / "p.svg")
    text = file.read_text(encoding="utf-8")
    assert f"<!-- {said} -->" in text
    assert f"<!-- {robot.names[-1]} -->" in text


def test_the_picture_of_pitches(coarse, tmp_path):
    robot, found = five(), inspected("five")
    text = iq.workbench.pitch_picture(found, robot, tmp_path / "p.svg").read_text(encoding="utf-8")
    for said in ("five to tool: rank 5", f"recommended h = {found.recommended.h:.3g}", "states of the range"):
        assert said in text


def test_frames_that_share_their_names_with_joints_are_found():
    # A link of the Z1 is called like the fixed joint before it; a tool may be a joint's own frame.
    assert len(load_arm("z1").names) == 6
    assert len(load_arm("panda", "panda_joint7").names) == 7


def test_it_says_how_to_use_the_arm():
    five_joints, six, seven = (" ".join(inspected(name).use_words()) for name in ("so101", "ur5", "panda"))
    assert five_joints.startswith('5 joints, 5 of 6 directions: exact="position" and point= at the tip')
    assert six == '6 joints, every pose near: nothing but a target is needed; exact="position" for a tip that draws.'
    assert seven == six.replace("6", "7", 1) + " Of the joints one is left over: posture= says where to."


def test_joints_without_a_velocity_limit_are_named():
    found = inspected("five")
    assert "No velocity limit is known for" in " ".join(found.use_words())
    assert found.unlimited == found.joints
