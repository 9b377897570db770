"""The compiled core gives the answers of the Python law, on hostile inputs too, or hands the tick back."""

from importlib import import_module

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.repeats import repeats
from support.two_laws import disagreements, native_answer, python_answer, random_tick

import invariantqp as iq
from invariantqp.engine import core
from invariantqp.velocity.backends import backend_of
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.solution import VelocitySolution

pytestmark = pytest.mark.skipif(core is None, reason="no compiled core here")
WIDE = (-np.full(7, 1e3), np.full(7, 1e3))


class Brought:
    """A form of the user's."""

    def matrix(self, inverse_root):
        return inverse_root.T @ inverse_root

    def describe(self):
        return "a definite form"


@pytest.fixture
def tick():
    J = np.random.default_rng(5).normal(size=(6, 7))
    return VelocityLaw(dt=0.01), Demand(J, np.arange(6.0), np.eye(6), *WIDE)


@settings(max_examples=repeats(5000, 300), deadline=None, derandomize=True)  # for other ticks there is two_laws.main
@given(st.integers(0, 2**63))
@example(77015359)  # a form's velocity and least squares, apart by rounding of terms that are far larger than |A x|
@example([424242, 5574])  # the weakest of the limits that hold the rows moves what they leave free by rounding
def test_both_answer_the_same(seed):
    law, demand = random_tick(np.random.default_rng(seed))
    native = native_answer(law, demand)
    if native is not None:
        assert disagreements(law, demand, native, python_answer(law, demand)) == []
        assert (native.velocity >= demand.lower).all()
        assert (native.velocity <= demand.upper).all()


def test_the_core_answers_most_of_them():
    ticks = [random_tick(np.random.default_rng(seed)) for seed in range(2000)]
    adaptive = [(law, demand) for law, demand in ticks if type(law.damping) is iq.velocity.Adaptive]
    usual = [(law, demand) for law, demand in adaptive if demand.exact is None and demand.cone is None and not law.form]
    still = [np.clip(np.zeros(len(demand.lower)), demand.lower, demand.upper) for _, demand in usual]
    usual = [tick for tick, x in zip(usual, still, strict=True) if tick[1].rows is None or tick[1].rows.allow(x)]
    back = sum(native_answer(law, demand) is None for law, demand in usual)
    assert back < 0.01 * len(usual)


def test_constants_are_those_of_python():
    for name, value in core.CONSTANTS.items():
        file, _, constant = name.partition(":")[0].rpartition(".")  # several of C's may be one of Python's
        assert getattr(import_module(f"invariantqp.{file}"), constant) == value


CALLED = "tick ticks solution loop step drive sight cost optimum arm descend misses answer_as tell_as"


@pytest.mark.parametrize("name", CALLED.split())
def test_the_core_says_how_it_is_called(name):
    with pytest.raises(TypeError, match=rf"^{name}\("):
        getattr(core, name)(*[3] * name.endswith("_as"))


def test_solve_velocity_asks_the_core_first(monkeypatch):
    J, s = np.random.default_rng(0).normal(size=(6, 6)), np.ones(6)
    first = iq.solve_velocity(J, s, bounds=(-0.1 * s, 0.1 * s))
    monkeypatch.setattr("invariantqp.velocity.solve.core", None)
    second = iq.solve_velocity(J, s, bounds=(-0.1 * s, 0.1 * s))
    assert (first.backend, second.backend) == ("native", "daqp")
    np.testing.assert_allclose(first.velocity, second.velocity, rtol=1e-12)


@pytest.mark.parametrize(
    "law",
    [
        {"form": iq.PitchForm(0.1, convexified=True)},
        {"form": Brought()},
        {"backend": backend_of("osqp")},
        {"damping": iq.velocity.PaperLambda(0.1)},
    ],
    ids=lambda law: next(iter(law)),
)
def test_another_law_is_python_s(tick, law):
    assert native_answer(VelocityLaw(**law), tick[1]) is None


@pytest.mark.parametrize("form", [iq.PitchForm(0.1), iq.Complement(np.eye(6)[:, :1])], ids=["pitch", "complement"])
def test_a_form_is_the_core_s_and_its_guard_acts(form):
    rng, guarded = np.random.default_rng(0), 0
    for _ in range(60):
        box = rng.uniform(0.05, 0.5, (2, 5))
        demand = Demand(rng.normal(size=(6, 5)), rng.normal(size=6), np.eye(6), -box[0], box[1])
        law = VelocityLaw(form=form, dt=0.01, guard=iq.velocity.Guard(0.9))
        native, answer = native_answer(law, demand), python_answer(law, demand)
        assert disagreements(law, demand, native, answer) == []
        assert native.guard == pytest.approx(answer.guard, rel=1e-8)
        guarded += native.status == "guarded"
    assert guarded > 6


def test_other_limits_are_python_s(tick):
    law, demand = tick
    many = iq.limits.LimitRows(np.ones((17, 7)), -np.ones(17), np.ones(17))
    away = iq.limits.LimitRows(np.eye(7)[:1], [1.0], [2.0])  # standing still is not allowed
    slow = iq.limits.ToolSpeed(1.0, np.zeros(3)).cone(demand.J, np.zeros(3))
    forced = demand._replace(cone=slow, lower=np.full(7, 10.0), upper=np.full(7, 20.0))  # far too fast
    for other in (demand._replace(rows=many), demand._replace(rows=away), forced):
        assert native_answer(law, other) is None
    assert native_answer(law, demand._replace(cone=slow)) is not None


def test_the_tool_is_never_faster_than_its_limit(tick):
    law, demand = tick
    answered = 0
    for limit in 10.0 ** np.linspace(-6.0, 2.0, 17):
        cone = iq.limits.ToolSpeed(limit, np.ones(3)).cone(demand.J, np.ones(3))
        for exact in (None, iq.ExactRows.of(demand.J, np.eye(6)[3:], demand.s[3:])):
            solution = native_answer(law, demand._replace(cone=cone, exact=exact))
            if solution is not None:
                answered += 1
                rounding = 1e-15 * np.linalg.norm(cone.J) * np.linalg.norm(solution.velocity)
                assert cone.speed(solution.velocity) <= limit * (1.0 + 1e-12) + rounding
    assert answered > 25


@pytest.mark.parametrize("scale", [1e-300, 1e-90, 1e90, 1e300])
def test_numbers_whose_squares_overflow_or_vanish_are_handed_back(tick, scale):
    law, demand = tick
    assert native_answer(law, demand._replace(J=scale * demand.J)) is None
    assert native_answer(law, demand._replace(s=scale * demand.s)) is None
    assert native_answer(law, demand._replace(posture=np.full(7, scale))) is None


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_no_number_is_handed_back(tick, value):
    law, demand = tick
    for name in ("J", "s", "root"):
        bad = getattr(demand, name).copy()
        bad.flat[3] = value
        assert native_answer(law, demand._replace(**{name: bad})) is None
    assert native_answer(law, demand._replace(posture=np.full(7, value))) is None


def test_exact_rows_hold_at_their_share(tick):
    law, demand = tick
    rows = iq.ExactRows.of(demand.J, np.eye(6)[3:], 100.0 * demand.s[3:])
    for width in (1e3, 10.0, 0.1):
        solution = native_answer(law, demand._replace(exact=rows, lower=np.full(7, -width), upper=np.full(7, width)))
        np.testing.assert_allclose(rows.A @ solution.velocity, solution.scale * rows.b, rtol=1e-12, atol=1e-12)
    assert solution.status == "scaled"
    assert "held by" in solution.reason


def test_exact_rows_that_it_does_not_have_are_handed_back(tick):
    law, demand = tick
    J = demand.J
    same = iq.ExactRows.of(J, np.ones((2, 6)), [1.0, 1.0])
    many = iq.ExactRows(np.ones((9, 7)), np.ones(9))
    whole = iq.ExactRows(np.eye(7), np.zeros(7))
    for rows in (same, many, whole):
        assert native_answer(law, demand._replace(exact=rows)) is None
    two = iq.ExactRows.of(J, np.eye(6)[4:], [1.0, 1.0])
    assert native_answer(law, demand._replace(exact=two, row_rank=1)) is None
    assert native_answer(law, demand._replace(exact=two, row_rank=2)) is not None


def test_arrays_of_any_layout_and_no_others(tick):
    law, demand = tick
    one = native_answer(law, demand)
    whole = np.zeros((12, 14))
    whole[::2, ::2] = demand.J
    for J in (np.asfortranarray(demand.J), whole[::2, ::2], demand.J[::-1][::-1]):
        assert native_answer(law, demand._replace(J=J)) == one
    for J in (demand.J.astype(">f8"), demand.J.astype(np.float32), demand.J[:5], demand.J.tolist(), np.eye(6)[0]):
        assert native_answer(law, demand._replace(J=J)) is None
    assert native_answer(law, demand._replace(lower=demand.lower[:6])) is None


def test_more_joints_than_it_has_room_for_are_handed_back():
    J = np.random.default_rng(0).normal(size=(6, 17))
    box = np.full(17, 10.0)
    assert native_answer(VelocityLaw(), Demand(J, np.ones(6), np.eye(6), -box, box)) is None
    assert native_answer(VelocityLaw(), Demand(J[:, :16], np.ones(6), np.eye(6), -box[:16], box[:16])) is not None


def test_arguments_are_counted(tick):
    with pytest.raises(TypeError, match=r"tick\(J, s, root"):
        core.tick(tick[1].J)
    with pytest.raises(TypeError):
        core.tick(*tick[1][:5], None, "dt", (0.0, 0.0, 0.0), *[None] * 4)


def test_the_answer_owns_its_arrays(tick):
    solution = native_answer(*tick)
    assert type(solution) is VelocitySolution
    assert all(a.flags.owndata and a.flags.writeable for a in (solution.velocity, solution.residual))
