"""What the core follows is what Python follows: ticks, stops, splices, curves through points."""

import numpy as np
import pytest
from support.streams import Arm, driven

import invariantqp as iq
from invariantqp.paths import driver, reference
from invariantqp.paths.time_law import JointLimits

pytestmark = pytest.mark.skipif(not iq.native, reason="there is no compiled core")


def chunks(arm, truth):
    follower, stamps = arm.follower(), np.arange(0.0, 1.2, 0.05)
    follower.follow([truth(t) for t in stamps], stamps)
    return follower, [(0.5, lambda f: f.follow([truth(t) + 0.02 for t in stamps + 0.4], stamps + 0.4))]


def hand(arm, truth):
    samples = [(t + 0.01, lambda f, t=t: f.add(truth(t), t)) for t in np.arange(0.0, 1.0, 1 / 60)]
    return arm.follower(), samples


def path(arm, truth, **options):
    follower = iq.PathFollower(arm.controller(), lambda t: arm.robot.pose(truth(t)), **options)
    follower.prepare(truth(0.0))
    return follower, [(0.3, lambda f: f.pause()), (0.6, lambda f: f.resume()), (0.9, lambda f: f.reverse())]


def leaps(arm, truth):
    """Points that leap farther than joints can go: they catch up."""
    stamps = np.arange(0.0, 1.2, 0.05)
    return arm.follower(), [
        (t, lambda f, t=t: f.follow([truth(s) + 0.5 * np.sin(40.0 * t) for s in stamps], stamps + t))
        for t in (0.0, 0.5)
    ]


def too_fast(arm, truth):
    """Slow joints that leap, and are led faster than they may turn."""
    r = arm.robot
    arm.robot = iq.robots.Chain(r.screws, r.home, r.names, r.position_lower, r.position_upper, 0.4)
    stamps, way = np.arange(0.0, 1.2, 0.05), np.sign(truth(0.3) - arm.start)
    return arm.follower(), [
        (0.0, lambda f: f.follow(arm.start + 0.1 * way * np.ones((24, 1)), stamps)),
        (0.6, lambda f: f.follow(arm.start + (0.1 - 0.48 * stamps[:, None]) * way, stamps + 0.6)),
    ]


def twists(arm, truth):
    """Twists one after the other, the last for as long as it holds."""
    rng = np.random.default_rng(7)
    several = [(t, 0.3 * rng.normal(size=6)) for t in (0.0, 0.05, 0.1, 0.3, 0.32, 0.9)]
    return arm.follower(), [(t, lambda f, v=v: f.twist(v)) for t, v in several]


def fast(arm, truth):
    """Faster than the tool may be, and a row."""
    row = iq.limits.LimitRows(np.eye(len(arm.start))[:1], [-0.15], [0.15])
    stamps = np.arange(0.0, 1.2, 0.05)
    loop = arm.controller(tool_speed=0.1, limits=[row])
    follower = iq.Follower(loop, jerk=arm.jerk)
    return follower, [
        (0.0, lambda f: f.follow([truth(t) for t in stamps], stamps)),
        (0.8, lambda f: f.twist([0.0, 0.0, 0.5, 0.2, 0.0, 0.0])),
    ]


def beside(arm, truth):
    """Beside a table above which the tool is kept, and a ball that comes nearer."""
    x, y, z = arm.robot.pose(arm.start)[:3, 3]
    ball = iq.limits.Sphere([x, y + 0.4, z + 0.1], 0.1, name="ball")
    table = iq.limits.HalfSpace([0.0, 0.0, z - 0.2], [0.0, 0.0, 1.0], name="table")
    hand = {"tool": [iq.limits.Sphere([0.0, 0.0, 0.0], 0.05, name="hand")]}
    limit = iq.limits.Clearance(arm.robot, hand, [table, ball], distance=0.02)
    stamps = np.arange(0.0, 0.6, 0.05)

    def moved(t):
        ball.move(iq.transform(translation=[0.0, -0.2 * t, 0.0]), [0, 0, 0, 0, -0.2, 0])

    return iq.Follower(arm.controller(limits=[limit]), jerk=arm.jerk), [
        (0.0, lambda f: f.follow([truth(t) for t in stamps], stamps)),
        *((t, lambda f, t=t: moved(t)) for t in np.arange(0.0, 1.0, 0.02)),
        *((t, lambda f: f.twist([0.0, 0.0, 0.0, 0.0, 0.1, -0.3])) for t in np.arange(0.7, 1.4, 0.05)),
    ]


def by_python(monkeypatch):
    monkeypatch.setattr(driver.Follower, "_made_course", lambda *_: None)
    monkeypatch.setattr(reference, "core", None)


ARMS = [("panda", 0.008), ("ur5", 0.0), ("so101", 0.008)]
WAYS = [chunks, hand, path, leaps, twists, fast, beside, too_fast]


@pytest.mark.parametrize(("way", "name", "delay"), [(way, *ARMS[k % 3]) for k, way in enumerate(WAYS)])
def test_the_core_follows_what_python_follows(name, way, delay, monkeypatch):
    arm = Arm(name, delay=delay)
    follower, events = way(arm, arm.motion(np.random.default_rng(1), size=0.8))
    asked = []
    real = driver.Follower._by_core
    monkeypatch.setattr(driver.Follower, "_by_core", lambda *a, **k: (asked.append(real(*a, **k)), asked[-1])[1])
    Q, answers = driven(arm, follower, events, 1.2)
    by_python(monkeypatch)
    follower, events = way(arm, arm.motion(np.random.default_rng(1), size=0.8))
    P, others = driven(arm, follower, events, 1.2)
    assert sum(a is not None for a in asked) > 100  # of 300 ticks, the core's share
    assert np.abs(Q - P).max() < 1e-8
    for a, b in zip(answers, others, strict=True):
        assert (a.status, a.reason, a.ruling) == (b.status, b.reason, b.ruling)
        np.testing.assert_allclose([a.place, a.late, a.speed], [b.place, b.late, b.speed], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose([a.across for a in answers[::25]], [b.across for b in others[::25]], atol=1e-7)


@pytest.mark.cases(20)
@pytest.mark.parametrize("seed", range(40))
def test_splices_and_plans_are_those_of_python(seed, monkeypatch):
    """Polynomials by the core, beside those of the arrays' definition."""
    rng, m = np.random.default_rng(seed), 3
    limits = JointLimits(*(np.full(m, x) for x in (-3.0, 3.0, 2.0, 10.0, 400.0)), 0.002)
    stamps = np.cumsum(rng.uniform(0.02, 0.1, rng.integers(2, 40)))
    positions = (
        0.1 * np.sin(2.0 * stamps)[:, None] + 0.1 * rng.normal(size=m) + 0.001 * rng.normal(size=(len(stamps), m))
    )
    calm = rng.choice([0.02, 0.053])
    now = float(stamps[len(stamps) // 2])
    away = 0.03 * rng.normal(size=(3, m)) * np.array([1.0, 0.3, 0.1])[:, None]

    def found():
        curve = reference.planned(10.0 * away, now - 0.4, stamps, positions, limits, calm)
        answer = [curve.knots, curve.at(curve.knots)[:, :3]]
        slowed = reference.Clocked(curve, reference.Clock(now, now, 0.5, 0.1, 0.8, 0.3))
        for source in (curve, slowed):
            followed = reference.Reference(limits, positions[0], 0.0)
            fits = followed.splice(source, now, curve.at(np.array((now,)))[0, :3] + away, 0.3)
            answer += [np.array([fits, followed.joined])]
            answer += [followed.at(np.array((t,)))[0, :3] for t in np.linspace(now - 0.1, now + 1.5, 9)]
        return answer

    ours = found()
    by_python(monkeypatch)
    for a, b in zip(ours, found(), strict=True):
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-7 * (1.0 + np.abs(b).max()))


@pytest.mark.parametrize("wrong", [[np.nan] * 6, [0.0] * 5, "joints", None])
def test_what_is_no_position_is_refused_between_two_ticks_of_the_core(wrong):
    arm = Arm("ur5")
    follower, events = chunks(arm, arm.motion(np.random.default_rng(2)))
    Q, _ = driven(arm, follower, events, 0.4)
    with pytest.raises(iq.BadInput, match="q"):
        follower.step(wrong)
    assert follower.step(Q[-1]).status == "moving"
