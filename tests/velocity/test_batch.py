import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import invariantqp as iq
from invariantqp.errors import BadInput

COUNT = 7
FORMS = {
    "pitch": 0.4,
    "none": None,
    "carried": iq.CarriedMetric((0.1, 0.2, 0.1, 1.0, 1.0, 2.0), iq.exp((0.3, 0.1, 0.2, 0.5, -0.2, 0.1))),
}
DAMPINGS = (None, 0.05)


def rows(seed, m, *, achievable, slides=False):
    """Jacobians, some near-singular, one rank one; twists, achievable or not."""
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(COUNT, 6, m))
    for i in (1, 2):
        U, sigma, Vt = np.linalg.svd(J[i], full_matrices=False)
        sigma[-1] *= (1e-2, 1e-4)[i - 1]
        J[i] = U * sigma @ Vt
    J[3] = J[3, :, :1] * rng.normal(size=m)
    if slides:
        J[:, :3, 0] = 0.0
    s = np.einsum("nij,nj->ni", J, rng.normal(size=(COUNT, m))) if achievable else rng.normal(size=(COUNT, 6))
    s[4] = 0.0
    return rng, J, s


@given(
    seed=st.integers(0, 10**6),
    m=st.integers(1, 9),
    form=st.sampled_from(sorted(FORMS)),
    damping=st.sampled_from(DAMPINGS),
    guard=st.booleans(),
    achievable=st.booleans(),
    limits=st.sampled_from(["none", "shared", "each", "some"]),
    posture=st.booleans(),
    metric=st.booleans(),
    slides=st.booleans(),
    point=st.sampled_from(["own", "shared", "each"]),
)
@settings(max_examples=50, deadline=None)
def test_every_row_is_that_of_solve_velocity(
    seed, m, form, damping, guard, achievable, limits, posture, metric, slides, point
):
    rng, J, s = rows(seed, m, achievable=achievable, slides=slides)
    wanted = rng.normal(size=(COUNT, m)) if posture else None
    A = rng.normal(size=(m, m))
    options = {
        "form": FORMS[form],
        "damping": damping,
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
    try:
        found = iq.solve_velocities(J, s, bounds=bounds, posture=wanted, point=named, **options)
    except iq.NoPseudoinverse:
        assert form == "pitch"
        assert damping is None
        return
    assert len(found) == COUNT
    for i, solution in enumerate(found):
        options |= {"bounds": boxes[i], "point": points[i], "posture": None if wanted is None else wanted[i]}
        one = iq.solve_velocity(J[i], s[i], **options)
        np.testing.assert_array_equal(solution.velocity, one.velocity)
        assert solution[1:4] == one[1:4]
        size = 1.0 + np.linalg.norm(one.velocity)
        if i != 2 or point != "own":  # of an arm next to singular, the own point has few digits
            close = {1: 1e-8, 2: 1e-5}.get(i, 1e-10)  # rounding, times the condition squared, and more of a form
            np.testing.assert_allclose(found.velocity[i], one.velocity, rtol=0.0, atol=close * size)
        np.testing.assert_allclose(found.residual[i], s[i] - J[i] @ found.velocity[i], atol=1e-13 * size)
        told = (found.method[i], found.status[i], found.reason[i], found.active[i], found.scale[i], found.damping[i])
        assert told == (one.method, one.status, one.reason, one.active, one.scale, one.damping)
        assert found.guard[i] == pytest.approx(one.guard)


def test_threads_change_nothing(monkeypatch):
    from invariantqp.velocity import batch

    rng = np.random.default_rng(5)
    J, s, reach = rng.normal(size=(400, 6, 7)), rng.normal(size=(400, 6)), rng.uniform(0.1, 3.0, size=(400, 7))
    found = []
    for cores in (1, 4):
        monkeypatch.setattr(batch, "cpu_count", lambda cores=cores: cores)
        found.append(iq.solve_velocities(J, s, bounds=(-reach, reach)))
    one, four = found
    assert one.velocity.tobytes() == four.velocity.tobytes()
    assert one.status.tolist() == four.status.tolist()


def test_a_nearly_active_bound_is_reported_as_in_a_single_row():
    _, J, s = rows(5, 4, achievable=False)
    options = {"point": np.zeros(3), "length": 1.0}
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
    found = iq.solve_velocities(J, s, point=np.zeros(3), length=1.0)
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
def test_wrong_arguments_are_reported_with_their_row(change, said):
    _, J, s = rows(3, 7, achievable=True)
    with pytest.raises(BadInput, match=said):
        iq.solve_velocities(**({"J": J, "twist": s} | change))


@pytest.mark.parametrize("solve", [iq.solve_velocity, iq.solve_velocities])
def test_an_unknown_option_is_refused(solve):
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
