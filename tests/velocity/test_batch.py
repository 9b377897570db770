import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.velocity_reference import LIMITED, UNLIMITED, adaptive

import invariantqp as iq
from invariantqp.engine import core
from invariantqp.errors import BadInput

COUNT = 7
FORMS = {
    "pitch": 0.4,
    "none": None,
    "carried": iq.CarriedMetric((0.1, 0.2, 0.1, 1.0, 1.0, 2.0), iq.exp((0.3, 0.1, 0.2, 0.5, -0.2, 0.1))),
}
DAMPINGS = {
    "adaptive": None,
    "none": 0.0,
    "fixed": 0.05,
    "selective": iq.velocity.Selective(),
    "paper": iq.velocity.PaperLambda(0.05),
}


def rows(seed, m, *, achievable, slides=False):
    """Jacobians, some near-singular, one rank one; twists, achievable or not."""
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(COUNT, 6, m))
    for i in (1, 2):
        U, sigma, Vt = np.linalg.svd(J[i], full_matrices=False)
        sigma[-1] *= (1e-3, 1e-9)[i - 1]
        J[i] = U * sigma @ Vt
    J[3] = J[3, :, :1] * rng.normal(size=m)
    if slides:
        J[:, :3, 0] = 0.0
    s = np.einsum("nij,nj->ni", J, rng.normal(size=(COUNT, m))) if achievable else rng.normal(size=(COUNT, 6))
    s[4] = 0.0
    return rng, J, s


def test_rows_that_the_core_leaves_are_not_read(monkeypatch):
    """What memory held before was cast to whole numbers: a warning where it was none."""
    real = np.empty
    monkeypatch.setattr(np, "empty", lambda shape, *how: real(shape, *how) if how else np.full(shape, np.nan))
    rng, J, s = rows(0, 6, achievable=False)
    reach = rng.uniform(0.5, 5.0, size=(COUNT, 6))
    found = iq.solve_velocities(J, s, bounds=(-reach, reach), damping=0.0)
    assert np.isfinite(found.velocity).all()


@given(
    seed=st.integers(0, 10**6),
    m=st.integers(1, 9),
    form=st.sampled_from(sorted(FORMS)),
    damping=st.sampled_from(sorted(DAMPINGS)),
    guard=st.booleans(),
    achievable=st.booleans(),
    limits=st.sampled_from(["none", "shared", "each", "some"]),
    posture=st.booleans(),
    metric=st.booleans(),
    slides=st.booleans(),
    point=st.sampled_from(["own", "shared", "each"]),
)
@settings(max_examples=50, deadline=None)
def test_every_row_is_what_solve_velocity_says(
    seed, m, form, damping, guard, achievable, limits, posture, metric, slides, point
):
    rng, J, s = rows(seed, m, achievable=achievable, slides=slides)
    wanted = rng.normal(size=(COUNT, m)) if posture else None
    A = rng.normal(size=(m, m))
    options = {
        "form": FORMS[form],
        "damping": DAMPINGS[damping],
        "guard": guard,
        "joint_metric": A @ A.T + np.eye(m) if metric else None,
    }
    reach = rng.uniform(0.5, 5.0, size=(COUNT, m))
    if limits == "some":
        reach[::2, -1] = np.inf
    boxes = {
        "none": [None] * COUNT,
        "shared": [iq.Bounds(-reach[0], reach[0])] * COUNT,
        "each": [iq.Bounds(-r, r) for r in reach],
        "some": [iq.Bounds(-r, r) for r in reach],
    }[limits]
    bounds = (-reach, reach) if limits in ("each", "some") else boxes[0]
    points = rng.normal(size=(COUNT, 3))
    points = {"own": [None] * COUNT, "shared": [points[0]] * COUNT, "each": points}[point]
    named = {"own": None, "shared": points[0], "each": points}[point]
    found = iq.solve_velocities(J, s, bounds=bounds, posture=wanted, point=named, **options)
    assert len(found) == COUNT
    for i, solution in enumerate(found):
        options |= {"bounds": boxes[i], "point": points[i], "posture": None if wanted is None else wanted[i]}
        one = iq.solve_velocity(J[i], s[i], **options)
        if damping == "none" and i in (2, 3):  # undamped a billionth from singular: no digit of it is anybody's
            assert np.isfinite(solution.velocity).all()
            continue
        size = np.linalg.norm(one.velocity)
        # To rounding; near singularities that is multiplied by their condition, or one over the ceiling squared.
        regular = one.method == "closed-form" and one.damping == 0.0 and np.linalg.cond(J[i]) < 1e3
        accuracy = (1e-10 if regular else 1e-6) * (1.0 + size)
        np.testing.assert_allclose(solution.velocity, one.velocity, rtol=0.0, atol=accuracy)
        np.testing.assert_allclose(found.residual[i], s[i] - J[i] @ found.velocity[i], atol=1e-12 * (1.0 + size))
        assert (solution.method, solution.status, solution.active) == (one.method, one.status, one.active)
        assert (solution.scale, bool(solution.guard), bool(solution.reason)) == (
            one.scale,
            bool(one.guard),
            bool(one.reason),
        )
        told = (found.method[i], found.status[i], found.reason[i], found.active[i], found.damping[i])
        assert told == (solution.method, solution.status, solution.reason, solution.active, solution.damping)
        assert solution.damping == pytest.approx(one.damping, rel=1e-6, abs=1e-9)


@pytest.mark.skipif(core is None, reason="no compiled core here")
def test_rows_that_are_free_are_not_solved_one_by_one(monkeypatch):
    from invariantqp.velocity import batch

    monkeypatch.setattr(batch, "solve", None)
    rng = np.random.default_rng(0)
    for m in (3, 6, 7):
        U, _, Vt = np.linalg.svd(rng.normal(size=(50, 6, m)), full_matrices=False)
        J = np.matmul(U * np.linspace(2.0, 1.0, min(m, 6)), Vt)
        x = np.linalg.pinv(J) @ rng.normal(size=(50, 6, 1))
        found = iq.solve_velocities(J, (J @ x)[:, :, 0], point=np.zeros(3), length=1.0)
        assert not found.slow
        assert set(found.method) == {"closed-form"}
        np.testing.assert_allclose(found.velocity, x[:, :, 0], rtol=0.0, atol=1e-12 * np.abs(x).max())


@pytest.mark.skipif(core is None, reason="no compiled core here")
def test_only_rows_that_meet_a_limit_are():
    rng = np.random.default_rng(1)
    J, s = rng.normal(size=(COUNT, 6, 7)), rng.normal(size=(COUNT, 6))
    options = {"point": np.zeros(3), "length": 1.0}
    free = iq.solve_velocities(J, s, **options)
    reach = np.full_like(free.velocity, np.inf)
    reach[6] = 0.5 * np.abs(free.velocity[6]).max()
    found = iq.solve_velocities(J, s, bounds=(-reach, reach), **options)
    assert set(found.slow) == {6} | set(free.slow)
    assert len(free.slow) <= 1
    assert found.method[6] == "qp"
    assert (np.abs(found.velocity[6]) <= reach[6]).all()


def test_a_row_is_damped_as_by_itself_whichever_joints_others_limit():
    rng = np.random.default_rng(4)
    U, _, Vt = np.linalg.svd(rng.normal(size=(COUNT, 6, 6)))
    J = np.matmul(U * (1.0, 1.0, 1.0, 1.0, 1.0, 5e-3), Vt)  # arms without limits are damped more
    s, reach = rng.normal(size=(COUNT, 6)), np.full((COUNT, 6), 1e3)
    reach[2, 4] = np.inf
    reach[[2, 5], 0] = 1e-3
    options = {"point": np.zeros(3), "length": 1.0}
    found = iq.solve_velocities(J, s, bounds=(-reach, reach), **options)
    for i in range(COUNT):
        one = iq.solve_velocity(J[i], s[i], bounds=(-reach[i], reach[i]), **options)
        np.testing.assert_allclose(found.velocity[i], one.velocity, rtol=0.0, atol=1e-9 * np.abs(one.velocity).max())
        assert found.status[i] == one.status
        assert found.damping[i] == pytest.approx(np.sqrt(adaptive(5e-3, 1.0, *(UNLIMITED if i == 2 else LIMITED))))
        assert found.active[i] == one.active == ((0,) if i in (2, 5) else ())


@pytest.mark.skipif(core is None, reason="no compiled core here")
def test_several_threads_answer_as_one_does(monkeypatch):
    from invariantqp.legacy import compiled
    from invariantqp.velocity import batch

    rng = np.random.default_rng(5)
    J, s, reach = rng.normal(size=(40, 6, 7)), rng.normal(size=(40, 6)), rng.uniform(0.1, 3.0, size=(40, 7))
    one = iq.solve_velocities(J, s, bounds=(-reach, reach))
    for name, value in {"ROWS_A_THREAD": 5, "ROWS_AT_A_TIME": 2, "cpu_count": lambda: 4}.items():
        monkeypatch.setattr(compiled, name, value)
    monkeypatch.setattr(batch, "solve", None)  # no row is left over
    several = iq.solve_velocities(J, s, bounds=(-reach, reach))
    assert one.velocity.tobytes() == several.velocity.tobytes()
    assert [(a.method, a.reason, a.active) for a in one] == [(a.method, a.reason, a.active) for a in several]


def test_a_bound_that_is_all_but_met_is_told_as_one_row_tells_it():
    _, J, s = rows(5, 4, achievable=False)
    options = {"point": np.zeros(3), "length": 1.0, "damping": 0.0}
    free = iq.solve_velocities(J, s, **options).velocity
    reach = np.where(np.arange(4) == 2, np.abs(free) * (1.0 + 1e-9) + 1e-12, 1e6)
    found = iq.solve_velocities(J, s, bounds=(-reach, reach), **options)
    for i in (0, 5, 6):
        one = iq.solve_velocity(J[i], s[i], bounds=(-reach[i], reach[i]), **options)
        assert one.active == (2,) == found.active[i]
        assert one.reason == found.reason[i]


def test_undamped_near_singular_rows_keep_the_digits_that_normal_equations_lose():
    rng = np.random.default_rng(6)
    U, _, Vt = np.linalg.svd(rng.normal(size=(20, 6, 5)), full_matrices=False)
    J = np.matmul(U * np.geomspace(1.0, 1e-4, 5), Vt)
    s = rng.normal(size=(20, 6))
    found = iq.solve_velocities(J, s, damping=0.0, point=np.zeros(3), length=1.0)
    expected = np.array([np.linalg.lstsq(row, twist, rcond=None)[0] for row, twist in zip(J, s, strict=True)])
    np.testing.assert_allclose(found.velocity, expected, rtol=0.0, atol=1e-11 * np.abs(expected).max())


def test_lists_one_twist_for_all_and_no_rows_at_all():
    _, J, s = rows(2, 6, achievable=False)
    found = iq.solve_velocities(J.tolist(), s[0].tolist(), form=0.4)
    np.testing.assert_array_equal(found.velocity, iq.solve_velocities(J, np.tile(s[0], (COUNT, 1)), form=0.4).velocity)
    empty = iq.solve_velocities(np.empty((0, 6, 7)), np.empty((0, 6)))
    assert empty.velocity.shape == (0, 7)
    assert list(empty) == []
    with pytest.raises(IndexError):
        found[COUNT]
    assert found[-1].velocity.tolist() == found.velocity[-1].tolist()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"J": np.ones((6, 7))}, r"J: found shape \(6, 7\); expected shape \(N, 6, m\).*solve_velocity"),
        ({"J": np.full((COUNT, 6, 7), np.nan)}, "J: found NaN or infinity in row 0"),
        (
            {"J": np.ones((COUNT, 6, 7)) * np.r_[np.ones(COUNT - 1), 1e40][:, None, None]},
            f"of 1e\\+40 in row {COUNT - 1};",
        ),
        ({"twist": np.ones((3, 6))}, r"twist: found shape \(3, 6\)"),
        ({"twist": np.r_[np.ones((COUNT - 1, 6)), np.full((1, 6), np.inf)]}, f"twist: .* in row {COUNT - 1}"),
        ({"bounds": iq.Bounds([-1.0], [1.0])}, "bounds: found 1 limits; expected 7"),
        ({"bounds": 3.0}, "bounds: found float"),
        ({"bounds": (np.ones((COUNT, 7)), -np.ones((COUNT, 7)))}, "row 0, joint 0"),
        ({"bounds": (np.full((COUNT, 7), np.nan), np.ones((COUNT, 7)))}, "bounds: found lower nan"),
        ({"bounds": (-np.ones(7), np.ones(7))}, r"bounds\[0\]: found shape \(7,\)"),
        ({"posture": np.ones(3)}, r"posture: found shape \(3,\)"),
        ({"joint_metric": -np.eye(7)}, "joint_metric"),
        ({"form": "own"}, "form: found 'own'"),
    ],
)
def test_wrong_arguments_are_told_with_their_row(change, said):
    _, J, s = rows(3, 7, achievable=True)
    with pytest.raises(BadInput, match=said):
        iq.solve_velocities(**({"J": J, "twist": s} | change))


@pytest.mark.parametrize("solve", [iq.solve_velocity, iq.solve_velocities, iq.velocity.method_for])
def test_an_option_that_there_is_not_is_refused(solve):
    J = np.ones((6, 3)) if solve is not iq.solve_velocities else np.ones((2, 6, 3))
    with pytest.raises(TypeError, match="no option 'postrue'"):
        solve(J, np.ones(6), postrue=np.zeros(3))


def test_rows_with_different_kinds_of_joints():
    """A prismatic joint in one row alone: each row has its own metric on joint velocities."""
    rng = np.random.default_rng(0)
    J, s = rng.normal(size=(3, 6, 7)), rng.normal(size=(3, 6))
    J[1, :3, 3] = 0.0
    found = iq.solve_velocities(J, s)
    for i in range(3):
        np.testing.assert_allclose(found.velocity[i], iq.solve_velocity(J[i], s[i]).velocity, rtol=1e-12, atol=1e-12)


@pytest.mark.skipif(core is None, reason="no compiled core here")
@pytest.mark.parametrize("counts", [(0, 0), (17, 0), (7, -1), (7, 1000)])
def test_a_record_that_the_core_did_not_write_is_refused(counts):
    record = np.zeros(core.RECORD)
    record[:1].view(np.int32)[:] = counts
    with pytest.raises(TypeError):
        core.solution(record)
