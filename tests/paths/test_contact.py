"""In contact, motion waits for limits, and force does not."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from support.half_circle import DT, PERIOD, Drive, off_circle, slow_bench

import invariantqp as iq


def test_a_circle_too_fast_for_the_joints_stays_one_under_its_force():
    drive = Drive(rate=1.0)
    drive.until("done", "blocked", most=1000)
    solutions, path = drive.solutions, drive.path
    first = [s.status for s in solutions].index("slowed")
    settled = first + 66
    assert {s.status for s in solutions[:first]} == {"waiting"}
    assert solutions[-1].status == "done"
    assert solutions[-1].late > PERIOD
    assert max(drive.off[settled:]) < 5e-5
    assert max(abs(s.hybrid.intensities[0] / 5.0 - 1.0) for s in solutions[settled:]) < 0.04
    assert np.linalg.norm(drive.tip()[:2] - path(PERIOD / 2)[0][:2, 3]) < 1e-4
    drive.check()

    alone = slow_bench()  # the hybrid controller by itself keeps the timing, and leaves the circle
    alone.run(50)
    worst = 0.0
    for k in range(round(PERIOD / 2 / DT)):
        alone.tick(*path(k * DT))
        worst = max(worst, off_circle(alone))
    assert worst > 5e-3


def test_the_path_waits_while_contact_is_lost():
    drive = Drive(yields=0.02)
    drive.tick(100)
    drive.bench.height -= 1e-2
    drive.tick(200)
    places, statuses = zip(*((s.place, s.status) for s in drive.solutions), strict=True)
    lost = [k for k in range(100, 300) if statuses[k] == "waiting"]
    assert len(lost) > 10
    assert places[lost[-1]] - places[lost[0] + 10] < 1e-3 * PERIOD
    assert statuses[lost[-1] + 1] == "slowed"
    assert places[-1] > places[lost[-1]] + 0.01 * PERIOD


def test_a_pushed_tool_comes_back_under_its_force_and_goes_on():
    drive = Drive()
    drive.tick(100)
    bench = drive.bench  # 30 mm to the side, as deep in the paper as before
    J = iq.adjoint(iq.transform(translation=-drive.tip())) @ bench.robot.jacobian(bench.q)
    bench.q = bench.q + np.linalg.pinv(J) @ [0.0, 0.0, 0.0, 0.0, -0.03, 0.0]
    bench.height = drive.tip()[2] + 5e-4
    drive.until("done", "blocked", most=1400)
    solutions = drive.solutions
    back = [k for k, s in enumerate(solutions) if "off the path, pushed" in s.reason]
    assert back[0] == 100
    assert all(solutions[k].status == "waiting" and solutions[k].place == solutions[99].place for k in back)
    assert max(abs(solutions[k].hybrid.intensities[0] / 5.0 - 1.0) for k in back[50:]) < 0.05
    assert solutions[-1].status == "done"
    assert max(drive.off[back[-1] + 25 :]) < 5e-5


def test_joints_off_their_plan_slow_the_path_down():
    drive = Drive()
    drive.tick(100)
    bench = drive.bench  # the tool stays where it is, but for 0.1 mm or so
    bench.q = bench.q + 0.1 * np.linalg.svd(bench.robot.jacobian(bench.q))[2][-1]
    assert drive.tick(15).ruling == "the arm is off its path"


def driven(bench, path, ticks, push=0.0):
    """Solutions along a path from the start on, until it ends."""
    follower = iq.PathFollower(bench.loop, path)
    follower.prepare(bench.q)
    bench.q, solutions = bench.q + push, []
    while len(solutions) < ticks and (not solutions or solutions[-1].status not in ("done", "blocked")):
        solutions.append(follower.step(bench.q, wrench=bench.wrench()))
        bench.q = bench.q + bench.dt * solutions[-1].velocity
    return solutions


def test_a_path_shorter_than_the_tool_error_ends():
    bench = slow_bench()
    way = np.array([[1e-5, 0.0, 0.0], [0.0, 1e-5, 0.0]])

    def path(u):  # ten micrometres, bent by more than a right angle
        return iq.transform(bench.start[:3, :3], bench.start[:3, 3] + [np.sin(3.0 * u), u] @ way)

    solutions = driven(bench, path, 1000, [-1e-3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert solutions[-1].status == "done"
    assert np.abs(np.diff([s.place for s in solutions])).sum() < 2.0  # not to and fro


@pytest.mark.cases(1)
@pytest.mark.parametrize("seed", [1, 13])
def test_in_long_ticks_joints_rest_when_the_tool_is_there(seed):
    bench = slow_bench(share=1.0 / 3.0, dt=0.01)
    corners = np.cumsum(np.vstack((np.zeros(2), np.random.default_rng(seed).normal(0.0, 0.01, (6, 2)))), axis=0)
    way = CubicSpline(np.linspace(0.0, 1.0, 7), corners)
    solutions = driven(bench, lambda u: iq.transform(bench.start[:3, :3], bench.start[:3, 3] + [*way(u), 0.0]), 300)
    assert solutions[-1].status == "done"
    assert sum(s.ruling == "settling" for s in solutions) < 15


def blocked(seed, dt):
    """Solutions on a line on the paper from which the arm is kept, at a third of its speed."""
    rng = np.random.default_rng(seed)
    bench, turn, length = slow_bench(share=1.0 / 3.0, dt=dt), rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.4, 0.9)
    way = length * np.array([np.cos(turn), np.sin(turn), 0.0])
    solutions = driven(
        bench, lambda u: iq.transform(bench.start[:3, :3], bench.start[:3, 3] + u * way), round(6.0 / dt)
    )
    assert solutions[-1].status == "blocked"
    return solutions


def test_a_blocked_path_is_reported_after_the_joints_have_braked():
    solutions = blocked(3, DT)  # where reach ends: joints went on for 1 s towards where they cannot be
    assert "it is out of reach" in solutions[-1].reason
    assert sum(s.ruling == "settling" for s in solutions) < 75
    assert (np.abs(solutions[-1].velocity) < 1e-3).all()


def test_a_pressed_tool_that_comes_no_farther_than_its_joint_is_blocked():
    solutions = blocked(39, 0.01)  # deeper than planned, where the joint ends before the path does: "slowed" for ever
    assert solutions[-1].reason.startswith(
        "the tool comes no farther than 0.617; joint 1 (panda_joint2) is at its lower"
    )
    assert sum(abs(s.place - solutions[-1].place) < 1e-4 for s in solutions) < 260
    assert abs(solutions[-1].hybrid.intensities[0] / 5.0 - 1.0) < 0.02


def test_a_refused_tick_leaves_the_follower_as_it_was():
    drive = Drive()
    drive.tick(100)
    bench, follower = drive.bench, drive.follower
    plan, place = follower.plan, follower.step(bench.q, wrench=bench.wrench()).place
    aside = bench.q + np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # from there the path is to be looked at again
    for q in (bench.q, aside):
        for wrench, more in (
            (np.full(6, np.nan), {}),
            (bench.wrench(), {"wanted": [-1.0]}),
            (bench.wrench(), {"velocity": np.full(7, np.inf)}),
            (bench.wrench(), {"contact": "a table"}),
            (bench.wrench(), {"override": 1.6}),
        ):
            with pytest.raises(iq.BadInput):
                follower.step(q, wrench=wrench, **more)
            assert follower.plan is plan
    assert follower.step(bench.q, wrench=bench.wrench()).place >= place
