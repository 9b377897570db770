"""The scenes of examples/22: the same in any frame; an edge is reported before the fall, two presses are both held."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.arms import ready
from support.contact_scenes import SHARED, in_scene
from support.plane import FAULTS, PANDA, SO101, UP
from support.random_systems import motion
from support.repeats import repeats

import invariantqp as iq

DT = 0.004
ARMS = {"panda": PANDA, "ur5": ready("ur5"), "xarm7": ready("xarm7"), "so101": SO101}


@pytest.mark.cases(1)
@pytest.mark.parametrize("arm", ["panda", "so101"])
def test_frames_of_tool_sensor_and_contact_change_nothing(arm):
    robot, q0, random = iq.load_robot(arm), ARMS[arm], np.random.default_rng(1)
    start = robot.pose(q0)
    for name, scene in SHARED["scenes"](start, 0.015).items():
        X, Y, Z = motion(random, 0.3), motion(random, 0.3), motion(random, 0.3)  # of contact, tool and sensor
        task, exact = iq.HybridTask(scene.told, scene.wanted, **scene.options), {}
        undeclared = name == "1e6 N/m"  # and a touch in ticks of 4 ms is an overload
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
            reading = iq.coadjoint(iq.inverse(tool)) @ scene.world(tool, twist)
            reading[3:] += random.normal(0.0, 0.02, 3)
            pressed += np.abs(scene.world(tool, twist)).max() > 1e-4
            a = here.step(q, target, reading, ahead)
            b = there.step(q, target @ Y, iq.coadjoint(iq.inverse(Z)) @ reading, ahead)
            worst = max(worst, np.abs(a.velocity - b.velocity).max())
            assert a.status == b.status, (name, a.reason, b.reason)
            assert a.status in ("ok", "lost", "degraded", "overload" if undeclared else "ok"), (name, a.reason)
            twist, q = a.J @ a.velocity, q + DT * a.velocity
        assert pressed > (0 if undeclared else 10), (name, pressed)
        assert 0.0 < worst < 1e-9, (name, worst)


def lowered(robot, q, by):
    """Joint positions with the tip lower along the tool's z."""
    goal = robot.pose(q) @ [0.0, 0.0, by, 1.0]
    for _ in range(3):
        tool = robot.pose(q)
        J = iq.adjoint(iq.transform(translation=-tool[:3, 3])) @ robot.jacobian(q)
        q = q + np.linalg.pinv(J[3:]) @ (goal[:3] - tool[:3, 3])
    return q


def test_an_edge_is_reported_in_time_and_nothing_is_pushed_beyond(panda):
    scene = SHARED["scenes"](panda.pose(PANDA), 0.03)["over an edge and back"]
    ticks = [
        (s.contact.edge, *tick.report, panda.pose(tick.q)[2, 3])
        for tick in in_scene(panda, PANDA, scene, 780)
        for s in [tick.solution]
    ]
    near = [s for s in ticks if 0.0 < s[0] < 0.005]
    beyond = [s for s in ticks if s[0] <= 0.0]
    assert len(near) > 20
    assert all(s[1] == "degraded" and "before the edge of the surface" in s[2] for s in near)
    assert all(s[1] == "lost" and "beyond the edge" in s[2] for s in beyond)
    lifts = [s[3] - beyond[0][3] - 0.1 * (beyond[0][0] - s[0]) for s in beyond]
    assert max(s[3] for s in beyond) > beyond[0][3] + 1e-3
    assert np.ptp(lifts) < 2e-4  # it rises by a tenth of its way beyond and comes down again
    assert ticks[-1][1] == "ok"  # and presses again


def test_a_round_tip_that_touches_the_edge_before_it_is_back_presses_on(panda):
    start, radius = panda.pose(PANDA), 0.0008
    x, z, foot = start[:3, 0], -start[:3, 2], start[:3, 3] + 0.002 * start[:3, 2]
    edges = []

    def world(tool, _):
        p, edge = tool[:3, 3], 0.045 - x @ (tool[:3, 3] - start[:3, 3])
        rim = np.sqrt(max(radius**2 - max(-edge, 0.0) ** 2, 0.0)) - radius  # the ball hangs so deep over the edge
        edges.append(edge)
        return SHARED["at"](p, 1e4 * max(0.0, rim - z @ (p - foot)) * (edge > -radius) * z)

    scene = replace(SHARED["scenes"](start, 0.03)["over an edge and back"], world=world)
    pressed = [z @ tick.wrench[3:] for tick in in_scene(panda, PANDA, scene, 900, starts=0.6, delay=0.012, lags=True)]
    back = np.flatnonzero(np.array(edges) < 0.0)[-1] + 1
    assert 700 < back < 880
    assert 2.0 < pressed[back - 3] < 4.0 < pressed[back]  # it is touched before
    assert min(pressed[back:]) > 4.5


@pytest.mark.parametrize("tilt", repeats([-5.0, 5.0], [-5.0]))
def test_a_tool_that_comes_back_over_another_part_of_the_edge_approaches(panda, tilt):
    """There the surface is 4 mm higher or lower than declared: a normal 5 deg off, 47 mm along the edge."""
    start, k = panda.pose(PANDA), 1e4
    x, y, z = start[:3, 0], start[:3, 1], -start[:3, 2]
    foot, normal = start[:3, 3] - 0.002 * z, iq.exp([*np.deg2rad(tilt) * x, 0, 0, 0])[:3, :3] @ z

    def extent(p):
        return 0.02 - x @ (p - start[:3, 3])

    def contact_at(tool):
        return iq.contacts.surface_contact(tool[:3, 3], implicit=lambda p: z @ (p - foot), extent=extent)

    def at(t):  # 1 s to touch, 40 mm along x, 47 mm along y, back along x, in 1 s each
        there = [np.interp(t, [1, 2, 3, 4], [0, 0.04, 0.04, 0.0]), np.interp(t, [2, 3], [0, 0.047])]
        return start[:3, 3] + there[0] * x + there[1] * y

    def world(tool, _):
        p, depth = tool[:3, 3], max(0.0, -normal @ (tool[:3, 3] - foot))
        return SHARED["at"](p, k * depth * normal * (extent(p) > 0.0))

    def path(t):
        target, ahead = start.copy(), np.zeros(6)
        target[:3, 3], ahead[3:] = at(t), (at(t + DT) - at(t)) / DT
        return target, ahead

    scene = SHARED["scenes"](start, 0.03)["over an edge and back"]
    options = {"told": contact_at, "wanted": [2.0], "options": {"max_force": np.inf}, "path": path, "world": world}
    ticks = list(in_scene(panda, PANDA, replace(scene, **options), 3000 if tilt > 0.0 else 1400))
    assert max(tick.force for tick in ticks) < 4.0
    assert ticks[-1].solution.status == "ok"
    assert ticks[-1].force == pytest.approx(2.0, rel=0.1)


def test_two_contacts_are_pressed_and_the_loss_of_one_is_reported(panda):
    scene, random = SHARED["scenes"](panda.pose(PANDA), 0.03)["corner, two contacts"], np.random.default_rng(1)

    def without_wall(k, _, reading):
        reading[3] = reading[3] if k < 600 else random.normal(0.0, 0.1)  # x of the tool and of the wall
        return reading

    ticks = list(in_scene(panda, PANDA, scene, 900, rests=True, change=without_wall))
    presses, statuses = [t.solution.intensities[:2] for t in ticks], [t.solution.status for t in ticks]
    aside = [np.linalg.norm((panda.pose(t.q) - t.tool)[:2, 3]) / DT for t in ticks]
    np.testing.assert_allclose(np.mean(presses[500:600], axis=0), [5.0, 3.0], rtol=0.02)
    assert set(statuses[500:600]) == {"ok"}
    assert set(statuses[650:]) == {"lost"}
    assert max(aside[650:]) < 0.02 * 1.01  # no faster than approach_speed
    np.testing.assert_allclose(np.mean(presses[700:], axis=0)[0], 5.0, rtol=0.05)  # the floor is not pressed harder


@pytest.mark.cases(3)
@pytest.mark.parametrize("since", [0.6, 1.2])  # one of them is felt, both are
@pytest.mark.parametrize("name", ["dead", "order", "sign"])
def test_a_fault_in_two_contacts_stops_both_pushes(panda, name, since):
    make, status, _ = FAULTS[name]
    scene, fault = SHARED["scenes"](panda.pose(PANDA), 0.03)["corner, two contacts"], make()

    def change(k, tool, reading):
        return fault(reading, tool[:3, :3].T @ UP) if k * DT >= since else reading

    ticks = list(in_scene(panda, PANDA, scene, round((since + 0.4) / DT), rests=True, change=change))
    assert ticks[-1].solution.status == status
    assert max(tick.force for tick in ticks) < 2.0 * np.hypot(5.0, 3.0)
    assert ticks[-1].force == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_friction_at_one_contact_is_no_tension_of_the_other(panda, sign):
    """Friction of 0.5 on the way to the wall looks like its contact, and reverses when the tool leaves."""
    scene, last, reports = SHARED["scenes"](panda.pose(PANDA), 0.03)["corner, two contacts"], panda.pose(PANDA), []

    def rubbing(tool, twist):
        nonlocal last
        wrench, way = scene.world(tool, twist), (tool - last)[:3, 3] * [1.0, 1.0, 0.0]
        last, rubs = tool, -0.5 * wrench[5] * way / max(np.linalg.norm(way), 2e-3 * DT)  # and sticks below 2 mm/s
        return sign * (wrench + np.concatenate((np.cross(tool[:3, 3], rubs), rubs)))

    for tick in in_scene(panda, PANDA, replace(scene, world=rubbing), 800, rests=True):
        reports.append(tick.report)
        if sign < 0.0 and "the contact pulls" in tick.solution.reason:
            return
    assert sign > 0.0
    assert reports[-1][0] == "ok", reports[-1]
    assert {status for status, _ in reports} <= {"lost", "ok", "degraded"}
    np.testing.assert_allclose(tick.solution.intensities[:2], [5.0, 3.0], atol=1.5)  # friction damps the wall's press


def test_two_contacts_that_press_on_one_line_are_refused():
    floor = iq.point_contact([0.4, 0.0, 0.1], UP)
    with pytest.raises(iq.BadInput, match=r"second: found a point and a point with 2 wrenches of rank 1"):
        iq.contacts.two_contacts(floor, iq.point_contact([0.4, 0.0, 0.3], -UP))
    ends = iq.contacts.two_contacts(floor, iq.point_contact([0.5, 0.0, 0.1], -UP))
    assert ends.kind.out is None  # pressed from both sides: no way out
    bottom = iq.contacts.two_contacts(iq.contacts.peg_in_hole([0.4, 0.0, 0.1], -UP), floor)
    assert (bottom.freedoms.shape, bottom.kind.presses) == ((6, 1), 1)
    np.testing.assert_allclose(bottom.constraints[:, 0], floor.constraints[:, 0], atol=1e-12)


def test_a_door_that_five_joints_cannot_yield_to_is_an_overload(so101):
    scene = SHARED["scenes"](so101.pose(SO101), 0.015)["door, hinge 10 mm off"]
    for tick in in_scene(so101, SO101, scene, 900, exact="position"):
        if tick.solution.status not in ("ok", "degraded"):
            break
    assert tick.solution.status == "overload"
    assert "N m of 1" in tick.solution.reason  # the tip yields, the handle turns in the hand
    assert tick.force < 4.0


def test_a_rotation_that_five_joints_cannot_do_is_not_reported_as_no_motion(so101):
    scene = SHARED["scenes"](so101.pose(SO101), 0.015)["hard, 1e5 N/m"]
    ticks = list(in_scene(so101, SO101, scene, 800, starts=2.0, exact="position"))
    # Damping of the rotation takes up to a tenth of what the joints could do.
    assert {tick.solution.status for tick in ticks[400:]} == {"ok", "limited"}


@pytest.mark.parametrize("name", ["screw, 63 mm a turn", "door, hinge 10 mm off", "peg, hole tilted 2 deg"])
def test_five_joints_that_cannot_follow_a_screw_report_it_before_they_press(so101, name):
    scene = SHARED["scenes"](so101.pose(SO101), 0.015)[name]
    count = 700 if "screw" in name else 400 if "door" in name else 200
    ticks = list(in_scene(so101, SO101, scene, count, starts=0.5, exact="position"))
    statuses = [tick.solution.status for tick in ticks]
    if "peg" in name:  # it slides in a plane in which the arm can move it
        assert set(statuses) == {"ok"}
        return
    warned = [k for k, t in enumerate(ticks) if "5 joints cannot move the tool along this contact" in t.solution.reason]
    first = warned[0]
    assert first < 150  # 0.1 s after the motion begins
    assert statuses[first] == "degraded"
    assert max(tick.force for tick in ticks[:first]) < 0.1
    assert max(tick.moment for tick in ticks[:first]) < 0.01
    assert {tick.solution.status for tick in ticks if tick.moment > 0.3} <= {"degraded", "overload"}
    if "screw" in name:
        assert set(statuses[:450]) == {"ok", "degraded"}
        assert max(tick.force for tick in ticks[:450]) < 4.0  # no integral is wound up


@pytest.fixture(scope="module")
def example():
    """The names of examples/22, run for no scene."""
    pytest.importorskip("mujoco")
    script = Path(__file__).parents[2] / "examples" / "22_contact_scenes.py"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", [str(script), "--scene", "none of them"])
        patch.syspath_prepend(str(script.parent))
        return runpy.run_path(str(script))


def test_an_impact_on_metal_of_a_compliant_arm_with_lag_is_no_fault(panda, example):
    """The mass of the tip shows 1e6 N/m of the metal at first, then the arm in series 2e5 N/m."""
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


def test_a_stiffness_declared_without_the_arm_in_series_is_corrected(example):
    robot, q = iq.load_robot("panda"), ARMS["panda"]
    scenes, start = SHARED["scenes"](robot.pose(q), 0.03), lowered(robot, q, 0.001)
    declared, undeclared = (
        example["run"]("panda", robot, start, scenes[s], "mujoco", 3.0) for s in ("1e6 N/m, told", "1e6 N/m")
    )
    _, rms, most, touch, after, *_ = declared
    assert (rms < 0.7, most < 1.0) == (True, True), declared
    assert (touch, after) == pytest.approx(undeclared[3:5])  # it was touched four seconds later


def test_a_stiff_door_declared_wrong_is_no_overload_with_compliant_drives(panda, example):
    start = panda.pose(PANDA)
    x, z, post = start[:3, 0], -start[:3, 2], start[:3, 3] + 0.3 * start[:3, 1]
    hinge, declared = iq.revolute(z, post), iq.contacts.hinge(post + 0.01 * x, z)
    scene = SHARED["grip"](start, hinge, lambda _: declared, SHARED["along"](start, 0.3 * hinge), stiffness=1e6)
    run = example["run"]("panda", panda, PANDA, scene, "mujoco", 5.5)
    assert run[2] < 12.0, run
    assert "overload" not in run[-1]
