import json
from dataclasses import replace

import numpy as np
import pytest
from attrs import evolve
from support.random_systems import motion

import invariantqp as iq
from invariantqp.analysis import survey as surveys
from invariantqp.analysis.recommendation import CLEARANCE, crowded, recommend
from invariantqp.analysis.survey import joint_ranges, spread, survey
from invariantqp.robots.kinematics import middle
from invariantqp.runs.arm import arm
from invariantqp.velocity.forms import FEW_JOINTS_PITCH

# name, joints, rank in the middle, rank of the arm, type in the middle, recommended form
ARMS = [
    ("so101", 5, 5, 5, "h", "pitch"),
    ("ur5", 6, 6, 6, "SE3", "pitch"),
    ("panda", 7, 6, 6, "SE3", "pitch"),
    ("scara", 4, 4, 4, "IIC", "tool"),
    ("planar_3r", 3, 3, 3, "IIC", "tool"),
    ("arm_3r", 3, 3, 3, "IB0", "pitch"),
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


def words(found):
    return " ".join((*found.state_words(), *found.range_words(), found.recommended.reason))


@pytest.mark.parametrize(("name", "joints", "rank", "attainable", "kind", "form"), ARMS, ids=[a[0] for a in ARMS])
def test_what_is_said_of_known_arms(name, joints, rank, attainable, kind, form):
    robot = arm(name)
    found = iq.analysis.inspect(robot, name=name)
    assert len(found.joints) == joints
    assert (found.report.rank, found.survey.attainable_rank, str(found.report.type)) == (rank, attainable, kind)
    assert found.recommended.form == form
    assert found.own_length == pytest.approx(iq.systems.centre(robot.jacobian(middle(robot))).length)
    if form == "pitch":
        h = found.recommended.h
        few = 1.0 if attainable == 6 else FEW_JOINTS_PITCH
        assert 0.9 * few < abs(h) / found.own_length < 4.1 * few
        regular = [q for q, r in zip(found.survey.q, found.survey.rank, strict=True) if r == attainable]
        assert all(iq.has_pseudoinverse(robot.jacobian(q), h) for q in regular)
    else:
        assert found.recommended.length == pytest.approx(found.own_length)
        assert found.recommended.h is None
        assert "No h works: every pitch form is blind to translation along (1, 0, 0) and (0, 1, 0)" in words(found)
        assert "Complement(Z)" in found.recommended.reason
    assert "nan" not in words(found)
    assert "e-1" not in words(found)


def test_a_singular_middle_is_not_taken_for_the_arm():
    found = iq.analysis.inspect(arm("ur5"))
    assert found.report.rank == 6
    assert found.where == "in a regular state, since the middle of the joint range is singular"
    singular = iq.analysis.inspect(arm("ur5"), q=np.zeros(6))
    assert "That is this state, not the arm: its rank is 6 in 100 % of the range." in singular.state_words()
    regular = iq.analysis.inspect(arm("ur5"), q=[0.1, -1.2, 1.6, -0.6, -0.4, 0.3])
    assert (regular.report.rank, regular.recommended) == (6, found.recommended)
    assert "not the arm" not in words(regular)


def test_redundant_joints_are_no_singularity():
    bases = ((0, 0, 0), (0.3, 0, 0), (0.6, 0.1, 0), (0.8, 0.3, 0))
    planar = iq.robots.Chain(np.array([iq.revolute((0, 0, 1), p) for p in bases]).T, np.eye(4))
    assert "the joints are redundant, this is no singularity" in words(iq.analysis.inspect(planar))


def test_arms_without_a_length_of_their_own():
    gantry = iq.robots.Chain(
        np.vstack((np.zeros((3, 3)), np.eye(3))), np.eye(4), position_lower=0.0, position_upper=1.0
    )
    found = iq.analysis.inspect(gantry)
    assert (found.recommended.form, found.recommended.length) == ("tool", 1.0)
    assert found.as_json()["own_length"] is None
    np.testing.assert_array_equal(iq.tool_metric(gantry).matrix, np.eye(6))
    wrist = iq.robots.Chain(np.array([iq.revolute(a, (1.0, 2.0, 3.0)) for a in np.eye(3)]).T, np.eye(4))
    found = iq.analysis.inspect(wrist)
    assert (found.recommended.form, found.recommended.h, found.own_length) == ("pitch", 1.0, 0.0)
    assert "any h but 0 does the same" in found.recommended.reason


def test_the_recommended_pitch_is_as_clear_of_principal_pitches_as_it_says():
    robot = five()
    found = iq.analysis.inspect(robot, samples=300)
    h = found.recommended.h
    near = 0
    for q in np.vstack((found.q, found.survey.q)):
        near += np.abs(iq.principal_pitches(robot.jacobian(q)) - h).min() < 0.5 * abs(h)
    assert f"in {100.0 * (1.0 - near / 301):.3g} % of the states" in found.recommended.reason
    assert near / 301 < 0.05


@pytest.mark.parametrize("where", [1.0, -1.0, 1.4, -2.5])
def test_it_gives_way_to_a_principal_pitch_of_its_own_size(where):
    found = iq.analysis.inspect(five())
    n, L = len(found.survey.q), FEW_JOINTS_PITCH * found.own_length
    pitches = np.full((n, 6), np.nan)
    pitches[:, 0] = where * L
    report = evolve(found.report, principal_pitches=np.array([where * L]))
    h = recommend(five(), report, replace(found.survey, pitches=pitches), found.own_length).h
    assert abs(h - where * L) >= CLEARANCE * abs(h)
    assert 0.9 * L < abs(h) < 4.1 * L
    assert crowded(pitches, h) == 0.0
    expected = {1.0: -1.0, -1.0: 1.0, 1.4: -1.0, -2.5: 1.0}[where]
    assert h / L == pytest.approx(expected, rel=0.1)


def test_states_in_which_no_pitch_works_do_not_speak_for_the_arm():
    found = iq.analysis.inspect(five())
    blind = np.zeros(len(found.survey.q), dtype=int)
    blind[:10] = 1
    few = recommend(five(), found.report, replace(found.survey, blind=blind), found.own_length)
    assert few.form == "pitch"
    assert "In 15.6 % of the states no h works" in few.reason


def test_no_frame_matters():
    T = motion(np.random.default_rng(3))
    plain, moved = iq.analysis.inspect(five()), iq.analysis.inspect(five(T))
    assert plain.recommended == moved.recommended
    np.testing.assert_allclose(plain.survey.pitches, moved.survey.pitches, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(plain.survey.distance, moved.survey.distance, rtol=1e-9)


def test_states_are_spread_evenly_inside_the_range():
    robot = arm("panda")
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


def test_processes_find_what_one_finds(monkeypatch):
    robot = arm("so101")
    q = spread(robot, 60)
    alone = survey(robot, q)
    monkeypatch.setattr(surveys, "PARALLEL_FROM", 1)
    monkeypatch.setattr(surveys, "CHUNK", 20)
    told = []
    together = survey(robot, q, jobs=2, progress=lambda done, total: told.append((done, total)))
    assert told == [(20, 60), (40, 60), (60, 60)]
    assert alone.types == together.types
    for key in ("rank", "pitches", "blind", "distance"):
        np.testing.assert_array_equal(getattr(alone, key), getattr(together, key))


@pytest.mark.parametrize("name", [a[0] for a in ARMS])
def test_json_has_the_fixed_keys_and_nothing_json_has_not(name):
    found = json.loads(json.dumps(iq.analysis.inspect(arm(name), name=name).as_json(), allow_nan=False))
    fixed = {"robot", "tool", "joints", "rank", "gibson_hunt", "admits_pseudoinverse", "principal_pitches"}
    assert fixed | {"blind_directions", "recommended"} <= set(found)
    assert {"form", "h", "reason"} <= set(found["recommended"])
    assert (found["robot"], found["samples"]["count"]) == (name, 64)
    assert all(len(direction) == 6 for direction in found["blind_directions"])
    assert found["admits_pseudoinverse"] == (not found["blind_directions"])


def test_bad_input():
    with pytest.raises(iq.BadInput, match=r"q: found shape \(2,\); expected"):
        iq.analysis.inspect(five(), q=[0.0, 1.0])
    with pytest.raises(iq.BadInput, match="NaN"):
        iq.analysis.inspect(five(), q=[np.nan] * 5)
    with pytest.raises(iq.BadInput, match="samples"):
        iq.analysis.inspect(five(), samples=0)
    with pytest.raises(iq.errors.UnknownName, match=r"did you mean .*scara"):
        arm("scarra")
    with pytest.raises(iq.errors.UnknownName, match="unknown task"):
        arm("nowhere.toml")
    with pytest.raises(iq.errors.UnknownName, match="unknown frame"):
        arm("so101_line", "nowhere")
    with pytest.raises(iq.BadInput, match="none with joint screws"):
        arm("scara", "tool0")


def test_a_task_lends_its_robot_and_another_tool_can_be_named():
    assert len(arm("ur5_wrist").names) == 6
    assert len(arm("ur5_wrist", "forearm_link").names) == 3


@pytest.mark.parametrize(("name", "said"), [("planar_3r", "no pitch works"), ("ur5", "every pitch works")])
def test_the_picture_says_where_there_are_no_pitches(tmp_path, name, said):
    robot = arm(name)
    file = iq.pictures.pitch_picture(iq.analysis.inspect(robot, name=name), robot, tmp_path / "p.svg")
    text = file.read_text(encoding="utf-8")
    assert f"<!-- {said} -->" in text
    assert f"<!-- {robot.names[-1]} -->" in text


def test_the_picture_of_pitches(tmp_path):
    robot = five()
    found = iq.analysis.inspect(robot, name="five")
    text = iq.pictures.pitch_picture(found, robot, tmp_path / "p.svg").read_text(encoding="utf-8")
    for said in ("five to tool_point: rank 5", f"recommended h = {found.recommended.h:.3g}", "states of the range"):
        assert said in text
    assert iq.pictures.pitch_picture(found, robot, tmp_path / "p.png").stat().st_size > 20_000


def test_frames_that_share_their_names_with_joints_are_found():
    # A link of the Z1 is called like the fixed joint before it; a tool may be a joint's own frame.
    assert len(arm("z1").names) == 6
    assert len(arm("panda", "panda_joint7").names) == 7
