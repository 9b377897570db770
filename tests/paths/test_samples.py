"""Samples of a stream: a wrong one is dropped, a far one approached slowly, exact demands are kept on the way."""

from collections import deque
from itertools import count

import numpy as np
import pytest
from support.inputs import TICKS, Bed
from support.streams import run

import invariantqp as iq

NAMES = ("panda", "ur5", "xarm7", "so101")
# One case of each arm and kind of sample, with ticks and signs among them.
CASES = [
    (kind, name, TICKS[(i + k) % 3], (60, 30, 15)[(i + k) % 3], 1 - 2 * ((i + k) % 2))
    for k, kind in enumerate(("joints", "poses"))
    for i, name in enumerate(NAMES)
]
STREAMS = pytest.mark.parametrize(("kind", "name", "dt", "rate", "sign"), CASES)


def fed(bed, sample, rate, seconds, *, q=None, **options):
    """Joint positions (n + 1, m), velocities (n, m), solutions; `sample` gives joint positions at a time, or None.

    A bed of poses is fed the poses of these joint positions; `sample` may give a pose (4, 4) itself.
    """
    follower, stamps = iq.Follower(bed.loop, jerk=bed.jerk, **options), (n / rate for n in count())
    coming = deque([next(stamps)])

    def before(k, q):
        while coming[0] <= k * bed.dt + 1e-9:
            x = sample(coming[0])
            if x is not None:
                follower.add(bed.robot.pose(x) if bed.kind == "poses" and np.ndim(x) == 1 else x, coming[0])
            coming[0] = next(stamps)

    return run(follower, bed.start if q is None else q, round(seconds / bed.dt), dt=bed.dt, before=before)


def moving(bed, t):
    return bed.start + bed.size * 0.5 * (1.0 - np.cos(2.0 * t)) * bed.axis


def wrong_at(bed, rate, which, by=1.0):
    """A stream some of whose samples, by their number from one second on, are off by so much [rad]."""
    bad = [rate + n for n in which]
    return lambda t: moving(bed, t) + (by * bed.axis if round(t * rate) in bad else 0.0)


@STREAMS
def test_one_outlier_is_dropped(kind, name, dt, rate, sign):
    bed = Bed(kind, name, dt, sign)
    good = fed(bed, lambda t: None if round(t * rate) == rate else moving(bed, t), rate, 2.0)
    for by in (1.0, -1.0):
        Q, _, answers = fed(Bed(kind, name, dt, sign), wrong_at(bed, rate, [0], by), rate, 2.0)
        np.testing.assert_allclose(Q, good[0], atol=1e-12)
        said = {a.reason for a in answers if a.status == "degraded"}
        assert len(said) == 1
        assert said.pop().startswith("a sample was dropped: joint ")
        # Until the next one comes.
        assert sum(a.status == "degraded" for a in answers) <= np.ceil(1.0 / rate / dt) + 1


@STREAMS
def test_of_two_outliers_in_a_row_the_second_is_accepted(kind, name, dt, rate, sign):
    bed = Bed(kind, name, dt, sign)
    Q, _, answers = fed(bed, lambda t: moving(bed, min(t, 1.0)) + (0.6 * bed.axis if t >= 1.0 else 0.0), rate, 4.0)
    assert 0 < sum("dropped" in a.reason for a in answers) <= np.ceil(1.0 / rate / dt) + 1
    there = bed.robot.pose(moving(bed, 1.0) + 0.6 * bed.axis)
    assert np.linalg.norm((bed.robot.pose(Q[-1]) - there)[:3, 3]) < 2e-3


@STREAMS
def test_samples_inside_the_speed_limits_are_never_dropped(kind, name, dt, rate, sign):
    """As fast as 0.8 of the limit, with noise; nor are wrong ones without the option."""
    bed, random = Bed(kind, name, dt, sign), np.random.default_rng(5)
    speed = 0.8 * bed.robot.velocity_limit[0]

    def fast(t):
        return bed.start + 0.4 * np.sin(sign * speed / 0.4 * t) * bed.axis + 1e-3 * random.normal(size=len(bed.start))

    assert not any("dropped" in a.reason for a in fed(bed, fast, rate, 1.5)[2])
    runs = [
        fed(bed, wrong_at(bed, rate, bad), rate, 1.5, drop_outliers=False)
        for bad, bed in (([0], Bed(kind, name, dt, sign)), ([], Bed(kind, name, dt, sign)))
    ]
    assert not any("dropped" in a.reason for a in runs[0][2])
    assert np.abs((runs[0][0] - runs[1][0]) @ bed.axis).max() > 0.01


@pytest.mark.parametrize("approach", [1 / 3, 0.1, 1.0])
@STREAMS
def test_the_approach_to_the_first_sample_uses_a_third_of_the_speed_limits(kind, name, dt, rate, sign, approach):
    bed = Bed(kind, name, dt, sign)
    Q, V, answers = fed(bed, lambda t: bed.start + sign * 1.2 * bed.axis, rate, 2.5, approach=approach)
    share = np.abs(V) / bed.robot.velocity_limit
    assert share.max() < approach * 1.02
    assert share.max() > 0.08 * (approach < 0.2) + 0.25 * (approach > 0.2)
    said = answers[round(0.3 / dt)]
    assert (said.status, said.reason) == (
        "late",
        f"on the way to the input, at most {approach:.2g} of the speed limits",
    )
    if approach > 0.2:
        assert answers[-1].status == "moving"
        there = bed.robot.pose(bed.start + sign * 1.2 * bed.axis)
        assert np.linalg.norm((bed.robot.pose(Q[-1]) - there)[:3, 3]) < 2e-3


@STREAMS
def test_after_a_gap_a_stream_is_approached_at_a_third_of_the_speed_limits(kind, name, dt, rate, sign):
    """A clutch that closes far away."""
    bed = Bed(kind, name, dt, sign)

    def hand(t):
        return bed.start if t < 0.5 else None if t < 1.0 else bed.start + sign * 1.2 * bed.axis

    Q, V, _ = fed(bed, hand, rate, 3.5)
    assert (np.abs(V) < 1.001 / 3.0 * np.array(bed.robot.velocity_limit)).all()
    there = bed.robot.pose(bed.start + sign * 1.2 * bed.axis)
    assert np.linalg.norm((bed.robot.pose(Q[-1]) - there)[:3, 3]) < 2e-3


@pytest.mark.parametrize(
    ("angle", "dt", "rate"),
    [(-2.1, 0.01, 30), (-1.57, 0.033, 15), (0.7, 0.01, 30), (1.4, 0.033, 15), (1.57, 0.002, 60), (2.6, 0.01, 30)],
)
def test_five_joints_keep_the_point_while_they_turn_the_tool_as_far_as_they_can(angle, dt, rate):
    """And rest when the hand rests, though they cannot do all of its turn."""
    bed = Bed("poses", "so101", dt, 1)
    home = bed.pose(0.0)
    hand = iq.transform(iq.exp([0.0, 0.0, angle, 0.0, 0.0, 0.0])[:3, :3] @ home[:3, :3], home[:3, 3])
    Q, V, answers = fed(bed, lambda t: hand, rate, 6.0)
    off = [np.linalg.norm(bed.robot.pose(q)[:3, 3] - home[:3, 3]) for q in Q]
    assert max(off) < 2e-3
    assert off[-1] < 2e-4
    last = round(1.0 / dt)
    assert np.abs(V[-1]).max() < 1e-5
    assert len({(a.status, a.reason.split("(")[0]) for a in answers[-last:]}) == 1


@pytest.mark.parametrize("how", ["add", "follow"])
@pytest.mark.parametrize("seed", range(5))
def test_five_joints_come_to_rest_before_any_pose(seed, how):
    """Turned at random, at a point that the arm reaches: the law's way there turns near singularities."""
    bed, random = Bed("poses", "so101", 0.01, 1), np.random.default_rng(seed)
    low, high = bed.robot.position_lower, bed.robot.position_upper
    turn = iq.exp(np.append(random.uniform(-2.5, 2.5, 3), np.zeros(3)))
    hand = bed.robot.pose(low + (high - low) * random.uniform(0.2, 0.8, 5))
    hand = iq.transform(turn[:3, :3] @ hand[:3, :3], hand[:3, 3])
    follower = iq.Follower(bed.loop, jerk=bed.jerk)
    if how == "follow":
        follower.follow([hand])
    sends = (lambda k, q: follower.add(hand, 0.01 * k) if k % 3 == 0 else None) if how == "add" else None
    assert np.abs(run(follower, bed.start, 800, dt=0.01, before=sends).V[-1]).max() < 0.03  # a damped turn takes long


@pytest.mark.parametrize("over", [0.1, 0.0, -0.001])
@pytest.mark.parametrize("side", ["lower", "upper"])
@pytest.mark.parametrize(
    ("name", "dt", "joint"), [("panda", 0.01, 3), ("ur5", 0.002, 2), ("so101", 0.033, 2), ("xarm7", 0.033, 3)]
)
def test_a_leader_beyond_a_joint_limit_is_followed_to_the_limit_where_the_arm_rests(name, dt, joint, side, over):
    bed, s = Bed("joints", name, dt, 1), 1.0 if side == "upper" else -1.0
    limit = getattr(bed.robot, f"position_{side}")[joint]
    goal, q = bed.start.copy(), bed.start.copy()
    goal[joint], q[joint] = limit + s * over, limit - s * 0.3
    Q, V, answers = fed(bed, lambda t: goal, 30, 4.0, q=q)
    last = round(1.0 / dt)
    assert np.abs(V[-last:]).max() < 1e-6
    assert np.abs(Q[-1, joint] - (limit + s * min(over, 0.0))) < 1e-4
    assert (s * (Q[:, joint] - limit) <= 1e-9).all()
    assert len({str(a.status) for a in answers[-last:]}) == 1


def test_no_sample_of_a_slow_stream_is_dropped():
    """Samples of 10 Hz that move at half the limit, in ticks of 2 ms, without stamps and with jitter."""
    bed, random, due = Bed("joints", "ur5", 0.002, 1), np.random.default_rng(1), [0.0]
    follower = iq.Follower(bed.loop, jerk=bed.jerk, timeout=0.5)

    def before(k, q):
        now = k * bed.dt
        if now >= due[-1]:
            follower.add(bed.start + 0.5 * np.sin(3.0 * now) * bed.axis)
            due.append(now + 0.1 + 0.05 * random.uniform(-1.0, 1.0))

    assert not any("dropped" in a.reason for a in run(follower, bed.start, 1500, dt=bed.dt, before=before).answers)
