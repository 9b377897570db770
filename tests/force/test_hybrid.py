"""Force along S*, motion along S, and neither in the other's way: closed loops on a plane that pushes back."""

import numpy as np
import pytest
from support.plane import DT, PANDA, SO101, UP, Bench, carried, circle, force_at, gantry, pen, tip
from support.random_systems import motion
from support.wrist import wrist

import invariantqp as iq


def rms_error(solutions, wanted):
    return float(np.sqrt(np.mean([(s.intensities[0] / wanted - 1.0) ** 2 for s in solutions])))


@pytest.mark.parametrize("rule", [{}, {"h": 0.3}, {"metric": np.ones(6)}, {"complement": np.eye(6)[:, [5]]}])
def test_a_pen_draws_a_circle_with_five_newtons(panda, rule):
    bench = Bench(panda, PANDA, pen(**rule))
    path = circle(bench.start, 0.03, 2.0)
    settled = bench.run(1400, path)[700:]
    assert rms_error(settled, 5.0) < 0.005
    off = bench.robot.pose(bench.q)[:2, 3] - path(1.4)[0][:2, 3]
    assert np.linalg.norm(off) < 5e-5
    assert {s.status for s in settled} == {"ok"}


@pytest.mark.parametrize("rule", [{}, {"h": 0.5}])
def test_five_joints_draw_with_an_exact_position(so101, rule):
    bench = Bench(so101, SO101, pen(2.0, compliance=5e-3, **rule), stiffness=2e3, dt=5e-3, exact="position")
    path = circle(bench.start, 0.02, 3.0)
    settled = bench.run(600, path)[200:]
    assert rms_error(settled, 2.0) < 0.02
    off = bench.robot.pose(bench.q)[:2, 3] - path(3.0)[0][:2, 3]
    assert np.linalg.norm(off) < 5e-4


def test_five_joints_keep_the_force_without_any_exact_demand(so101):
    errors = {}
    for first in (True, False):
        task = pen(2.0, compliance=5e-3)
        bench = Bench(so101, SO101, task, stiffness=2e3, dt=5e-3, force_first=first)
        errors[first] = rms_error(bench.run(500, circle(bench.start, 0.02, 3.0))[200:], 2.0)
    assert errors[True] < 0.01, errors
    assert errors[True] <= errors[False], errors


def test_a_tilted_face_lies_down_and_is_wiped_along(panda):
    def sole(tool):
        return iq.contacts.face_contact(tool[:3, 3], UP)

    tilted = PANDA + np.array([0, 0, 0, 0, 0, 0.03, 0])
    bench = Bench(panda, tilted, iq.HybridTask(sole, [20.0, 0.0, 0.0]), half=0.04, stiffness=5e3)
    path = circle(bench.start, 0.04, 2.0)
    solutions = bench.run(2000, path)
    assert rms_error(solutions[1200:], 20.0) < 0.02
    normal = bench.robot.pose(bench.q)[:3, 2]
    assert np.arccos(np.clip(-normal @ UP, -1, 1)) < 1e-3
    assert np.arccos(np.clip(-bench.start[:3, 2] @ UP, -1, 1)) > 0.02  # it had to be laid down
    assert np.abs([s.intensities[1:] for s in solutions[1200:]]).max() < 0.06


def test_a_door_is_moved_along_its_screw_and_pushed_no_other_way(panda):
    start = panda.pose(PANDA)
    post = start[:3, 3] + [0.0, 0.6, 0.0]
    grip = iq.inverse(start)[:3, :3] @ (post - start[:3, 3])  # the hinge is compliant
    task = iq.HybridTask(iq.contacts.hinge(post, UP), np.zeros(5), grip=grip)
    hinge, angles = iq.revolute(UP, post), []

    def world(pose):
        """The door holds the tool by a spring to the nearest pose that the hinge allows."""
        angles.append(np.arctan2(*(pose[:3, :3] @ start[:3, :3].T)[[1, 0], [0, 0]]))
        off = iq.log(pose @ iq.inverse(iq.exp(angles[-1] * hinge) @ start))
        local = iq.adjoint(iq.inverse(task.contact.pose)) @ off
        return iq.coadjoint(task.contact.pose) @ (np.array([200, 200, 200, 1e4, 1e4, 1e4]) * local)

    bench = Bench(panda, PANDA, task, world=world)
    solutions = bench.run(500, lambda t: (iq.exp(0.2 * t * hinge) @ start, 0.2 * hinge))
    assert angles[-1] == pytest.approx(0.1, abs=1e-3)
    assert np.abs(solutions[-1].intensities).max() < 0.5
    with pytest.raises(iq.BadInput, match="a hinge and a retreat"):
        iq.HybridTask(iq.contacts.hinge(post, UP), np.zeros(5), on_overload="retreat")


def test_a_pen_follows_a_sphere(panda):
    start = panda.pose(PANDA)
    centre, radius = start[:3, 3] - [0.0, 0.0, 0.3], 0.3

    def ball(tool):
        return iq.contacts.surface_contact(tool[:3, 3], normal=lambda p: p - centre)

    def world(tool):
        away, distance = tool[:3, 3] - centre, np.linalg.norm(tool[:3, 3] - centre)
        return force_at(tool[:3, 3], -1e4 * max(0.0, radius - distance) * away / distance)

    bench = Bench(panda, PANDA, pen(contact=ball), world=world)
    presses = [s.intensities[0] for s in bench.run(1500, circle(start, 0.05, 2.0))]
    np.testing.assert_allclose(presses[600:], 5.0, atol=0.25)
    assert panda.pose(bench.q)[2, 3] < start[2, 3] - 0.005  # it has gone down the side


@pytest.mark.parametrize(
    ("share", "settles", "overshoots"), [(0.5, True, False), (1.5, True, True), (2.1, False, True)]
)
def test_the_stability_limit_of_a_fixed_compliance(share, settles, overshoots):
    """dt c k: no overshoot below 1, unstable above 2."""
    stiffness, dt = 1e4, 5e-3
    task = pen(compliance=share / (dt * stiffness))
    bench = Bench(gantry(), np.zeros(6), task, depth=4e-4, dt=dt, stiffness=stiffness, joint_metric=np.ones(6))
    presses = np.array([s.intensities[0] for s in bench.run(60)])
    assert (abs(presses[-1] - 5.0) < 1e-6) == settles
    assert (presses.max() > 5.0 + 1e-9) == overshoots


def test_limits_slow_the_path_down_before_they_change_the_force(panda):
    errors = {}
    for first in (True, False):
        bench = Bench(panda, PANDA, pen(), depth=5e-4, force_first=first)
        solutions = bench.run(300, circle(bench.start, 0.3, 0.5))  # 3.8 m/s: far beyond the joints
        assert any(s.velocity_solution.active for s in solutions)
        assert max(np.abs(s.velocity / panda.velocity_limit).max() for s in solutions) <= 1.0 + 1e-12
        across = [s.contact.constraints.T @ (s.J @ s.velocity - s.force) for s in solutions]
        assert (np.abs(across).max() < 1e-6) == first  # what is left is the bend of the way within a tick
        errors[first] = np.median([abs(s.intensities[0] - 5.0) for s in solutions[100:]])
    assert errors[True] < 2.0 < 4.0 < errors[False]


@pytest.mark.parametrize("rule", [{}, {"h": 0.3}, {"metric": np.arange(1.0, 7.0)}])
def test_the_solution_agrees_with_projectors_in_the_base_frame(panda, rule):
    loop = iq.HybridController(
        panda, pen(slide_speed=np.inf, **{"compliance": 1e-3, **rule}), dt=DT, order="moment first", gain=10.0
    )
    felt, ahead = np.array([0.1, 2.0, -0.3, 0.5, -0.2, -4.0]), np.array([0.1, -0.2, 0.3, 0.01, 0.02, 0.03])
    target = iq.exp([0.02, 0.01, -0.02, 0.004, -0.003, 0.002]) @ panda.pose(PANDA)
    solution = loop.step(PANDA, target, felt, ahead)
    contact = tip(panda.pose(PANDA))
    split = iq.dual_projectors(contact.freedoms, **carried(rule, contact))
    A, B = iq.adjoint(contact.pose), iq.coadjoint(contact.pose)
    C = A @ np.diag(np.repeat([1e-3 / 0.05**2, 1e-3], 3)) @ A.T
    s = 10.0 * iq.log(target @ iq.inverse(panda.pose(PANDA))) + ahead
    error = split.force @ (B @ [0, 0, 0, 0, 0, 5.0] - felt)
    np.testing.assert_allclose(solution.motion, split.motion @ s, atol=1e-12)
    np.testing.assert_allclose(solution.error, error, atol=1e-12)
    np.testing.assert_allclose(solution.force, (np.eye(6) - split.motion) @ C @ error, atol=1e-12)
    np.testing.assert_allclose(contact.constraints @ solution.intensities, split.force @ felt, atol=1e-12)
    np.testing.assert_allclose(solution.J @ solution.velocity, solution.twist, atol=1e-3)  # damped in the first tick


PLACE = np.array([0.5, 0.1, 0.4])
KINDS = {
    "point": (iq.point_contact(PLACE, [0, 0.3, 1]), [5.0]),
    "rolling point": (iq.point_contact(PLACE, [0, 0.3, 1], slip=False), [5.0, 1.0, 0.0]),
    "line": (iq.contacts.line_contact(PLACE, [1, 0, 0], [0, 0.3, 1]), [5.0, 0.1]),
    "face": (iq.contacts.face_contact(PLACE, [0, 0.3, 1]), [5.0, 0.1, 0.2]),
    "sticking face": (
        iq.contacts.face_contact(PLACE, [0, 0.3, 1], slip=False),
        iq.Wrench(moment=[0, 1, 2], force=[3, 4, 5]),
    ),
    "peg": (iq.contacts.peg_in_hole(PLACE, [0, 0.3, -1]), np.zeros(4)),
    "hinge": (iq.contacts.hinge(PLACE, [0, 0.3, 1], 0.1), np.zeros(5)),
}
TENSOR = np.diag([0.4, 0.4, 0.2, 1e-3, 2e-3, 1e-3]) + 1e-5


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("rule", ["compliance", "h", "metric", "complement"])
def test_a_task_in_other_frames_is_the_same_task(panda, name, rule):
    rng = np.random.default_rng(len(name))
    contact, wrench = KINDS[name]
    n = contact.constraints.shape[1]
    given = {"h": 0.3, "metric": np.arange(1.0, 7.0), "complement": rng.normal(size=(6, n))}.get(rule)
    made = {"compliance": TENSOR, **({} if given is None else {rule: given})}
    if rule == "h" and name in ("line", "face"):
        with pytest.raises(iq.NoProjectors):
            iq.HybridTask(contact, wrench, **made)
        return
    task, X, Y = iq.HybridTask(contact, wrench, **made), motion(rng, 0.3), motion(rng, 0.3)
    felt, target = rng.normal(size=6), iq.exp(0.01 * rng.normal(size=6)) @ panda.pose(PANDA)
    plain = iq.HybridController(panda, task, dt=DT, order="moment first", gain=5.0).step(PANDA, target, felt)
    other = iq.HybridController(panda.with_tool(Y), task.relabelled(X, Y), dt=DT, order="moment first", gain=5.0)
    moved = other.step(PANDA, target @ Y, felt)
    np.testing.assert_allclose(moved.velocity, plain.velocity, atol=1e-9 * (1 + np.abs(plain.velocity).max()))
    np.testing.assert_allclose(moved.error, plain.error, atol=1e-10)
    np.testing.assert_allclose(moved.wanted, plain.wanted, atol=1e-10)
    np.testing.assert_allclose(moved.contact.point, plain.contact.point, atol=1e-12)


def test_torques_exert_the_desired_wrench(panda):
    solution = Bench(panda, PANDA, pen()).tick()
    p = panda.pose(PANDA)[:3, 3]
    np.testing.assert_allclose(solution.wanted, [*np.cross(p, -5.0 * UP), 0.0, 0.0, -5.0], atol=1e-12)
    np.testing.assert_allclose(solution.torque, panda.jacobian(PANDA).T @ solution.wanted, atol=1e-12)


def test_a_wrench_in_the_contacts_frame_is_the_same_as_its_parts(panda):
    by_parts = Bench(panda, PANDA, pen(5.0)).tick()
    whole = Bench(panda, PANDA, iq.HybridTask(tip, iq.Wrench(moment=[0.1, 0.2, 0.3], force=[1.0, 2.0, 5.0]))).tick()
    np.testing.assert_allclose(whole.velocity, by_parts.velocity, atol=1e-12)


def test_the_contact_of_a_tick_may_be_given(panda):
    solution = iq.HybridController(panda, pen(), dt=DT, order="moment first").step(
        PANDA, panda.pose(PANDA), np.zeros(6), contact=iq.point_contact(panda.pose(PANDA)[:3, 3], [0, 1, 1])
    )
    np.testing.assert_allclose(
        solution.force[3:] / np.linalg.norm(solution.force[3:]), -np.sqrt([0, 0.5, 0.5]), atol=1e-12
    )
    everything = iq.contacts.face_contact([0, 0, 0], UP, slip=False)
    with pytest.raises(iq.BadInput, match="found 1 number;"):
        iq.HybridController(panda, pen(), dt=DT, order="moment first").step(
            PANDA, panda.pose(PANDA), np.zeros(6), contact=everything
        )


def test_a_normal_that_flips_while_it_is_pressed_is_refused_before_anything_moves(panda):
    inward = iq.point_contact([0.4, 0.0, 0.4], -UP)
    bench = Bench(panda, PANDA, pen(), depth=5e-4)
    bench.run(200)
    with pytest.raises(iq.BadInput, match=r"^contact: found a normal that turned by 180 degrees"):
        bench.tick(contact=inward)
    assert bench.tick().intensities[0] == pytest.approx(5.0, abs=0.1)
    bench.loop.reset()
    assert bench.tick(contact=inward).status


def test_a_wrist_sensor_is_read_where_it_sits(panda):
    """Weight, mount and low-pass in the loop: the press that is felt at the tip is the one wanted."""
    rng = np.random.default_rng(0)
    mount = motion(rng, 0.1)
    sensor = wrist(mount=mount, mass=0.7, centre=[0.0, 0.01, 0.06], cutoff=50.0, bias=np.arange(6.0))
    bench = Bench(panda, PANDA, pen(), sensor=sensor)
    for _ in range(2000):
        pose = panda.pose(bench.q)
        reading = sensor.tare(pose) - iq.coadjoint(iq.inverse(pose @ mount)) @ bench.wrench()
        solution = bench.loop.step(bench.q, bench.start, reading)
        bench.q = bench.q + DT * solution.velocity
    assert -bench.wrench()[5] == pytest.approx(5.0, rel=1e-3)
    np.testing.assert_allclose(solution.wrench, bench.wrench(), atol=1e-2)


REFUSED = {
    "wrench": {"wrench": np.full(6, np.nan)},
    "target": {"target": np.full((4, 4), np.nan)},
    "q": {"q": np.full(7, np.nan)},
    "feedforward": {"feedforward": np.full(6, np.inf)},
    "velocity": {"velocity": np.full(7, np.nan)},
}


@pytest.mark.parametrize("argument", REFUSED)
def test_a_refused_tick_leaves_filter_and_monitor_unchanged(panda, argument):
    sensor = wrist(cutoff=5.0, reads="action", gravity=(0, 0, 0))

    def readings(k):
        return np.array([0.0, 0.1, 0.0, 0.2 * k, 0.0, 1.0])

    hurt, fresh = (iq.HybridController(panda, pen(), dt=DT, sensor=sensor) for _ in range(2))
    good = {"q": PANDA, "target": panda.pose(PANDA), "feedforward": np.zeros(6), "velocity": np.zeros(7)}
    for k in range(4):
        with pytest.raises(iq.BadInput, match=f"^{argument}: found "):
            hurt.step(**{**good, "wrench": readings(k), **REFUSED[argument]})
        a, b = (loop.step(**good, wrench=readings(k)) for loop in (hurt, fresh))
        np.testing.assert_array_equal(a.velocity, b.velocity)
        np.testing.assert_array_equal(a.wrench, b.wrench)
        assert (a.status, a.reason) == (b.status, b.reason)


BAD = {
    "two rules": (lambda: pen(h=0.3, metric=np.ones(6)), "h"),
    "wrench": (lambda: iq.HybridTask(tip(np.eye(4)), [1.0, 2.0]), "wrench"),
    "wrench nan": (lambda: pen(np.nan), "wrench"),
    "no list": (lambda: iq.HybridTask(tip(np.eye(4)), 5.0), "wrench"),
    "pull": (lambda: iq.HybridTask(tip(np.eye(4)), iq.Wrench(moment=[0, 0, 0], force=[0, 0, -5.0])), "wrench"),
    "compliance": (lambda: pen(compliance=-1e-3), "compliance"),
    "compliance matrix": (lambda: pen(compliance=-np.eye(6)), "compliance"),
    "size": (lambda: pen(size=0.0), "size"),
    "speed": (lambda: pen(approach_speed=0.0), "approach_speed"),
    "overload": (lambda: pen(max_force=-1.0), "max_force"),
    "overload by what is wanted": (lambda: pen(max_force=3.0), "max_force"),
    "the same of a wrench": (
        lambda: iq.HybridTask(tip(np.eye(4)), iq.Wrench(moment=[0, 0, 0], force=[0, 0, 5.0]), max_force=5.0),
        "max_force",
    ),
    "nan overload": (lambda: pen(max_moment=np.nan), "max_moment"),
    "loss": (lambda: pen(on_loss="pray"), "on_loss"),
    "on overload": (lambda: pen(on_overload="continue"), "on_overload"),
    "time": (lambda: pen(lost_after=-0.1), "lost_after"),
    "threshold": (lambda: pen(lost_below=np.nan), "lost_below"),
    "contact": (lambda: iq.HybridTask("table", [1.0]), "contact"),
}


@pytest.mark.parametrize("case", BAD)
def test_tasks_that_cannot_be(case):
    make, argument = BAD[case]
    with pytest.raises(iq.BadInput, match=r": found .*; expected ") as caught:
        make()
    assert caught.value.argument == argument


def test_a_pitch_that_no_contact_of_this_kind_has_is_refused_when_the_task_is_made(panda):
    with pytest.raises(iq.NoProjectors, match=r"type IIC.*No h works"):
        iq.HybridTask(iq.contacts.face_contact([0, 0, 0], UP), [5.0, 0.0, 0.0], h=0.3)
    by_function = iq.HybridTask(lambda tool: iq.contacts.face_contact(tool[:3, 3], UP), [5.0, 0.0, 0.0], h=0.3)
    with pytest.raises(iq.NoProjectors):
        iq.HybridController(panda, by_function, dt=DT, order="moment first")
    with pytest.raises(iq.BadInput, match="a function that gave"):
        iq.HybridController(panda, iq.HybridTask(lambda tool: tool, [5.0]), dt=DT, order="moment first")


def test_a_path_held_up_by_limits_is_not_ok():
    """A pen is drawn against the end of a slide, under its force."""
    arm = gantry()
    short = iq.robots.Chain(arm.screws, arm.home, position_lower=-1.0, position_upper=[0.02, 1, 1, 1, 1, 1])
    bench = Bench(short, np.zeros(6), pen(), depth=5e-4, dt=2e-3)
    reports = []
    for k in range(1500):
        target, ahead = bench.start.copy(), np.array([0.0, 0.0, 0.0, 0.03, 0.0, 0.0])
        target[0, 3] += 0.03 * 2e-3 * k
        reports.append(bench.tick(target, ahead))
    assert {s.status for s in reports[:300]} == {"ok"}
    assert reports[-1].intensities[0] == pytest.approx(5.0, rel=0.01)
    assert reports[-1].status == "limited"
    assert "at the limits of joint 0" in reports[-1].reason


def test_duplicate_rows_do_not_stop_a_tool_at_rest():
    bench = Bench(iq.load_robot("so101"), SO101, pen(stiffness=1e4), dt=2e-3, depth=-1e-4, exact="position")
    target = bench.start.copy()
    target[:3, 3] += [0.002, -0.003, 0.0]
    solutions = bench.run(3000, lambda t: (target, None))
    assert not any("cannot keep the direction" in s.reason for s in solutions[100:])
    assert bench.wrench()[5] == pytest.approx(-5.0, rel=1e-11)
