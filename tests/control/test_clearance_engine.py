"""The engine's clearance by itself: rows are gradients, chains of any length, no pairs, hostile arguments."""

import pickle
from copy import deepcopy

import numpy as np
import pytest
from support.arms import ready

import invariantqp as iq
from invariantqp.control.loop_limits import loop_of
from invariantqp.engine import law
from invariantqp.limits import Box, Clearance, HalfSpace, OtherArm, Sphere


def sphere(body, mover, place, radius=0.05):
    return (body, mover, 0.0, radius, *np.zeros(3), *np.eye(3).ravel(), *place)


def arm(screws):
    m = np.shape(screws)[1]
    free = np.full(m, np.inf)
    return np.asarray(screws), range(m), np.array((np.full(m, 2.0), free, -free, free)), np.zeros(m), False


def snake(m):
    """Hinges about z and y in turn, 0.1 apart along x."""
    return np.column_stack([iq.revolute(((0, 0, 1), (0, 1, 0))[i % 2], (0.1 * i, 0, 0)) for i in range(m)])


def rate_of(m, alpha=10.0, dt=0.002, acceleration=np.inf, delay=0.0):
    return law.ClearanceRate(np.array([[2.0] * m, [acceleration] * m, [-9.0] * m, [9.0] * m]), alpha, dt, 1 / dt, delay)


@pytest.mark.parametrize("m", [1, 2, 7, 30, 64])
@pytest.mark.parametrize("acceleration", [np.inf, 3000.0])
def test_a_row_is_the_gradient_of_the_distance_for_chains_of_any_length(m, acceleration):
    rng = np.random.default_rng(m)
    tip = sphere(m, -1, (0.1 * m, 0, 0))
    one = law.Clearance(0.02, [arm(snake(m))], np.array([tip, sphere(0, 0, (0, 0, 0))]), [[0, 1, 0]], 1)
    checked = 0
    for _ in range(30):
        q = rng.uniform(-0.3, 0.3, m)
        here = iq.robots.Chain(snake(m), iq.transform(translation=[0.1 * m, 0, 0])).pose(q)[:3, 3]
        out = rng.normal(size=3)
        one.move(0, iq.transform(translation=here + 0.125 * out / np.linalg.norm(out)))
        found = one.rows(q, np.zeros(m), rate_of(m, acceleration=acceleration))
        assert one.distances(q)[0] == pytest.approx(0.025, abs=1e-12)
        if found is None:
            continue
        C, lower, upper, pairs, apart = found
        x, h = rng.normal(size=m), 1e-6
        slope = (one.distances(q + h * x)[0] - one.distances(q - h * x)[0]) / (2.0 * h)
        assert C[0] @ x == pytest.approx(slope, abs=1e-7 * m)
        assert pairs == [0]
        assert apart[0] == pytest.approx(0.025)
        assert np.isposinf(upper).all()
        assert lower[0] <= 0.0
        checked += 1
    assert checked > 10 or m == 1


def test_velocity_zero_keeps_the_rows_of_what_is_far_enough_and_at_rest(panda):
    """And so does any velocity of a tick that ends no nearer than the rate allows."""
    limit = Clearance(panda, None, [Box(iq.transform(translation=[0.5, 0.2, 0.3]), [0.2, 0.3, 0.2])])
    rng, asked = np.random.default_rng(1), 0
    rate = limit.in_loop(loop_of(panda, 0.002, 0.0))
    for _ in range(200):
        q = ready("panda") + rng.uniform(-0.4, 0.4, 7)
        rows = limit.rows_at(q, rate, np.zeros(7))
        if rows is None or limit.nearest.distance < 0.02:
            continue
        asked += 1
        assert (rows.lower <= 0.0).all()
        assert limit.rows_after(q, np.zeros(7), rate) is None
    assert asked > 20


def test_a_pair_that_is_near_in_half_a_turn_and_not_beyond_it_counts():
    hinge = np.array([iq.revolute((0, 0, 1), (0, 0, 0))]).T
    table = np.array([sphere(1, -1, (1, 0, 0)), sphere(0, 0, (0, 0.5, 0), 1.05)])
    for upper, always in ((np.pi, True), (4.5, False)):
        limits = np.array([[2.0], [np.inf], [0.0], [upper]])
        one = law.Clearance(0.02, [(hinge, [0], limits, np.zeros(1), False)], table, [[0, 1, 0]], 1)
        one.start()
        assert one.always_near() == ([0] if always else [])


def test_nothing_to_keep_apart_has_no_rows():
    empty = np.zeros((0, 19)), np.zeros((0, 3))
    one = law.Clearance(0.02, [arm(snake(3))], *empty)
    one.start()
    assert one.rows(np.zeros(3), None, rate_of(3)) is None
    assert one.after(np.zeros(3), np.ones(3), rate_of(3)) is None
    assert one.nearest == (-1, np.inf)
    assert one.distances([0, 0, 0]).shape == (0,)
    assert one.poses([0, 0, 0]).shape == (0, 4, 4)
    begun = []
    loop = law.ClearanceInLoop(one, rate_of(3), begun.append)
    assert loop.last is None
    for time in (0.0, 0.002):
        loop.begin(np.zeros(3))
        assert loop.last == time
    assert len(begun) == 1
    np.testing.assert_array_equal(begun[0], np.zeros(3))


SHAPES = np.array([sphere(3, -1, (0.3, 0, 0)), sphere(0, 0, (0, 0, 0)), sphere(5, 1, (0.5, 0.5, 0))])
PAIRS = np.array([[0, 1, 0], [0, 2, 1]])


def made(**other):
    given = {"distance": 0.02, "arms": [arm(snake(3)), arm(snake(2))], "shapes": SHAPES, "pairs": PAIRS,
             "obstacles": 1}  # fmt: skip
    return law.Clearance(**(given | other))


WRONG = [None, "text", np.zeros(2), np.zeros(4), np.zeros((3, 1)), np.full(3, np.nan), np.full(3, np.inf),
         np.full(3, 1j), [None] * 3, [True] * 3, np.zeros(0), 1.0, object()]  # fmt: skip


def moved(column, by):
    table = SHAPES.copy()
    table[:, column] += by
    return table


def wrong_clearances():
    screws, each, limits, turns, _ = arm(snake(3))
    for distance in (-1.0, np.nan, np.inf, "far"):
        yield {"distance": distance}
    for one in (3, (1, 2), (screws[:, :0], each[:0], limits[:, :0], turns[:0], False),
                (screws[:, :2], each[:2], limits, turns, False), (screws, (0, 1, 3), limits, turns, False),
                (screws, (0, -1, 1), limits, turns, False), (screws, (0, 0.5, 1), limits, turns, False),
                (screws, (0, 1), limits, turns, False), (screws, None, limits, turns, False),
                (screws, each, limits[:3], turns, False), (screws, each, limits, turns[:2], False),
                (screws * np.nan, each, limits, turns, False), arm(snake(65))):  # fmt: skip
        yield {"arms": [one, one]}
    yield {"arms": []}
    shifts = ((0, 9.0), (0, 0.5), (0, 1.0), (1, 5.0), (1, -2.0), (2, 3.0), (2, 7.0), (2, -1.0), (3, -1.0), (4, np.nan))
    for column, by in shifts:
        yield {"shapes": moved(column, by)}
    for shapes in (SHAPES[:, :18], SHAPES[0], SHAPES[[1, 0, 2]], None, 3):
        yield {"shapes": shapes}
    for pairs in ([[0, 3, 0]], [[1, 0, 0]], [[-1, 0, 0]], [[0, 1]], [[0, 1, np.nan]], [[0, 1.5, 0]], 0):
        yield {"pairs": pairs}
    for obstacles in (-1, 0, 10**6, 1.5):
        yield {"obstacles": obstacles}


@pytest.mark.parametrize("other", list(wrong_clearances()))
def test_what_is_no_clearance_is_refused(other):
    with pytest.raises((ValueError, TypeError, RuntimeError)):
        made(**other)


def test_arguments_of_a_tick_that_are_wrong_are_refused_and_change_nothing():
    one, rate, q = made(), rate_of(3), np.array([0.1, -0.2, 0.3])
    one.start()
    loop = law.ClearanceInLoop(one, rate, print)
    memory, pose = one.memory(), np.eye(4)
    for wrong in WRONG:
        calls = [(one.rows, wrong, q, rate), (one.after, wrong, q, rate), (one.after, q, wrong, rate),
                 (one.distances, wrong), (one.poses, wrong), (loop.begin, wrong), (one.move, 0, wrong),
                 (one.move_arm, 0, wrong, np.zeros(3)), (one.rows, q, q, wrong), (one.remember, wrong),
                 (law.ClearanceRate, wrong, 1.0)]  # fmt: skip
        calls += [] if wrong is None else [(one.rows, q, wrong, rate), (one.move, 0, pose, wrong)]
        for call, *given in calls:
            with pytest.raises((ValueError, TypeError, IndexError)):
                call(*given)
    for call, *given in ((one.move, 1, pose), (one.move, -1, pose), (one.move_arm, 1, [0, 0]),
                         (one.move_arm, -1, [0, 0]), (one.rows, q, q, rate_of(4)),
                         (law.ClearanceInLoop, one, rate_of(4), print), (law.ClearanceInLoop, one, rate, None),
                         (one.after, q, q, law.ClearanceRate(np.ones((4, 3)), 1.0)),
                         (rate_of, 3, -1.0), (rate_of, 3, np.nan), (rate_of, 3, 1.0, 0.1, 0.0)):  # fmt: skip
        with pytest.raises((ValueError, TypeError)):
            call(*given)
    np.testing.assert_array_equal(one.memory(), memory)


def test_lists_and_float32_are_taken():
    one, rate, q = made(), rate_of(3), np.array([0.1, -0.2, 0.3])
    one.move(0, iq.transform(translation=[0.3, 0.05, 0.12]).tolist())
    one.start()
    for other in (q.tolist(), q.astype(np.float32), np.repeat(q, 2)[::2], np.asfortranarray(q)):
        np.testing.assert_allclose(one.distances(other), one.distances(q), atol=1e-7)
        for a, b in zip(one.rows(other, None, rate)[:2], one.rows(q, None, rate)[:2], strict=True):
            np.testing.assert_allclose(a, b, atol=1e-6)


def test_numbers_stay_finite_for_limits_positions_and_rooms_of_any_size(ur5):
    rng, other = np.random.default_rng(3), OtherArm(ur5, name="other", acceleration_limit=3.0)
    limit = Clearance(ur5, None, [Sphere([0.4, 0, 0.4], 0.1), HalfSpace([0, 0, -0.3], [0, 0, 1]), other])
    for _ in range(200):
        size = 10.0 ** rng.uniform(-8, 8)
        q, before = rng.uniform(-6, 6, 6), size * rng.uniform(-3, 3, 6)
        other.move(rng.uniform(-6, 6, 6), rng.uniform(-3, 3, 6) * size)
        loop = loop_of(ur5, 10.0 ** rng.uniform(-4, 0), rng.choice([0.0, 0.1]))
        acceleration = rng.choice([np.inf, 1e-8, 1.0, 1e8], size=6)
        rows = limit.rows_at(q, limit.in_loop(loop._replace(acceleration=acceleration)), before)
        if rows is not None:
            assert np.isfinite(rows.C).all()
            assert np.isfinite(rows.lower).all()


def test_a_copy_remembers_what_the_first_one_does_and_then_goes_its_own_way(panda):
    ball = Sphere([0, 0, 0], 0.1, name="ball")
    limit, q = Clearance(panda, None, [ball]), ready("panda")
    at, loop = panda.pose(q)[:3, 3], iq.Controller(panda, dt=0.01, limits=[limit])
    for i in range(20):
        ball.move(iq.transform(translation=[at[0], at[1] + 0.4 - 0.005 * i, at[2]]))
        loop.step(q, panda.pose(q))
    found = limit._engine.memory()
    assert limit._engine.twist(0)[4] == pytest.approx(-0.5, rel=0.2)
    for one in (pickle.loads(pickle.dumps(limit)), deepcopy(limit)):
        np.testing.assert_array_equal(one._engine.memory(), found)
        np.testing.assert_array_equal(one._engine.twist(0), limit._engine.twist(0))
        rate = limit.in_loop(loop_of(panda, 0.01, 0.0))
        assert (one.rows_at(q, rate).lower == limit.rows_at(q, rate).lower).all()
        one.obstacles[0].move(iq.transform(translation=[0, 0, 5.0]))
        assert one.at(q).distance > limit.at(q).distance
    rate = pickle.loads(pickle.dumps(limit.in_loop(loop_of(panda, 0.01, 0.02))))
    assert rate.dt == 0.01
    with pytest.raises(IndexError):
        limit._engine.remember(found[:-1])
    with pytest.raises(IndexError):
        limit._engine.remember(np.zeros(len(found)))
