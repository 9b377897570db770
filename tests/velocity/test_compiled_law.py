"""The engine is the definition: recorded ticks of closed loops, random ticks; and nothing but numbers gets in."""

from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from support.random_ticks import random_tick
from support.recorded_ticks import FAILED, NO_PSEUDOINVERSE, apart, engine_fields, perturbed, read, scale, solve

import invariantqp as iq
from invariantqp import _core
from invariantqp.velocity import definition
from invariantqp.velocity.backends import backend_of

# Solvers of the definition stop at tolerances of about this much; the engine's answers have ten digits and more.
SOLVERS = 1e-7


@pytest.fixture
def rng():
    return np.random.default_rng(70)


def engine(tick):
    """The engine's answer, as far as the definition has it; and by how much which rows gave way."""
    x, pace, share, missed, guarded, relaxed, faster, failure, _, _ = _core.tick(**engine_fields(tick))
    if failure:
        return (FAILED, NO_PSEUDOINVERSE)[failure - 1]
    names = ("row",) * int(relaxed is not None) + ("speed",) * int(faster > 0.0)
    return definition.Answer(x, pace, share, missed, names, guarded)


def inside(tick, x):
    """The velocity without rounding past its limits."""
    return np.clip(x, tick.lower, tick.upper)


def outside(tick, x):
    """By how much a velocity is outside the box, relative to `scale`."""
    return max(float((tick.lower - x).max()), float((x - tick.upper).max()), 0.0) / scale(tick, x)


def distance(tick, one, other):
    """How far two answers are apart inside the limits, relative to `scale`."""
    return np.linalg.norm(inside(tick, one.velocity) - inside(tick, other.velocity)) / scale(tick, other.velocity)


def test_recorded_ticks_of_every_kind_agree_with_the_definition():
    least_digits = []
    for i, (kind, tick, expected, sensitivity) in enumerate(read()):
        answer = engine(tick)
        if isinstance(expected, str):
            continue
        assert not isinstance(answer, str), (i, kind)
        tolerance = max(1e-8, 10.0 * sensitivity, 100.0 * outside(tick, expected.velocity))
        off = distance(tick, answer, expected)
        if off > max(SOLVERS, tolerance):  # where DAQP ends early
            off = distance(tick, answer, definition.velocity(tick, backend_of("quadprog")))
        if off > tolerance:
            least_digits.append((i, kind, off))
        assert off <= max(SOLVERS, tolerance) or (kind == "random kind" and off < 1e-4), (i, kind, off)
        if tolerance <= SOLVERS and expected.scale > SOLVERS and kind != "random kind":
            measured, theirs = (
                (one.approach_scale, one.scale, one.form_share, one.residual / max(1.0, expected.residual))
                for one in (answer, expected)
            )
            np.testing.assert_allclose(measured, theirs, atol=1e-5, err_msg=f"{i} {kind}")
        assert bool(answer.relaxed) == bool(expected.relaxed) or kind in {"random kind", "scales"}, (i, kind)
    assert len(least_digits) <= 8, least_digits


@pytest.mark.parametrize("seed", range(60))
def test_random_ticks_agree_with_the_definition_or_are_inside_all_limits(seed):
    tick = random_tick(np.random.default_rng(seed + 10_000))
    answer, expected = engine(tick), solve(tick)
    if isinstance(answer, str):
        assert isinstance(expected, str) or tick.form is not None
        return
    x = answer.velocity
    assert np.isfinite(x).all()
    assert outside(tick, x) <= 1e-9 or (tick.lower == tick.upper).any()
    if tick.rows is not None and not answer.relaxed:
        value, margin = tick.rows.C @ x, 1e-7 * np.linalg.norm(tick.rows.C, axis=1) * scale(tick, x)
        assert ((value >= tick.rows.lower - margin) & (value <= tick.rows.upper + margin)).all()
    if isinstance(expected, str) or outside(tick, expected.velocity) > 1e-10:
        return
    if tick.form is not None and np.linalg.cond(tick.root @ tick.J) > 1e8:  # where a projector has few digits left
        return
    off = np.linalg.norm(x - expected.velocity) / scale(tick, expected.velocity)
    if off > SOLVERS:
        again = [solve(perturbed(tick, np.random.default_rng(k))) for k in range(4)]
        off -= 10.0 * max(apart(tick, expected, other) for other in again)
    assert off <= SOLVERS


def test_levels_are_those_of_the_definition(rng):
    for _ in range(40):
        m = int(rng.integers(4, 10))
        ticks = []
        for _ in range(int(rng.integers(1, 4))):
            n = int(rng.integers(1, 3))
            J, s = rng.normal(size=(6 * n, m)) * (rng.random((6 * n, 1)) < 0.5), rng.normal(size=6 * n)
            J[0] += 0.1
            ticks.append(alone(J, s, rng.uniform(0.1, 2.0)))
        levels = [(tick.J, tick.root, tick.feedforward) for tick in ticks]
        found = _core.solve_levels(levels, lower=ticks[0].lower, upper=ticks[0].upper)
        ticks = [replace(tick, lower=ticks[0].lower, upper=ticks[0].upper) for tick in ticks]
        expected = definition.prioritised(ticks).velocity
        np.testing.assert_allclose(found[0], expected, atol=1e-6 * max(1.0, np.abs(expected).max()))


def alone(J, s, speed):
    """A twist by itself inside a box."""
    n, m = J.shape
    free, box = np.full(m, inf), np.full(m, speed)
    return definition.Tick(J, np.eye(n), s, np.zeros(n), -box, box, -free, free)


def test_64_joints_and_256_rows_are_solved_and_more_are_refused(rng):
    J, s, wide = rng.normal(size=(6, 64)), rng.normal(size=6), np.full(64, 1.0)
    C = rng.normal(size=(256, 64))
    tight = np.full(256, 0.05)
    x = _core.solve(J, s, lower=-wide, upper=wide, rows=(C, -tight, tight))[0]
    assert (np.abs(C @ x) <= 0.05 + 1e-9).all()
    expected = iq.solve_velocity(J, s, bounds=(-wide, wide), rows=iq.limits.LimitRows(C, -tight, tight), backend="daqp")
    np.testing.assert_allclose(x, expected.velocity, atol=1e-7)
    with pytest.raises(iq.errors.BadInput, match="at most 64"):
        iq.solve_velocity(rng.normal(size=(6, 65)), s)
    with pytest.raises(iq.errors.BadInput, match="at most 256"):
        iq.solve_velocity(J, s, rows=iq.limits.LimitRows(np.vstack((C, C[:1])), [-1.0] * 257, [1.0] * 257))


def calls(rng):
    """Arguments of each bound function."""
    J, s, m = rng.normal(size=(6, 7)), rng.normal(size=6), 7
    box = {"lower": np.full(m, -1.0), "upper": np.full(m, 1.0)}
    rows = {"rows": (rng.normal(size=(2, m)), np.full(2, -0.1), np.full(2, 0.1))}
    plain = {"posture": rng.normal(size=m), "metric": np.eye(m), "damping": 0.1, "guard": 0.5}
    memory = {"velocity_limit": np.full(m, 2.0), "last_velocity": np.zeros(m), "hold_time": 0.01, "last_residual": 0.1}
    exact = {"exact": (J[:2], s[:2], np.eye(6)[:2])}
    numbers = {"root": np.eye(6), "form": ("pitch", 0.3)}
    tick = {"J": J, "feedforward": s, "error": s, "position_lower": box["lower"], "position_upper": box["upper"]}
    demands = {"exact": (J[:2], s[:2], s[:2]), "tool_speed": (J[3:], 0.2)}
    one = {"J": J, "twist": s, "point": np.zeros(3), "length": 1.0, "tool_speed": (np.zeros(3), 0.2)}
    many = {"J": rng.normal(size=(5, 6, m)), "twist": rng.normal(size=(5, 6)), "points": np.zeros((5, 3))}
    many |= {"lower": np.full((5, m), -1.0), "upper": np.full((5, m), 1.0), "posture": np.zeros((5, m))}
    frame = {"J": J, "error": s, "gain": 0.5, "lm_damping": 0.1}
    at_point = {"costs": np.ones(6), "point": np.zeros(3), "form": ("pitch", 0.3), "damping": 0.1, "guard": 0.5}
    levels = {"levels": [(J, np.eye(6), s), (J, np.eye(6), s)], "tool_speed": (J[3:], 0.2), "metric": np.eye(m)}
    return {
        "tick": tick | box | rows | plain | memory | demands | numbers,
        "solve": one | box | rows | exact | plain | numbers,
        "solve_rows": many
        | {"length": 1.0, "metric": np.eye(m), "damping": 0.1, "guard": 0.5}
        | numbers
        | {"threads": 2},
        "solve_levels": levels | box | rows | exact | {"damping": 0.1},
        "frame_cost": frame | at_point,
        "frame_cost by a root": frame | {"root": np.eye(6)},
    }


NAMES = list(calls(np.random.default_rng(0)))
BAD = {
    "a text": "seven",
    "an object": object(),
    "a set": {1.0, 2.0},
    "complex numbers": np.full((6, 7), 1j),
    "texts": np.array([["a"] * 7] * 6),
    "truth values": np.full((6, 7), fill_value=True),
    "objects": np.full((6, 7), None),
    "no dimension": np.float64(1.0),
    "no numbers": np.zeros((0, 7)),
    "four dimensions": np.zeros((1, 6, 7, 1)),
    "too long": np.zeros(1000),
    "too wide": np.zeros((6, 1000)),
    "a ragged list": [[1.0, 2.0], [3.0]],
    "a masked array": np.ma.masked_array(np.zeros(7), mask=True),
    "a huge number": 10**400,
    "a number below": -1.0,
    "NaN": np.nan,
    "a tuple of nothing": (None, None, None),
    "an empty tuple": (),
}


@pytest.mark.parametrize("name", NAMES)
def test_arguments_of_wrong_types_raise_errors(name, rng):
    function, arguments = getattr(_core, name.split()[0]), calls(rng)[name]
    function(**arguments)
    refused = 0
    for argument in arguments:
        for bad in BAD.values():
            try:
                found = function(**{**arguments, argument: bad})
            except (ValueError, TypeError, ArithmeticError, OverflowError):
                refused += 1
            else:
                assert np.isfinite(found[0]).all() or name == "solve_rows", (argument, bad)
    assert refused >= 0.8 * len(arguments) * len(BAD)


@pytest.mark.parametrize("name", NAMES)
def test_arrays_of_every_layout_and_kind_are_read_alike(name, rng):
    function, arguments = getattr(_core, name.split()[0]), calls(rng)[name]
    expected = function(**arguments)[0]
    layouts = {
        "columns first": np.asfortranarray,
        "every other": lambda a: np.repeat(a, 2, axis=-1)[..., ::2],
        "backwards": lambda a: a[..., ::-1].copy()[..., ::-1],
        "other byte order": lambda a: a.astype(">f8"),
        "read only": lambda a: (a.setflags(write=False), a)[1],
        "a list": np.ndarray.tolist,
    }
    for argument, value in arguments.items():
        for layout in layouts.values():
            if isinstance(value, np.ndarray):
                other = layout(value.copy())
            elif isinstance(value, tuple) and isinstance(value[0], np.ndarray):
                other = tuple(layout(part.copy()) if isinstance(part, np.ndarray) else part for part in value)
            else:
                continue
            np.testing.assert_array_equal(function(**{**arguments, argument: other})[0], expected)


@pytest.mark.parametrize("value", [np.nan, inf, -inf])
def test_no_nan_and_no_infinity_gets_in(value, rng):
    for name, arguments in calls(rng).items():
        for argument, given in arguments.items():
            parts = list(given) if isinstance(given, tuple) else [given]
            for i, part in enumerate(parts):
                if not isinstance(part, np.ndarray):
                    continue
                changed = part.copy()
                changed.flat[changed.size // 2] = value
                other = (*parts[:i], changed, *parts[i + 1 :]) if isinstance(given, tuple) else changed
                try:
                    found = getattr(_core, name.split()[0])(**{**arguments, argument: other})
                except (ValueError, ArithmeticError):
                    continue
                limits = argument in {"lower", "upper", "position_lower", "position_upper", "rows"}
                assert name == "solve_rows" or (limits and not np.isnan(value)), (name, argument)
                assert name != "solve_rows" or limits or (found[2][:, 1] == -1.0).any()
                assert np.isfinite(found[0][found[2][:, 1] >= 0.0] if name == "solve_rows" else found[0]).all()


def test_the_engine_has_the_codes_of_the_sentences_in_their_order():
    source = Path(iq.__file__).with_name("core").joinpath("report.hpp").read_text(encoding="utf-8")
    names = source.partition("enum class Code {")[2].partition("}")[0].replace(",", " ").split()
    assert names == ["none", *(code.name.lower() for code in iq.velocity.Code)]
