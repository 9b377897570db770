"""What Python hands the compiled core is one table of named fields, which struct, parser and stub come from."""

import pickle
import re
from copy import copy, deepcopy
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest
from support.arms import ready

import invariantqp as iq
from invariantqp.engine import core
from invariantqp.legacy.loop import LegacyLoop

SOURCES = Path(__file__).parent.parent / "invariantqp" / "csrc"
pytestmark = pytest.mark.skipif(core is None, reason="no compiled core here")
NEEDED = {
    "home": np.eye(4),
    "dt": 0.01,
    "gain": 5.0,
    "rate": 10.0,
    "position_lower": -np.ones(2),
    "position_upper": np.ones(2),
    "beyond": np.ones(2),
    "fastest": np.ones(2),
}


@pytest.fixture
def fields():
    return {"law": core.Law(threshold=0.1, form="pitch", pitch=0.2), "screws": np.arange(12.0).reshape(6, 2), **NEEDED}


@pytest.mark.skipif(not SOURCES.is_dir(), reason="an installed package has no sources")
def test_the_stub_is_written_from_the_table():
    spec = spec_from_file_location("stub", SOURCES / "stub.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.STUB.read_text() == module.stub()


def test_what_is_given_is_what_is_kept(fields):
    exact = (core.Wanted(kind="axis", direction=np.eye(3)[0]), core.Wanted(kind="joints", row=np.ones(2), speed=3.0))
    fields |= {"exact": exact, "G": np.ones((3, 2)), "least": -np.ones(3), "most": np.ones(3), "carried": "tool"}
    loop = core.Loop(**fields)
    for other in (loop, pickle.loads(pickle.dumps(loop)), copy(loop), deepcopy(loop)):
        for name in fields.keys() - {"law", "exact"}:
            np.testing.assert_array_equal(getattr(other, name), fields[name])
        assert (other.law.form, other.law.pitch, other.joints, other.limits) == ("pitch", 0.2, 2, 3)
        assert [one.kind for one in other.exact] == ["axis", "joints"]
        np.testing.assert_array_equal(other.exact[1].row, np.ones(2))
        assert other.acceleration is None
        assert other.speed_limit == 0.0
        np.testing.assert_array_equal(other.pull, np.zeros(2))


def test_it_does_not_change(fields):
    loop = core.Loop(**fields)
    with pytest.raises(AttributeError):
        loop.dt = 1.0
    fields["screws"][:] = 0.0
    loop.screws[:] = 0.0
    assert loop.screws[5, 1] == 11.0


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"speed": 1.0}, "Loop() takes no 'speed'"),
        ({"joints": 2}, "Loop() takes no 'joints'"),
        ({"dt": None}, "Loop(dt=...) does not take None: tick [s]"),
        ({"law": 3}, "Loop(law=...) does not take 3: of its ticks"),
        ({"carried": "air"}, "Loop(carried=...) does not take 'air'"),
        ({"exact": (1,)}, "Loop(exact=...) does not take (1,)"),
        ({"dt": 0.0}, "do not go together"),
        ({"delay": 1e300}, "do not go together"),
        ({"fastest": np.ones(3)}, "an array of another shape"),
        ({"fastest": ["1.0", "1.0"]}, "an array of another shape"),
        ({"screws": np.ones((6, 17))}, "an array of another shape"),
        ({"G": np.ones((33, 2))}, "an array of another shape"),
        ({"law": "metric of three"}, "do not go together"),
        ({"exact": "row of three"}, "do not go together"),
    ],
    ids=str,
)
def test_what_is_wrong_is_said(fields, wrong, said):
    if wrong.get("law") == "metric of three":
        wrong = {"law": core.Law(T=np.eye(3), inverse=np.eye(3))}
    if wrong.get("exact") == "row of three":
        wrong = {"exact": (core.Wanted(kind="joints", row=np.ones(3)),)}
    with pytest.raises(TypeError, match=re.escape(said)):
        core.Loop(**fields | wrong)


def test_nothing_is_positional(fields):
    with pytest.raises(TypeError, match="by name"):
        core.Loop(fields["law"])
    del fields["gain"]
    with pytest.raises(TypeError, match=re.escape("Loop(gain=...) is missing: of the error [1/s]")):
        core.Loop(**fields)


def test_the_engine_is_an_argument_of_a_loop_and_of_a_law():
    robot = iq.load_robot("panda")
    q = ready("panda")
    target = robot.pose(q + 0.3)
    native = LegacyLoop(robot, dt=0.002)
    alone = LegacyLoop(robot, dt=0.002, engine="python")
    assert native.compiled is not None
    assert alone.compiled is None
    assert alone.law.engine == "python"
    steps = [loop.step(q, target) for loop in (native, alone, native.by_engine("python"))]
    assert [step.backend for step in steps] == ["native", *[steps[1].backend] * 2]
    for step in steps:
        np.testing.assert_allclose(step.velocity, steps[0].velocity, rtol=0.0, atol=1e-10)
    moved = native.by_engine("python")
    np.testing.assert_array_equal(moved.kept, native.kept)
    assert moved.by_engine("compiled").compiled is not None
    for make in (native.by_engine, lambda name: LegacyLoop(robot, dt=0.01, engine=name)):
        with pytest.raises(iq.BadInput, match="engine"):
            make("fortran")
