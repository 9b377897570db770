"""The rows of a clearance: gradients of coal's distances, enough for a whole tick, the same in every frame and unit."""

import numpy as np
import pytest
from scipy.optimize import linprog
from support.clearances import DT, HAND, LINKS, READY, TABLE, below, by_coal
from support.loops import drive

import invariantqp as iq
from invariantqp import engine
from invariantqp.control.loop_limits import box_of, limit_fields, loop_of
from invariantqp.engine import law
from invariantqp.limits import Box, Capsule, Clearance, HalfSpace, OtherArm, Sphere

MOST_ROWS = 16  # of a tick


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
