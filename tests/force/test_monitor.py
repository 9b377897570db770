"""Contact lost, or too hard: statuses with reasons, and what was configured is done, never more."""

import numpy as np
import pytest
from support.arms import ready
from support.plane import Bench, force_at, gantry, pen
from support.wrist import wrist

import invariantqp as iq

DT = 0.01
READY = ready("panda")
TOUCH, AIR, HARD = 5.0, 0.0, 50.0


def surface(tool):
    return iq.point_contact(tool[:3, 3], [0.0, 0.0, 1.0])


def fed(robot, presses, task=None, **options):
    """The solutions of a loop that is fed with presses, whatever it does; the arm moves, and so does the surface."""
    options = {"yields": np.inf, **options}
    task = iq.HybridTask(surface, [5.0], **options) if task is None else task
    loop, q, solutions = iq.HybridController(robot, task, dt=DT, order="moment first"), READY.copy(), []
    start = robot.pose(q)
    for press in presses:
        target = iq.exp([0.0, 0.0, 0.0, 0.05, 0.0, 0.0]) @ start  # motion along S is desired all the time
        solutions.append(loop.step(q, target, force_at(robot.pose(q)[:3, 3], [0.0, 0.0, -press])))
        q = q + DT * solutions[-1].velocity
    return solutions, loop


def pushed(robot, task, wrench, q=READY, **options):
    """The solution of one tick with a wrench, in the base frame."""
    loop = iq.HybridController(robot, task, dt=DT, order="moment first", **options)
    return loop.step(q, robot.pose(q), wrench)


def rises(solution):
    """Speed of the tool along the outward normal, and across."""
    p = solution.contact.point
    v = (solution.J @ solution.velocity)[3:] + np.cross((solution.J @ solution.velocity)[:3], p)
    return v[2], np.linalg.norm(v[:2])


def test_before_the_first_touch_it_approaches_no_faster_than_allowed(panda):
    for on_loss in ("approach", "hold", "retreat", "continue"):
        solutions, _ = fed(panda, [AIR] * 30, on_loss=on_loss, compliance=0.1, approach_speed=0.01)
        assert {s.status for s in solutions} == {"lost"}
        assert {s.reason for s in solutions} == {"no contact yet: approaching"}
        assert rises(solutions[5])[0] == pytest.approx(-0.01, abs=1e-6)
        assert rises(solutions[5])[1] > 1e-3


@pytest.mark.parametrize(
    ("on_loss", "speed", "moves", "message"),
    [
        ("approach", -0.01, True, "approaching"),
        ("hold", 0.0, False, "standing still"),
        ("retreat", 0.02, False, "retreating"),
        ("continue", -0.5, True, "no contact for"),
    ],
)
def test_a_lost_contact_is_reported_in_time_and_handled_as_declared(panda, on_loss, speed, moves, message):
    presses = [TOUCH] * 3 + [AIR] * 20
    options = {"lost_after": 0.1, "compliance": 0.1, "approach_speed": 0.01, "retreat_speed": 0.02}
    solutions, _ = fed(panda, presses, on_loss=on_loss, **options)
    statuses = [s.status for s in solutions]
    assert statuses[:13] == ["ok"] * 13  # ten ticks of 0.01 s are not yet longer than 0.1 s
    assert set(statuses[13:]) == {"lost"}
    assert message in solutions[14].reason
    up, across = rises(solutions[14])
    assert up == pytest.approx(speed, abs=1e-3)
    assert (across > 1e-3) == moves


def test_a_short_gap_is_no_loss_and_a_contact_found_again_is_ok(panda):
    gap, _ = fed(panda, [TOUCH] * 3 + [AIR] * 5 + [TOUCH] * 3)
    assert {s.status for s in gap} == {"ok"}
    for on_loss in ("approach", "hold"):
        again, _ = fed(panda, [TOUCH] * 3 + [AIR] * 20 + [TOUCH] * 3, on_loss=on_loss)
        assert [s.status for s in again[-4:]] == ["lost", "ok", "ok", "ok"]


def test_a_compliant_tool_that_leaves_its_contact_comes_back_no_faster_than_it_approaches(panda):
    solutions, _ = fed(panda, [TOUCH] * 3 + [AIR] * 10, lost_after=0.1, compliance=0.1, approach_speed=0.01)
    assert {s.status for s in solutions} == {"ok"}
    assert [rises(s)[0] for s in solutions[7:]] == pytest.approx([-0.01] * 6, abs=1e-6)


def test_a_press_near_the_contact_limit_presses_on(panda):
    solutions, _ = fed(panda, [TOUCH] * 3 + [0.499] * 100, lost_after=0.05, yields=1e-3)
    presses_on = [rises(solution)[0] < -1e-5 for solution in solutions[3:]]
    assert "lost" not in {solution.status for solution in solutions}
    assert sum(presses_on) >= 20  # then it is unloaded: it does not answer


def test_a_retreat_ends_after_its_distance_and_stays_until_reset(panda):
    presses = [TOUCH] * 2 + [AIR] * 140 + [TOUCH] * 3
    solutions, loop = fed(panda, presses, on_loss="retreat", retreat_speed=0.02, retreat_distance=0.01)
    heights = [s.contact.point[2] for s in solutions]
    first = next(k for k, s in enumerate(solutions) if s.status == "lost")
    assert heights[-1] - heights[first] == pytest.approx(0.01, abs=5e-4)
    assert solutions[-1].status == "lost"
    assert "standing still until reset" in solutions[-1].reason
    assert not solutions[-1].velocity.any()
    loop.reset()
    again = loop.step(READY, panda.pose(READY), force_at(solutions[-1].contact.point, [0, 0, -5.0]))
    assert again.status in ("ok", "limited")


def test_no_threshold_no_loss_and_thresholds_of_ones_own(panda):
    never, _ = fed(panda, [TOUCH] + [AIR] * 30, lost_below=0.0)
    assert {s.status for s in never} == {"ok"}
    high, _ = fed(panda, [TOUCH] * 30, lost_below=7.0)
    assert {s.status for s in high} == {"lost"}
    nothing_wanted, _ = fed(panda, [AIR] * 30, task=iq.HybridTask(surface, [0.0]))
    assert {s.status for s in nothing_wanted} == {"ok"}
    hinge = iq.HybridTask(iq.contacts.hinge([0, 0, 0], [0, 0, 1]), np.zeros(5))
    assert {s.status for s in fed(panda, [AIR] * 30, task=hinge)[0]} == {"ok"}  # held from both sides


def test_a_contact_that_is_never_lost_is_approached_gently(panda):
    bench = Bench(panda, READY, pen(lost_below=0.0), stiffness=2e4, depth=-2e-3)
    solutions = bench.run(1000)
    assert solutions[0].status == "lost"
    assert max(s.intensities[0] for s in solutions) < 5.5
    assert [s.intensities[0] for s in solutions[-100:]] == pytest.approx([5.0] * 100, abs=0.1)


@pytest.mark.parametrize(("on_overload", "speed"), [("hold", 0.0), ("retreat", 0.02)])
def test_an_overload_is_reported_at_once_and_stays_until_reset(panda, on_overload, speed):
    presses = [TOUCH] * 3 + [HARD] + [TOUCH] * 3
    solutions, loop = fed(panda, presses, max_force=20.0, on_overload=on_overload)
    assert [s.status for s in solutions] == ["ok"] * 3 + ["overload"] * 4
    assert "50 N of 20" in solutions[3].reason
    for s in solutions[3:]:
        assert rises(s) == (pytest.approx(speed, abs=1e-4), pytest.approx(0.0, abs=1e-4))
    loop.reset()
    again = loop.step(READY, panda.pose(READY), force_at(panda.pose(READY)[:3, 3], [0, 0, -5.0]))
    assert again.status in ("ok", "limited")


@pytest.mark.parametrize(
    ("across", "press", "status"),
    [(11.0, 12.0, "ok"), (0.0, 13.0, "overload"), (9.0, 13.0, "overload"), (13.0, 5.0, "overload")],
)
def test_the_default_overload_limits_press_and_lateral_force_separately(panda, across, press, status):
    wrench = force_at(panda.pose(READY)[:3, 3], [0.6 * across, -0.8 * across, -press])
    assert pushed(panda, iq.HybridTask(surface, [5.0]), wrench).status == status


def test_a_moment_is_counted_about_the_place_of_contact(panda):
    fine, _ = fed(panda, [TOUCH] * 3, max_moment=0.1)  # 5 N half a metre from the base: 2.5 N m about its origin
    assert {s.status for s in fine} == {"ok"}
    wrench = force_at(panda.pose(READY)[:3, 3], [0.0, 0.0, -5.0]) + 0.2 * np.eye(6)[0]
    solution = pushed(panda, iq.HybridTask(surface, [5.0], max_moment=0.1), wrench)
    assert solution.status == "overload"
    assert "0.2 N m of 0.1" in solution.reason


def test_an_overload_is_seen_through_the_low_pass(panda):
    task = iq.HybridTask(surface, [5.0], max_force=20.0)
    sensor = wrist(cutoff=0.1, reads="action", force_deadband=40.0)
    loop = iq.HybridController(panda, task, dt=DT, sensor=sensor)
    loop.step(READY, panda.pose(READY), np.zeros(6))
    hit = loop.step(READY, panda.pose(READY), [0, 0, 0, 0, 0, 30.0])
    assert np.linalg.norm(hit.wrench[3:]) < 1.0
    assert hit.status == "overload"


@pytest.mark.parametrize(("joint", "beyond", "options"), [(3, 0.01, {}), (0, 0.02, {"tool_speed": 0.1})])
def test_a_stopped_tool_outside_its_position_limits_moves_back_within_the_other_limits(panda, joint, beyond, options):
    q = READY.copy()
    q[joint] = panda.position_upper[joint] + beyond
    task = iq.HybridTask(surface, [5.0], max_force=20.0, on_overload="hold")
    solution = pushed(panda, task, [0, 0, 0, 0, 0, -30.0], q, **options)
    assert solution.status == "overload"
    assert solution.velocity[joint] < 0.0
    if options:
        assert np.linalg.norm(rises(solution)) <= 0.1 * (1 + 1e-6)


@pytest.mark.cases(1)
@pytest.mark.parametrize(
    ("name", "q", "speed"),
    [("so101", [-0.991, -0.313, -1.182, 0.599, -1.793], 0.02), ("panda", READY, 5.0), ("panda", READY, 0.5)],
)
def test_a_retreat_leads_out_by_its_distance_and_no_further(name, q, speed):
    robot, dt = iq.load_robot(name), 0.005
    task = iq.HybridTask(surface, [5.0], max_force=20.0, on_overload="retreat", retreat_speed=speed)
    loop = iq.HybridController(robot, task, dt=dt, order="moment first")
    q = np.array(q)
    start = robot.pose(q)
    for tick in range(400):
        solution = loop.step(q, start, force_at(robot.pose(q)[:3, 3], [0.0, 0.0, -100.0 * (tick == 0)]))
        q = q + dt * solution.velocity
        assert robot.pose(q)[2, 3] > start[2, 3] - 1e-4
    assert "standing still" in solution.reason
    assert robot.pose(q)[2, 3] - start[2, 3] == pytest.approx(task.retreat_distance, abs=1e-3)


def test_a_bad_task_sensor_contact_or_press_is_refused(panda):
    with pytest.raises(iq.BadInput, match="task: found 'x'"):
        iq.HybridController(panda, "x", dt=DT, order="moment first")
    task = iq.HybridTask(surface, [5.0])
    with pytest.raises(iq.BadInput, match="sensor: found 'x'"):
        iq.HybridController(panda, task, dt=DT, sensor="x")
    with pytest.raises(iq.BadInput, match="contact: found 'x'"):
        iq.HybridController(panda, task, dt=DT).step(READY, panda.pose(READY), np.zeros(6), contact="x")
    with pytest.raises(iq.BadInput, match="a press of -5"):
        iq.HybridController(panda, iq.HybridTask(surface, [-5.0]), dt=DT, order="moment first")
    with pytest.raises(iq.BadInput, match="presses"):
        iq.contacts.ContactKind("free", np.eye(6), presses=1)


@pytest.mark.cases(2)
@pytest.mark.parametrize("options", [{}, {"stiffness": 5e4}, {"compliance": 2.0 / 1e4}])
def test_a_press_that_is_lowered_is_no_overload_and_one_that_rises_then_is(options):
    bench = Bench(gantry(), np.zeros(6), pen(8.0, **options), depth=1e-4, dt=0.004)
    high = [bench.tick(wanted=[24.0]) for _ in range(600)]
    assert high[-1].intensities[0] == pytest.approx(24.0, rel=0.05)
    low = [bench.tick(wanted=[8.0]) for _ in range(600)]
    assert {s.status for s in low} <= {"ok", "degraded"}  # not reached within a second, a stiffness declared wrong
    assert low[-1].intensities[0] == pytest.approx(8.0, rel=0.05)
    bench.height += 14.0 / bench.stiffness
    assert "N of 20: " in bench.tick(wanted=[8.0]).reason  # there was contact: the sensor is not blamed


def test_a_rise_while_a_press_is_lowered_is_an_overload():
    bench = Bench(gantry(), np.zeros(6), pen(8.0, stiffness=1e4), depth=1e-4, dt=0.002)
    for wanted in [24.0] * 1000 + [8.0] * 20:
        felt = bench.tick(wanted=[wanted]).intensities[0]
    assert 8.0 < felt < 20.0
    bench.height += 1.6 * felt / bench.stiffness
    assert bench.tick(wanted=[8.0]).status == "overload"


def test_a_press_lowered_and_not_followed_becomes_an_overload():
    loop = iq.HybridController(gantry(), pen(8.0, stiffness=500.0), dt=DT, order="moment first")
    for wanted in [24.0] * 10 + [8.0] * 100:
        last = loop.step(np.zeros(6), np.eye(4), [0, 0, 0, 0, 0, -24.0], wanted=[wanted])
    assert last.status == "overload"


def test_a_constant_reading_shows_no_stiffness():
    loop = iq.HybridController(gantry(), pen(8.0), dt=DT, order="moment first")
    for _ in range(100):
        solution = loop.step(np.zeros(6), np.eye(4), [0, 0, 0, 0, 0, -12.0])
    assert loop.stiffness is None
    assert abs(solution.velocity[2]) < 1.0


@pytest.mark.cases(4)
@pytest.mark.parametrize("follows", [-1.0, 0.0, 0.5, 1.0])  # the sign is wrong, the brakes hold, half, all of it
@pytest.mark.parametrize("on_loss", ["approach", "continue"])
def test_an_approach_that_the_arm_does_not_follow_ends(follows, on_loss):
    task = pen(on_loss=on_loss, approach_distance=np.inf, approach_time=np.inf)
    bench = Bench(gantry(), np.zeros(6), task, depth=-0.008, dt=0.004)
    reports = []
    for _ in range(3500):
        q = bench.q
        solution = bench.tick()
        bench.q = q + follows * (bench.q - q)
        reports.append((solution.status, solution.reason))
        if reports[-500:-499] and {status for status, _ in reports[-500:]} == {"ok"}:
            break
        if reports[-20:-19] == reports[-1:] and "until reset" in solution.reason:
            break
    if follows > 0.2:
        assert reports[-1][0] == "ok"
        return
    assert reports[-1][0] == "lost"
    assert "the robot does not follow commands: standing still until reset" in reports[-1][1]
    assert not solution.velocity.any()
    assert 0.009 < follows * -bench.robot.pose(bench.q)[2, 3] < 0.011 or follows == 0.0


def test_a_blocked_tool_without_force_retreats():
    """A stop after 10 mm that no force of the drives moves, and a sensor that does not read it."""
    gap = 0.01
    bench = Bench(gantry(), np.zeros(6), pen(on_overload="retreat"), depth=-1.0, dt=0.004)
    asked, reports = 0.0, []
    for _ in range(6500):
        solution = bench.tick()
        asked += -bench.dt * solution.velocity[2] if bench.q[2] < -gap else 0.0
        bench.q[2] = max(bench.q[2], -gap)
        reports.append((solution.status, solution.reason))
        if reports[-20:-19] == reports[-1:] and "until reset" in solution.reason:
            break
    assert reports[-1][0] == "fault"
    assert "towards the contact, the tool moved" in reports[-1][1]
    assert "something blocks it, or the sensor is stuck: standing still until reset" in reports[-1][1]
    assert asked < 0.017
    assert bench.q[2] > 0.019  # where the approach began, and 20 mm more
