"""The scenes of examples/22: the same in any frame; an edge is told before the fall, two presses are both held."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from support.arms import ready
from support.noisy_plane import FAULTS
from support.random_systems import motion
from support.repeats import repeats
from support.spring_plane import PANDA, UP

import invariantqp as iq

SHARED = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "shared" / "contact_scenes.py"))
DT = 0.004
ARMS = {"panda": PANDA, "ur5": ready("ur5"), "xarm7": ready("xarm7"), "so101": np.array([0.1, -0.4, 0.5, 0.6, 0.2])}


@pytest.fixture(scope="module")
def panda():
    return iq.load_robot("panda")


def loop_of(robot, task, noise=0.1, **given):
    sensor = iq.WrenchSensor(np.eye(4), order="moment first", reads="reaction", cutoff=50.0, noise=noise)
    return iq.HybridController(robot, task, dt=DT, sensor=sensor, **given)


def reading_of(scene, tool, twist, random, noise=0.1):
    reading = iq.coadjoint(iq.inverse(tool)) @ scene.world(tool, twist)
    return reading + np.concatenate((np.zeros(3), random.normal(0.0, noise, 3)))


@pytest.mark.cases(1)
@pytest.mark.parametrize("arm", ["panda", "so101"])
def test_frames_of_tool_sensor_and_contact_change_nothing(arm):
    """In all scenes; the tool begins a tick's way above the surface."""
    robot, q0, random = iq.load_robot(arm), ARMS[arm], np.random.default_rng(1)
    start = robot.pose(q0)
    for name, scene in SHARED["scenes"](start, 0.015).items():
        X, Y, Z = motion(random, 0.3), motion(random, 0.3), motion(random, 0.3)  # of contact, tool and sensor
        task, exact = iq.HybridTask(scene.told, scene.wanted, **scene.options), {}
        untold = name == "1e6 N/m"  # and a touch in ticks of 4 ms is an overload
        sensor = iq.WrenchSensor(np.eye(4), order="moment first", reads="reaction", cutoff=50.0, noise=0.02)
        if len(q0) < 6:
            exact = {"here": iq.control.ExactPoint(), "there": iq.control.ExactPoint(iq.inverse(Y)[:3, 3])}
        here = iq.HybridController(robot, task, dt=DT, sensor=sensor, exact=exact.get("here"), tare=False)
        there = iq.HybridController(
            robot.with_tool(Y),
            task.relabelled(X, Y),
            dt=DT,
            sensor=sensor.relabelled(Z, Y),
            exact=exact.get("there"),
            tare=False,
        )
        q, twist, pressed, worst = lowered(robot, q0, 0.00199), np.zeros(6), 0, 0.0
        for k in range(25):
            tool, (target, ahead) = robot.pose(q), scene.path(k * DT)
            reading = reading_of(scene, tool, twist, random, noise=0.02)
            pressed += np.abs(scene.world(tool, twist)).max() > 1e-4
            a = here.step(q, target, reading, ahead)
            b = there.step(q, target @ Y, iq.coadjoint(iq.inverse(Z)) @ reading, ahead)
            worst = max(worst, np.abs(a.velocity - b.velocity).max())
            assert a.status == b.status, (name, a.reason, b.reason)
            assert a.status in ("ok", "lost", "degraded", "overload" if untold else "ok"), (name, a.reason)
            twist, q = a.J @ a.velocity, q + DT * a.velocity
        assert pressed > (0 if untold else 10), (name, pressed)
        assert 0.0 < worst < 1e-9, (name, worst)


def lowered(robot, q, by):
    """Joint positions with the tip lower along the tool's z."""
    goal = robot.pose(q) @ [0.0, 0.0, by, 1.0]
    for _ in range(3):
        tool = robot.pose(q)
        J = iq.adjoint(iq.transform(translation=-tool[:3, 3])) @ robot.jacobian(q)
        q = q + np.linalg.pinv(J[3:]) @ (goal[:3] - tool[:3, 3])
    return q


def test_an_edge_is_told_before_the_tool_is_over_it_and_nothing_is_pushed_beyond(panda):
    scene, random = SHARED["scenes"](panda.pose(PANDA), 0.03)["over an edge and back"], np.random.default_rng(0)
    loop = loop_of(panda, iq.HybridTask(scene.told, scene.wanted, **scene.options))
    q, seen = PANDA, []
    for k in range(780):
        tool, (target, ahead) = panda.pose(q), scene.path(k * DT)
        solution = loop.step(q, target, reading_of(scene, tool, np.zeros(6), random), ahead)
        q = q + DT * solution.velocity
        seen.append((solution.contact.edge, solution.status, solution.reason, panda.pose(q)[2, 3]))
    near = [s for s in seen if 0.0 < s[0] < 0.005]
    beyond = [s for s in seen if s[0] <= 0.0]
    assert len(near) > 20
    assert all(s[1] == "degraded" and "before the edge of the surface" in s[2] for s in near)
    assert all(s[1] == "lost" and "beyond the edge" in s[2] for s in beyond)
    lifts = [s[3] - beyond[0][3] - 0.1 * (beyond[0][0] - s[0]) for s in beyond]
    assert max(s[3] for s in beyond) > beyond[0][3] + 1e-3
    assert np.ptp(lifts) < 2e-4  # it rises by a tenth of its way beyond and comes down again
    assert seen[-1][1] == "ok"  # and presses again


def test_a_round_tip_that_touches_the_edge_before_it_is_back_presses_on(panda):
    """What a lagging arm was told inwards beyond the edge was taken back, and then went on: the press was let go."""
    start, lag, radius = panda.pose(PANDA), 0.012, 0.0008
    scene, random = SHARED["scenes"](start, 0.03)["over an edge and back"], np.random.default_rng(0)
    x, z, foot = start[:3, 0], -start[:3, 2], start[:3, 3] + 0.002 * start[:3, 2]
    loop = loop_of(panda, iq.HybridTask(scene.told, scene.wanted, **scene.options), delay=lag)
    q, speed, edges, pressed = PANDA, np.zeros(7), [], []
    for k in range(900):
        tool, (target, ahead) = panda.pose(q), scene.path(max(0.0, (k - 150) * DT))
        p, edge = tool[:3, 3], 0.045 - x @ (tool[:3, 3] - start[:3, 3])
        rim = np.sqrt(max(radius**2 - max(-edge, 0.0) ** 2, 0.0)) - radius  # as deep the ball hangs over the edge
        force = 1e4 * max(0.0, rim - z @ (p - foot)) * (edge > -radius) * z
        reading = iq.coadjoint(iq.inverse(tool)) @ SHARED["at"](p, force)
        reading[3:] += random.normal(0.0, 0.1, 3)
        solution = loop.step(q, target, reading, ahead)
        speed = solution.velocity + np.exp(-DT / lag) * (speed - solution.velocity)
        q = q + DT * speed
        edges.append(edge)
        pressed.append(z @ force)
    back = np.flatnonzero(np.array(edges) < 0.0)[-1] + 1
    assert 700 < back < 880
    assert 2.0 < pressed[back - 3] < 4.0 < pressed[back]  # it is touched before
    assert min(pressed[back:]) > 4.5


@pytest.mark.parametrize("tilt", repeats([-5.0, 5.0], [-5.0]))
def test_a_tool_that_comes_back_over_another_part_of_the_edge_approaches(panda, tilt):
    """The surface is 4 mm higher or lower there than was told: a normal 5 deg off, a way of 47 mm beside the edge."""
    start, random, k = panda.pose(PANDA), np.random.default_rng(0), 1e4
    x, y, z = start[:3, 0], start[:3, 1], -start[:3, 2]
    foot, normal = start[:3, 3] - 0.002 * z, iq.exp([*np.deg2rad(tilt) * x, 0, 0, 0])[:3, :3] @ z

    def extent(p):
        return 0.02 - x @ (p - start[:3, 3])

    def told(tool):
        return iq.contacts.surface_contact(tool[:3, 3], implicit=lambda p: z @ (p - foot), extent=extent)

    def at(t):  # 1 s to touch, 40 mm along x, 47 mm along y, back along x, in 1 s each
        there = [np.interp(t, [1, 2, 3, 4], [0, 0.04, 0.04, 0.0]), np.interp(t, [2, 3], [0, 0.047])]
        return start[:3, 3] + there[0] * x + there[1] * y

    def world(tool, _):
        p, depth = tool[:3, 3], max(0.0, -normal @ (tool[:3, 3] - foot))
        return SHARED["at"](p, k * depth * normal * (extent(p) > 0.0))

    loop = loop_of(panda, iq.HybridTask(told, [2.0], max_force=np.inf))
    q, felt, twist = PANDA, [], np.zeros(6)
    for i in range(3000 if tilt > 0.0 else 1400):
        tool, target = panda.pose(q), start.copy()
        target[:3, 3], ahead = at(i * DT), np.zeros(6)
        ahead[3:] = (at((i + 1) * DT) - at(i * DT)) / DT
        wrench = world(tool, twist)
        reading = iq.coadjoint(iq.inverse(tool)) @ wrench
        reading[3:] += random.normal(0.0, 0.1, 3)
        solution = loop.step(q, target, reading, ahead)
        q = q + DT * solution.velocity
        felt.append(np.linalg.norm(wrench[3:]))
    assert max(felt) < 4.0
    assert solution.status == "ok"
    assert felt[-1] == pytest.approx(2.0, rel=0.1)


def test_both_of_two_contacts_are_pressed_and_the_loss_of_one_is_told(panda):
    scene, random = SHARED["scenes"](panda.pose(PANDA), 0.03)["corner, two contacts"], np.random.default_rng(0)
    loop = loop_of(panda, iq.HybridTask(scene.told, scene.wanted))
    q, start = PANDA, panda.pose(PANDA)
    wall, presses, said, aside = True, [], [], []
    for k in range(900):
        tool, wall = panda.pose(q), k < 600
        reading = reading_of(scene, tool, np.zeros(6), random)
        if not wall:
            reading[3] = random.normal(0.0, 0.1)  # x of the tool and of the wall
        solution = loop.step(q, start, reading)
        q = q + DT * solution.velocity
        presses.append(solution.intensities[:2])
        said.append(solution.status)
        aside.append(np.linalg.norm(panda.pose(q)[:2, 3] - tool[:2, 3]) / DT)
    np.testing.assert_allclose(np.mean(presses[500:600], axis=0), [5.0, 3.0], rtol=0.02)
    assert set(said[500:600]) == {"ok"}
    assert set(said[650:]) == {"lost"}
    assert max(aside[650:]) < 0.02 * 1.01  # looked for no faster than approach_speed
    np.testing.assert_allclose(np.mean(presses[700:], axis=0)[0], 5.0, rtol=0.05)  # the floor is not pressed harder


@pytest.mark.cases(3)
@pytest.mark.parametrize("since", [0.6, 1.2])  # one of them is felt, both are
@pytest.mark.parametrize("name", ["dead", "order", "sign"])
def test_a_fault_in_two_contacts_stops_both_pushes(panda, name, since):
    make, status, _ = FAULTS[name]
    scene, random = SHARED["scenes"](panda.pose(PANDA), 0.03)["corner, two contacts"], np.random.default_rng(0)
    loop, fault = loop_of(panda, iq.HybridTask(scene.told, scene.wanted)), make()
    q, start, forces, said = PANDA, panda.pose(PANDA), [], []
    for k in range(round((since + 0.4) / DT)):
        tool = panda.pose(q)
        reading = reading_of(scene, tool, np.zeros(6), random)
        if k * DT >= since:
            reading = fault(reading, tool[:3, :3].T @ UP)
        solution = loop.step(q, start, reading)
        q = q + DT * solution.velocity
        forces.append(np.linalg.norm(scene.world(tool, np.zeros(6))[3:]))
        said.append(solution.status)
    assert status in said
    assert said[-1] == status
    assert max(forces) < 2.0 * np.hypot(5.0, 3.0)
    assert forces[-1] == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_rubs_on_the_floor_is_no_pull_of_the_wall_but_both_of_them_are(panda, sign):
    """Friction of 0.5 on the way to the wall passes for its touch; where the tool lets go it turns round: a "fault"."""
    scene, random = SHARED["scenes"](panda.pose(PANDA), 0.03)["corner, two contacts"], np.random.default_rng(0)
    loop, said, way = loop_of(panda, iq.HybridTask(scene.told, scene.wanted)), [], np.zeros(3)
    q, start = PANDA, panda.pose(PANDA)
    for _ in range(800):
        tool = panda.pose(q)
        wrench = scene.world(tool, np.zeros(6))
        rubs = -0.5 * wrench[5] * way / max(np.linalg.norm(way), 2e-3 * DT)  # and sticks below 2 mm/s
        wrench = sign * (wrench + np.concatenate((np.cross(tool[:3, 3], rubs), rubs)))
        reading = iq.coadjoint(iq.inverse(tool)) @ wrench
        reading[3:] += random.normal(0.0, 0.1, 3)
        solution = loop.step(q, start, reading)
        q = q + DT * solution.velocity
        way = (panda.pose(q) - tool)[:3, 3] * [1.0, 1.0, 0.0]
        said.append((solution.status, solution.reason))
        if sign < 0.0 and "the contact pulls" in solution.reason:
            break
    if sign > 0.0:
        assert said[-1][0] == "ok", said[-1]
        assert {status for status, _ in said} <= {"lost", "ok", "degraded"}
        np.testing.assert_allclose(solution.intensities[:2], [5.0, 3.0], atol=1.5)  # what rubs damps the wall's press
    else:
        assert any("the contact pulls" in reason for _, reason in said)


def test_two_contacts_that_press_on_one_line_are_refused():
    floor = iq.point_contact([0.4, 0.0, 0.1], UP)
    with pytest.raises(iq.BadInput, match=r"second: found a point and a point with 2 wrenches of rank 1"):
        iq.contacts.two_contacts(floor, iq.point_contact([0.4, 0.0, 0.3], -UP))
    ends = iq.contacts.two_contacts(floor, iq.point_contact([0.5, 0.0, 0.1], -UP))
    assert ends.kind.out is None  # pressed from both sides: no way out
    bottom = iq.contacts.two_contacts(iq.contacts.peg_in_hole([0.4, 0.0, 0.1], -UP), floor)
    assert (bottom.freedoms.shape, bottom.kind.presses) == ((6, 1), 1)
    np.testing.assert_allclose(bottom.constraints[:, 0], floor.constraints[:, 0], atol=1e-12)


def test_a_door_that_five_joints_cannot_yield_to_is_no_ok():
    robot, q = iq.load_robot("so101"), np.array([0.1, -0.4, 0.5, 0.6, 0.2])
    scene, random = SHARED["scenes"](robot.pose(q), 0.015)["door, hinge 10 mm off"], np.random.default_rng(0)
    loop = loop_of(robot, iq.HybridTask(scene.told, scene.wanted), exact="position")
    for k in range(900):
        tool, (target, ahead) = robot.pose(q), scene.path(DT * k)
        solution = loop.step(q, target, reading_of(scene, tool, np.zeros(6), random), ahead)
        q = q + DT * solution.velocity
        if solution.status not in ("ok", "degraded"):
            break
    assert solution.status == "overload"
    assert "N m of 1" in solution.reason  # the tip yields, the handle turns in the hand
    assert np.linalg.norm(scene.world(tool, np.zeros(6))[3:]) < 4.0


def test_a_turn_that_five_joints_leave_out_is_no_motion_that_stands():
    robot, q, random = iq.load_robot("so101"), ARMS["so101"], np.random.default_rng(0)
    scene = SHARED["scenes"](robot.pose(q), 0.015)["hard, 1e5 N/m"]
    loop, said = loop_of(robot, iq.HybridTask(scene.told, scene.wanted), exact="position"), []
    for k in range(800):
        tool, (target, ahead) = robot.pose(q), scene.path(max(0.0, DT * k - 2.0))
        solution = loop.step(q, target, reading_of(scene, tool, np.zeros(6), random), ahead)
        q = q + DT * solution.velocity
        said.append((solution.status, solution.reason))
    # What damps the turn that five joints leave out takes up to a tenth of what they could do.
    assert {status for status, _ in said[400:]} == {"ok", "limited"}


@pytest.mark.parametrize("name", ["screw, 63 mm a turn", "door, hinge 10 mm off", "peg, hole tilted 2 deg"])
def test_five_joints_that_cannot_follow_a_screw_say_so_before_they_press(name):
    robot, q, random = iq.load_robot("so101"), ARMS["so101"], np.random.default_rng(0)
    scene = SHARED["scenes"](robot.pose(q), 0.015)[name]
    loop = loop_of(robot, iq.HybridTask(scene.told, scene.wanted), exact="position")
    said, forces, moments = [], [], []
    for k in range(700 if "screw" in name else 400 if "door" in name else 200):
        tool, (target, ahead) = robot.pose(q), scene.path(max(0.0, DT * k - 0.5))
        pushes = scene.world(tool, np.zeros(6))
        solution = loop.step(q, target, reading_of(scene, tool, np.zeros(6), random), ahead)
        q = q + DT * solution.velocity
        said.append((solution.status, solution.reason))
        forces.append(np.linalg.norm(pushes[3:]))
        moments.append(np.linalg.norm(pushes[:3] - np.cross(tool[:3, 3], pushes[3:])))
    told = [k for k, (_, why) in enumerate(said) if "5 joints cannot move the tool along this contact" in why]
    if "peg" in name:  # it slides in a plane in which the arm can move it
        assert {status for status, _ in said} == {"ok"}
        return
    assert told[0] < 150  # 0.1 s after the motion begins
    assert said[told[0]][0] == "degraded"
    assert max(forces[: told[0]]) < 0.1
    assert max(moments[: told[0]]) < 0.01
    late = [status for (status, _), moment in zip(said, moments, strict=True) if moment > 0.3]
    assert set(late) <= {"degraded", "overload"}
    if "screw" in name:
        assert {status for status, _ in said[:450]} == {"ok", "degraded"}
        assert max(forces[:450]) < 4.0  # no integral is wound up


@pytest.fixture(scope="module")
def example():
    """The names of examples/22, run for no scene."""
    pytest.importorskip("mujoco")
    script = Path(__file__).parents[2] / "examples" / "22_contact_scenes.py"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", [str(script), "--scene", "none of them"])
        patch.syspath_prepend(str(script.parent))
        return runpy.run_path(str(script))


def test_a_touch_of_metal_by_an_arm_that_yields_and_lags_is_not_doubted(panda, example):
    """The tip's own mass shows the metal's 1e6 N/m at first, the arm in series 2e5 N/m then; 0.4 s from the touch."""
    scene, start = SHARED["scenes"](panda.pose(PANDA), 0.03)["1e6 N/m"], panda.pose(PANDA)
    plant = example["plant_of"]("mujoco", "panda", panda, PANDA, scene)
    loop, touched, solutions = next(example["loops"](panda, scene, "mujoco")), 0, []
    while touched < 200 and len(solutions) < 1500:
        touched += touched > 0 or np.abs(plant.state().wrench).max() > 1e-6
        measured = plant.measure()
        solutions.append(loop.step(measured.q, start, measured.wrench))
        plant.command(solutions[-1].velocity)
    assert touched == 200
    assert {s.status for s in solutions} <= {"lost", "ok", "limited", "degraded"}
    assert solutions[-1].status in ("ok", "limited")
    assert plant.state().wrench[5] == pytest.approx(5.0, rel=0.05)


def test_metal_that_is_told_without_the_arm_in_series_is_pressed_as_it_answers(example):
    """1e6 N/m told, 2e5 N/m left, from a second after the touch along a path; the law for 1e6 was 5 and 1.7 N off."""
    robot, q = iq.load_robot("panda"), ARMS["panda"]
    scenes, start = SHARED["scenes"](robot.pose(q), 0.03), lowered(robot, q, 0.001)
    told, untold = (
        example["run"]("panda", robot, start, scenes[s], "mujoco", 3.0) for s in ("1e6 N/m, told", "1e6 N/m")
    )
    _, rms, most, touch, after, *_ = told
    assert (rms < 0.7, most < 1.0) == (True, True), told
    assert (touch, after) == pytest.approx(untold[3:5])  # it was touched four seconds later


def test_a_stiff_door_told_wrong_is_no_overload_behind_motors_that_yield(panda, example):
    """Hinge told 10 mm off, 1e6 N/m: slowed down for the moments, as over one size of the contact, 20 N built up."""
    start = panda.pose(PANDA)
    x, z, post = start[:3, 0], -start[:3, 2], start[:3, 3] + 0.3 * start[:3, 1]
    hinge, told = iq.revolute(z, post), iq.contacts.hinge(post + 0.01 * x, z)
    scene = SHARED["grip"](start, hinge, lambda _: told, SHARED["along"](start, 0.3 * hinge), stiffness=1e6)
    run = example["run"]("panda", panda, PANDA, scene, "mujoco", 5.5)
    assert run[2] < 12.0, run
    assert "overload" not in run[-1]
