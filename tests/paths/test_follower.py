"""One driver for chunks, hands, twists: limits in every tick whatever comes, and at rest when nothing does."""

import copy
import pickle
import re
import warnings
from functools import cache
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from support.arms import LIMITS, ready
from support.streams import Arm, chunks, driven, run

import invariantqp as iq
from invariantqp.paths import waypoints


def hand(arm, rng, T, f=60.0, noise=1.0, lag=0.02):
    """Events of a hand that moves as a motion of the arm does, and that motion."""
    truth, events = arm.motion(rng), []
    for stamp in np.arange(0.0, T, 1.0 / f):
        pose = arm.robot.pose(truth(stamp))
        pose[:3, 3] += noise * 2e-4 * rng.normal(size=3)
        pose = pose @ iq.exp(np.append(noise * 1e-3 * rng.normal(size=3), np.zeros(3)))
        events.append((stamp + lag, lambda f, pose=pose, stamp=stamp: f.add(pose, stamp)))
    return events, truth


def following(arm, seed, T=5.0, size=0.3, **options):
    """A follower of points of a motion of the arm, 20 a second, and that motion."""
    truth, stamps = arm.motion(np.random.default_rng(seed), size), np.arange(0.0, T, 0.05)
    follower = arm.follower(**options)
    follower.follow([truth(t) for t in stamps], stamps)
    return follower, truth


def rests(Q, arm, after):
    """When the joints stand for good, from the time `after` on."""
    still = (np.diff(Q, axis=0) == 0.0).all(axis=1)
    moving = np.flatnonzero(~still)
    assert still[-round(0.2 / arm.dt) :].all()
    return (moving[-1] + 1) * arm.dt - after


@pytest.mark.cases(3)
@pytest.mark.parametrize("name", LIMITS)
@pytest.mark.parametrize("poses", [True, False])
@pytest.mark.parametrize("seed", range(1))
def test_chunks_keep_every_limit_and_end_at_rest(name, poses, seed):
    arm, rng = Arm(name), np.random.default_rng([seed, poses])
    sent = chunks(arm, rng, 1.5, poses=poses)
    events = [(t, lambda f, p=p, s=s: f.follow(p, s)) for t, p, s in sent]
    end = max(s[-1] for _, _, s in sent)
    came, first = max((t, s[0]) for t, _, s in sent if s[-1] == end)
    wait = max(came, end if len(sent) > 1 else 0.0) - first  # newer ones may be as late, and one of a stream is lost
    Q, answers = driven(arm, arm.follower(), events, end + wait + 1.0)
    arm.held(Q)
    assert (np.diff(Q[round((end + 0.7) / arm.dt) : round((end + wait) / arm.dt) - 1], axis=0) == 0.0).all()
    assert rests(Q, arm, end + wait) < 0.7
    assert answers[-1].status in ("done", "blocked")


@pytest.mark.cases(1)
@pytest.mark.parametrize("name", LIMITS)
def test_after_overshoot_the_arm_is_done_at_the_last_point(name):
    arm = Arm(name)
    stamps = np.arange(30) / 20
    points = arm.start + np.outer(stamps, 0.2 * np.ones(len(arm.start)))
    Q, answers = driven(arm, arm.follower(), [(0.0, lambda f: f.follow(points, stamps))], stamps[-1] + 1.0)
    arm.held(Q)
    done = [a.status for a in answers].index("done")
    assert done * arm.dt - stamps[-1] < 0.7
    assert all(a.status == "done" for a in answers[done:])
    assert np.abs(Q[done + 1 :] - points[-1]).max() < 1e-6
    assert answers[-1].across < 1e-6
    assert np.abs(Q - points[-1]).max(axis=1)[-225] > 0.005  # it did not brake before the end


def test_a_gap_between_chunks_does_not_turn_the_arm_back():
    arm = Arm("ur5")
    stamps = np.arange(30) / 20
    ways = [arm.start + np.outer(s, 0.3 * np.ones(6)) for s in (stamps, stamps + 1.45)]
    events = [(0.4 + 1.42 * k, lambda f, k=k: f.follow(ways[k], stamps + 1.45 * k)) for k in (0, 1)]
    Q, answers = driven(arm, arm.follower(), events, 2.5)  # 0.37 s without points
    arm.held(Q)
    assert np.diff(Q, axis=0).min() > -1e-12
    assert {a.status for a in answers[round(1.78 / arm.dt) : round(1.82 / arm.dt)]} == {"waiting"}


@pytest.mark.parametrize("again", [False, True])
def test_newer_points_are_blended_in_and_another_motion_takes_over_at_once(again):
    arm = Arm("ur5")
    old, new = (np.tile(arm.start + away, (41, 1)) for away in (0.0, 0.1))
    stamps, now = np.arange(41) / 20, 0.5  # the old are for two seconds, the new for 2.5 s
    replace = {} if again else {"at": now}
    events = [(0.0, lambda f: f.follow(old, stamps)), (now, lambda f: f.follow(new, stamps + now, **replace))]
    Q, _ = driven(arm, arm.follower(), events, 2.55)
    arm.held(Q)
    share = (Q - arm.start).mean(axis=1) / 0.1
    for t in (1.0, 1.5, 1.75, 2.25, 2.5):  # those before them end at 2 s
        assert abs(share[round(t / arm.dt)] - ((t - now) / 2.0 if again else 1.0)) < 0.02


def test_a_short_overlap_needs_no_more_acceleration_than_another_motion():
    arm, most = Arm("ur5"), []
    stamps = np.arange(21) / 20
    for replace in ({}, {"at": 0.9}):
        events = [
            (now, lambda f, k=k, now=now, more=more: f.follow(np.tile(arm.start + k, (21, 1)), stamps + now, **more))
            for k, now, more in ((0.0, 0.0, {}), (0.1, 0.9, replace))
        ]
        Q, _ = driven(arm, arm.follower(), events, 2.0)
        arm.held(Q)
        most.append(np.abs(np.diff(Q, 2, axis=0)).max() / arm.dt**2)
    assert most[0] <= max(most[1], 0.97 * arm.acceleration[0])


def test_samples_after_points_cancel_the_return_to_the_last_point():
    arm = Arm("ur5")
    stamps = np.arange(19) / 20
    events = [(0.4, lambda f: f.follow(np.tile(arm.start + 0.1, (19, 1)), stamps))]  # the last is waited at till 1.3 s
    events += [(t, lambda f, t=t: f.add(arm.start, t)) for t in np.arange(0.5, 2.0, 1 / 60)]
    Q, answers = driven(arm, arm.follower(), events, 2.0)
    arm.held(Q)
    assert {a.status for a in answers[round(0.95 / arm.dt) :]} == {"moving"}
    assert np.abs(Q[round(1.0 / arm.dt) :] - arm.start).max() < 1e-3


@pytest.mark.cases(1)
@pytest.mark.parametrize("over", [0.8, 0.02, 1.2])
def test_points_that_are_over_within_a_second_give_the_last_as_a_goal(over):
    arm = Arm("ur5")
    stamps = np.arange(10) / 20
    points = arm.start + np.outer(stamps, 0.3 * np.ones(6))
    Q, answers = driven(arm, arm.follower(), [(0.45 + over, lambda f: f.follow(points, stamps))], 3.5)
    arm.held(Q)
    followed = over < 1.0
    assert answers[-1].status == ("done" if followed else "waiting")
    assert np.abs(Q[-1] - (points[-1] if followed else arm.start)).max() < 1e-6


def test_joints_that_catch_up_do_not_overshoot():
    arm = Arm("ur5")

    def place(t):  # it leaps, and comes back a little while the joints are on their way
        back = np.clip((t - 0.8) / 0.6, 0.0, 1.0)
        return arm.start + (0.0 if t < 0.5 else 1.2 - 0.16 * back**3 * (10 - 15 * back + 6 * back**2))

    events = [(t + 0.01, lambda f, t=t: f.add(place(t), t)) for t in np.arange(0.0, 2.0, 1 / 60) if not 0.3 < t < 0.5]
    Q, answers = driven(arm, arm.follower(), events, 2.0)
    arm.held(Q)
    assert "late" in {a.status for a in answers}
    quick = Arm("ur5")
    quick.acceleration, quick.jerk = 100.0 * quick.acceleration, 1e4 * quick.jerk
    followed, _ = driven(quick, quick.follower(), events, 2.0)
    assert (Q - followed)[200:].max() < 1e-4
    assert np.abs(Q[-25:] - place(2.0)).max() < 1e-3


@pytest.mark.cases(1)
@pytest.mark.parametrize("name", LIMITS)
@pytest.mark.parametrize("seed", range(1))
def test_broken_streams_keep_every_limit(name, seed):
    arm, rng = Arm(name), np.random.default_rng(seed)
    truth, events = arm.motion(rng), []
    for t in np.sort(rng.uniform(0.0, 2.5, 160)):
        pose = arm.robot.pose(truth(t))
        if rng.random() < 0.1:
            pose[:3, 3] += rng.normal(size=3) * rng.choice([0.02, 0.3, 3.0])
        stamp = t + rng.choice([0.0, -0.02, -0.5, 0.3, 40.0, -1e6], p=[0.7, 0.1, 0.05, 0.05, 0.05, 0.05])
        events.append((t, lambda f, pose=pose, stamp=stamp: f.add(pose, stamp)))
    Q, answers = driven(arm, arm.follower(), events, 3.5)
    arm.held(Q)
    assert rests(Q, arm, 2.5) < 0.1 + 0.7
    assert answers[-1].status == "waiting"


@pytest.mark.cases(1)
@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_noise_does_not_delay_a_hand(name):
    arm, off, lates = Arm(name), [], []
    for noise in (0.0, 1.0):
        events, truth = hand(arm, np.random.default_rng(5), 4.0, noise=noise)
        Q, answers = driven(arm, arm.follower(), events, 4.0)
        arm.held(Q)
        late = answers[-1].late
        lates.append(late)
        ticks = range(375, len(Q) - 1, 5)
        places = [[arm.robot.pose(x)[:3, 3] for x in (Q[i], truth(i * arm.dt - late))] for i in ticks]
        off.append(np.linalg.norm(np.diff(places, axis=1), axis=2).max())
    assert off[0] < 1e-3
    assert off[1] < 2e-3
    assert abs(lates[0] - lates[1]) < 0.02
    assert lates[0] < 0.02 + 0.08  # transport and the window


def test_points_without_noise_are_met_at_their_stamps():
    arm = Arm("panda")
    follower, truth = following(arm, 2, 3.0, cutoff=np.inf)
    Q, answers = driven(arm, follower, [], 2.9)
    arm.held(Q)
    for i in range(150, 700, 25):
        assert np.abs(Q[i] - truth(i * arm.dt)).max() < 1e-4
        assert answers[i].late == 0.0
        assert answers[i].across < 1e-3


def test_a_function_of_time_is_followed():
    arm = Arm("ur5")
    truth = arm.motion(np.random.default_rng(3))
    follower = arm.follower()
    follower.follow(lambda t: arm.robot.pose(truth(t)))
    Q, _ = driven(arm, follower, [], 4.0)
    arm.held(Q)
    for i in range(150, 1000, 50):
        error = arm.robot.pose(Q[i]) - arm.robot.pose(truth(i * arm.dt))
        assert np.abs(error).max() < 1e-5


def test_chunks_in_the_wrong_order_change_nothing():
    arm, rng = Arm("ur5"), np.random.default_rng(4)
    truth = arm.motion(rng)

    def chunk(first):
        stamps = first + np.arange(20) * 0.05
        return np.array([truth(t) for t in stamps]) + 0.02 * rng.normal(size=6), stamps

    old, new = chunk(0.0), chunk(0.3)
    events = [(0.4, lambda f: f.follow(*new))]
    Q, _ = driven(arm, arm.follower(), events, 2.0)
    again, _ = driven(arm, arm.follower(), [*events, (0.5, lambda f: f.follow(*old))], 2.0)
    assert np.abs(again - Q).max() < 1e-12


@pytest.mark.parametrize("name", LIMITS)
def test_a_twist_is_followed_and_ends_at_rest(name):
    arm = Arm(name)
    wanted = np.array([0.1, 0.0, 0.2, 0.05, -0.05, 0.08])
    events = [(t, lambda f: f.twist(wanted)) for t in np.arange(0.0, 1.0, 0.02)]
    Q, answers = driven(arm, arm.follower(), events, 2.5)
    arm.held(Q)
    tool = iq.transform(translation=arm.robot.pose(Q[200])[:3, 3])
    done = iq.adjoint(iq.inverse(tool)) @ arm.robot.jacobian(Q[200]) @ answers[200].velocity
    if not arm.exact:
        assert np.abs(done - wanted).max() < 1e-3
    assert rests(Q, arm, 0.98) < 0.1 + 0.6
    assert answers[-1].status == "waiting"


@pytest.mark.parametrize("name", LIMITS)
def test_a_pause_comes_to_rest_and_resume_continues_with_the_points_that_are_due(name):
    arm = Arm(name)
    follower, truth = following(arm, 6, size=0.6)
    Q, answers = driven(arm, follower, [(1.5, lambda f: f.pause()), (3.0, lambda f: f.resume())], 4.8)
    arm.held(Q)
    paused = np.diff(Q[:750], axis=0)
    assert (paused[round((1.5 + 0.7) / arm.dt) :] == 0.0).all()
    assert answers[745].status == "paused"
    assert np.abs(Q[1150] - truth(4.6)).max() < 2e-3


def test_after_an_override_the_arm_catches_up_with_its_stamps():
    arm = Arm("ur5")
    follower, truth = following(arm, 7)
    Q, answers = driven(arm, follower, [], 4.5, options=lambda i, q: {"override": 0.4 if 250 <= i < 500 else 1.0})
    arm.held(Q)
    assert answers[495].late == pytest.approx(0.6 * (495 - 250 + 1) * arm.dt, abs=1e-9)
    assert np.abs(Q[496] - truth(answers[495].place)).max() < 3e-3
    assert np.abs(Q[-1] - truth(1125 * arm.dt)).max() < 3e-3


def test_newer_points_are_followed_during_an_override():
    arm, stamps = Arm("ur5"), np.arange(20) / 20
    events = [
        (0.6 * k, lambda f, k=k: f.follow(np.tile(arm.start + 0.1 * k, (20, 1)), 0.6 * k + stamps)) for k in range(3)
    ]
    Q, _ = driven(arm, arm.follower(), events, 6.0, override=0.5)
    assert np.abs(Q[-1] - arm.start - 0.2).max() < 1e-6


@pytest.mark.cases(1)
@pytest.mark.parametrize(("name", "seed"), [("ur5", 1), ("panda", 0)])
def test_out_of_reach_and_back_it_is_never_stuck(name, seed):
    arm, rng = Arm(name), np.random.default_rng([seed, 9])
    home = arm.robot.pose(arm.start)
    away = rng.normal(size=3)
    away *= np.sign(away @ home[:3, 3]) * 1.0 / np.linalg.norm(away)
    turn = rng.normal(size=3) * 0.2
    events = []
    for stamp in np.arange(0.0, 4.5, 1 / 60):
        s = np.interp(stamp, [0.0, 1.0, 1.5, 2.5], [0.0, 1.0, 1.0, 0.0])
        pose = home @ iq.exp(np.append(s * turn, np.zeros(3)))
        pose[:3, 3] = home[:3, 3] + s * s * (3.0 - 2.0 * s) * away
        events.append((stamp, lambda f, pose=pose, stamp=stamp: f.add(pose, stamp)))
    Q, answers = driven(arm, arm.follower(), events, 4.5)
    arm.held(Q)
    assert "left" in {a.status for a in answers}
    assert np.linalg.norm((arm.robot.pose(Q[-1]) - home)[:3, 3]) < 1e-3


@pytest.mark.parametrize("exact", [True, False])
def test_the_error_of_five_joints_is_reported(exact):
    arm = Arm("so101")
    if not exact:
        arm.exact = None
    home = arm.robot.pose(arm.start)
    turned = home @ iq.exp([0.3, 0.0, 0.0, 0.0, 0.0, 0.0]) @ iq.exp([0.0, 0.0, 0.3, 0.0, 0.0, 0.0])
    follower = arm.follower()
    follower.follow([home, turned], [0.5, 2.0])
    Q, answers = driven(arm, follower, [], 4.0)
    error = iq.log(turned @ np.linalg.inv(arm.robot.pose(Q[-1])))
    measure = follower.controller.measure
    root = measure.root_for(arm.robot.jacobian(Q[-1]), arm.robot.pose(Q[-1]))
    assert answers[-1].across == pytest.approx(np.linalg.norm(root @ error), rel=1e-6)
    assert answers[-1].across > 1e-3
    assert answers[-1].status == ("done" if exact else "blocked")


def test_the_work_of_a_tick_is_bounded(monkeypatch):
    arm = Arm("ur5")
    truth = arm.motion(np.random.default_rng(8))
    solved = []
    for name in ("solve", "descend"):
        real = getattr(waypoints.PoseSearch, name)
        monkeypatch.setattr(waypoints.PoseSearch, name, lambda *a, _=real, **k: (solved.append(1), _(*a, **k))[1])
    follower, q = arm.follower(), arm.start
    stamps = np.arange(5000) * 0.01
    poses = np.array([arm.robot.pose(truth(t)) for t in stamps])
    most = 0
    for i in range(100):
        for k in range(40):
            follower.add(poses[min(i * 40 + k, 4999)], i * arm.dt + k * arm.dt / 50)
        solved.clear()
        q = q + arm.dt * follower.step(q, now=i * arm.dt).velocity
        most = max(most, len(solved))
    assert most <= 8 * 12  # eight samples, each with a walk to it at most
    follower.follow(poses, stamps)
    most = 0
    for i in range(100, 350):
        solved.clear()
        q = q + arm.dt * follower.step(q, now=i * arm.dt).velocity
        most = max(most, len(solved))
    assert 0 < most <= 96 * 12


def test_an_arm_waits_at_a_first_point_that_is_due_later():
    arm = Arm("ur5")
    stamps = np.arange(20) / 20
    points = arm.start + np.outer(stamps, 0.3 * np.ones(6))
    again = arm.start + 0.1, 3.0 + stamps
    events = [
        (0.0, lambda f: f.follow(points, stamps)),
        (0.5, lambda f: f.follow(np.tile(again[0], (20, 1)), again[1])),
    ]
    Q, _ = driven(arm, arm.follower(), events, 3.5)
    arm.held(Q)
    assert np.abs(Q[round(1.0 / arm.dt) :] - again[0]).max() < 1e-3
    assert np.abs(Q - again[0]).max() < 0.12


def test_an_arm_away_from_the_first_point_is_late_until_it_is_there():
    arm, stamps = Arm("ur5"), np.arange(30) / 20
    for away, first in ((0.5, "late"), (0.02, "moving")):
        points = arm.start + away + 0.1 * np.sin(stamps)[:, None]
        Q, answers = driven(arm, arm.follower(), [(0.0, lambda f, p=points: f.follow(p, stamps))], 2.0)
        arm.held(Q)
        assert (str(answers[0].status), answers[0].reason) == (first, "the joints' limits" if first == "late" else "")
        on = [k for k, solution in enumerate(answers) if solution.status == "moving"]
        off = np.abs(Q[on[0]] - arm.start - away - 0.1 * np.sin(on[0] * arm.dt)).max()
        assert off < 0.02 + 1e-9
        assert answers[-1].status == "done"


def test_an_arm_that_does_not_move_is_degraded():
    """Stopped without a word to the follower: it says so, tells how far off the tool is, and goes on with the arm."""
    arm = Arm("ur5")
    truth, stamps = arm.motion(np.random.default_rng(5)), np.arange(0.0, 3.0, 0.05)
    follower = arm.follower()
    follower.follow([arm.robot.pose(truth(t)) for t in stamps], stamps)
    Q, answers = driven(arm, follower, [], 2.8, moves=lambda i: not 250 <= i < 350)
    for i, stands in ((245, False), (349, True), (699, False)):
        assert answers[i].status == ("degraded" if stands else "moving")
        assert ("no motion measured" in answers[i].reason) == stands
        off = np.linalg.norm((arm.robot.pose(Q[i + 1]) - arm.robot.pose(truth(answers[i].place)))[:3, 3])
        assert 0.5 * off <= answers[i].across < 1e-3 + 5.0 * off


@pytest.mark.parametrize("poses", [True, False])
def test_stamps_in_milliseconds_cause_a_warning(poses):
    arm, rng = Arm("ur5"), np.random.default_rng(12)
    for _, points, stamps in chunks(arm, rng, 3.0, poses=poses):
        with pytest.warns(UserWarning, match="stamps are seconds here") as said:
            arm.follower().follow(points, 1e3 * stamps)
        assert said[0].filename == __file__
        arm.follower().follow(points, stamps)
    still, slow = np.tile(arm.start, (3, 1)), arm.start + np.outer((0.0, 1.0, 2.0), 0.1 * np.ones(6))
    for points in (still, slow):
        arm.follower().follow(points, np.array((0.0, 20.0, 40.0)))


@pytest.mark.parametrize("unit", [1.0, 1e3, 1e9])
def test_samples_stamped_in_milliseconds_cause_one_warning(unit):
    """Another clock, which leaps once, is not."""
    arm, events = Arm("ur5", dt=0.004), []
    for k in range(60):
        stamp = k / 60 + (40.0 if k > 30 and unit == 1.0 else 0.0)
        events.append((k / 60, lambda f, stamp=stamp: f.add(arm.start, unit * stamp)))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        driven(arm, arm.follower(), events, 1.0)
    assert ["stamps are seconds here" in str(each.message) for each in said] == [True] * (unit > 1.0)


@pytest.mark.parametrize(("spacing", "count"), [(13.0, 3), (0.5, 101)])
def test_a_long_chunk_is_done_only_at_its_end(spacing, count):
    """Points farther apart than a plan reaches, and more of them than are planned at once."""
    start = np.array([0.2, -1.5, 1.1, -2.0, 0.1, 1.7])
    points, stamps = start + np.outer(np.linspace(0.0, 0.3, count), np.ones(6)), spacing * np.arange(count)
    follower = iq.Follower(iq.Controller(iq.load_robot("ur5"), dt=0.02, acceleration_limit=8.0))
    follower.follow(points, stamps)
    made = run(follower, start, round((stamps[-1] + 0.5) / 0.02), dt=0.02, until=("done",))
    assert set(made.statuses[:-1]) <= {"moving", "waiting"}
    assert made.statuses[-1] == "done"
    assert np.abs(made.Q[-1] - points[-1]).max() < 1e-6
    assert 0.02 * (len(made.V) - 1) > stamps[-1]


@pytest.mark.cases(1)
@pytest.mark.parametrize("hertz", [60, 30, 12])
def test_noise_is_not_amplified_at_low_sample_rates(hertz):
    arm, rng, noise = Arm("ur5"), np.random.default_rng(0), []
    follower, here = iq.Follower(arm.controller(), timeout=0.3), arm.robot.pose(arm.start)

    def before(k, q):
        if k % round(250 / hertz) == 0:
            noise.append(1e-3 * rng.normal(size=3))
            follower.add(here @ iq.transform(translation=noise[-1]), arm.dt * k)

    Q, _ = driven(arm, follower, before, 6.0)
    moved, seen = (np.linalg.norm(x, axis=1) for x in ([arm.robot.pose(q)[:3, 3] - here[:3, 3] for q in Q], noise))
    assert np.sqrt((moved**2).mean()) < 0.85 * np.sqrt((seen**2).mean())
    assert moved.max() < seen.max()


@pytest.mark.parametrize("shape", [(20, 5), (6, 20), (1, 20, 6), (20, 3, 4), (0, 6)])
def test_points_of_a_wrong_shape_are_refused(shape):
    follower = iq.Follower(iq.Controller(iq.load_robot("ur5"), dt=0.02, acceleration_limit=8.0))
    with pytest.raises(iq.BadInput, match=f"points: found shape {re.escape(str(shape))}"):
        follower.follow(np.zeros(shape), np.arange(len(np.zeros(shape))))


@pytest.mark.cases(2)
@pytest.mark.parametrize("away", [15.0, 1e6])
@pytest.mark.parametrize("cutoff", [3.0, np.inf])
def test_points_far_ahead_are_waited_for(away, cutoff):
    """The arm goes on as without them, and meets the first when it is due."""
    arm = Arm("ur5", dt=0.01)
    stamps = np.arange(20) / 20
    points = arm.start + np.outer(stamps, 0.3 * np.ones(6))
    events = [(0.0, lambda f: f.follow(points, stamps))]
    later = (0.3, lambda f: f.follow(np.array((points[-1], points[0])), away + np.array((0.0, 40.0))))
    Q, _ = driven(arm, arm.follower(cutoff=cutoff), events, 2.0)
    ahead, _ = driven(arm, arm.follower(cutoff=cutoff), [*events, later], 17.0 if away < 100.0 else 4.0)
    arm.held(ahead)
    assert np.abs(ahead[80] - Q[80]).max() < 0.01
    assert np.abs(ahead - arm.start).max() < 0.4
    if away < 100.0:
        assert np.abs(ahead[round(away / arm.dt)] - points[-1]).max() < 2e-3


@pytest.mark.parametrize("push", [0.01, 0.19, 0.4])
def test_the_arm_returns_after_a_push(push):
    arm = Arm("ur5")
    follower, truth = following(arm, 10)
    Q, _ = driven(arm, follower, [], 4.5, reads=lambda q, i: q + push * (i >= 350))
    arm.held(Q)
    assert np.abs(Q[-1] + push - truth(1125 * arm.dt)).max() < 3e-3


def test_a_start_outside_its_range_comes_back_inside_all_limits():
    arm = Arm("panda")
    start = arm.start.copy()
    start[3] = arm.robot.position_lower[3] - 0.05
    events = [(t, lambda f: f.add(arm.start)) for t in np.arange(0.0, 3.0, 0.016)]
    Q, _ = driven(arm, arm.follower(), events, 3.0, q=start)
    moved = np.vstack((np.tile(Q[0], (3, 1)), Q))
    for n, most in ((1, arm.robot.velocity_limit), (2, arm.acceleration), (3, arm.jerk)):
        assert (np.abs(np.diff(moved, n, axis=0)) / arm.dt**n <= 1.001 * most).all()
    assert np.abs(Q[-1] - arm.start).max() < 1e-4


@pytest.mark.cases(1)
@pytest.mark.parametrize(
    ("name", "q", "turn"),
    [
        ("lite6", [0, 0.3, 1.2, 0, 0.9, 0], [3.14, 0.0, 0.0]),
        ("iiwa14", [0, 0.4, 0, -1.5, 0, 1.2, 0], [0.0, 3.14, 0.0]),
        ("panda", [0, -0.4, 0, -2.2, 0, 1.8, 0.8], [0.0, 1.57, 0.0]),
    ],
)
def test_a_goal_is_reached_where_the_straight_path_to_it_is_not(name, q, turn):
    robot, dt, q = iq.load_robot(name), 0.004, np.array(q, float)
    goal = robot.pose(q) @ iq.exp([*turn, 0.0, 0.0, 0.0])
    follower = iq.Follower(iq.Controller(robot, dt=dt, acceleration_limit=10.0), jerk=500.0)
    Q, answers = driven(SimpleNamespace(dt=dt, start=q), follower, [(0.0, lambda f: f.follow([goal]))], 3.2)
    np.testing.assert_allclose(robot.pose(Q[-1]), goal, atol=1e-6)
    assert {a.status for a in answers} <= {"moving", "late", "done"}
    assert answers[-1].status == "done"


def test_a_goal_sent_repeatedly_is_done():
    robot, q, dt = iq.load_robot("ur5e"), ready("ur5"), 0.002
    goal = iq.transform(translation=[0.1, 0.2, -0.1]) @ robot.pose(q)
    follower = iq.Follower(iq.Controller(robot, dt=dt, acceleration_limit=10.0))
    events = [(dt * k, lambda f: f.follow([goal])) for k in range(600) if k % 3 != 1]
    Q, answers = driven(SimpleNamespace(dt=dt, start=q), follower, events, 1.2)
    assert {a.status for a in answers} <= {"moving", "late", "done"}
    assert np.linalg.norm((robot.pose(Q[-1]) - goal)[:3, 3]) < 1e-4


def test_a_solution_can_be_pickled():
    arm = Arm("ur5")
    solution = driven(arm, following(arm, 17)[0], [], 0.1)[1][-1]
    other = pickle.loads(pickle.dumps(solution))
    for name in ("status", "reason", "across", "late"):
        assert getattr(other, name) == getattr(solution, name)
    np.testing.assert_array_equal(other.velocity, solution.velocity)


def test_a_goal_without_a_stamp_is_due_at_the_first_clock_reading():
    arm = Arm("ur5")
    follower = arm.follower()
    follower.follow([arm.robot.pose(arm.start + 0.1)])
    Q, answers = driven(arm, follower, [], 2.0, clock=7e4)
    arm.held(Q)
    assert answers[-1].status == "done"
    assert np.abs(Q[-1] - arm.start - 0.1).max() < 1e-6


@pytest.mark.parametrize("each", [False, True])
def test_the_motion_continues_from_a_given_velocity(each):
    arm = Arm("ur5")
    follower, q, before = arm.follower(), arm.start, np.zeros(6)
    follower.follow([arm.start + 0.5])
    for i in range(750):
        stopped = i >= 100 if each else i == 100  # by an emergency stop; or an arm that never moves again
        assert i != 100 or np.abs(before).max() > 0.5
        before = np.zeros(6) if stopped else before
        answer = follower.step(q, velocity=before if stopped else None)
        assert (np.abs(answer.velocity - before) <= 1.001 * arm.dt * arm.acceleration).all()
        before = answer.velocity
        q = q if each and stopped else q + arm.dt * before
    assert each or np.abs(q - arm.start - 0.5).max() < 1e-6


@pytest.mark.cases(1)
@pytest.mark.parametrize("again", [3.0, 0.5])
def test_the_arm_stands_before_a_goal_out_of_reach(again):
    """As a function of time that is the same always, and as chunks of a policy that sends it again."""
    arm = Arm("ur5")
    pose = iq.transform(translation=[0.0, 1.2, 0.0]) @ arm.robot.pose(arm.start)
    stamps = np.arange(0.0, 1.0, 0.05)
    events = [(0.0, lambda f: f.follow(lambda t: pose))]
    if again < 1.0:
        events = [(t, lambda f, t=t: f.follow([pose] * len(stamps), stamps + t)) for t in np.arange(0.0, 4.0, again)]
    Q, answers = driven(arm, arm.follower(), events, 4.0)
    arm.held(Q)
    assert answers[-1].status == "left"
    assert np.abs(np.diff(Q[-250:], axis=0)).max() / arm.dt < 0.01


@pytest.mark.parametrize(
    ("name", "twist"), [("ur5", [0.3, 0.0, 0.0]), ("ur5", [0.0, 0.2, -0.2]), ("so101", [0.1, 0.0, 0.0])]
)
def test_a_twist_beyond_the_arm_is_limited_and_no_joint_oscillates(name, twist):
    arm, twist = Arm(name), [0.0, 0.0, 0.0, *twist]
    if name == "so101":  # slow to brake, and the rows that it meets exactly can be met until just before they are lost
        arm.acceleration, arm.jerk = np.full(5, 10.0), 50.0
    events = [(t, lambda f: f.twist(twist)) for t in np.arange(0.0, 5.0, 0.05)]
    Q, answers = driven(arm, arm.follower(), events, 5.0)
    arm.held(Q)
    said = [a.status for a in answers]
    assert said[50] == "moving"
    assert set(said[-250:]) == {"limited" if name == "ur5" else "scaled"}
    assert all(a.reason for a in answers if a.status in ("limited", "scaled"))
    assert np.abs(np.diff(Q[-250:], 2, axis=0)).max() / arm.dt**2 < 0.1 * arm.acceleration.min()


TABLE = iq.limits.HalfSpace([0, 0, 0.2], [0, 0, 1], name="table")


def beside(arm, obstacle):
    """A loop whose hand keeps 20 mm from an obstacle."""
    hand = {"tool": [iq.limits.Sphere([0, 0, -0.02], 0.05, name="hand")]}
    limit = iq.limits.Clearance(arm.robot, hand, [obstacle], distance=0.02)
    return iq.Controller(arm.robot, dt=arm.dt, acceleration_limit=arm.acceleration, limits=[limit]), limit


@pytest.mark.parametrize("way", ["twist", "hand", "speed"])
def test_limits_of_the_loop_brake_joints_inside_their_acceleration(way):
    arm = Arm("ur5", **({"tool_speed": 0.2} if way == "speed" else {}))
    home = arm.robot.pose(arm.start)
    loop, limit = (arm.controller(), None) if way == "speed" else beside(arm, TABLE)
    follower = iq.Follower(loop, jerk=arm.jerk)

    def before(i, q):
        t = i * arm.dt
        if way == "twist":
            follower.twist([0.0, 0.0, 0.0, 0.0, 0.05, -0.2])
        elif i % 4 == 0:
            x = [0.15 * np.sin(2.0 * t), 0.0, 0.0] if way == "speed" else [0.0, 0.1 * np.sin(t), 0.3 * np.cos(t) - 0.3]
            follower.add(iq.transform(translation=x) @ home, t)

    Q, answers = driven(arm, follower, before, 2.8)
    assert limit is None or min(limit.at(q).distance for q in Q) > 0.0199
    assert (np.abs(np.diff(np.vstack((Q[:1], Q)), 2, axis=0)) / arm.dt**2 <= 1.001 * arm.acceleration).all()
    assert ("limited" if way == "twist" else "late") in {a.status for a in answers}


@pytest.mark.parametrize("way", ["nothing", "path", "paused"])
def test_it_avoids_a_moving_obstacle_and_reports_it(way):
    arm = Arm("ur5", dt=0.01)
    home = arm.robot.pose(arm.start)
    ball = iq.limits.Sphere([0, 0, 0], 0.08, name="ball")
    loop, limit = beside(arm, ball)
    follower = iq.Follower(loop, jerk=arm.jerk)
    if way != "nothing":
        follower = iq.PathFollower(loop, [home, iq.transform(translation=[0.3, 0.0, 0.0]) @ home], rate=0.1)
        follower.prepare(arm.start)

    def before(i, q):
        assert i == 0 or limit.at(q).distance > 0.0195
        place = home[:3, 3] + [0.0, 0.25 - 0.1 * arm.dt * i, 0.0]
        ball.move(iq.transform(translation=place), [0, 0, 0, 0, -0.1, 0])
        if way == "paused" and i == 10:
            follower.pause()

    Q, answers = driven(arm, follower, before, 3.0)
    assert (np.abs(np.diff(np.vstack((Q[:1], Q)), 2, axis=0)) / arm.dt**2 <= 1.001 * arm.acceleration).all()
    assert ("limited", "limited by clearance: tool and ball") in {(a.status, a.reason.split(",")[0]) for a in answers}


def test_a_late_arm_gets_the_same_commands():
    plain, late = Arm("ur5"), Arm("ur5", delay=0.02)
    (follower, _), (other, _) = (following(arm, 11, 3.0) for arm in (plain, late))
    Q, answers = driven(plain, follower, [], 2.0)
    for i, answer in enumerate(answers):
        assert np.abs(other.step(Q[max(i - 5, 0)]).velocity - answer.velocity).max() < 1e-9


@pytest.mark.parametrize("names", [["the table"], []])
def test_the_limiting_row_is_named(names):
    """Above a table a hand that goes below it is late for the table's sake, not for the joints'."""
    arm, q = iq.load_robot("panda"), ready("panda")
    start = arm.pose(q)

    def above(q):
        twist, place = arm.jacobian(q), arm.pose(q)[:3, 3]
        rise = twist[5] + twist[0] * place[1] - twist[1] * place[0]
        return iq.limits.LimitRows(rise[None], [-20.0 * (place[2] - start[2, 3] + 0.02)], [np.inf], names)

    follower = iq.Follower(iq.Controller(arm, dt=0.005, acceleration_limit=10.0, limits=[above]), jerk=500.0)

    def before(k, q):
        if k % 4 == 0:
            follower.add(iq.transform(translation=[0.0, 0.0, -0.1 * min(1.0, 0.01 * k)]) @ start, 0.005 * k)

    made = run(follower, q, 200, dt=0.005, before=before)
    assert arm.pose(made.Q[-1])[2, 3] > start[2, 3] - 0.0201
    assert (made.statuses[-1], made.answers[-1].reason) == ("late", f"limited by {names[0] if names else 'above'}")


@pytest.mark.cases(1)
@pytest.mark.parametrize(("dt", "delay", "declared"), [(0.004, 0.0, True), (0.01, 0.0, False), (0.005, 0.02, False)])
def test_an_arm_at_rest_avoids_an_obstacle_and_returns(dt, delay, declared):
    """A ball comes as far as 20 mm into the hand, stays and goes; what is lost is what an arm alone loses."""
    arm, q, speed, a = iq.load_robot("ur5"), ready("ur5"), 0.1, 8.0
    at, start, ball = arm.pose(q), q, iq.limits.Sphere([0.0, 0.0, 0.0], 0.08, name="ball")
    clear = iq.limits.Clearance(arm, {"tool": [iq.limits.Sphere([0.0, 0.0, -0.02], 0.05)]}, [ball])
    follower = iq.Follower(iq.Controller(arm, dt=dt, delay=delay, acceleration_limit=a, limits=[clear]))
    d = []

    def before(i, q):
        d.append(clear.at(q).distance)
        t = dt * i
        way = speed * (t if t < 0.9 else 0.9 if t < 1.4 else max(0.9 - (t - 1.4), 0.0))
        along = -speed if t < 0.9 else 0.0 if t < 1.4 else speed if t < 2.3 else 0.0
        ball.move(
            iq.transform(translation=at[:3, 3] + [0.0, 0.2 - way, 0.0]), [0, 0, 0, 0, along, 0] if declared else None
        )
        if i % round(0.02 / dt) == 0:
            follower.add(at, t)

    made = run(follower, q, round(5.0 / dt), dt=dt, before=before, late=round(delay / dt))
    behind = speed * (dt + delay) + (0.0 if declared else speed * max(10.0 * dt, np.e * (delay + 0.5 * dt)))
    assert min(d[1:]) > 0.02 - behind - speed**2 / (2.0 * 0.3 * a * np.hypot(*at[:2, 3]))
    assert ("late", "limited by clearance: tool and ball") in {(a.status, a.reason.split(",")[0]) for a in made.answers}
    np.testing.assert_allclose(made.Q[-1], start, atol=1e-6)


def test_a_tool_speed_holds():
    arm = Arm("ur5", tool_speed=0.1)
    Q, _ = driven(arm, following(arm, 12, 4.0, 1.0)[0], [], 4.0)
    twists = [(arm.robot.jacobian(a) @ (b - a) / arm.dt, arm.robot.pose(a)[:3, 3]) for a, b in pairwise(Q)]
    speed = [np.linalg.norm(x[3:] + np.cross(x[:3], p)) for x, p in twists]
    assert max(speed) <= 0.1 * (1 + 1e-9)
    assert max(speed) > 0.099


def test_a_copy_is_a_follower_of_its_own():
    arm = Arm("ur5")
    follower, _ = following(arm, 14, 3.0)
    Q, _ = driven(arm, follower, [], 0.5)
    other = copy.copy(follower)
    a, b = (driven(arm, f, [], 0.5, q=Q[-1])[0] for f in (follower, other))
    assert (a == b).all()


def test_a_new_path_is_joined_from_the_motion_of_the_arm():
    arm = Arm("panda")
    home = arm.robot.pose(arm.start)
    poses = np.array([home @ iq.transform(translation=[0.0, 0.01 * k, 0.0]) for k in range(12)])
    follower = iq.Follower(arm.controller(), keep="shape")
    follower.follow(poses)
    follower.prepare(arm.start)
    other = [home @ iq.transform(translation=[0.01 * k, 0.0, 0.0]) for k in range(8)]
    Q, _ = driven(arm, follower, [(30 * arm.dt, lambda f: f.follow(other))], 16.0, clock=None, until=("done",))
    assert np.abs(Q[30] - Q[29]).max() > 0.01 * arm.dt
    assert (np.abs(np.diff(Q, 2, axis=0) / arm.dt**2) <= 1.001 * arm.acceleration).all()
    assert (
        np.linalg.norm(arm.robot.pose(Q[-1])[:3, 3] - (home @ iq.transform(translation=[0.07, 0.0, 0.0]))[:3, 3]) < 1e-4
    )


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda f: f.follow(np.zeros((3, 6)), [0, 1, 1]), "stamps"),
        (lambda f: f.follow(np.zeros((3, 6))), "stamps"),
        (lambda f: f.follow(np.zeros((3, 5)), [0, 1, 2]), "points"),
        (lambda f: f.follow("path", [0]), "points"),
        (lambda f: f.follow(np.degrees(np.ones((3, 6))), [0, 1, 2]), "points"),
        (lambda f: f.follow(lambda t: np.degrees(np.ones(6))), "points"),
        (lambda f: f.add(np.degrees(np.ones(6))), "point"),
        (lambda f: f.follow(lambda t: "pose"), "points"),
        (lambda f: f.step([0.0] * 6, now=np.inf), "now"),
        (lambda f: f.step([np.nan] * 6), "q"),
        (lambda f: f.step([0.0] * 6, override=2.0), "override"),
        (lambda f: f.reverse(), "reverse"),
        (lambda f: (f.close(), f.add(np.eye(4))), "point"),
    ],
)
def test_bad_input_is_refused_and_changes_nothing(call, argument):
    def wrong(follower):
        with pytest.raises(iq.BadInput) as refused:
            call(follower)
        assert refused.value.argument.startswith(argument)

    assert (interrupted(wrong) == interrupted(None)).all()


@cache
def interrupted(call):
    """Joint positions after a call in the middle of a motion."""
    arm = Arm("ur5")
    follower, _ = following(arm, 16, 3.0)
    Q, _ = driven(arm, follower, [], 0.3)
    if call is not None:
        call(follower)
    return driven(arm, follower, [], 0.3, q=Q[-1])[0]


def test_loops_it_cannot_drive_are_refused():
    robot = iq.load_robot("ur5")
    for loop, options, argument in [
        (robot, {}, "loop"),
        (iq.Controller(robot, dt=0.002), {}, "loop"),
        (iq.Controller(robot, dt=0.002, acceleration_limit=8.0), {"jerk": [1.0, 2.0]}, "jerk"),
        (iq.Controller(robot, dt=0.002, acceleration_limit=8.0), {"jerk": -1.0}, "jerk"),
        (iq.Controller(robot, dt=0.002), {"keep": "shape", "jerk": 9.0}, "loop"),
        (iq.Controller(robot, dt=0.002, acceleration_limit=8.0), {"keep": "all"}, "keep"),
    ]:
        with pytest.raises(iq.BadInput) as refused:
            iq.Follower(loop, **options)
        assert refused.value.argument == argument
