"""Ticks in which nothing new comes: the core follows what Python follows."""

import numpy as np
import pytest
from support.streams import ARMS, Arm, driven

import invariantqp as iq
from invariantqp.paths import driver

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


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("way", [chunks, hand, path])
@pytest.mark.parametrize("delay", [0.0, 0.006])
def test_the_core_follows_what_python_follows(name, way, delay, monkeypatch):
    arm = Arm(name, delay=delay)
    follower, events = way(arm, arm.motion(np.random.default_rng(1), size=0.8))
    asked = []
    real = driver.Follower._by_core
    monkeypatch.setattr(driver.Follower, "_by_core", lambda *a: (asked.append(real(*a)), asked[-1])[1])
    Q, answers = driven(arm, follower, events, 1.6)
    monkeypatch.setattr(driver.Follower, "_made_course", lambda *_: None)
    follower, events = way(arm, arm.motion(np.random.default_rng(1), size=0.8))
    P, others = driven(arm, follower, events, 1.6)
    assert sum(a is not None for a in asked) > 200  # of 800 ticks, the core's share
    assert np.abs(Q - P).max() < 1e-9
    for a, b in zip(answers, others, strict=True):
        assert (a.status, a.reason, a.ruling) == (b.status, b.reason, b.ruling)
        np.testing.assert_allclose([a.place, a.late, a.speed], [b.place, b.late, b.speed], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose([a.across for a in answers[::50]], [b.across for b in others[::50]], atol=1e-8)


@pytest.mark.parametrize("wrong", [[np.nan] * 6, [0.0] * 5, "joints", None])
def test_what_is_no_position_is_refused_between_two_ticks_of_the_core(wrong):
    arm = Arm("ur5")
    follower, events = chunks(arm, arm.motion(np.random.default_rng(2)))
    Q, _ = driven(arm, follower, events, 0.4)
    with pytest.raises(iq.BadInput, match="q"):
        follower.step(wrong)
    assert follower.step(Q[-1]).status == "moving"
