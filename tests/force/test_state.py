"""What a hybrid loop remembers is a value: it copies, pickles, and a tick changes its own controller's alone."""

import pickle
from copy import copy

import numpy as np
import pytest
from support.plane import PANDA, Bench, pen, press_on_damper

import invariantqp as iq


@pytest.fixture
def bench():
    made = Bench(iq.load_robot("panda"), PANDA, pen(), depth=-5e-4, dt=0.002)
    made.run(400)
    return made


@pytest.mark.parametrize("other", [copy, lambda loop: pickle.loads(pickle.dumps(loop))])
def test_a_copy_is_equal_and_independent(bench, other):
    twin, q, wrench = other(bench.loop), bench.q, bench.wrench()
    for _ in range(3):
        ours, its = bench.loop.step(q, bench.start, wrench), twin.step(q, bench.start, wrench)
        np.testing.assert_array_equal(ours.velocity, its.velocity)
    before = twin.state.law.bounds()
    bench.run(20)
    assert twin.state.law.bounds() == before


def test_a_saved_state_can_be_restored(bench):
    kept, q, wrench = bench.loop.state, bench.q, bench.wrench()
    one = bench.loop.step(q, bench.start, 0.5 * wrench)
    bench.loop.state = kept
    bench.loop.loop.state = bench.loop.loop.state
    assert bench.loop.step(q, bench.start, 0.5 * wrench).force == pytest.approx(one.force)


@pytest.mark.parametrize(("k", "b"), [(2e3, 0.0), (2e4, 400.0), (1e5, 0.0)])
def test_the_stiffness_is_estimated_at_the_impact(k, b):
    """Within a factor of four, which the margins allow, and an upper bound."""
    run = press_on_damper("gantry", stiffness=k, damping=b, dt=0.002, seconds=3.0)
    bound, damping, _, least = run.loop.state.law.bounds()
    assert 0.9 * k < bound < 4.0 * k
    assert least < 1.1 * k
    assert damping > 0.5 * b
