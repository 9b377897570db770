"""A hybrid tick in the compiled core is the tick of Python, from what was kept to what is kept, word by word."""

import pickle
import runpy
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
from support.arms import ready
from support.repeats import repeats
from support.spring_plane import exerted, tip
from support.two_laws import same_reasons
from support.wrist import wrist

import invariantqp as iq
from invariantqp.engine import core
from invariantqp.force import control
from invariantqp.force.control import PACKING, Memory
from invariantqp.force.estimate import SLOWER, UNKNOWN

pytestmark = pytest.mark.skipif(core is None, reason="no compiled core here")
SHARED = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "shared" / "contact_scenes.py"))
EACH = np.repeat((0.03, 1.0), 3)
NEAR = 1e-8
TICKS = 300  # where a normal is looked for, rounding grows by ten in a hundred ticks
OPTIONS = {
    "lost_below": 0.0,
    "on_loss": "continue",
    "slide_speed": 0.02,
    "yields": 0.01,
    "max_force": 60.0,
    "compliance": 2e-5,
    "stiffness": 5e3,
    "lost_after": 0.0,
}
LOOPS = {"acceleration_limit": 5.0, "tool_speed": 0.1, "force_first": False, "point": [0.0, 0.0, 0.05]}


def reading_of(random, loop, tool, pushes, noise, fault, since):
    """What a sensor reads of a wrench that the world exerts, or a hostile one."""
    if loop.sensor is None:
        return -pushes
    reading = iq.coadjoint(iq.inverse(tool @ loop.sensor.mount)) @ pushes + noise * EACH * random.normal(size=6)
    if not since:
        return reading
    hostile = {
        "dead": np.ones(6),
        "bias": reading + 3.0 * EACH,
        "drift": reading + 1e-3 * since * EACH,
        "sign": -reading,
        "huge": 1e6 * reading,
    }
    return hostile.get(fault, reading)


def assert_same_loop(seed):
    """A whole loop, each tick by both engines. What is held is read with noise: its ways may be rounding, and without
    noise an estimate would take rounding for way."""
    random = np.random.default_rng(seed)
    arm = str(random.choice(["panda", "ur5", "so101"]))
    robot, q = iq.load_robot(arm), ready(arm)
    scenes = SHARED["scenes"](robot.pose(q), 0.015)
    scene = scenes[str(random.choice(sorted(scenes)))]
    dt = float(random.choice([0.001, 0.002, 0.005, 0.01]))
    noise = float(random.choice([0.0, 0.05, 0.2] if scene.told(robot.pose(q)).kind.presses else [0.05, 0.2]))
    some = {name: value for name, value in OPTIONS.items() if random.random() < 0.15}
    task = iq.HybridTask(scene.told, scene.wanted, **scene.options | some)
    told = {name: value for name, value in LOOPS.items() if random.random() < 0.2}
    delay = dt * float(random.choice([0.0, 0.0, 1.0, 2.5]))
    if random.random() < 0.2 and not noise:
        told["order"] = "moment first"
    else:
        mount = iq.exp([0.2, -0.1, 0.3, 0.01, 0.02, -0.05]) if random.random() < 0.5 else np.eye(4)
        cleans = {"cutoff": 50.0, "force_deadband": 0.1, "moment_deadband": 0.01, "origin": [0.0, 0.0, 0.05]}
        cleans = {name: value for name, value in cleans.items() if random.random() < 0.5}
        told["sensor"] = wrist(mount, noise=noise, **cleans)
    loops = [iq.HybridController(robot, task, dt=dt, delay=delay, engine=by, **told) for by in ("compiled", "python")]
    late, fault = (
        [np.zeros(len(q))] * round(delay / dt),
        str(random.choice(["none", "dead", "bias", "drift", "sign", "huge"])),
    )
    begins, twist, wanted = int(random.integers(TICKS)), np.zeros(6), random.random() < 0.2
    for k in range(TICKS):
        tool, (target, ahead) = robot.pose(q), scene.path(max(0.0, dt * k - 0.3))
        pushes = np.asarray(scene.world(tool, twist))
        reading = reading_of(random, loops[0], tool, pushes, noise, fault, max(0, k - begins))
        more = {"velocity": late[-1] if late else np.zeros(len(q))} if seed % 3 == 0 else {}
        if wanted:
            n = len(loops[0].splits.at(loops[0].task.contact_at(tool), tool).unit_parts)
            more["wanted"] = (1.0 + 0.3 * np.sin(0.01 * k)) * np.array(scene.wanted)[:n] if n != 6 else None
        ours, theirs = (loop.step(q, target, reading, ahead, **more) for loop in loops)
        assert same_reasons(ours.velocity_solution.reasons, theirs.velocity_solution.reasons)
        said = [(one.status, one.reason.removesuffix(one.velocity_solution.reason)) for one in (ours, theirs)]
        assert said[0] == said[1], k
        for name in ("velocity", "twist", "J", "wrench", "error", "intensities", "wanted"):
            python = getattr(theirs, name)
            near = NEAR * (1.0 + np.abs(python).max(initial=0.0))
            np.testing.assert_allclose(getattr(ours, name), python, rtol=0.0, atol=near)
        assert loops[0].room == pytest.approx(loops[1].room, abs=NEAR)
        late.append(ours.velocity)
        command = late.pop(0)
        twist, q = ours.J @ command, q + dt * command


@pytest.mark.parametrize("seed", range(repeats(200, 2)))
def test_both_engines_give_the_same_loop(seed):
    assert_same_loop(seed)


@pytest.fixture
def pressing():
    """A controller that has touched, and what it is given next."""
    robot, q = iq.load_robot("panda"), ready("panda")
    start = robot.pose(q)
    loop = iq.HybridController(robot, iq.HybridTask(tip, [5.0]), dt=0.002, order="moment first")
    for _ in range(250):
        given = q, start, exerted([robot.pose(q)[:3, 3]], start[2, 3] - 1e-3, 1e4)
        q = q + 0.002 * loop.step(*given).velocity
    return loop, (q, *given[1:])


def test_what_is_kept_is_the_same_in_numbers(pressing):
    loop, _ = pressing
    numbers = loop._kept
    assert isinstance(numbers, bytes)
    assert PACKING.packed(PACKING.unpacked(numbers)) == numbers
    assert PACKING.packed(Memory()) is not None
    assert PACKING.packed(PACKING.unpacked(PACKING.packed(Memory()))) == PACKING.packed(Memory())


@pytest.mark.parametrize("engine", ["compiled", "python"])
def test_a_speed_along_the_surface_counts_for_as_long_as_an_estimate_looks_back(engine):
    robot, q, dt = iq.load_robot("panda"), ready("panda"), 0.005
    start, along = robot.pose(q), []
    loop = iq.HybridController(robot, iq.HybridTask(tip, [5.0]), dt=dt, order="moment first", engine=engine)
    for k in range(120):
        tool = robot.pose(q)
        ahead = np.array([0.0, 0.0, 0.0, 0.03 if 40 <= k < 80 else 0.0, 0.0, 0.0])
        reading = exerted([tool[:3, 3]], start[2, 3] - 1e-3, 1e4)
        q = q + dt * loop.step(q, tool, reading, ahead).velocity
        along.append(loop.memory.pressing.along)
    late = dt + loop._delay.arm + UNKNOWN
    assert along[79] == pytest.approx(0.03, rel=1e-3)
    assert along[-1] / along[-2] == pytest.approx(np.exp(-dt / (SLOWER * late)), rel=1e-9)


def test_a_tick_changes_no_state_but_its_own(pressing):
    """Copies, pickled ones too, go on alike; what was kept before is as it was."""
    loop, given = pressing
    before = loop._kept
    others = deepcopy(loop), pickle.loads(pickle.dumps(loop))
    told = loop.step(*given)
    for other in others:
        assert other._kept == before
        np.testing.assert_array_equal(other.step(*given).velocity, told.velocity)
        assert other._kept == loop._kept


def test_a_tick_that_is_handed_back_changes_nothing(pressing, monkeypatch):
    loop, (q, target, wrench) = pressing
    kept = []
    core_press = control.compiled_press
    monkeypatch.setattr(control, "compiled_press", lambda *a, **k: kept.append(core_press(*a, **k)) or kept[-1])
    before, inner = loop._kept, loop.loop.kept.copy()
    for wrong in ({"feedforward": np.full(6, np.nan)}, {"posture": np.ones(3)}):
        with pytest.raises(iq.BadInput):
            loop.step(q, target, wrench, **wrong)
    assert kept == [None, None]
    assert loop.memory.pressing.lag == PACKING.unpacked(before).pressing.lag
    np.testing.assert_array_equal(loop.loop.kept, inner)
    assert loop.step(q, target, 1e3 * wrench).status == "overload"  # what a check finds is told by Python
    assert kept[-1] is None
