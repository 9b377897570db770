"""What an arm must not touch: kept in loops, by coal's distances; named, listed, led apart."""

import pickle
import sys
import warnings
from copy import deepcopy

import numpy as np
import pytest
from scipy.optimize import linprog
from support.arms import ready
from support.loops import drive

import invariantqp as iq
from invariantqp import engine
from invariantqp.control.loop_limits import box_of, limit_fields, loop_of
from invariantqp.engine import law
from invariantqp.geometry.shapes import Core
from invariantqp.limits import Box, Capsule, Clearance, HalfSpace, LimitRows, OtherArm, Sphere

coal = pytest.importorskip("coal")
DT = 0.002
MOST_ROWS = 16  # of a tick
UP = iq.transform(translation=[0.0, 0.0, 0.1])
READY = ready("panda")
TABLE = HalfSpace([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], name="table")
HAND = {
    "panda_link5": [Capsule([0, 0, -0.31], [0, 0, -0.21], 0.06)],
    "panda_hand": [
        Capsule([0, -0.06, 0.03], [0, 0.06, 0.03], 0.04),
        Capsule([0, -0.04, 0.085], [0, 0.04, 0.085], 0.025),
    ],
}


LINKS = {  # about those of a UR5, for states in which tenths of a millimetre count
    "base_link": [Capsule([-2e-05, 0.00072, 0.00841], [0.00168, -0.0362, 0.00916], 0.07439)],
    "shoulder_link": [Capsule([-6e-05, 0.00416, -0.00231], [1e-05, 0.00332, 0.00017], 0.0888)],
    "upper_arm_link": [Capsule([-0.00032, -0.0053, 0.00066], [-0.00085, -0.00493, 0.42496], 0.08442)],
    "forearm_link": [Capsule([0.00011, 0.02345, -0.00012], [4e-05, 0.00276, 0.38925], 0.06624)],
    "wrist_1_link": [Capsule([-8e-05, 0.09023, -0.00808], [-0.00011, 0.09014, 0.0075], 0.05689)],
    "wrist_2_link": [Capsule([-8e-05, 0.01113, 0.08996], [-0.0003, -0.00952, 0.09115], 0.05592)],
    "wrist_3_link": [Capsule([4e-05, 0.06126, -0.00027], [-0.00012, 0.06158, 0.00319], 0.04005)],
    "ee_link": [Box(iq.transform(translation=[-0.01, 0.0, 0.0]), [0.01, 0.01, 0.01])],
}


def by_coal(clearance, q):
    """The least distance of the pairs whose distance some joint changes."""
    placed = [place for _, _, place in clearance.shapes(q)]
    made = [(of_coal(p), coal.Transform3s(np.ascontiguousarray(p.pose[:3, :3]), p.pose[:3, 3].copy())) for p in placed]
    known = clearance._distances(q)
    return min(
        coal.distance(*made[i], *made[j], coal.DistanceRequest(), coal.DistanceResult())
        for (i, j), d in zip(clearance._shape_pairs, known, strict=True)
        if np.isfinite(d)
    )


def of_coal(placed):
    if placed.core is Core.SEGMENT:
        length = 2.0 * float(placed.half[2])
        return coal.Capsule(placed.radius, length) if length > 0.0 else coal.Sphere(placed.radius)
    return coal.Box(*(2.0 * placed.half)) if placed.core is Core.BOX else coal.Halfspace(np.array([0.0, 0, 1]), 0.0)


def below(robot, q, depth):
    target = robot.pose(q)
    target[2, 3] -= depth
    return target


@pytest.mark.parametrize("acceleration", [None, 10.0])
def test_the_engine_asks_a_clearance_without_python(panda, acceleration):
    box = Box(iq.transform(translation=[0.6, 0.0, 0.2]), [0.1, 0.1, 0.1], name="box")
    loop = iq.Controller(panda, dt=DT, acceleration_limit=acceleration, limits=[Clearance(panda, HAND, [TABLE, box])])
    q, target = READY, below(panda, READY, 0.6)
    loop.step(q, target)
    called, rows = set(), 0

    def note(frame, event, _):
        if event == "call" and frame.f_code.co_filename.endswith("clearance.py"):
            called.add(frame.f_code.co_name)

    for i in range(1000):
        box.move(iq.transform(translation=[0.0, 1e-4 * i, 0.0]))
        sys.setprofile(note)
        try:
            solution = loop.step(q, target)
        finally:
            sys.setprofile(None)
        rows += len(solution.row_names) > 0
        q = q + DT * solution.velocity
    assert rows > 100
    assert called == {"update", "_updated"}  # it is told where obstacles are


def test_rows_of_users_and_of_clearances_keep_their_order_and_names(panda):
    def narrow(q):
        return LimitRows(np.eye(7)[:2], [-1.0, -1.0], [1.0, 1.0], ["first", "second"])

    clearance = Clearance(panda, HAND, [TABLE])
    fixed = LimitRows([np.ones(7)], [-9.0], [9.0], "sum")
    loops = [
        iq.Controller(panda, dt=DT, limits=[fixed, clearance, narrow]),
        iq.Controller(panda, dt=DT, limits=[narrow, fixed]),
    ]
    q, target, seen = READY, below(panda, READY, 0.6), 0
    for _ in range(1000):
        solution = loops[0].step(q, target)
        names, more = solution.row_names, loops[1].step(q, target, limits=[clearance]).row_names
        assert names[0] == "sum"
        assert names[-2:] == ("first", "second")
        assert more[:3] == ("first", "second", "sum")
        if len(names) > 3:
            seen += 1
            assert all(name.startswith("clearance: panda_") for name in (*names[1:-2], *more[3:]))
            again = pickle.loads(pickle.dumps(solution))
            assert again == solution
            assert again.row_names == names
        q = q + DT * solution.velocity
    assert seen > 100


def test_the_hand_stops_above_the_table_and_is_named(panda):
    limit = Clearance(panda, HAND, [TABLE])
    loop = iq.Controller(panda, dt=DT, limits=[limit])
    target = below(panda, READY, 0.8)
    run = drive(loop, READY, target, 600)
    q, solution = run.end
    assert 0.0199 < min(by_coal(limit, p) for p in run.q) < 0.0201
    assert solution.status == "limited"
    assert solution.reason.endswith("at the limits of clearance: panda_hand and table, 20.0 mm")
    assert limit.nearest[:2] == ("panda_hand", "table")
    assert str(limit.nearest) == "panda_hand and table, 20.0 mm"
    assert limit.at(q).distance == pytest.approx(by_coal(limit, q), abs=1e-9)
    without = iq.Controller(panda, dt=DT)
    assert limit.at(drive(without, READY, target, 600).q[-1]).distance < 0.0


@pytest.mark.cases(3)
@pytest.mark.parametrize(("options", "tolerance"), [
    ({"dt": 0.001}, 1e-4),
    ({"dt": 0.01}, 5e-4),
    ({"dt": 0.002, "acceleration_limit": 10.0}, 1e-4),
    ({"dt": 0.01, "acceleration_limit": 5.0}, 5e-4),
    ({"dt": 0.002, "acceleration_limit": [3.0, 5.0, 8.0, 20.0, 20.0, 20.0], "delay": 0.02}, 5e-4),
    # Of a late arm with one joint that stops at once 24 runs came as near as 19.1 mm.
    ({"dt": 0.002, "acceleration_limit": [3.0, 5.0, 8.0, 20.0, np.inf, 20.0], "delay": 0.02}, 1e-3),
    ({"dt": 0.002, "delay": 0.02}, 5e-4),
])  # fmt: skip
def test_the_distance_is_kept_while_targets_jump(ur5, options, tolerance):
    around = [Box(iq.transform(translation=[0.45, 0.0, 0.15]), [0.24, 0.4, 0.3], name="box"), TABLE]
    limit = Clearance(ur5, None, around, exclude=[("upper_arm_link", "table"), ("shoulder_link", "table")])
    loop = iq.Controller(ur5, limits=[limit], **options)
    rng = np.random.default_rng(3)
    q, x = np.array([1.2, -1.4, 1.6, -1.8, -1.57, 0.0]), np.zeros(6)
    late = [np.zeros(6)] * round(loop.delay / loop.dt)
    assert limit.at(q).distance > 0.02
    least, statuses = 9.0, set()
    hold = round((1.2 if "acceleration_limit" in options else 0.4) / loop.dt)
    for i in range((3 if "acceleration_limit" in options else 5) * hold):
        if i % hold == 0:
            target = ur5.pose(rng.uniform(-2.0, 2.0, 6))
        solution = loop.step(q, target)
        if "acceleration_limit" in options:
            assert (np.abs(solution.velocity - x) <= np.array(options["acceleration_limit"]) * loop.dt + 1e-9).all()
        x = solution.velocity
        near = limit.at(q) if late else limit.nearest  # ticks of a late arm look at where it will be
        least = min(least, near.distance)
        if i % 40 == 0:
            assert near.distance == pytest.approx(by_coal(limit, q), abs=2e-6)
        late.append(x)
        q = q + loop.dt * late.pop(0)
        statuses.add(str(solution.status))
    assert 0.02 - tolerance < least < 0.03
    assert not statuses & {"degraded", "held"}


def pushed(limit, robot, q, dt, direction):
    """The velocities of joints that go as far as they may in a direction: by the rows, and by those after it too."""
    kept, m = limit.for_loop(loop_of(robot, dt, 0.0)), len(q)
    C, lower, found = np.zeros((0, m)), np.zeros(0), []
    more = kept.rows(q, np.zeros(m))
    for _ in range(5):
        if more is not None:
            C, lower = np.vstack((C, more.C)), np.append(lower, more.lower)
        bounds = [(-fastest, fastest) for fastest in robot.velocity_limit]
        found.append(linprog(-direction, -C, -lower, bounds=bounds, method="highs-ds").x)
        more = kept.after(q, found[-1])
        if more is None:
            break
    return found[0], found[-1]


def test_the_distance_is_kept_at_the_end_of_a_tick(ur5):
    """All joints fast past an edge: a row that is linear where the tick begins does not see how the way turns."""
    box = Box(iq.transform(translation=[0.45, 0.0, 0.15]), [0.24, 0.4, 0.3], name="box")
    limit, dt, rng = Clearance(ur5, LINKS, [box]), 0.01, np.random.default_rng(0)
    q = np.array([0.2272, -0.9174, 2.4997, 1.3378, -1.3491, 4.2825])
    assert limit.at(q).distance > 0.0206
    tried = [pushed(limit, ur5, q, dt, rng.normal(size=6)) for _ in range(100)]
    ends = [[limit.at(q + dt * x).distance for x in two] for two in tried]
    assert np.min(ends, axis=0)[0] < 0.018
    assert np.min(ends, axis=0)[1] > 0.0197


def test_curvature_of_many_ticks_does_not_add_up(panda):
    """Of 20 mm a tick may leave 19.9: one that began at 19.95 is answered once more where it would end at 19.87."""
    limit, dt = Clearance(panda, HAND, [TABLE]), 0.01
    near, _ = drive(iq.Controller(panda, dt=DT, limits=[limit]), READY, below(panda, READY, 0.8), 400).end
    one_joint = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    slope = (limit.at(near + 1e-6 * one_joint).distance - limit.at(near - 1e-6 * one_joint).distance) / 2e-6
    q = near + (0.01995 - limit.at(near).distance) / slope * one_joint
    kept = limit.for_loop(loop_of(panda, dt, 0.0))
    kept.rows(q, np.zeros(7))
    small, large = -0.03e-3 / slope / dt * one_joint, -0.08e-3 / slope / dt * one_joint
    assert kept.after(q, small) is None
    rows = kept.after(q, large)
    assert (rows.C.dot(large) < rows.lower).any()


def test_distances_in_singular_states(panda):
    """A ball on the last axis's far side of a straight arm: to first order, no joint changes its distance."""
    straight = iq.robots.Chain(
        np.column_stack([iq.revolute((0, 1, 0), (0, 0, z)) for z in (0.0, 0.5)]), np.eye(4), velocity_limit=1.0
    )
    ball, other = Sphere([0, 0, 1.0], 0.05), Sphere([0, 0, 1.3], 0.05, name="above")
    limit = Clearance(straight, {"joint2": [ball]}, [other])
    for q, d in (([0.0, 0.0], 0.2), ([1e-9, 0.0], 0.2), ([np.pi, 0.0], 2.2), ([0.0, np.pi], 1.2)):
        assert limit.at(q).distance == pytest.approx(d, abs=1e-9)
        assert limit.distances(q)["joint2", "above"] == pytest.approx(d, abs=1e-9)
    near = Clearance(straight, {"joint2": [ball]}, [Sphere([0, 0, 1.05], 0.05, name="above")])
    assert near.blocked([0.0, 0.0]) == "joint2 and above are nearer than 20.0 mm"
    with pytest.warns(UserWarning, match="apart from table"):
        still = Clearance(panda, {"panda_link1": [Capsule([0, 0, -0.3], [0, 0, 0], 0.06)]}, [TABLE])
    for q in (np.zeros(7), READY):
        assert still.at(q).distance == np.inf  # turning about its own axis, it comes no nearer


def test_a_row_is_the_gradient_of_coals_distance(panda):
    limit = Clearance(panda, HAND, [TABLE, Sphere([0.5, 0.3, 0.4], 0.05)])
    rng = np.random.default_rng(0)
    checked = 0
    while checked < 10:
        q = READY + rng.uniform(-0.5, 0.5, 7)
        C, lower, _, of_pair, _ = limit._engine.rows(q, None, limit._at_rate(1.0))
        d = limit._engine.last_distances
        k = int(np.argmin(d))
        rows = np.flatnonzero(np.array(of_pair) == k)
        if not len(rows) or d[k] < 0.01:
            continue
        nearest = rows[lower[rows].argmax()]
        x, h = rng.normal(size=7), 1e-6
        slope = (by_coal(limit, q + h * x) - by_coal(limit, q - h * x)) / (2.0 * h)
        assert C[nearest] @ x == pytest.approx(slope, abs=1e-4)
        checked += 1


def test_a_pair_that_is_always_near_is_dropped_until_the_obstacle_moves(ur5):
    """An arm on a desk, its upper arm mounted 5 mm above it, goes as fast as without; so beside what stands there."""
    desk, post = HalfSpace([0, 0, 0], [0, 0, 1], name="desk"), Sphere([0.0, 0.0, 0.0], 0.03, name="post")
    other = OtherArm(iq.load_robot("ur5", base=iq.transform(translation=[0, 2.0, 0])), name="left")
    q, twist = np.array([1.2, -1.4, 1.6, -1.8, -1.57, 0.0]), np.array([0, 0, 0, 0.2, 0, 0])
    limit = Clearance(ur5, None, [desk, post, other], exclude=[("base_link", "desk")])
    post.move(iq.transform(translation=[0, 3.0, 0]))
    assert {d[:2] for d in limit.dropped if d.reason == "always nearer than 20.0 mm"} >= {
        ("shoulder_link", "desk"), ("upper_arm_link", "desk")
    }  # fmt: skip
    alone = iq.Controller(ur5, dt=DT)
    loop = iq.Controller(ur5, dt=DT, limits=[limit])
    for place, near in (([0.1, -0.02, 0.1], True), ([0, 3.0, 0.1], False), ([0.1, -0.02, 0.1], True)):
        post.move(iq.transform(translation=place))
        np.testing.assert_allclose(loop.follow(q, twist).velocity, alone.follow(q, twist).velocity, atol=1e-12)
        assert (("shoulder_link", "post") in {d[:2] for d in limit.dropped}) == near
        assert (("shoulder_link", "post") in limit.pairs) != near
    assert limit.at(q).distance > 0.02
    post.move(ur5.pose(q))
    assert limit.at(q).distance < 0.0
    assert ("shoulder_link", "post") in limit.pairs


class States:
    """The states that are looked at: positions, how they change with the velocity, and that braked for a tick."""

    def __init__(self, arms, q, before, limits, dt):
        found = engine.law.braking_states(arms, q, before, limits, dt, 1.0 / dt)
        self.positions, self.weights, self.longer, self.grows, self.y = map(np.array, found)


def test_braking_passes_through_the_predicted_states(ur5):
    """Joints far from their ranges' ends and near them, of an arm and of another one: no row can contradict braking."""
    rng, dt, near = np.random.default_rng(0), 0.001, 0
    high = np.concatenate((ur5.position_upper, np.full(3, np.inf)))
    limits = np.array((np.full(9, np.pi), np.array([10.0] * 5 + [np.inf] + [5.0] * 3), -high, high))
    arms = [0] * 6 + [1] * 3
    for _ in range(200):
        q, before = rng.uniform(-2.0, 2.0, 9), rng.uniform(-3.0, 3.0, 9)
        ends = np.sign(before[:4]) * high[:4]
        room = before[:4] ** 2 / (2 * rng.uniform(2.0, 9.9, 4)) + 2.0 * dt * np.abs(before[:4])
        q[:4], near = ends - np.sign(ends) * room, near + int((room < before[:4] ** 2 / 14.0).sum())
        now = States(arms, q, before, limits, dt)
        then = States(arms, q + dt * now.y, now.y, limits, dt)
        np.testing.assert_allclose(then.positions[1], now.positions[1], atol=1e-12)
        np.testing.assert_allclose(then.positions[-1], now.positions[-2], atol=1e-12)
        assert (np.abs(now.positions) <= high + 1e-12).all()
        x = now.y + 1e-6 * rng.uniform(-1, 1, 9)
        other = States(arms, q + dt * x, x, limits, dt)
        z, weights, longer = x - now.y, now.weights[1], now.longer[1]
        moved = dt * (weights * z + longer * np.dot(now.grows[:6], z[:6]))[:6]
        found = (other.positions - then.positions)[1, :6]
        np.testing.assert_allclose(found, moved, atol=0.02 * dt * weights.max() * np.abs(z).max())
    assert near > 100


@pytest.mark.cases(1)
@pytest.mark.parametrize(("acceleration", "dt", "delay"), [(3.0, 0.004, 0.0), (10.0, 0.001, 0.0), (3.0, 0.001, 0.02)])
def test_an_arm_led_into_an_obstacle_comes_to_rest(panda, acceleration, dt, delay):
    limit = Clearance(panda, HAND, [TABLE])
    loop = iq.Controller(panda, dt=dt, delay=delay, acceleration_limit=acceleration, limits=[limit])
    under = iq.transform(np.diag([1.0, -1.0, -1.0]), [0.5, 0.0, -0.05])
    run = drive(loop, READY, under, round(5.0 / dt), late=round(delay / dt))
    q, held = run.q[-1], run.x[round(4.0 / dt) :]
    assert np.abs(np.diff(held, axis=0)).max() < 0.02 * acceleration * dt
    assert 0.01999 < by_coal(limit, q) < 0.0201
    assert loop.step(q, under).reason.endswith("panda_hand and table, 20.0 mm")


def test_a_tick_ends_no_nearer_than_it_began(ur5):
    """A box's edge, ticks of 10 ms: rows alone end 2.9 mm nearer, those about that answer 0.07 mm."""
    box = Box(iq.transform(translation=[0.45, 0.0, 0.15]), [0.24, 0.4, 0.3], name="box")
    q = np.array([6.275583519338, -5.328769210213, -2.525720807412, -2.456191622961, 1.703820080511, 5.496691728276])
    turn = [
        [-0.637348393, 0.125114295, 0.760350866],
        [0.707404651, -0.296270954, 0.641718148],
        [0.305557990, 0.946873769, 0.100321382],
    ]
    target = iq.transform(turn, [-0.045989214314, 0.032757171046, -0.046676316993])
    limit = Clearance(ur5, None, [box])
    loop = iq.Controller(ur5, dt=0.01, limits=[limit])
    loop.step([0.0, -1.4, 1.6, -1.8, -1.57, 0.0], target)  # it begins elsewhere
    x = loop.step(q, target).velocity
    assert limit.at(q + 0.01 * x).distance > limit.at(q).distance - 1e-6


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    ("obstacle", "q", "before"),
    [
        (  # a wrist a hair too near its base in a state ahead, while a box holds the joint that would help
            Box(iq.transform(translation=[0.45, 0.0, 0.15]), [0.24, 0.4, 0.3], name="box"),
            [5.08206427408764, 6.28318530718, 2.3793289727078086, -6.136162129784486, 3.24775235118537, -6.28318530718],
            [5.3243446789490603e-08, 0.0, 0.00789952677658324, -1.4547193744642215, 1.724989839466184, -0.0],
        ),
        (  # a wrist that would pass a shelf's corner between two states ahead, 1.0 mm too near
            Box(iq.transform(translation=[0.55, 0.3, 0.4001]), [0.3, 0.3, 0.03], name="shelf"),
            [0.489305253, -1.548114737, 2.229209935, -2.683606500, -1.416325435, 0.342852750],
            [-2.616864388, -0.018547788, -0.002737405, -0.142537831, -0.330634067, 2.123420180],
        ),
    ],
)
def test_recovery_rows_are_feasible_with_all_joint_limits(ur5, obstacle, q, before):
    limit, q, before = Clearance(ur5, LINKS, [obstacle]), np.array(q), np.array(before)
    loop = loop_of(ur5, 0.001, 0.0)._replace(acceleration=np.full(6, 10.0))
    rows = limit.rows_at(q, limit.in_loop(loop), before)
    box = box_of(loop)
    lower, upper, *_ = law.joint_bounds(limit_fields(loop, box.rate), q, before)
    of_joints = np.array((box.velocity_limit, loop.acceleration, box.position_lower, box.position_upper))
    braked = States([0] * 6, q, before, of_joints, 0.001).y
    assert (rows.lower - rows.C @ braked).max() > 1e-3  # it does ask for something
    found = linprog(
        np.zeros(6), -rows.C, -rows.lower, bounds=list(zip(lower, upper, strict=True)), method="highs-ds",
        options={"primal_feasibility_tolerance": 1e-10},
    )  # fmt: skip
    assert found.success


@pytest.mark.cases(1)
@pytest.mark.parametrize("acceleration", [None, 10.0, 30.0])
def test_parallel_faces_do_not_cause_chatter(panda, acceleration):
    """A hand's capsule along a face: the joints' changes are those of the loop without a clearance."""
    box = Box(iq.transform(translation=[0.5, 0.0, 0.1]), [0.3, 0.5, 0.2], name="box")
    tip = {"panda_hand": [Capsule([0, -0.04, 0.085], [0, 0.04, 0.085], 0.025)]}
    down = iq.transform(np.diag([1.0, -1.0, -1.0]), [0.5, 0.0, 0.30])
    start = iq.solve_pose(panda, down, q0=[0, -0.1, 0, -2.2, 0, 2.1, 0.785]).q
    changes = {}
    for label, limits in (("kept", [Clearance(panda, tip, [box])]), ("without", [])):
        loop = iq.Controller(panda, dt=DT, limits=limits, acceleration_limit=acceleration)
        q, rng, velocities = start, np.random.default_rng(0), []
        for i in range(1500):
            target = down.copy()
            target[:3, 3] = 0.5 + 0.08 * np.sin(2 * np.pi * i * DT / 1.5), 0.05 * np.sin(2 * np.pi * i * DT / 1.1), 0.15
            velocities.append(loop.step(q + 1e-5 * rng.normal(size=7), target).velocity)
            q = q + DT * velocities[-1]
        changes[label] = np.median(np.abs(np.diff(velocities[300:], axis=0)).max(axis=1))
    assert changes["kept"] < 1.2 * changes["without"]


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    ("dt", "acceleration", "starts"), [(DT, None, 2), (0.001, 8.0, 1), (0.005, 8.0, 2), (0.02, 2.0, 2)]
)
def test_an_arm_comes_out_of_an_obstacle_slowly_and_reports_it(ur5, dt, acceleration, starts):
    """In the same time at every tick and acceleration, but for the last millimetre: a tick covers a tenth of it."""
    here, away = iq.transform(translation=[0.45, 0.0, 0.15]), iq.transform(translation=[0.45, 0.0, 3.0])
    box = Box(np.eye(4), [0.24, 0.4, 0.3], name="box")
    limit = Clearance(ur5, LINKS, [box])
    rng, tried = np.random.default_rng(3), 0
    while tried < starts:
        q = rng.uniform(-np.pi, np.pi, 6)
        box.move(here)
        if not -0.03 < limit.at(q).distance < -0.005:
            continue
        tried += 1
        box.move(away, np.zeros(6))
        if limit.at(q).distance < 0.02:
            continue
        loop = iq.Controller(ur5, dt=dt, limits=[limit], acceleration_limit=acceleration)
        assert loop.step(q, ur5.pose(q)).status == "ok"
        box.move(here, np.zeros(6))
        assert "are nearer than 20.0 mm; " in loop.step(q, ur5.pose(q)).reason
        target, ticks = ur5.pose(q), 0
        while limit.at(q).distance < 0.0199:
            x = loop.step(q, target).velocity
            if limit.nearest.distance < 0.019:
                assert np.abs(x).max() < 0.3
            q, ticks = q + dt * x, ticks + 1
            assert ticks * dt < 2.5 + 25.0 * dt


@pytest.mark.parametrize("acceleration", [None, 8.0])
def test_no_tick_is_ok_while_bodies_are_nearer_than_the_distance(panda, acceleration):
    """A ball is put into the hand; the target moves away from it faster than the way out is asked for."""
    ball = Sphere(panda.pose(READY)[:3, 3] + [0.0, 0.17, 0.0], 0.1, name="ball")
    for more in ([], [lambda q: LimitRows(np.eye(7)[:1], [-1.0], [1.0])]):
        limit = Clearance(panda, {"tool": [Sphere([0.0, 0.0, 0.0], 0.06)]}, [ball])
        loop = iq.Controller(panda, dt=DT, limits=[limit, *more], acceleration_limit=acceleration)
        q, inside, target = READY, 0, panda.pose(READY)
        ball.move(UP @ UP, np.zeros(6))
        assert loop.step(q, target).status == "ok"
        for _ in range(300):
            ball.move(np.eye(4), [0.0, 0.0, 0.0, 0.0, 0.05, 0.0])
            target[1, 3] -= 0.2 * DT
            solution = loop.step(q, target, [0.0, 0.0, 0.0, 0.0, -0.2, 0.0])
            near = limit.at(q).distance < 0.0199
            inside += near
            assert not near or solution.status != "ok"
            assert ("tool and ball are nearer than 20.0 mm" in solution.reason) == near
            q = q + DT * solution.velocity
        assert 5 < inside < 250
        assert solution.status == "ok"


@pytest.mark.cases(4)
@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("dt", [0.002, 0.02])
@pytest.mark.parametrize("speed", [0.1, 0.3])
def test_the_arm_evades_a_moving_obstacle_with_and_without_acceleration_limits(ur5, dt, speed, told):
    """A ball goes through where the hand is: the arm begins in time to go before it, by its own distances."""
    q0 = np.array([0.0, -1.4, 1.6, -1.8, -1.57, 0.0])
    at, ball = ur5.pose(q0), Sphere([0.0, 0.0, 0.0], 0.08, name="ball")
    for acceleration in (None, 8.0):
        limit = Clearance(ur5, {"tool": [Sphere([0.0, 0.0, 0.0], 0.05)]}, [ball])
        loop, q, d = iq.Controller(ur5, dt=dt, limits=[limit], acceleration_limit=acceleration), q0, []
        for i in range(round(0.22 / speed / dt)):
            y = 0.25 - speed * dt * i
            ball.move(iq.transform(translation=at[:3, 3] + [0.0, y, 0.0]), [0, 0, 0, 0, -speed, 0] if told else None)
            solution = loop.step(q, at)
            assert solution.status != "degraded"
            q = q + dt * solution.velocity
            d.append(np.linalg.norm(ur5.pose(q)[:3, 3] - at[:3, 3] - [0.0, y - speed * dt, 0.0]) - 0.13)
        assert 0.0195 - (0.0 if told else 0.2 * speed * dt) < min(d) < 0.025 + 10.0 * speed * dt


def test_the_arm_evades_an_obstacle_with_and_without_a_declared_twist(panda):
    """Into the hand and out again, by coal; between two poses of a camera, one in 16 ticks, what comes is not seen."""
    ball = Sphere([0.0, 0.0, 0.0], 0.06, name="ball")
    limit = Clearance(panda, HAND, [ball])
    tool, least = panda.pose(READY)[:3, 3], {}
    for told, every in ((True, 1), (False, 1), (False, 16)):
        loop = iq.Controller(panda, dt=DT, limits=[limit])
        q, d = READY, []
        for i in range(800):
            y, speed = (0.5 - i * DT, -1.0) if i < 250 else (i * DT - 0.5, 1.0)
            if i % every == 0:
                twist = [0.0, 0.0, 0.0, 0.0, speed, 0.0] if told else None
                ball.move(iq.transform(translation=tool + np.array([0.0, y, 0.0])), twist)
            q = q + DT * loop.step(q, panda.pose(READY)).velocity
            there, last = ball.pose, ball.twist if ball.declared else None
            ball.move(iq.transform(translation=tool + np.array([0.0, y + DT * speed, 0.0])), last)  # by then
            d.append(by_coal(limit, q))
            ball.move(there, last)
        least[told, every] = min(d)
        np.testing.assert_allclose(panda.pose(q), panda.pose(READY), atol=1e-3)
    assert least[True, 1] > 0.0195
    assert least[False, 1] > 0.0195
    assert least[False, 16] > 0.0195 - 16 * DT * 1.0


@pytest.mark.parametrize("count", [1, 2])
def test_the_twist_of_an_obstacle_is_estimated_from_its_last_two_poses(panda, count):
    """In one loop, and in two that take turns."""
    ball = Sphere([0.0, 0.0, 0.0], 0.06, name="ball")
    limit = Clearance(panda, HAND, [ball])
    loops = [iq.Controller(panda, dt=DT, limits=[limit]) for _ in range(count)]

    def twist(pose, given=None):
        if pose is not None:
            ball.move(pose, given)
        for loop in loops:
            loop.step(READY, panda.pose(READY))
        return limit._engine.twist(0)

    speed, places = np.array([0.3, -0.1, 0.2, 0.5, -0.4, 0.1]), [iq.transform(translation=[0.0, 2.0, 0.0])]
    assert not twist(places[0]).any()
    for _ in range(5):  # every 20th tick, 10 of which are as long as the room takes
        for _ in range(19):
            twist(None)
        places.append(iq.exp(20 * DT * speed) @ places[-1])
        np.testing.assert_allclose(twist(places[-1]), speed, atol=1e-9)
    for i in range(1, 60):  # held for twice the time between the last two
        np.testing.assert_allclose(twist(None), speed if i <= 40 else 0.0 * speed, atol=1e-9)
    for _ in range(100):  # in every tick: a tenth of what is new, as rows take a tenth of the room
        places.append(iq.exp(DT * speed) @ places[-1])
        found = twist(places[-1])
    np.testing.assert_allclose(found, speed, atol=1e-3)
    assert not twist(iq.transform(translation=[0.0, 3.0, 0.0]), np.zeros(6)).any()  # told to rest, wherever that is


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("acceleration", [None, 10.0])
def test_the_arm_evades_another_arm(ur5, acceleration, told):
    """Both tools at one place, if this arm stayed: it makes way, whether or not the other one's velocity is told."""
    q = np.array([0.0, -1.2, 1.5, -1.0, -1.5, 0.3])
    target, dt, speed, d = ur5.pose(q), 0.004, 0.5, []
    facing = iq.transform(np.diag([-1.0, -1.0, 1.0]), [*(2.0 * target[:2, 3]), 0.0])
    other = OtherArm(iq.load_robot("ur5", base=facing), {"tool": [Sphere([0, 0, 0], 0.1)]})
    limit = Clearance(ur5, {"tool": [Sphere([0, 0, 0], 0.05)]}, [other])
    loop, sweeps = iq.Controller(ur5, dt=dt, limits=[limit], acceleration_limit=acceleration), -speed * np.eye(6)[0]
    start = q + 0.8 * np.eye(6)[0]
    for i in range(500):
        other.move(start + dt * i * sweeps, sweeps if told else None)
        q = q + dt * loop.step(q, target).velocity
        there = other.robot.pose(start + dt * (i + 1) * sweeps)
        d.append(np.linalg.norm(ur5.pose(q)[:3, 3] - there[:3, 3]) - 0.15)
    assert 0.0195 < min(d) < 0.025


def test_dropped_pairs_are_listed_with_a_reason(panda, ur5):
    limit = Clearance(panda, None, [TABLE], exclude=[("panda_hand", "table")])
    why = {(one, other): reason for one, other, reason in limit.dropped}
    assert why["panda_link0", "panda_link1"] == "by the SRDF: Adjacent"
    assert why["panda_link0", "table"] == "no joint moves it"
    assert why["panda_hand", "table"] == "excluded"
    assert ("panda_hand", "table") not in limit.pairs
    assert ("panda_link7", "table") in limit.pairs
    assert len(limit.pairs) + len(limit.dropped) == 12 * 11 // 2
    near = {"shoulder_link": [Sphere([0, 0, 0], 0.1)], "forearm_link": [Sphere([0, 0, -0.2], 0.05)],
            "upper_arm_link": [Sphere([0, 0, 0.1], 0.05)], "base_link": [Sphere([0, 0, 0.05], 0.1)]}  # fmt: skip
    free = {(one, other): reason for one, other, reason in Clearance(ur5, near).dropped}
    assert free["shoulder_link", "upper_arm_link"].startswith(("neighbours", "by the SRDF"))
    chosen = Clearance(panda, HAND, [TABLE], pairs=[("table", "panda_link5")])
    assert chosen.pairs == (("panda_link5", "table"),)


@pytest.mark.filterwarnings("ignore:clearance. nothing is kept apart")
def test_only_links_that_are_provably_always_near_are_dropped():
    """Two hinges through one point: a ball on the last link stays within reach of one at the base, or comes off it.

    So does a rod that begins 10 mm beside the axes and ends half a metre from them; its end takes no part in it.
    """
    wrist = iq.robots.Chain(
        np.column_stack([iq.revolute((0, 0, 1)), iq.revolute((0, 1, 0))]), np.eye(4), velocity_limit=1.0
    )
    rod, pin, ball = Capsule([0.012, 0, 0], [0.5, 0, 0], 0.002), Sphere([0, 0, 0], 0.005), Sphere([0, 0, 0], 0.05)
    near, off = Sphere([0.03, 0, 0], 0.01), Sphere([0.2, 0, 0], 0.01)
    for base, last, mm, always in ((ball, near, 20, 1), (ball, off, 20, 0), (pin, rod, 20, 1), (pin, rod, 4.9, 0)):
        for bodies in ({"base": [base], "joint2": [last]}, {"joint2": [last], "base": [base]}):
            dropped = Clearance(wrist, bodies, distance=1e-3 * mm).dropped
            assert [d.reason for d in dropped] == ["always nearer than 20.0 mm"] * always


def test_another_arm_uses_half_of_the_margin_unless_its_velocity_is_declared(ur5):
    other = OtherArm(iq.load_robot("ur5", base=iq.transform(np.diag([-1.0, -1.0, 1.0]), [0.9, 0, 0])), name="left")
    limit = Clearance(ur5, None, [other])
    q = np.array([0.3, -1.3, 1.9, -2.17, -1.57, 0.0])
    other.move(q)
    rate = limit._at_rate(0.5)

    def rows():
        limit.rows_at(q, rate)  # which tells the engine where the other arm is
        C, lower, _, of_pair, _ = limit._engine.rows(q, None, rate)
        return C, lower, np.array(of_pair), limit._engine.last_distances

    lower = {}
    for known in (False, True):
        other.move(q, np.zeros(6) if known else None)
        _, low, of_pair, _ = rows()
        mine = [limit._geoms[limit._shape_pairs[int(k)][1]].name.startswith("left/") for k in of_pair]
        lower[known] = low[mine].min()
    assert lower[True] == pytest.approx(2.0 * lower[False])
    other.move(q)
    assert any(name.startswith("left/") for pair in limit.pairs for name in pair)
    with pytest.raises(iq.BadInput, match=r"q: found joint 3 .* degrees"):
        other.move(np.degrees(q))
    x, y, h = 0.1 * np.ones(6), np.linspace(0.1, 0.6, 6), 1e-6
    C, low, of_pair, d = rows()
    near = [k for k in of_pair if limit._geoms[limit._shape_pairs[k][1]].arm > 0 and d[k] > 0.02]
    after = {}
    for sign in (-1, 1):
        other.move(q + sign * h * y)
        after[sign] = limit._distances(q + sign * h * x)
    other.move(q, y)
    _, moving, of_moving, _ = rows()
    for k in set(near) & set(of_moving):
        row, same = (
            np.flatnonzero(of == k)[np.argmax(lower[of == k])] for of, lower in ((of_pair, low), (of_moving, moving))
        )
        drift = -moving[same] - 0.5 * (d[k] - 0.02)
        assert C[row] @ x + drift == pytest.approx((after[1][k] - after[-1][k]) / (2 * h), abs=1e-6)
    assert set(near) & set(of_moving)


@pytest.mark.parametrize(("acceleration", "tolerance", "seed"), [(None, 1e-4, 1), (10.0, 1.5e-3, 2)])
def test_two_arms_that_evade_each_other_keep_the_distance(ur5, acceleration, tolerance, seed):
    """Each is told where the other one was and how fast, and that it brakes; both are led to the same place."""
    left = iq.load_robot("ur5", base=iq.transform(np.diag([-1.0, -1.0, 1.0]), [0.9, 0, 0]))
    arms, brakes = (ur5, left), {} if acceleration is None else {"acceleration_limit": acceleration}
    others = [OtherArm(arm, **brakes) for arm in arms[::-1]]
    limits = [Clearance(arm, None, [other]) for arm, other in zip(arms, others, strict=True)]
    loops = [iq.Controller(a, dt=DT, limits=[c], **brakes) for a, c in zip(arms, limits, strict=True)]
    q, x, rng = [np.array([1.2, -1.4, 1.6, -1.8, -1.57, 0.0])] * 2, [np.zeros(6)] * 2, np.random.default_rng(seed)
    least, places = 9.0, ([0.1, -0.35, 0.05], [0.8, 0.35, 0.75])
    for i in range(900):
        if i % 300 == 0:
            targets = [iq.transform(arm.pose(rng.uniform(-3, 3, 6))[:3, :3], rng.uniform(*places)) for arm in arms]
        for k in (0, 1):
            others[k].move(q[1 - k], x[1 - k] if brakes else None)
        x = [loops[k].step(q[k], targets[k]).velocity for k in (0, 1)]
        q = [a + DT * b for a, b in zip(q, x, strict=True)]
        others[0].move(q[1])
        least = min(least, limits[0].at(q[0]).distance)
        if i % 50 == 0:
            assert limits[0].at(q[0]).distance == pytest.approx(by_coal(limits[0], q[0]), abs=2e-6)
    assert 0.02 - tolerance < least < 0.021


def test_each_of_two_arms_leaves_half_of_the_margin_to_the_other_at_the_end_of_a_tick(ur5):
    left, dt = iq.load_robot("ur5", base=iq.transform(np.diag([-1.0, -1.0, 1.0]), [0.9, 0, 0])), 0.01
    q = [
        np.array([0.2744, 0.5347, -2.1503, -0.8648, 2.4904, 1.6511]),
        np.array([-3.2869, -3.2592, 1.6717, -5.1375, -4.3574, -0.4156]),
    ]
    around = [OtherArm(left, LINKS), OtherArm(ur5, LINKS)]
    limits = [Clearance(arm, LINKS, [other]) for arm, other in zip((ur5, left), around, strict=True)]
    for other, there in zip(around, q[::-1], strict=True):
        other.move(there)
    assert 0.021 < limits[0].at(q[0]).distance < 0.022
    rng, ends = np.random.default_rng(0), []
    for _ in range(100):
        both = [pushed(limit, limit.robot, at, dt, rng.normal(size=6)) for limit, at in zip(limits, q, strict=True)]
        for x, y in zip(*both, strict=True):
            around[0].move(q[1] + dt * y)
            ends.append(limits[0].at(q[0] + dt * x).distance)
        around[0].move(q[1])
    assert min(ends[::2]) < 0.0198
    assert min(ends[1::2]) > 0.0199


@pytest.mark.parametrize(("speed", "said"), [(2e-4, "ok"), (5e-3, "ok"), (0.02, "degraded")])
def test_an_obstacle_slower_than_the_effect_of_curvature_causes_no_contradiction(panda, speed, said):
    stuck = panda.with_limits(position_lower=READY, position_upper=READY)
    at = stuck.pose(READY)
    ball = Sphere([0.0, 0.0, 0.0], 0.05, name="ball")
    clearance = Clearance(stuck, {"panda_hand": [Sphere([0.0, 0.0, 0.1034], 0.03)]}, [ball])
    loop = iq.Controller(stuck, dt=0.001, limits=[clearance])
    ball.move(iq.transform(translation=at[:3, 3] + [0.1, 0.0, 0.0]), [0.0, 0.0, 0.0, -speed, 0.0, 0.0])
    solution = loop.step(READY, at)
    assert (solution.status, clearance.nearest.distance) == (said, pytest.approx(0.02))
    assert not solution.velocity.any()


def test_many_obstacles_make_at_most_the_largest_number_of_rows(ur5):
    ball, box = Sphere([0, 0, 0], 0.1, name="ball"), Box(np.eye(4), [0.2, 0.4, 0.2], name="box")
    crate = Box(iq.transform(translation=[0.5, 0.2, 0.1]), [0.2, 0.4, 0.2], name="crate")
    limit = Clearance(ur5, None, [ball, box, crate, HalfSpace([0, 0, -0.1], [0, 0, 1])])
    rate, rng, crowded = limit._at_rate(25.0), np.random.default_rng(7), 0
    for _ in range(20):
        q = np.array([0.0, -1.2, 1.5, -1.0, -1.5, 0.3]) + 0.3 * rng.standard_normal(6)
        for shape in (box, ball):
            shape.move(iq.transform(translation=ur5.pose(q)[:3, 3] + 0.2 * rng.standard_normal(3)))
        rows = limit.rows_at(q, rate)
        at_places = [name for name in rows.names if "slowly" not in name]
        assert len(at_places) <= MOST_ROWS
        crowded += len(at_places) == MOST_ROWS
    assert crowded > 3


def test_two_arms_in_one_chain_and_an_arm_on_a_rail(ur5):
    left = iq.load_robot("ur5", base=iq.transform(np.diag([-1.0, -1.0, 1.0]), [0.9, 0, 0]))
    both = iq.robots.relative(ur5, left)
    bodies = {"wrist_3_link": [Sphere([0, 0, 0], 0.05)], "other/wrist_3_link": [Sphere([0, 0, 0], 0.05)],
              "base_link": [Capsule([0, 0, -0.1], [0, 0, 0.1], 0.1)]}  # fmt: skip
    limit = Clearance(both, bodies)
    assert ("wrist_3_link", "other/wrist_3_link") in limit.pairs
    rng = np.random.default_rng(2)
    for _ in range(20):
        q, p = rng.uniform(-2, 2, 6), rng.uniform(-2, 2, 6)
        apart = np.linalg.norm(frame(ur5, q) - frame(left, p)) - 0.1
        found = limit.distances(np.concatenate((p[::-1], q)))["wrist_3_link", "other/wrist_3_link"]
        assert found == pytest.approx(apart, abs=1e-12)
    railed = iq.load_robot("ur5", base=iq.robots.rail([0, 1, 0], -1.0, 1.0, 0.5))
    wall = HalfSpace([0, 0.6, 0], [0, -1, 0], name="wall")
    kept = Clearance(railed, None, [wall])
    loop = iq.Controller(railed, dt=DT, limits=[kept])
    q = np.array([0.0, 0.0, -1.3, 1.9, -2.17, -1.57, 0.0])
    target = railed.pose(q)
    target[1, 3] += 0.7
    after, solution = drive(loop, q, target, 1500).end
    assert kept.at(after).distance == pytest.approx(0.02, abs=1e-4)
    assert by_coal(kept, after) == pytest.approx(0.02, abs=1e-4)
    assert "wall" in solution.reason


def frame(robot, q):
    link = next(link for link in robot.links if link.name == "wrist_3_link")
    return (robot.motions(q)[link.body] @ link.frame)[:3, 3]


def test_neither_base_frame_nor_tool_frame_nor_unit_changes_a_velocity(panda):
    rng = np.random.default_rng(0)
    X = iq.exp([0.4, 1.1, -0.3, 0.5, -2.0, 0.7])
    Y = iq.exp([0.2, -0.4, 0.3, 0.1, 0.2, -0.1])
    point = np.linalg.inv(Y)[:3, 3]
    normal = X[:3, 2]
    moved = iq.robots.stand_on(X, panda)
    limit = Clearance(panda, HAND, [TABLE])
    same = Clearance(moved, HAND, [HalfSpace(X[:3, 3], normal, name="table")])
    other = panda.with_tool(Y)
    checked = 0
    while checked < 25:
        q = READY + rng.uniform(-0.7, 0.7, 7)
        if not 0.02 < limit.at(q).distance < 0.05:
            continue
        checked += 1
        target = panda.pose(q + 0.3 * rng.normal(size=7))
        x = iq.Controller(panda, dt=DT, limits=[limit]).step(q, target).velocity
        seen = iq.Controller(moved, dt=DT, limits=[same]).step(q, X @ target).velocity
        tool = (
            iq.Controller(other, dt=DT, limits=[Clearance(other, HAND, [TABLE])], point=point)
            .step(q, target @ Y)
            .velocity
        )
        np.testing.assert_allclose(seen, x, atol=1e-10 * np.abs(x).max())
        np.testing.assert_allclose(tool, x, atol=1e-10 * np.abs(x).max())


@pytest.mark.cases(1)
@pytest.mark.filterwarnings("ignore:clearance. nearer than")
@pytest.mark.parametrize("acceleration", [None, 10.0])
def test_the_unit_of_length_changes_no_velocity(panda, acceleration):
    """The same arm, shapes and target in millimetres, while it comes down on the table and begins inside of it."""
    unit = 1e3
    scale = np.diag([1.0, 1.0, 1.0, unit, unit, unit])
    home = panda.home.copy()
    home[:3, 3] *= unit
    limits = {"position_lower": panda.position_lower, "position_upper": panda.position_upper}
    small = iq.robots.Chain(scale @ panda.screws, home, velocity_limit=panda.velocity_limit, **limits)
    bodies = {}
    for name, shapes in HAND.items():
        link = next(link for link in panda.links if link.name == name)
        bodies[small.names[link.body - 1]] = bodies.get(small.names[link.body - 1], [])
        for shape in shapes:
            T, half = link.frame @ shape.placement, shape.half[2] * link.frame[:3, :3] @ shape.placement[:3, 2]
            ends = T[:3, 3] - half, T[:3, 3] + half
            bodies[small.names[link.body - 1]].append(Capsule(*(unit * end for end in ends), unit * shape.radius))
    options = {"dt": DT, "acceleration_limit": acceleration}
    for start, seconds in ((READY, 1.0), (READY + np.array([0, 1.1, 0, 0.2, 0, 0, 0]), 0.2)):
        loops = (
            iq.Controller(panda, limits=[Clearance(panda, HAND, [TABLE])], **options),
            iq.Controller(small, limits=[Clearance(small, bodies, [TABLE], unit * 0.02)], **options),
        )
        target = below(panda, start, 0.8)
        same = target.copy()
        same[:3, 3] *= unit
        q, x, limited = start, np.zeros(7), 0
        for _ in range(int(seconds / DT)):
            one, other = loops[0].step(q, target, None, x), loops[1].step(q, same, None, x)
            np.testing.assert_allclose(other.velocity, one.velocity, atol=1e-10)
            limited += "clearance" in one.reason
            x = one.velocity
            q = q + DT * x
        assert limited > 10


def test_degenerate_and_overlapping_shapes_give_finite_rows(panda):
    degenerate = [
        Box(np.eye(4), [0.0, 0.0, 0.0]),
        Box(np.eye(4), [0.3, 0.3, 0.0], name="sheet"),
        Capsule([0.3, 0, 0.3], [0.3, 0, 0.3], 0.0),
        Sphere([0, 0, 0], 0.0, name="at the hand"),
        Capsule([0, 0, 0], [0, 0, 0.2], 0.05, name="along"),
    ]
    limit = Clearance(panda, HAND, degenerate)
    rate = limit._at_rate(100.0)
    hand = panda.motions(READY)[7] @ next(link.frame for link in panda.links if link.name == "panda_hand")
    for place in (
        hand,
        hand @ iq.transform(translation=[0, 0, 0.03]),
        hand @ iq.transform(translation=[0, -0.06, 0.03]),
    ):
        for shape in degenerate:
            shape.move(place)
        rows = limit.rows_at(READY, rate)
        assert np.isfinite(rows.C).all()
        assert np.isfinite(rows.lower).all()
        assert len(rows.lower) <= MOST_ROWS + 7  # and how fast joints may be inside
        loop = iq.Controller(panda, dt=DT, limits=[limit])
        with pytest.warns(UserWarning, match="exclude="):
            loop.step(READY + 0.1, panda.pose(READY))
        solution = loop.step(READY, panda.pose(READY))
        assert np.isfinite(solution.velocity).all()
        assert (np.abs(solution.velocity) <= panda.velocity_limit).all()


def test_a_target_inside_an_obstacle_and_a_fast_one_leave_joints_inside_their_limits(ur5):
    ball = Sphere([0, 0, 0], 0.15, name="ball")
    limit = Clearance(ur5, None, [ball])
    loop = iq.Controller(ur5, dt=DT, limits=[limit])
    q = np.array([0.3, -1.3, 1.9, -2.17, -1.57, 0.0])
    inside = ur5.pose(q)
    for i in range(300):
        at = inside[:3, 3] + [0.0, 0.6 - 5.0 * i * DT, 0.0]  # 5 m/s, through the arm
        ball.move(iq.transform(translation=at), [0, 0, 0, 0, -5.0, 0])
        x = loop.step(q, inside).velocity
        assert np.isfinite(x).all()
        assert (np.abs(x) <= ur5.velocity_limit + 1e-12).all()
        q = q + DT * x
    assert (q >= ur5.position_lower).all()


@pytest.mark.parametrize("kind", ["twist", "goal"])
def test_a_follower_keeps_the_distance(panda, kind):
    """Down onto the table."""
    limit = Clearance(panda, HAND, [TABLE])
    loop = iq.Controller(panda, dt=0.004, acceleration_limit=20.0, limits=[limit])
    follower, q, least, named = iq.Follower(loop), READY, 9.0, 0
    if kind == "goal":
        follower.follow(below(panda, READY, 0.8)[None])
    for i in range(250):
        if kind == "twist" and i % 10 == 0:
            follower.twist([0.0, 0.0, 0.0, 0.0, 0.0, -0.8])
        solution = follower.step(q)
        q = q + 0.004 * solution.velocity
        least, named = min(least, by_coal(limit, q)), named + ("panda_hand and table" in solution.reason)
    assert 0.0195 < least < 0.021
    assert named > 10


def test_a_path_into_a_wall_is_blocked_by_name(ur5):
    q = np.array([-0.6, -1.3, 1.9, -2.17, -1.57, 0.0])
    start = ur5.pose(q)
    wall = Box(iq.transform(translation=[start[0, 3], start[1, 3] + 0.3, 0.2]), [0.3, 0.05, 0.6], name="wall")
    limit = Clearance(ur5, None, [wall])
    path = [iq.transform(translation=[0, 0.5 * s, 0]) @ start for s in np.linspace(0.0, 1.0, 30)]
    follower = iq.PathFollower(iq.Controller(ur5, dt=DT, limits=[limit]), path)
    follower.prepare(q)
    for _ in range(2000):
        solution = follower.step(q)
        q = q + DT * solution.velocity
        if solution.status == "blocked":
            break
    assert solution.status == "blocked"
    assert "and wall are nearer than 20.0 mm" in solution.reason
    assert limit.at(q).distance == pytest.approx(0.02, abs=1e-4)


def test_a_pose_is_found_where_the_clearance_is_kept_or_is_no_success(ur5):
    q = np.array([-0.6, -1.3, 1.9, -2.17, -1.57, 0.0])
    target = ur5.pose(q)
    block = Box(iq.transform(translation=[0.25, -0.1, 0.45]), [0.1, 0.1, 0.2], name="block")
    limit = Clearance(ur5, None, [block])
    assert limit.at(iq.solve_pose(ur5, target, q0=q).q).distance < 0.0
    found = iq.solve_pose(ur5, target, q0=q, clearance=limit, time_limit=np.inf)
    assert found.success
    assert limit.at(found.q).distance >= 0.02
    inside = Clearance(ur5, None, [Sphere(target[:3, 3], 0.1, name="ball")])
    none = iq.solve_pose(ur5, target, q0=q, clearance=inside, time_limit=np.inf, restarts=8)
    assert not none.success
    assert none.position_error < 1e-6
    assert "and ball are nearer than 20.0 mm" in none.reason
    with pytest.raises(iq.BadInput, match="clearance"):
        iq.solve_pose(ur5, target, clearance=3.0)


def test_a_contact_surface_is_excluded_by_name(panda):
    task = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], normal=[0, 0, 1]), [5.0])
    limit = Clearance(panda, HAND, [TABLE], exclude=[("panda_hand", "table")])
    loop = iq.HybridController(panda, task, dt=DT, order="moment first", limits=[limit])
    solution = loop.step(READY, panda.pose(READY), np.zeros(6))
    assert np.isfinite(solution.velocity).all()
    assert limit.nearest.first == "panda_link5"


def test_the_rate_depends_on_tick_and_delay(panda):
    limit = Clearance(panda, HAND, [TABLE])
    assert limit.in_loop(loop_of(panda, 0.001, 0.0)).alpha == pytest.approx(100.0)
    assert limit.in_loop(loop_of(panda, 0.001, 0.02)).alpha == pytest.approx(1.0 / (np.e * 0.0205))
    assert Clearance(panda, HAND, [TABLE], rate=3.0).in_loop(loop_of(panda, 0.001, 0.0)).alpha == 3.0
    unlimited = panda.with_limits(velocity_limit=np.inf)
    rows = iq.Controller(unlimited, dt=DT, limits=[Clearance(unlimited, HAND, [TABLE])]).step(
        READY, below(panda, READY, 0.1)
    )
    assert np.isfinite(rows.velocity).all()


@pytest.mark.parametrize(("make", "said"), [
    (lambda r: Clearance("panda"), "robot: found 'panda'"),
    (lambda r: Clearance(r, HAND, 3), "obstacles: found 3"),
    (lambda r: Clearance(r, HAND, [np.eye(4)]), "obstacles"),
    (lambda r: Clearance(r, HAND, distance=-0.1), "distance"),
    (lambda r: Clearance(r, {"panda_hand": [3]}), "bodies"),
    (lambda r: Clearance(r, 3), "bodies"),
    (lambda r: Clearance(r, HAND, exclude=["ab"]), "exclude"),
    (lambda r: Clearance(iq.load_robot("fr3")), "known without collision geometry"),
    (lambda r: Sphere([0, 0, 0], -0.1), "radius"),
    (lambda r: Capsule([0, 0, 0], [0, np.inf, 0], 0.1), "b"),
    (lambda r: Capsule([0, 0, -1e308], [0, 0, 1e308], 0.1), "b"),
    (lambda r: Box(np.eye(4), [0.1, -0.1, 0.1]), "size"),
    (lambda r: Box(2 * np.eye(4), [0.1, 0.1, 0.1]), "pose"),
    (lambda r: HalfSpace([0, 0, 0], [0, 0, 0]), "normal"),
    (lambda r: Sphere([0, 0, 0], 0.1, name=3), "name"),
    (lambda r: Sphere([0, 0, 0], 0.1).move(np.zeros((4, 4))), "pose"),
    (lambda r: Clearance(r, HAND, [TABLE]).rows(READY, np.zeros(7)), "rate"),
    (lambda r: iq.Controller(iq.load_robot("ur5"), dt=DT, limits=[Clearance(r, HAND, [TABLE])]), "of another robot"),
    (lambda r: iq.Controller(r.with_tool(UP), dt=DT, limits=[Clearance(r, HAND, [TABLE])]), "offset="),
    (lambda r: iq.solve_pose(r.with_tool(UP), UP, clearance=Clearance(r, HAND, [TABLE])), "clearance: .* of another"),
    (lambda r: iq.Controller(iq.load_robot("panda", base=UP), dt=DT, limits=[Clearance(r, HAND, [TABLE])]), "base="),
    (lambda r: Clearance(r, HAND, [TABLE, HalfSpace([0, 0, -1], [0, 0, 1], name="table")]), "a second body 'table'"),
    (lambda r: Clearance(r, HAND, [Sphere([0, 0, 1], 0.1, name="panda_hand")]), "a second body 'panda_hand'"),
    (lambda r: Clearance(r, HAND, [OtherArm(r, HAND), OtherArm(r, HAND)]), "a second body 'other'"),
])  # fmt: skip
def test_bad_arguments_of_a_clearance_are_refused_by_name(panda, make, said):
    with pytest.raises(iq.BadInput, match=said):
        make(panda)


def test_obstacles_in_millimetres_warn_and_parked_ones_do_not(panda):
    box = Box(iq.transform(translation=[500.0, 0.0, 200.0]), [200.0, 200.0, 400.0], name="box")
    table = HalfSpace([0.0, 0.0, -100.0], [0.0, 0.0, 1.0], name="table")
    with pytest.warns(
        UserWarning, match=r"away from box by 399\.\d.*, table by 10.* \[length\]. Are these millimetres"
    ):
        Clearance(panda, HAND, [box, table])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        floor = Box(iq.transform(translation=[0.0, 0.0, -0.5]), [200.0, 200.0, 1.0], name="floor")
        Clearance(panda, HAND, [Sphere([100.0, 0.0, 0.0], 0.1, name="parked"), floor])


def test_a_distance_that_drops_all_pairs_warns_once(ur5):
    bodies = {"forearm_link": LINKS["forearm_link"], "tool": [Sphere([0.0, 0.0, 0.0], 0.05)]}
    with pytest.warns(UserWarning, match="nothing is kept 20 apart from .*table, .*than 20000.0 mm; .* metres") as told:
        assert not Clearance(ur5, bodies, [TABLE], distance=20).pairs
    assert len(told) == 1
    foot = Sphere([0.0, 0.0, 0.0], 0.08, name="foot")
    with pytest.warns(UserWarning, match="apart from foot, being always nearer than 20.0 mm"):
        Clearance(ur5, {**bodies, "shoulder_link": LINKS["shoulder_link"]}, [TABLE, foot],
                  exclude=[(link, "foot") for link in bodies])  # fmt: skip


def test_a_clearance_without_pairs_warns(panda):
    hand, ball = {"panda_hand": [Sphere([0.0, 0.0, 0.0], 0.05)]}, Sphere([1.0, 0.0, 0.0], 0.1, name="ball")
    with pytest.warns(UserWarning, match=r"nothing is kept apart \(there are no two bodies\)"):
        Clearance(panda, hand)
    with pytest.warns(UserWarning, match="panda_hand and panda_link7.*Adjacent"):
        Clearance(panda, hand | {"panda_link7": [Sphere([0.0, 0.0, 0.0], 0.05)]})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not Clearance(panda, hand, [ball], exclude=[("panda_hand", "ball")]).pairs


def test_unknown_bodies_are_refused(panda):
    with pytest.raises(iq.errors.UnknownName, match="elbow"):
        Clearance(panda, {"elbow": [Sphere([0, 0, 0], 0.1)]})
    with pytest.raises(iq.errors.UnknownName, match="shelf"):
        Clearance(panda, HAND, [TABLE], exclude=[("panda_hand", "shelf")])


def test_attributes_of_a_clearance_do_not_change(panda):
    limit = Clearance(panda, HAND, [TABLE])
    for name, value in (("obstacles", []), ("distance", 0.05), ("robot", panda), ("bodies", HAND)):
        with pytest.raises(AttributeError, match=rf"{name} of a clearance does not change: .*limits="):
            setattr(limit, name, value)
    with pytest.raises(AttributeError, match="radius of a shape does not change: move"):
        HAND["panda_hand"][0].radius = 0.2
    for one in (limit, pickle.loads(pickle.dumps(limit)), deepcopy(limit)):
        with pytest.raises(TypeError, match="does not support item assignment"):
            one.bodies["tool"] = []
        assert one.at(READY) == limit.at(READY)


def test_a_long_tool_stays_above_a_table_that_the_bare_arm_does_not_reach(panda):
    """Its bodies are kept from the table and from the arm, but not from the link that carries it."""
    shift = iq.transform(translation=[0.0, 0.0, 0.2])
    shaft = [Capsule([0.0, 0.0, -0.3], [0.0, 0.0, 0.0], 0.01)]
    old = ["panda_hand", "panda_leftfinger", "panda_rightfinger"]
    tip = {}
    for name, robot in (
        ("pen", panda.with_tool(shift, shaft, name="pen", without=old)),
        ("bare", panda.with_tool(shift)),
    ):
        limit, q = Clearance(robot, obstacles=[TABLE], distance=0.02), READY
        loop = iq.Controller(robot, dt=DT, limits=[limit])
        q, solution = drive(loop, q, iq.transform(translation=[0.0, 0.0, -0.35]) @ robot.pose(q), 600).end
        tip[name] = robot.pose(q)[2, 3], solution.status
        if name == "pen":
            assert str(limit.nearest) == "pen and table, 20.0 mm"
            assert {"panda_link6", "panda_link7"} == {a for a, b, _ in limit.dropped if b == "pen"}
            assert {("panda_link4", "pen"), ("panda_link5", "pen"), ("pen", "table")} <= set(limit.pairs)
            assert not {*old} & {body for pair in limit.pairs for body in pair}
    assert tip["pen"][0] == pytest.approx(0.03, abs=1e-4)
    assert tip["pen"][1] == "limited"
    assert tip["bare"][0] < -0.1
    assert tip["bare"][1] == "ok"
