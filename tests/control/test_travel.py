"""Controllers are copied, pickled and sent to other processes, with any back end; a copy is a loop of its own."""

import copy
import pickle
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import numpy as np
import pytest
from support.arms import ready
from support.workers import steps
from support.wrist import wrist

import invariantqp as iq

DT = 0.005
START = ready("panda")
UP = iq.transform(np.diag([1.0, -1.0, -1.0]))
FAR = iq.exp([0.3, 0.2, 0.5, 0.3, -0.2, 0.4])  # joint speeds meet their limits on the way there


def wall(q, joint=1):
    """Rows that depend on where the arm is."""
    return iq.limits.LimitRows(np.eye(7)[[joint]], [-np.inf], [0.5 - q[joint]])


def pink_limits(robot):
    from pink.limits import VelocityLimit

    return [VelocityLimit(robot.model)]


OPTIONS = {
    "plain": lambda _: {},
    "osqp": lambda _: {"backend": "osqp"},
    "quadprog": lambda _: {"backend": "quadprog"},
    "exact and fast": lambda _: {
        "exact": [iq.control.ExactPoint(), iq.control.ExactAxis([0, 0, 1])],
        "tool_speed": 0.2,
    },
    "braking": lambda _: {"acceleration_limit": 10.0, "position_margin": 0.01, "posture_gain": 2.0},
    "carried": lambda _: {"form": iq.CarriedMetric(np.ones(6))},
    "rows": lambda _: {"rows": partial(wall, joint=3)},
    "pink": lambda robot: {"limits": pink_limits(robot)},
}
TRAVELS = {"copied": copy.copy, "deep-copied": copy.deepcopy, "pickled": lambda loop: pickle.loads(pickle.dumps(loop))}


def used(robot, case):
    """A loop after some ticks, and where the arm is then."""
    loop, q = iq.Controller(robot, dt=DT, **{"form": 0.3} | OPTIONS[case](robot)), START
    for velocity in steps(loop, q, FAR @ robot.pose(START), 5):
        q = q + DT * velocity
    return loop, q


WAYS = [(case, way) for case in OPTIONS for way in TRAVELS if (case, way) != ("pink", "pickled")]  # Pink refuses


@pytest.mark.parametrize(("case", "way"), WAYS)
def test_a_copy_goes_on_where_the_loop_was(panda, case, way):
    loop, q = used(panda, case)
    again, target = TRAVELS[way](loop), FAR @ panda.pose(START)
    np.testing.assert_allclose(steps(again, q, target, 5), steps(loop, q, target, 5), rtol=1e-12, atol=1e-12)
    assert again.state == loop.state


def test_a_controller_crosses_a_process_pool(panda):
    loop, q = used(panda, "osqp")
    target = FAR @ panda.pose(START)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        there = pool.submit(steps, loop, q, target, 3).result(60.0)
    np.testing.assert_allclose(there, steps(loop, q, target, 3), rtol=1e-12, atol=1e-12)


def test_a_returned_velocity_may_be_changed(panda):
    """The controller keeps its own copy of what it commanded, for the acceleration limits of the next tick."""
    (one, q), (other, _) = used(panda, "braking"), used(panda, "braking")
    target = FAR @ panda.pose(START)
    one.step(q, target).velocity[:] = np.nan
    other.step(q, target)
    np.testing.assert_array_equal(one.step(q, target).velocity, other.step(q, target).velocity)


def hybrid(robot, contact):
    task = iq.HybridTask(contact, [5.0], max_force=50.0)
    return iq.HybridController(robot, task, dt=DT, sensor=wrist(cutoff=20.0, mass=0.3), gain=5.0)


@pytest.mark.parametrize("way", TRAVELS)
def test_a_hybrid_controller_travels_with_what_it_remembers(panda, way):
    contact = iq.point_contact(panda.pose(START)[:3, 3], [0.0, 0.0, 1.0])
    loop, target = hybrid(panda, contact), panda.pose(START)
    loop.step(START, target, [0, 0, 0, 0.1, 0.2, 4.0])
    again = TRAVELS[way](loop)
    readings = [[0, 0, 0, 0.0, 0.1, 5.0], [0, 0, 0, 0.0, 0.1, 60.0], [0, 0, 0, 0.0, 0.1, 3.0]]
    for reading in readings:
        a, b = again.step(START, target, reading), loop.step(START, target, reading)
        assert a == b
        assert pickle.loads(pickle.dumps(a)) == b
    assert a.status == "overload"


def test_a_relabelled_task_whose_contact_moves_can_be_pickled(panda):
    task = iq.HybridTask(partial(contact_under, normal=(0.0, 0.0, 1.0)), [5.0])
    moved = task.relabelled(iq.exp([0.1, 0.2, 0.3, 0, 0, 0]), iq.exp([0, 0, 0, 0.1, 0, 0]))
    again, tool = pickle.loads(pickle.dumps(moved)), panda.pose(START)
    np.testing.assert_array_equal(again.contact_at(tool).pose, moved.contact_at(tool).pose)


def contact_under(tool, normal):
    return iq.point_contact(tool[:3, 3], normal)


VALUES = {
    "twist": iq.control.ExactTwist,
    "point": lambda: iq.control.ExactPoint([1, 2, 3]),
    "axis": lambda: iq.control.ExactAxis([1, 2, 3]),
    "plane": lambda: iq.control.ExactPlane([1, 2, 3], [0, 0, 1]),
    "joints": lambda: iq.control.ExactJoints(np.eye(3)),
    "shared": lambda: iq.control.SharedTask(np.eye(6)[:, :2], np.eye(6)[:, 2:]),
    "sensor": lambda: wrist(UP, mass=0.3, centre=[0, 0, 0.1]),
    "chain": lambda: iq.robots.Chain(np.eye(6), np.eye(4)),
    "target": lambda: iq.Target([0.1, 0.2, 0.3], [0.0, 0.0, 2.0], tool_axis=[1.0, 0.0, 0.0]),
    "joint limits": lambda: iq.limits.JointLimits(-1.0, [1.0, 2.0], 3.0, 0.1),
    "acceleration": lambda: iq.limits.AccelerationLimit([1.0, 2.0]),
    "limit rows": lambda: iq.limits.LimitRows([[1.0, 2.0]], [-1.0], [1.0], "a"),
    "tool speed": lambda: iq.limits.ToolSpeed(0.25, (0.0, 0.0, 1.0)),
    "bounds": lambda: iq.Bounds([-1.0], [1.0]),
    "exact rows": lambda: iq.ExactRows([[1.0, 2.0]], [0.5]),
    "pitch": lambda: iq.PitchForm(0.3),
    "complement": lambda: iq.Complement(np.eye(6)[:, :2]),
    "metric": lambda: iq.CarriedMetric(np.ones(6)),
    "metric at a pose": lambda: iq.CarriedMetric(np.eye(6), np.eye(4)),
    "guard": lambda: iq.Guard(0.7),
    "twist task": lambda: iq.velocity.TwistTask(np.eye(6), np.ones(6), form=0.3),
    "joint task": lambda: iq.velocity.JointTask([1.0, 2.0]),
}


@pytest.mark.parametrize("name", VALUES)
def test_values_compare_hash_and_show_themselves(name):
    value, again = VALUES[name](), VALUES[name]()
    assert value == again
    assert hash(value) == hash(again)
    assert value != object()
    assert all(value != other() for key, other in VALUES.items() if key != name)
    assert repr(value).startswith(type(value).__name__ + "(")
    assert len(repr(value)) < 300
    assert "\n" not in repr(value)
    for travel in TRAVELS.values():
        there = travel(value)
        assert there == value
        assert hash(there) == hash(value)
        assert all(not a.flags.writeable for a in vars(there).values() if isinstance(a, np.ndarray))
    for name in ("name", *vars(value)):
        with pytest.raises(AttributeError):
            setattr(value, name, 0.0)


def test_values_keep_their_own_arrays():
    point, normal, mount = np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.0, 1.0]), np.eye(4)
    plane, sensor = iq.control.ExactPlane(normal, point), wrist(mount)
    point[:], normal[:], mount[:] = 7.0, 7.0, 7.0
    assert plane == iq.control.ExactPlane([0, 0, 1], [1, 2, 3])
    assert sensor == wrist()
    with pytest.raises(ValueError, match="read-only"):
        plane.point[0] = 7.0
