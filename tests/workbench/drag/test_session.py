"""The dragged arm and its ghosts, tick by tick, without a browser."""

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.workbench.compare.sweep import methods_named
from invariantqp.workbench.drag.recording import LONGEST
from invariantqp.workbench.drag.session import (
    ACCELERATION,
    DT,
    FORMS,
    HAND,
    HISTORY,
    MOST_LATE,
    RATE,
    SAMPLE_TICKS,
    Session,
    Settings,
)

ARMS = ("panda", "so101", "ur5e")


def session(name="panda", against=()):
    return Session(iq.load_robot(name), name, methods_named(against) if against else ())


def dragged(arms, move, ticks):
    """The positions (ticks + 1, m) of our arm while the target moves by `move` in half of the time."""
    start, q = arms.target.copy(), [arms.ours.q]
    for k in range(ticks):
        arms.target = start.copy()
        arms.target[:3, 3] += min(1.0, 2.0 * k / ticks) * np.array(move)
        arms.tick()
        q.append(arms.ours.q)
    return np.array(q)


@pytest.mark.parametrize("name", ARMS)
def test_it_follows_inside_all_limits(name):
    arms = session(name)
    q = dragged(arms, [-0.03, 0.05, 0.02], 1500)
    velocity = np.diff(q, axis=0) / DT
    robot = arms.robot
    assert ((q >= robot.position_lower) & (q <= robot.position_upper)).all()
    assert (np.abs(velocity) <= robot.velocity_limit + 1e-9).all()
    assert np.abs(np.diff(velocity, axis=0, prepend=0.0 * velocity[:1])).max() <= ACCELERATION * DT + 1e-9
    assert np.linalg.norm(robot.pose(q[-1])[:3, 3] - arms.target[:3, 3]) < (1e-3 if len(q[0]) > 5 else 0.05)


def test_out_of_reach_it_rests():
    arms = session("panda")
    dragged(arms, [3.0, 0.0, 0.0], 4000)
    for _ in range(1000):
        arms.tick()
    assert np.abs(arms.ours.velocity).max() < 5e-3
    assert arms.ours.status in ("left", "late", "limited")
    assert arms.ours.reason


def test_in_another_tool_frame_our_arm_moves_the_same_and_others_do_not():
    ours, theirs = [], []
    for displaced in (False, True):
        arms = session("so101", ["DLS"])
        arms.requested = Settings(displaced=displaced, ghost_limit=False)
        ours.append(dragged(arms, [0.02, 0.08, 0.05], 1000))
        theirs.append(arms.arms[1].q)
    assert np.abs(ours[1] - ours[0]).max() < 1e-9
    assert np.abs(theirs[1] - theirs[0]).max() > 1e-3


def test_an_exact_position_is_met_with_five_joints():
    errors = []
    for exact in (False, True):
        arms = session("so101")
        arms.requested = Settings(exact=exact)
        q = dragged(arms, [0.02, 0.06, 0.03], 2000)
        errors.append(np.linalg.norm(arms.robot.pose(q[-1])[:3, 3] - arms.target[:3, 3]))
    assert errors[1] < 1e-4 < 1e-2 < errors[0]


def test_a_table_is_kept_clear_of():
    arms = session("panda")
    arms.requested = Settings(table=True)
    q = dragged(arms, [0.0, 0.0, -0.5], 3000)
    heights = np.array([arms.robot.pose(each)[2, 3] for each in q[::10]])
    assert heights.min() - HAND - arms.table_height > 0.0099


def test_speed_limits_and_override_slow_it_down():
    fastest = []
    for speed, override in ((1.0, 1.0), (0.2, 1.0), (1.0, 0.3), (1.0, 0.0)):
        arms = session("ur5e")
        arms.requested, arms.override = Settings(speed=speed), override
        velocity = np.diff(dragged(arms, [0.0, 0.3, 0.2], 600), axis=0) / DT
        fastest.append(np.abs(velocity).max() / arms.robot.velocity_limit[0])
    assert fastest[1] <= 0.2 + 1e-9 < fastest[0]
    assert fastest[3] == 0.0 < fastest[2] < 0.5 * fastest[0]


def test_settings_that_contradict_one_another_are_refused_and_the_arm_goes_on(monkeypatch):
    arms = session("panda")

    def refuses(*_, **__):
        raise iq.BadInput("form", "this", "that")

    monkeypatch.setattr("invariantqp.workbench.drag.session.Controller", refuses)
    arms.requested = Settings(form=FORMS[1])
    arms.tick()
    assert arms.refused == "form: found this; expected that."
    assert arms.settings == arms.requested == Settings()


def test_a_ghost_that_fails_stops_and_says_why(monkeypatch):
    arms = session("panda", ["Moore-Penrose"])
    ghost = arms._ghosts[0]
    for answer, why in ((np.full(7, np.nan), "the answer is not finite"), (None, "ZeroDivisionError: no")):

        def step(*_, answer=answer):
            if answer is None:
                raise ZeroDivisionError("no")
            return answer

        monkeypatch.setattr(ghost.loop, "step", step)
        arms.tick()
        assert (ghost.arm.status, ghost.arm.reason) == ("fails", why)
        assert not ghost.arm.velocity.any()
        assert np.isfinite(arms.ours.q).all()


def test_ghosts_have_the_same_limits():
    arms = session("ur5e", ["Moore-Penrose", "QP"])
    fastest = np.zeros(3)
    start, before = arms.target.copy(), [arm.velocity for arm in arms.arms]
    for k in range(500):
        arms.target = start.copy()
        arms.target[:3, 3] += [0.0, 0.002 * min(k, 150), 0.0]
        arms.tick()
        fastest = np.maximum(
            fastest, [np.abs(a.velocity - b).max() / DT for a, b in zip(arms.arms, before, strict=True)]
        )
        before = [arm.velocity for arm in arms.arms]
    assert (fastest <= 1.001 * ACCELERATION).all()


def test_it_catches_up_with_the_clock_but_not_without_end():
    arms = session()
    arms.advance(0.0161)
    assert arms.ticks == 8
    arms.advance(0.0009)
    assert arms.ticks == 8
    arms.advance(0.0011)
    assert arms.ticks == 9
    arms.advance(60.0)
    assert arms.ticks == 9 + round(MOST_LATE / DT)


def test_nothing_grows_without_bound():
    arms = session("so101", ["DLS"])
    for _ in range(round(1.2 * HISTORY / DT)):
        arms.tick()
    assert [len(arm.history) for arm in arms.arms] == [round(HISTORY * RATE)] * 2
    assert arms.ours.history[-1].time - arms.ours.history[0].time == pytest.approx(HISTORY, abs=2.0 / RATE)


def test_back_at_the_start():
    arms = session("panda", ["DLS"])
    dragged(arms, [0.1, 0.1, 0.1], 300)
    arms.reset()
    assert all((arm.q == arms.start).all() and not arm.history for arm in arms.arms)
    arms.tick()
    assert np.abs(arms.ours.velocity).max() < 1e-9


def test_a_recording_is_a_task_that_runs_and_a_page(tmp_path):
    arms = session("ur5e")
    arms.record()
    dragged(arms, [0.05, 0.1, -0.05], 40 * SAMPLE_TICKS)
    recorder = arms.recorder
    file = tmp_path / "dragged.toml"
    file.write_text(recorder.task_file(), encoding="utf-8")
    trace = iq.run_task(iq.load_task(file))
    assert trace.time[-1] == pytest.approx(recorder.seconds, abs=0.1)
    np.testing.assert_allclose(trace.wanted[-1], arms.target, atol=2e-3)
    assert np.linalg.norm(arms.robot.pose(trace.q[-1])[:3, 3] - arms.target[:3, 3]) < 0.02
    assert "dragged" in recorder.page()


def test_a_recording_ends_by_itself():
    arms = session("so101")
    arms.record()
    recorder = arms.recorder
    for _ in range(3):
        recorder.add(arms.start, arms.start, "ok", arms.target, is_limited=False)
    assert recorder.seconds == pytest.approx(3 * DT)
    recorder._ticks = recorder._ticks[:1] * round(LONGEST / DT)
    recorder.add(arms.start, arms.start, "ok", arms.target, is_limited=False)
    assert recorder.seconds == pytest.approx(LONGEST)
