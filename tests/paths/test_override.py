"""The override scales every kind of input, may change in every tick, and keeps the tool in the range of its input."""

import numpy as np
import pytest
from support.inputs import INPUTS, TIME, Bed, cases
from support.plane import exerted
from support.streams import Arm, run

import invariantqp as iq

FOLLOWED = (*INPUTS, "path")
CASES = pytest.mark.parametrize(("kind", "name", "dt", "sign"), cases(FOLLOWED, 2))


def in_range(bed, trace, base):
    """Assert that joints stay in the range of what was requested, and accelerations inside the limit."""
    x, y = ((one.Q - bed.start) @ bed.axis for one in (trace, base))
    assert y.min() - 0.01 < x.min()
    assert x.max() < y.max() + 0.01
    assert np.abs(np.diff(trace.V, axis=0, prepend=0.0)).max() < 1.001 * bed.acceleration * bed.dt


@CASES
def test_an_override_of_a_fifth_gives_a_fifth_of_the_requested_speed(kind, name, dt, sign):
    base = Bed(kind, name, dt, sign).run(2.0)
    bed = Bed(kind, name, dt, sign)
    slow = bed.run(2.5, override=0.2)
    most = np.abs(base.V).max()
    assert np.abs(slow.V).max() < 0.2 * 1.05 * most + 1e-3
    assert np.abs(slow.V).max() > 0.1 * most
    in_range(bed, slow, base)


@CASES
def test_at_zero_the_arm_stops_and_stays(kind, name, dt, sign):
    base = Bed(kind, name, dt, sign).run(2.5)
    bed = Bed(kind, name, dt, sign)
    stopped = bed.run(2.5, options=lambda k, q: {"override": 0.0 if k * dt >= 0.4 else 1.0})
    assert np.abs(stopped.V[: round(0.4 / dt)]).max() > 0.05
    assert np.abs(stopped.V[round(0.9 / dt) :]).max() < 1e-6
    last = stopped.answers[round(1.0 / dt)]
    assert (last.status, last.reason) == ("paused", "" if kind == "path" else "override is 0")
    in_range(bed, stopped, base)


@CASES
def test_it_may_change_in_every_tick_and_the_input_is_reached_at_last(kind, name, dt, sign):
    base = Bed(kind, name, dt, sign).run(2.5)
    bed, random = Bed(kind, name, dt, sign), np.random.default_rng(3)
    changed = bed.run(4.5, options=lambda k, q: {"override": random.random() if k * dt < 2.0 else 1.0})
    in_range(bed, changed, base)
    assert np.abs(changed.V[-1]).max() < 1e-3
    if kind != "twist":
        assert bed.off(changed.Q[-1], TIME) < 2e-3


def test_a_moving_stream_is_caught_up_with_after_an_override():
    """A slow arm is late, and leads back inside the range: at a half, in both directions and from either side."""
    for sign in (1, -1):
        bed = Bed("chunks of joints", "ur5", 0.01, sign)
        trace = bed.run(6.0, override=0.5)
        assert {str(a.status) for a in trace.answers[: round(1.0 / 0.01)]} >= {"late"}
        assert bed.off(trace.Q[-1], TIME) < 1e-3


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("dt", [0.002, 0.01])
def test_in_contact_the_path_is_driven_at_a_fifth(dt, sign):
    arm = Arm("ur5", dt=dt)
    start = arm.robot.pose(arm.start)

    def driven(override):
        task = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], [0.0, 0.0, 1.0]), [5.0])
        loop = iq.HybridController(arm.robot, task, dt=dt, order="moment first", acceleration_limit=8.0)
        path = [iq.transform(translation=[0.0, sign * 0.02 * t, -0.002]) @ start for t in (0.0, 1.0, 2.0, 3.0)]
        follower = iq.PathFollower(loop, path, rate=1.0)
        follower.prepare(arm.start)

        def wrench(k, q):
            return {"wrench": exerted([arm.robot.pose(q)[:3, 3]], start[2, 3] - 0.001, 2e4)}

        Q = run(follower, arm.start, round(2.5 / dt), dt=dt, options=wrench, override=override).Q
        return abs(arm.robot.pose(Q[-2])[1, 3] - arm.robot.pose(Q[round(1.5 / dt)])[1, 3])

    assert driven(0.2) == pytest.approx(0.2 * driven(1.0), rel=0.05)
