"""An operator 100 ms away: the two ends of the link let out no more than came in, in any frame, and say when."""

import re
from collections import deque

import numpy as np
import pytest
from support.random_systems import motion

import invariantqp as iq
from invariantqp.control.passivity import DelayEstimate

DT, LATE, WALL, STORE = 0.004, 25, 1e3, 0.02  # [s], [ticks] each way, [N/m], [J]
STEADY = 60.0 * WALL * 0.03 / (60.0 + WALL)  # where hand and wall balance [N]
UP = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


class Everything:
    """An end that passes on all: what there is without `LinkEnd`, with its books."""

    def __init__(self, passes):
        self.end = iq.control.LinkEnd(dt=DT, passes=passes)

    def step(self, twist, wrench, _):
        return self.end.step(twist, wrench, 1e9)

    came_in = property(lambda self: self.end.came_in)
    went_out = property(lambda self: self.end.went_out)


def pushed(robot_end, device_end, seconds=6.0, *, wall=WALL, gap=0.01, spring=60.0, late=LATE, arm=0, measured=False):
    """A hand pushes a device 40 mm up; the tool meets a wall at a gap: forces [N], balances [J], what was said.

    The hand is a spring [N/m] with 5 N s/m, the device 0.3 kg. Forces are felt, twists arrive, `late` ticks late, and
    the arm does them `arm` ticks later, which may be measured. A balance is what came in less what went out, by the
    books; where the arm is measured what came in from the hand less what is in the wall.
    """
    hand = speed = tool = done = 0.0
    there, back = (deque([(0.0, 0.0)] * late, maxlen=max(1, late)) for _ in range(2))
    coming, forces, balances, said = deque([0.0] * arm), [], [], []
    packets = (0.0, 0.0), (0.0, 0.0)
    for k in range(round(seconds / DT)):
        wanted = 0.02 * (1.0 - np.cos(np.pi * min(1.0, k * DT)))
        packets = (back[0], there[0]) if back else packets
        (felt, told_by_robot), (asked, told_by_hand) = packets
        felt = device_end.step(speed * UP, felt * UP, told_by_robot)
        speed += DT * (felt.passed[5] + spring * (wanted - hand) - 5.0 * speed) / 0.3
        hand += DT * speed
        force = wall * max(0.0, tool - gap)
        tick = robot_end.step(asked * UP, force * UP, told_by_hand, **({"done": done * UP} if measured else {}))
        coming.append(tick.passed[5])
        done = coming.popleft()
        tool += DT * done
        there.append((speed, device_end.came_in))
        back.append((-force, robot_end.came_in))
        forces.append(force)
        out = robot_end.went_out + device_end.went_out
        in_wall = 0.5 * wall * max(0.0, tool - gap) ** 2
        balances.append(device_end.came_in - in_wall if measured else robot_end.came_in + device_end.came_in - out)
        said.append((tick.status, tick.reason))
    return np.array(forces), np.array(balances), said


def test_forces_of_an_operator_with_delay_do_not_grow():
    alone, balance, _ = pushed(Everything("twist"), Everything("wrench"))
    assert alone.max() > 4.0 * STEADY  # hand and tool push each other higher
    assert balance.min() < -1.0
    ends = [iq.control.LinkEnd(dt=DT, passes=what, store=STORE) for what in ("twist", "wrench")]
    forces, balance, said = pushed(*ends)
    assert forces.max() < 1.5 * np.sqrt(2.0 * WALL * STORE)  # the spring that the store fills, and a tick's share
    assert forces[-500:].max() < 1e-9  # let go of slowly
    # What a tick more of the wall's rising force lets out.
    assert balance.min() > -2.0 * STORE - 2e-3
    assert said[0] == ("ok", "")
    assert any(s == "scaled" and "the link would generate energy" in why for s, why in said)


def test_an_end_is_the_same_in_every_frame():
    random, T = np.random.default_rng(0), motion(np.random.default_rng(1))
    here, there = (iq.control.LinkEnd(dt=DT, passes="twist", store=1e-3) for _ in range(2))
    shares = []
    for _ in range(50):
        v, w = random.normal(size=(2, 6))
        a, b = here.step(v, w, 0.01), there.step(iq.adjoint(T) @ v, iq.coadjoint(T) @ w, 0.01)
        np.testing.assert_allclose(b.passed, iq.adjoint(T) @ a.passed, atol=1e-10)
        shares.append(a.share)
    assert min(shares) == 0.0
    assert here.went_out == pytest.approx(there.went_out, abs=1e-10)


def test_free_motion_and_entering_energy_are_passed_on():
    end = iq.control.LinkEnd(dt=DT, passes="twist", store=0.0)
    assert end.step(UP, np.zeros(6), 0.0).status == "ok"
    end.step(UP, -UP, 0.0)  # pushed along by the world
    assert end.step(UP, -UP, 0.0).share == 1.0
    assert end.came_in == pytest.approx(2.0 * DT)  # each tick what is met at its end
    assert end.step(UP, UP, 0.0).share == 0.0
    assert end.step(UP, UP, 1.0).share == 1.0  # the operator has worked for it


def test_packets_too_old_or_from_the_future_are_not_used():
    end = iq.control.LinkEnd(dt=DT, passes="twist", store=0.0, timeout=0.5)
    assert end.step(UP, np.zeros(6), 0.0, age=0.5).status == "ok"
    for age, why in ((0.51, "0.51 s old"), (np.inf, "inf s old"), (-0.1, "0.1 s ahead of this clock")):
        tick = end.step(UP, UP, 1.0, age)
        assert (tick.status, tick.share, tick.passed.any()) == ("held", 0.0, False)
        assert why in tick.reason
    assert end.step(UP, UP, 0.0, age=-DT).status == "scaled"  # nor is the energy it told of
    assert end.step(UP, UP, 1.0, age=0.1).share == 1.0
    with pytest.raises(iq.BadInput, match="age"):
        end.step(UP, UP, 1.0, np.nan)


@pytest.mark.parametrize("seed", range(4))
def test_springs_and_dampers_get_no_more_than_came_in_by_an_exact_integral(seed):
    """In six dimensions, 100 ms away from a hand of 0.3 kg on a spring and a damper."""
    random, size = np.random.default_rng(seed), np.array([0.01] * 3 + [1.0] * 3)
    K, D = size * 10.0 ** random.uniform(0.0, 3.0, 6), size * random.uniform(0.0, 3.0, 6)
    swing, beat = random.normal(size=6) * ([0.1] * 3 + [0.03] * 3), random.uniform(1.0, 10.0, 6)
    robot, device = (iq.control.LinkEnd(dt=DT, passes=what, store=STORE) for what in ("twist", "wrench"))
    there, back = (deque([(np.zeros(6), 0.0)] * LATE, maxlen=LATE) for _ in range(2))
    tool, hand, speed, twist, out = np.zeros(6), np.zeros(6), np.zeros(6), np.zeros(6), []
    for k in range(750):
        (felt, told_by_robot), (asked, told_by_hand) = back[0], there[0]
        there.append((speed, device.came_in))
        back.append((-(K * tool + D * twist), robot.came_in))
        twist = robot.step(asked, K * tool + D * twist, told_by_hand).passed
        out.append(DT * twist @ (K * (tool + DT / 2.0 * twist) + D * twist))
        tool = tool + DT * twist
        felt = device.step(speed, felt, told_by_robot).passed
        before = speed
        wanted = swing * np.sin(beat * DT * k)
        speed = speed + DT / 0.3 * (felt / size + 60.0 * (wanted - hand) - 5.0 * speed)
        hand = hand + DT * speed
        out.append(DT * felt @ (before + speed) / 2.0)
    assert np.sum(np.abs(out)) > 0.02  # something is moved
    assert np.cumsum(out).max() < 2.0 * STORE + 2.0 * max(out)


def link(push, wall, arm, told=None):
    """Both ends before a wall that the hand may press with `push` before it is felt."""
    store, delay = push**2 / (2.0 * wall), DT * (arm if told is None else told)
    robot = iq.control.LinkEnd(dt=DT, passes="twist", store=store, delay=delay, stiffness=wall)
    return robot, iq.control.LinkEnd(dt=DT, passes="wrench", store=store), store


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    ("wall", "arm", "late"), [(1e3, 25, 25), (1e4, 3, 0), (1e4, 12, 25), (1e5, 3, 25), (1e5, 25, 0)]
)
def test_a_robot_with_delay_presses_with_little_more_than_the_hand(wall, arm, late):
    robot, device, store = link(10.0, wall, arm)
    way = {"wall": wall, "gap": 5.0 / wall, "spring": 250.0, "arm": arm, "late": late}
    forces, balance, said = pushed(robot, device, 1.5, measured=True, **way)  # the hand pushes with 250 N/m * 40 mm
    assert 5.0 < forces.max() < 22.0
    assert balance.min() > -1.001 * store
    assert {status for status, _ in said} == {"ok", "scaled"}


def test_a_delay_beyond_the_declared_one_is_detected_before_contact():
    robot, device, _ = link(10.0, 1e4, arm=12, told=0)
    way = {"wall": 1e4, "gap": 0.015, "spring": 250.0, "arm": 12}
    forces, _, said = pushed(robot, device, 1.5, measured=True, **way)
    first = next(k for k, (status, _) in enumerate(said) if status == "degraded")
    assert "later than declared: set delay=" in said[first][1]
    assert "the robot follows 48 ms later than declared: set delay=0.048" in said[-1][1]
    assert first < np.flatnonzero(forces)[0]
    assert 5.0 < forces.max() < 22.0
    plain = [iq.control.LinkEnd(dt=DT, passes=what) for what in ("twist", "wrench")]
    assert pushed(*plain, 1.5, **way)[0].max() > 50.0  # where what is passed on counts as done


@pytest.mark.parametrize(("extra", "reports"), [(1, False), (2, True)])
def test_a_delay_of_one_tick_more_than_declared_is_tolerated(extra, reports):
    robot, device, _ = link(10.0, 1e4, arm=12, told=12 - extra)
    _, _, said = pushed(robot, device, 0.8, measured=True, wall=1e4, gap=0.5, spring=250.0, arm=12)
    assert ("later than declared" in said[-1][1]) is reports


@pytest.mark.parametrize(
    ("ratio", "noise", "found"),
    [(1.0, 0.0, 10), (0.5, 0.0, 10), (0.2, 0.0, 0), (1.2, 0.0, 10), (2.0, 0.0, 0), (1.0, 0.012, 10), (1.0, 0.024, 0)],
)
def test_a_delay_is_found_only_where_it_explains_the_motion(ratio, noise, found):
    rng, estimate = np.random.default_rng(0), DelayEstimate(DT, 0.0, 1)
    times = DT * np.arange(1000)
    commands = 0.1 * np.sin(6.0 * np.pi * times) + 0.05 * np.sin(2.6 * np.pi * times + 1.0)
    measured = ratio * np.append(np.zeros(11), commands)[:1000] + noise * rng.standard_normal(1000)
    delays = [estimate.update(m[None], c[None]) for m, c in zip(measured, commands, strict=True)]
    assert delays[-1] == pytest.approx(found * DT)


def test_a_wall_stiffer_than_declared_is_reported():
    robot, device, store = link(10.0, 1e3, arm=12)
    forces, _, said = pushed(robot, device, 1.5, wall=1e4, gap=0.01, spring=250.0, arm=12, measured=True)
    first = next(k for k, (status, _) in enumerate(said) if status == "degraded")
    assert "more energy has left than was available" in said[first][1]
    found = float(re.search(r"stiffer than declared: set stiffness=([\d.e+]+)$", said[-1][1].split(";")[0])[1])
    assert found == pytest.approx(1e4, rel=0.05)
    assert np.flatnonzero(0.5 * forces**2 / 1e4 > 1.5 * store)[0] in (first, first - 1, first + 1)


def test_a_robot_with_delay_is_limited_to_the_impact_energy_at_constant_speed():
    robot, _, store = link(10.0, 1e4, arm=12)
    ticks = [robot.step(0.1 * UP, np.zeros(6), 0.0) for _ in range(100)]
    assert "would exceed the impact energy of a contact ahead" in ticks[-1].reason
    speeds = np.array([tick.passed[5] for tick in ticks])
    np.testing.assert_allclose(speeds, np.sqrt(2.0 * store / 1e4) / (13 * DT), rtol=1e-9)
    assert robot.step(0.01 * UP, np.zeros(6), 0.0).status == "ok"


@pytest.mark.parametrize(("press", "share"), [(5.0, 1.0), (100.0, 0.0)])
def test_a_soft_hand_that_moves_far_does_not_pay_for_a_hard_press(press, share):
    robot, _, store = link(10.0, 1e4, arm=0)
    done, given = np.zeros(6), 0.0
    for k in range(600):  # the hand moves at 0.1 m/s, and pushes with 10 N from 0.4 s on: 2 J
        given += 10.0 * 0.1 * DT * (k >= 100)
        tick = robot.step(0.1 * UP, press * UP, given, done=done)
        done = tick.passed
    assert tick.share == pytest.approx(share, abs=1e-3)
    assert (robot.went_out < 1.5 * store) == (share == 0.0)


def test_the_energy_balance_uses_measured_motion_and_keeps_at_most_the_store():
    robot, _, store = link(10.0, 1e4, arm=0)
    for depth in 1e-4 * np.arange(1, 6):  # 0.1 mm a tick, measured, into a spring
        robot.step(0.01 * UP, 1e4 * depth * UP, 0.0, done=1e-4 / DT * UP)
    assert robot.went_out == pytest.approx(0.5 * 1e4 * 5e-4**2, rel=1e-9)
    assert robot.step(UP, np.zeros(6), 1.0, done=np.zeros(6)).left == store


def test_the_store_refills_slowly_after_friction_and_at_once_from_a_spring():
    robot, _, store = link(10.0, 1e4, arm=0)
    while robot.step(0.1 * UP, 8.0 * UP, 0.0).left > 1e-2 * store:
        pass
    least = robot.step(0.0 * UP, 0.0 * UP, 0.0).left
    for _ in range(round(5.0 / DT)):
        left = robot.step(0.1 * UP, np.zeros(6), 0.0).left
    assert left - least == pytest.approx(0.5 * store, rel=1e-9)
    robot.step(np.zeros(6), np.zeros(6), 0.0)
    left = robot.step(-0.1 * UP, 4.0 * UP, 0.0).left
    back = robot.step(np.zeros(6), 4.0 * UP, 0.0).left
    assert back - left == pytest.approx(0.1 * 4.0 * DT, rel=1e-2)
    assert robot.came_in == 0.0


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: iq.control.LinkEnd(dt=DT, passes="twist", delay=0.05), "stiffness"),
        (lambda: iq.control.LinkEnd(dt=DT, passes="twist", delay=-0.05, stiffness=1e3), "delay"),
        (lambda: iq.control.LinkEnd(dt=DT, passes="wrench", stiffness=1e3), "stiffness"),
        (lambda: iq.control.LinkEnd(dt=DT, passes="twist", stiffness=0.0), "stiffness"),
        (lambda: iq.control.LinkEnd(dt=DT, passes="wrench").step(UP, UP, 0.0, done=UP), "done"),
        (lambda: iq.control.LinkEnd(dt=DT, passes="twist").step(UP, UP, 0.0, done=UP * np.nan), "done"),
    ],
)
def test_bad_arguments_of_a_link_end_are_refused(make, named):
    with pytest.raises(iq.BadInput, match=named):
        make()
