"""The compiled core gives the answers of the Python law, on hostile inputs too, or hands the tick back."""

import pickle
from functools import reduce
from importlib import import_module

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear, minimize
from support.repeats import repeats
from support.two_laws import Brought, disagreements, native_answer, python_answer, random_tick

import invariantqp as iq
from invariantqp.engine import core
from invariantqp.legacy.damping import Adaptive, Fixed, PaperLambda
from invariantqp.legacy.law import Demand, VelocityLaw
from invariantqp.legacy.problem import problem_of
from invariantqp.legacy.solve import solve
from invariantqp.velocity.backends import backend_of
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.solution import VelocitySolution

pytestmark = pytest.mark.skipif(core is None, reason="no compiled core here")
WIDE = (-np.full(7, 1e3), np.full(7, 1e3))


class Quiet:
    """A damping of the user's."""

    def squares(self, sigma, wanted, largest):
        return 0.0 * sigma


@pytest.fixture
def tick():
    J = np.random.default_rng(5).normal(size=(6, 7))
    return VelocityLaw(dt=0.01), Demand(J, np.arange(6.0), np.eye(6), *WIDE)


@settings(max_examples=repeats(5000, 100), deadline=None, derandomize=True)  # for other ticks there is two_laws.main
@given(st.integers(0, 2**63))
@example(77015359)  # a form's velocity and least squares, apart by rounding of terms that are far larger than |A x|
@example(8002185)  # a posture a hundred thousand times as fast as what the twist needs
@example(8000173)  # a tool speed that leaves a millionth of itself beside exact rows
@example(1074648)  # position limits that leave a chase a room of 1e-8 beside exact rows
@example(1008561)  # likewise beside rows that gave way, in joints of 1e-3 rad/s
@example(2014428)  # rows that do not contradict, told so by rounding of velocities of 200 rad/s
@example(30009505)  # a joint that hardly moves the tool, in a null space one of whose bases has it hold no limit
@example(30015323)  # a tool speed that joints which move nothing would feel by rounding
@example(30001609)  # a joint that no exact row moves, mixed into their null space by rounding; a share of 1e-9
@example(40032394)  # a tool speed that is met by one direction of exact rows, and hardly moved by the others
@example(500547333)  # a joint without room, whose price two opposite limits shared
@example(501121464)  # exact rows that fix a joint without room, to 1e-32 of the velocity
@example(500668231)  # a joint that moves the tool by a ten-millionth of what others do, in directions of the others
@example(500723351)  # a chase in the room of 1e-4 that a tool speed has which gave way
@example(500571970)  # damped beside exact rows, in an arm that is not, at rest
@example(700075262)  # a tool speed that hardly any of the joints' directions feels
@example(910019844)  # rows that contradict nothing, but are met by 15 000 rad/s alone
@example(1300003995)  # limits that let rows move no less leave one velocity
@example(1300003375)  # and one of them depends on the joints that are left by a ten-trillionth
@example(1510004792)  # the price of a tool speed that no price was found for in sixty steps
@example(910012748)  # what a form attempts where joints hardly move, and a direction that they move by 1e-12
@example(700672630)  # exact rows that are slow beside a motion which limits require
@example(4000087692)  # a tool speed that gave way, and whose price the first digits of its terms do not tell
@example(4000091569)  # likewise, as joints move the tool by a ten-millionth of what each does by itself
@example(1550005201)  # a share of 1e-12, beside which limits are rounding of what is asked for
@example(4000289558)  # a share that is rounding of a motion which limits require
@example(19196)  # a direction in which a tool speed is felt by rounding alone, which its price then multiplies
@example(6100000999)  # nothing is possible beside exact rows, and joints move by what rounding leaves of that
@example(20261148109)  # an arm at rest but for rounding of its posture
@example(7700005953)  # two limits that leave nothing share one pull
@example(20261128184203)  # six joints are told by the twist alone, whatever their posture
@example([424242, 5574])  # the weakest of the limits that hold the rows moves what they leave free by rounding
def test_both_answer_the_same(seed):
    law, demand = random_tick(np.random.default_rng(seed))
    native = native_answer(law, demand)
    if native is not None:
        assert disagreements(law, demand, native, python_answer(law, demand)) == []
        assert (native.velocity >= demand.lower).all()
        assert (native.velocity <= demand.upper).all()


def test_rows_are_exceeded_by_one_rounding_at_most_or_the_tick_is_handed_back():
    """In lengths of 1e60, two columns alike: margins of each step on the way to an answer must not add up."""
    J = 1e60 * np.array(
        [
            [1.0, 0.0, -1.0, -1.0, 1.0, -1.0, -1.0, -1.0],
            [0.0, 1.0, -2.0, 0.0, -2.0, -1.0, -2.0, -2.0],
            [-1.0, 0.0, -1.0, 1.0, 1.0, 0.0, -1.0, -1.0],
            [1.0, 0.0, 2.0, -1.0, -2.0, -1.0, 1.0, 1.0],
            [-2.0, -1.0, 1.0, 2.0, 2.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, -2.0, 0.0, -1.0, 0.0, -1.0, -1.0],
        ]
    )
    J[:, 7] += 1e-7 * J[:, 1]
    C = np.array([[1.1, -2.9, -0.06, 1.1, -1.4, 2.4, 4.0, 0.3], [1.34, -0.72, 0.065, 2.47, 1.015, -1.66, -2.66, 0.39]])
    C = np.vstack((np.eye(8)[2], C))
    rows = iq.limits.LimitRows(C, [-np.inf, -34.5, -12.475], [0.037, 18.35, 17.3])
    s, root = 1e60 * np.array([-8.8, 5.4, -4.3, 10.2, 4.0, 2.3]), np.eye(6)
    lower = np.array([-2.667, 4.065, -2.763, 0.0, 0.6065, -np.inf, -0.7573, -3.4289])
    upper = np.array([0.01903, 4.065, 1.9348, 0.0, 1.1028, 1.6463, np.inf, 0.8999])
    exact = ExactRows(J[1:], s[1:], root[1:])
    rng, answered = np.random.default_rng(0), 0
    for _ in range(300):
        d = 0.01 * rng.normal(size=8)
        demand = Demand(J, s, root, lower + d, upper + d, exact, rows=rows)
        found = native_answer(VelocityLaw(damping=Fixed(0.0), dt=0.002), demand)
        if found is not None and "contradict" not in found.reason:
            answered += 1
            size = np.linalg.norm(C, axis=1) * np.linalg.norm(found.velocity)
            assert (np.abs(rows.excess(found.velocity)) <= 1e-9 * size).all()
    assert answered > 100


def test_rows_that_ask_for_a_motion_are_met_by_the_core():
    """As of a clearance that is a little inside: standing still is no answer, and nothing has to give way."""
    rng, handed_back, m = np.random.default_rng(3), 0, 7
    for trial in range(1000):
        C = rng.normal(size=(rng.integers(3, 12), m)) + 3.0 * rng.normal(size=m) * rng.integers(2)
        possible = C.dot(0.01 * rng.normal(size=m)) - 1e-4 * rng.random(len(C)) * rng.integers(2, size=len(C))
        rows = iq.limits.LimitRows(C, possible, np.full(len(C), np.inf))
        wide = np.full(m, 2.0)
        demand = Demand(rng.normal(size=(6, m)), 0.3 * rng.normal(size=6), np.eye(6), -wide, wide, rows=rows)
        law = VelocityLaw(dt=0.002)
        found = native_answer(law, demand)
        handed_back += found is None
        if found is not None:
            assert (rows.excess(found.velocity) >= -1e-9 * np.linalg.norm(C, axis=1)).all()
            assert "contradict" not in found.reason
            if trial % 20 == 0:
                assert disagreements(law, demand, found, python_answer(law, demand)) == []
    assert handed_back <= 5


def test_exact_rows_that_hardly_any_velocity_moves_are_met_by_the_core():
    """As of an arm at rest that is nearly stretched: singular values down to where a row depends on the others."""
    rng = np.random.default_rng(7)
    for share in 10.0 ** rng.uniform(-9.9, -7.0, 100):
        J, m = rng.normal(size=(6, 6)), 6
        U, _, Vt = np.linalg.svd(J[3:])
        J[3:] = (U * (1.0, 0.7, share)).dot(Vt[:3])
        x = 0.1 * rng.normal(size=m)
        law, exact = VelocityLaw(dt=0.002), ExactRows.of(J, np.eye(6)[3:], J[3:].dot(x))
        demand = Demand(J, J.dot(x), np.eye(6), -np.ones(m), np.ones(m), exact=exact)
        native, answer = native_answer(law, demand), python_answer(law, demand)
        assert native is not None
        assert native.scale == answer.scale == 1.0
        np.testing.assert_allclose(native.velocity, answer.velocity, rtol=0.0, atol=1e-14 / share)


def test_limits_that_lead_away_from_what_exact_rows_ask_for_leave_none_of_it():
    """As of joints that brake: in the core, too, though more limits meet there than hold the joints."""
    rng, law, away = np.random.default_rng(11), VelocityLaw(dt=0.002), 0
    for _ in range(150):
        J, m = rng.normal(size=(6, 5)), 5
        moving = rng.normal(size=m)
        exact = ExactRows.of(J, np.eye(6)[3:], rng.normal(size=3))
        demand = Demand(J, rng.normal(size=6), np.eye(6), moving - 0.02, moving + 0.02, exact=exact)
        free = np.linalg.svd(J[3:])[2][:3]
        full = np.linalg.pinv(J[3:]).dot(exact.b)
        least = lsq_linear(free, np.zeros(3), (demand.lower, demand.upper), tol=1e-14).x
        start = free.T.dot(free.dot(least))
        if start.dot(full) > -1e-3 * np.linalg.norm(start) * np.linalg.norm(full):
            continue
        away += 1
        native, answer = native_answer(law, demand), python_answer(law, demand)
        assert native is not None
        assert native.scale == answer.scale == 0.0
    assert away > 40


def test_rows_hold_to_rounding_beside_a_tool_speed_that_gives_way(tick):
    """Rows that the velocity without them exceeds by less than the tolerance of a solver."""
    law, demand = tick
    rng, answered = np.random.default_rng(7), 0
    for _ in range(100):
        lower = rng.uniform(-0.5, 0.7, 7)
        cone = iq.limits.ToolSpeed(1e-3, np.ones(3)).cone(demand.J, np.ones(3))
        told = demand._replace(s=rng.normal(size=6), lower=lower, upper=lower + rng.uniform(0.1, 1.0, 7), cone=cone)
        alone, C = native_answer(law, told), rng.normal(size=(4, 7))
        if alone is None or "the tool's speed is" not in alone.reason:
            continue
        most = np.abs(C @ alone.velocity) * (1.0 - 5e-10)
        rows = iq.limits.LimitRows(C, -most, most)
        solution = native_answer(law, told._replace(rows=rows))
        if solution is None or "rows contradict" in solution.reason:
            continue
        answered += 1
        size = np.linalg.norm(C, axis=1) * np.linalg.norm(solution.velocity)
        assert (np.abs(rows.excess(solution.velocity)) <= 1e-14 * size).all()
    assert answered > 10


def test_the_core_answers_most_of_them():
    ticks = [random_tick(np.random.default_rng(seed)) for seed in range(repeats(2000, 800))]
    adaptive = [(law, demand) for law, demand in ticks if type(law.damping) is Adaptive]
    usual = [(law, demand) for law, demand in adaptive if demand.exact is None and demand.cone is None and not law.form]
    still = [np.clip(np.zeros(len(demand.lower)), demand.lower, demand.upper) for _, demand in usual]
    usual = [tick for tick, x in zip(usual, still, strict=True) if tick[1].rows is None or tick[1].rows.allow(x)]
    back = sum(native_answer(law, demand) is None for law, demand in usual)
    assert back < 0.01 * len(usual)


def test_directions_are_orthonormal_to_rounding():
    """Of nine joints two are alike: what moves nothing weighs 1e-8 beside a twist that is missed twelve times over."""
    law, demand = random_tick(np.random.default_rng(40020135))
    demand = demand._replace(cone=None)
    native, answer = native_answer(law, demand), python_answer(law, demand)
    assert native.active == (0, 1, 3, 7)
    np.testing.assert_allclose(native.velocity, answer.velocity, rtol=0.0, atol=1e-10 * np.abs(answer.velocity).max())


def test_directions_beside_one_that_moves_nothing():
    """Of four joints two are opposite, and one moves the tool by 5e-7 of what they do: only rounding mixes these."""
    law, demand = random_tick(np.random.default_rng(60009541))
    native, answer = native_answer(law, demand), python_answer(law, demand)
    np.testing.assert_allclose(native.velocity, answer.velocity, rtol=0.0, atol=1e-9 * np.abs(answer.velocity).max())


def test_a_motion_that_moves_nothing_is_none_of_the_tool():
    law, demand = random_tick(np.random.default_rng(50013584))
    assert not demand.s.any()
    for answer in (native_answer(law, demand), python_answer(law, demand)):
        assert np.abs(answer.velocity).max() > 0.1
        assert (answer.status, answer.reason) == ("ok", "")


def test_constants_are_those_of_python():
    for name, value in core.CONSTANTS.items():
        room, file, *rest = name.partition(":")[0].split(".")  # several of C's may be one of Python's
        assert reduce(getattr, rest, import_module(f"invariantqp.{room}.{file}")) == value


CALLED = "tick step sight pseudoinverse answer_as"


@pytest.mark.parametrize("name", CALLED.split())
def test_the_core_says_how_it_is_called(name):
    with pytest.raises(TypeError, match=rf"^{name}\("):
        getattr(core, name)(*[3] * name.endswith("_as"))


@pytest.mark.parametrize(
    "law",
    [
        {"form": iq.PitchForm(0.1, convexified=True)},
        {"damping": Quiet()},
        {"backend": backend_of("osqp")},
        {"damping": PaperLambda(0.1)},
    ],
    ids=lambda law: next(iter(law)),
)
def test_another_law_is_python_s(tick, law):
    assert native_answer(VelocityLaw(**law), tick[1]) is None


@pytest.mark.parametrize(
    "form",
    [iq.PitchForm(0.1), iq.Complement(np.eye(6)[:, :1]), Brought(np.diag([1.0, 2.0, -1.0, 1.0, -0.5, 0.3]))],
    ids=["pitch", "complement", "brought"],
)
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
    many = iq.limits.LimitRows(np.ones((33, 7)), -np.ones(33), np.ones(33))
    for other in (demand._replace(rows=many),):
        assert native_answer(law, other) is None


def test_up_to_32_rows_of_limits(tick):
    law, demand = tick
    rng = np.random.default_rng(3)
    for k in (1, 2, 17, 32):
        C = rng.normal(size=(k, 7))
        C[-1] = C[0]  # the same limit twice
        tight = demand._replace(rows=iq.limits.LimitRows(C, np.full(k, -0.3), np.full(k, 0.3)))
        native = native_answer(law, tight)
        assert disagreements(law, tight, native, python_answer(law, tight)) == []
        assert (np.abs(C @ native.velocity) <= 0.3 + 1e-12).all()
        assert np.abs(native.row_multipliers).max() > 0.0


def test_limits_that_contradict_each_other_give_way_by_the_least(tick):
    """Against scipy's bounded least squares: the violations of rows of unit length have the least sum of squares."""
    law, demand = tick
    rng, degraded = np.random.default_rng(4), 0
    for k in range(60):
        m, width = 7, rng.uniform(0.1, 1.0)
        box = {"lower": -rng.uniform(0.0, width, m), "upper": rng.uniform(0.0, width, m)}
        if k % 3 == 0:
            box["lower"][:2] = 0.5 * box["upper"][:2]  # joints that have to move
        C = rng.normal(size=(3, m)) * 10.0 ** rng.uniform(-2.0, 2.0, (3, 1))
        C[1] = (C[1], C[0], -C[0])[k % 3]
        length = np.linalg.norm(C, axis=1)
        low = length * rng.uniform(0.5, 4.0, 3) * width
        told = demand._replace(**box, rows=iq.limits.LimitRows(C, low, low * (1.0, 1.5)[k % 2]))
        native = native_answer(law, told)
        if native is None:
            continue
        assert disagreements(law, told, native, python_answer(law, told)) == []
        if native.status != "degraded":
            continue
        degraded += 1
        best = minimize(
            lambda x, C=C, low=low, high=told.rows.upper, size=length: sum(
                (np.maximum(low - C @ x, 0.0) + np.maximum(C @ x - high, 0.0)) ** 2 / size**2
            ),
            np.clip(np.zeros(m), *box.values()),
            bounds=list(zip(*box.values(), strict=True)),
            tol=1e-14,
        )
        over = np.linalg.norm(told.rows.excess(native.velocity) / length)
        assert over == pytest.approx(np.sqrt(best.fun), rel=1e-4, abs=1e-6 * width)
        assert native.reason.startswith("rows contradict ")
    assert degraded > 40


def test_a_tool_that_cannot_be_slow_is_as_slow_as_other_limits_let_it(tick):
    law, demand = tick
    for factor in (0.5, 3.0):
        forced = demand._replace(lower=np.full(7, 0.1), upper=np.full(7, 0.2))
        cone = iq.limits.ToolSpeed(1.0, np.zeros(3)).cone(demand.J, np.zeros(3))
        inside = lsq_linear(cone.J, np.zeros(3), (forced.lower, forced.upper), tol=1e-14)
        least = np.linalg.norm(cone.J @ inside.x)
        forced = forced._replace(cone=cone._replace(limit=factor * least))
        native = native_answer(law, forced)
        assert disagreements(law, forced, native, python_answer(law, forced)) == []
        assert cone.speed(native.velocity) <= max(factor, 1.0001) * least * (1.0 + 1e-9)
        assert (native.status == "degraded") == (factor < 1.0)
        assert ("the tool's speed is" in native.reason) == (factor < 1.0)


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
    assert answered > 20


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


def test_exact_rows_that_depend_on_each_other(tick):
    law, demand = tick
    J, rng = demand.J, np.random.default_rng(2)
    point = np.eye(6)[3:]
    twice, each = np.vstack((point, point)), np.linspace(0.04, 0.1, 7)
    for rows, said in (
        (iq.ExactRows.of(J, twice, np.tile(demand.s[3:], 2)), ""),
        (iq.ExactRows.of(J, twice, demand.s[[3, 4, 5, 4, 4, 4]]), "cannot keep the direction of the exact rows"),
        (iq.ExactRows.of(J, np.vstack((point, rng.normal(size=3) @ point)), np.zeros(4)), ""),
        (iq.ExactRows(np.eye(7), each), ""),
        (iq.ExactRows(np.vstack((np.eye(7), np.ones(7))), np.append(each, each.sum())), ""),
        (iq.ExactRows(np.vstack((np.eye(7), np.ones(7))), np.append(each, 0.8)), "direction"),
        (iq.ExactRows(np.zeros((2, 7)), [0.0, 1.0]), "direction"),
    ):
        for width in (1e3, 0.05):
            told = demand._replace(exact=rows, lower=np.full(7, -width), upper=np.full(7, width))
            native = native_answer(law, told)
            assert disagreements(law, told, native, python_answer(law, told)) == []
            assert said in native.reason
            assert (native.status == "degraded") == bool(said)
            np.testing.assert_allclose(rows.A @ native.velocity, native.scale * rows.b, atol=1e-9)


def test_exact_rows_of_an_arm_that_can_keep_fewer(tick):
    law, demand = tick
    two = iq.ExactRows.of(demand.J, np.eye(6)[4:], [1.0, 1.0])
    for rank in (1, 2):
        told = demand._replace(exact=two, row_rank=rank)
        native = native_answer(law, told)
        assert disagreements(law, told, native, python_answer(law, told)) == []
        assert ("this arm can keep 1 of the exact rows" in native.reason) == (rank == 1)


def test_exact_rows_that_it_does_not_have_are_handed_back(tick):
    law, demand = tick
    many = iq.ExactRows(np.ones((9, 7)), np.ones(9))
    for rows in (many, nearly_alike(2e-10)):  # at the tolerance
        assert native_answer(law, demand._replace(exact=rows)) is None
    for apart in (1.9e-10, 2.1e-10):  # beside it
        near = demand._replace(exact=nearly_alike(apart))
        assert native_answer(law, near) is not None
        assert disagreements(law, near, native_answer(law, near), python_answer(law, near)) == []


def nearly_alike(apart):
    """Two rows whose singular values are nearly 1 : apart / 2."""
    return iq.ExactRows(np.vstack((np.eye(7)[:1], np.eye(7)[:1] + apart * np.eye(7)[1:2])), np.ones(2))


def test_arrays_of_any_layout_and_no_others(tick):
    law, demand = tick
    one = native_answer(law, demand)
    whole = np.zeros((12, 14))
    whole[::2, ::2] = demand.J
    rows = [demand.J.tolist(), tuple(map(tuple, demand.J)), list(demand.J)]
    for J in (np.asfortranarray(demand.J), whole[::2, ::2], demand.J[::-1][::-1], demand.J.astype(">f8"), *rows):
        assert native_answer(law, demand._replace(J=J)) == one
    single = demand.J.astype(np.float32)
    assert native_answer(law, demand._replace(J=single)) == native_answer(law, demand._replace(J=single.astype(float)))
    for J in (
        demand.J[:5],
        demand.J[:5].tolist(),
        np.eye(6)[0],
        demand.J.astype(complex),
        demand.J.astype(str),
        [1.0] * 6,
    ):
        assert native_answer(law, demand._replace(J=J)) is None
    assert native_answer(law, demand._replace(lower=demand.lower[:6])) is None


def test_more_joints_than_it_has_room_for_are_handed_back():
    J = np.random.default_rng(0).normal(size=(6, 17))
    box = np.full(17, 10.0)
    assert native_answer(VelocityLaw(), Demand(J, np.ones(6), np.eye(6), -box, box)) is None
    assert native_answer(VelocityLaw(), Demand(J[:, :16], np.ones(6), np.eye(6), -box[:16], box[:16])) is not None


def test_arguments_have_names(tick):
    law, demand = tick
    with pytest.raises(TypeError, match=r"tick\(J=...\) is missing: joint twists"):
        core.tick(law.compiled, s=demand.s)
    with pytest.raises(TypeError, match=r"tick\(\) takes no 'twist'"):
        core.tick(law.compiled, twist=demand.s)
    with pytest.raises(TypeError, match=r"tick\(a Law"):
        core.tick(demand.J)


def test_an_answer_is_a_value_with_a_status_of_the_enum(tick):
    solution = native_answer(*tick)
    assert type(solution.status) is iq.Status
    again = pickle.loads(pickle.dumps(solution))
    assert type(again) is VelocitySolution
    assert again == solution
    assert again.status is solution.status


def test_the_answer_owns_its_arrays(tick):
    solution = native_answer(*tick)
    assert type(solution) is VelocitySolution
    assert all(a.flags.owndata and a.flags.writeable for a in (solution.velocity, solution.residual))


@pytest.mark.parametrize("size", [1e-3, 1e-6, 1e-9, 1e-13])
@pytest.mark.parametrize("engine", ["compiled", "python"])
def test_limits_hold_however_far_the_optimum_without_them_is(engine, size):
    rng = np.random.default_rng(5)
    for m in (1, 2, 6, 8):
        J, s = size * rng.normal(size=(6, m)), 10.0 * rng.normal(size=6)
        C = rng.normal(size=(2, m))
        most, slow = 1e-3 * np.linalg.norm(C, axis=1), iq.limits.ToolSpeed(1e-4 * size, np.zeros(3))
        options = {
            "damping": Fixed(0.0),
            "point": np.zeros(3),
            "length": 1.0,
            "rows": iq.limits.LimitRows(C, -most, most),
            "bounds": (-np.ones(m), np.ones(m)),
            "engine": engine,
        }
        x = solve(*problem_of(J, s, **options)).velocity
        assert (np.abs(C @ x) <= most * (1.0 + 1e-6)).all()
        assert np.abs(C @ x / most).max() > 0.5
        x = solve(*problem_of(J, s, tool_speed=slow, **options)).velocity
        assert (np.abs(C @ x) <= most * (1.0 + 1e-6)).all()
        assert 0.5 * slow.limit < slow.cone(J, np.zeros(3)).speed(x) <= slow.limit * (1.0 + 1e-6)
