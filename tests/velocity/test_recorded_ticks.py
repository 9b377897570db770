"""The definition still gives the recorded answers, so the law only changes on purpose (`support/record_ticks.py`)."""

import numpy as np
import pytest
from support import record_ticks, recorded_ticks
from support.random_ticks import random_tick

from invariantqp.velocity.definition import Answer

EVERY = 20  # ticks
AGREE = 1e-8  # of `scale`: the larger of |x| and the smallest speed limit, at least 1e-6
# Near singularities rounding changes some answers by more than that; these may differ by ten times that change.
SENSITIVE = 10.0


@pytest.fixture(scope="module")
def ticks():
    return list(recorded_ticks.read())


def test_the_definition_gives_the_recorded_answers(ticks):
    for kind, tick, answer, sensitivity in ticks[::EVERY]:
        again = recorded_ticks.solve(tick)
        assert recorded_ticks.apart(tick, answer, again) <= max(AGREE, SENSITIVE * sensitivity), kind
        if isinstance(answer, Answer) and isinstance(again, Answer):
            assert [name for name, _ in again.relaxed] == [name for name, _ in answer.relaxed], kind


def test_every_kind_is_recorded(ticks):
    kinds = [make.__name__.replace("_", " ") for make in record_ticks.KINDS]
    assert list(dict.fromkeys(one.kind for one in ticks)) == kinds
    assert recorded_ticks.FILE.stat().st_size < 5e6


def test_a_file_gives_back_what_was_written(ticks, tmp_path):
    some = ticks[::40]
    recorded_ticks.write(tmp_path / "some.npz", some)
    for one, other in zip(some, recorded_ticks.read(tmp_path / "some.npz"), strict=True):
        assert one.kind == other.kind
        assert same(vars(one.tick), vars(other.tick))
        assert same(one.answer, other.answer)


def test_a_random_tick_comes_from_its_generator_alone():
    ticks = [[random_tick(np.random.default_rng(seed)) for seed in range(20)] for _ in range(2)]
    assert all(same(vars(one), vars(other)) for one, other in zip(*ticks, strict=True))


def same(one, other):
    """Whether two values are the same to the bit."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[name], other[name]) for name in one)
    if isinstance(one, (tuple, Answer)):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        return one.shape == other.shape and one.tobytes() == other.tobytes()
    if hasattr(one, "matrix"):
        return type(one) is type(other) and same(one.matrix(np.eye(6)), other.matrix(np.eye(6)))
    return one == other
