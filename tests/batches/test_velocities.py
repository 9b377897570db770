"""Rows of every array library against the law row by row; libraries that are missing are skipped by name."""

from types import SimpleNamespace

import numpy as np
import pytest

import invariantqp as iq
from invariantqp import batches
from invariantqp.legacy.law import Demand, VelocityLaw
from invariantqp.legacy.problem import problem_of
from invariantqp.legacy.solve import solve
from invariantqp.velocity.arguments import measure_of

N = 40


def solved(J, s, p, low, high, posture, damping=None):
    return batches.velocities(J, s, point=p, bounds=(low, high), posture=posture, damping=damping)


@pytest.fixture(params=("numpy", "torch", "jax"), scope="module")
def library(request):
    """A library: `array` makes its arrays, `host` numpy's of them, `solved` takes them; JAX's is compiled once."""
    name = request.param
    if name == "numpy":
        return SimpleNamespace(name=name, array=np.asarray, host=np.asarray, solved=solved)
    module = pytest.importorskip(name)
    if name == "torch":
        module.set_num_threads(1)
        return SimpleNamespace(name=name, array=module.tensor, host=lambda a: a.detach().numpy(), solved=solved)
    module.config.update("jax_enable_x64", val=True)
    by_row = module.jit(module.vmap(solved))
    return SimpleNamespace(name=name, array=module.numpy.asarray, host=np.asarray, solved=by_row)


def rows(seed, n, m):
    """Jacobians, among them singular and nearly singular ones, zero ones and ones with slides; s, point, posture."""
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(n, 6, m))
    for i, least in ((1, 1e-3), (2, 2e-4), (3, 0.0)):
        U, sigma, Vt = np.linalg.svd(J[i], full_matrices=False)
        sigma[-1] = least * sigma[0]
        J[i] = U * sigma @ Vt
    J[4, :3, 0] = 0.0
    J[5] = 0.0
    J[6] = J[6, :, :1] * rng.normal(size=m)
    return rng, J, rng.normal(size=(n, 6)), rng.normal(size=(n, 3)), rng.normal(size=(n, m))


def alone(J, s, p, box=None, posture=None, **options):
    """One row by the law that loops run."""
    bounds = None if box is None else iq.Bounds(*box)
    return solve(*problem_of(J, s, point=p, bounds=bounds, posture=posture, **options))


@pytest.mark.parametrize("m", [1, 2, 5, 6, 7, 8])
def test_every_row_is_what_the_law_says(library, m):
    """To 1e-9 of its size in double precision: 1e-11 is usual."""
    if library.name == "jax" and m != 7:
        pytest.skip("JAX compiles each number of joints for seconds")
    n = N
    rng, J, s, p, posture = rows(m, n, m)
    size = 0.3 * rng.uniform(0.1, 3.0, size=(n, 1)) * rng.uniform(0.3, 1.5, size=(n, m))
    low, high = -size, size * rng.uniform(0.0, 1.0, size=(n, m))
    low[7:9] -= 1e3
    high[7:9] += 1e3  # free
    low[9, 0], high[10] = -np.inf, np.inf
    low[11] = high[11] = 0.1  # locked, not at rest
    low[12, 0] = high[12, 0]
    low[13], high[13] = 0.02, 0.3  # standing still is not allowed
    low[14] = high[14] = 0.0
    s[15] = 0.0
    s[16] *= 1e6
    found = library.solved(*map(library.array, (J, s, p, low, high, posture)))
    assert type(found.velocity) is type(library.array(J))
    x, status, side, residual = map(library.host, found)
    expected = [alone(J[i], s[i], p[i], (low[i], high[i]), posture[i]) for i in range(n)]
    assert ((low <= x) & (x <= high)).all()
    for i, one in enumerate(expected):
        np.testing.assert_allclose(x[i], one.velocity, rtol=0.0, atol=1e-9 * (1.0 + np.abs(one.velocity).max()))
        if i != 5:  # nothing moves
            assert batches.STATUSES[status[i]] == one.status
            assert set(np.flatnonzero(side[i])) <= set(one.active)
        np.testing.assert_allclose(residual[i], s[i] - J[i] @ x[i], atol=1e-9 * (1.0 + np.abs(s[i]).max()))


@pytest.mark.parametrize("damping", [0.0, 0.05, iq.velocity.Adaptive(0.3, 0.1)])
def test_policies_lengths_and_no_bounds(damping):
    _, J, s, p, _ = rows(1, 30, 4)
    J[3:7] = J[10:14]  # undamped singular rows are nobody's
    found = batches.velocities(J, s, point=p[0], length=0.7, damping=damping)
    for i in range(30):
        one = alone(J[i], s[i], p[0], length=0.7, damping=damping)
        np.testing.assert_allclose(found.velocity[i], one.velocity, rtol=0.0, atol=1e-9 * np.abs(one.velocity).max())
        assert batches.STATUSES[found.status[i]] == one.status


def test_lengths_of_axes_that_meet_in_the_point_and_of_slides():
    rng = np.random.default_rng(0)
    J = np.zeros((3, 6, 3))
    J[:, :3] = rng.normal(size=(3, 3, 3))
    J[1, 3:], J[1, :3] = J[1, :3], 0.0
    p = np.array([0.3, 0.2, 1.0])
    J[2, 3:] = np.cross(p, J[2, :3], axisb=0).T
    s = rng.normal(size=(3, 6))
    found = batches.velocities(J, s, point=np.array([[0.0, 0, 0], [1, 2, 3], p]))
    for i, point in enumerate(([0, 0, 0], [1, 2, 3], p)):
        expected = alone(J[i], s[i], point).velocity
        np.testing.assert_allclose(found.velocity[i], expected, rtol=0.0, atol=1e-10)


def test_the_damping_of_a_loop_is_the_controllers():
    dt, n = 0.02, 30
    rng, J, s, p, posture = rows(3, n, 7)
    s *= rng.choice([1.0, 30.0], size=(n, 1))
    high = rng.uniform(0.1, 3.0, size=(n, 7))
    found = batches.velocities(J, s, point=p, bounds=(-high, high), posture=posture, dt=dt)
    plain = batches.velocities(J, s, point=p, bounds=(-high, high), posture=posture)
    for i in (0, *range(7, n)):
        law = VelocityLaw(dt=dt)
        demand = Demand(J[i], s[i], measure_of(J[i], s[i], None, p[i], None).root, -high[i], high[i])
        one = solve(law, demand._replace(posture=posture[i]))
        np.testing.assert_allclose(found.velocity[i], one.velocity, rtol=0.0, atol=1e-9)
    assert np.abs(found.velocity - plain.velocity).max() > 0.1


def test_no_row_spoils_another(library):
    n, m = N, 7
    _, J, s, p, posture = rows(4, n, m)
    low, high = -0.3 * np.ones((n, m)), 0.4 * np.ones((n, m))
    good = library.host(library.solved(*map(library.array, (J, s, p, low, high, posture))).velocity)
    J[8, 2, 3], s[9, 0], p[10, 1], posture[11, 0] = np.nan, np.inf, np.nan, -np.inf
    low[12, 0], low[13, 0], high[14, 2], low[15, 1] = 1.0, np.nan, -np.inf, np.inf
    J[16] *= 1e300
    s[16] *= 1e300
    low[8, 1], high[9, 2] = 0.1, -0.2  # standing still is not allowed
    found = library.solved(*map(library.array, (J, s, p, low, high, posture)))
    x, status = library.host(found.velocity), library.host(found.status)
    assert (status[8:16] == 2).all()
    rest = [*range(8), *range(17, n)]
    np.testing.assert_allclose(x[rest], good[rest], rtol=0.0, atol=1e-13)
    expected = np.zeros((8, m))
    expected[0, 1], expected[1, 2] = 0.1, -0.2
    np.testing.assert_array_equal(x[8:16], expected)
    assert np.isfinite(x).all()


def test_twists_of_any_size_stay_in_the_box():
    _, J, s, p, _ = rows(5, 24, 7)
    scales = 10.0 ** np.linspace(-300, 300, 24)
    high = np.full((24, 7), 2.0)
    found = batches.velocities(J, s * scales[:, None], point=p, bounds=(-high, high))
    assert (np.abs(found.velocity) <= 2.0).all()
    for i in range(24):  # beyond a hundred million times the box the answer is the same corner
        one = alone(J[i], s[i] * min(scales[i], 1e8), p[i], (-high[i], high[i]))
        np.testing.assert_allclose(found.velocity[i], one.velocity, rtol=1e-9, atol=1e-9)
    assert (found.status != 2).all()


def test_single_precision(library):
    """Tool twists agree to 3e-4, joint velocities to 2e-3, nine tenths of both to 2e-5, in a box that binds."""
    if library.name == "jax":
        pytest.skip("the same operations, compiled once more for seconds")
    robot = iq.load_robot("fr3")
    rng = np.random.default_rng(6)
    q = rng.uniform(robot.position_lower, robot.position_upper, size=(200, 7))
    here = batches.kinematics(robot, q)
    s, high = 0.3 * rng.normal(size=(200, 6)), np.full((200, 7), 0.3)
    double = batches.velocities(here.jacobian, s, point=here.pose[:, :3, 3], bounds=(-high, high))
    J, t, p, h = (library.array(a.astype(np.float32)) for a in (here.jacobian, s, here.pose[:, :3, 3], high))
    single = batches.velocities(J, t, point=p, bounds=(-h, h))
    x = library.host(single.velocity)
    assert x.dtype == np.float32
    assert np.abs(x).max() <= np.float32(0.3)
    off = np.abs(x - double.velocity).max(axis=1)
    missed = np.abs(np.einsum("nij,nj->ni", here.jacobian, x - double.velocity)).max(axis=1)
    assert off.max() < 2e-3
    assert missed.max() < 3e-4
    assert max(np.quantile(off, 0.9), np.quantile(missed, 0.9)) < 2e-5
    assert (library.host(single.status) == double.status).mean() > 0.95


def varied(m):
    """Rows that are free, at bounds, near a singularity, with a slide; where they are, and a way for each argument."""
    rng, J, s, p, posture = rows(9, 24, m)
    J[5], J[6] = rng.normal(size=(2, 6, m))
    s[:8] *= 0.01
    high = rng.uniform(0.2, 1.5, size=(24, m))
    values = [J, s, p, -high, high * rng.uniform(0.3, 1.0, size=(24, m)), posture]
    ways = [rng.normal(size=v.shape) for v in values]
    ways[0][3:5] = 0.0  # a singular J stays singular, a slide a slide
    return values, ways, rng.normal(size=(24, m))


def slopes(values, ways, weights, damping):
    """Of weights . x along the ways, by central differences; NaN where a joint meets or leaves a bound."""
    h = 1e-6
    after, before = (solved(*(v + t * w for v, w in zip(values, ways, strict=True)), damping) for t in (h, -h))
    smooth = (after.active == before.active).all(axis=1)
    return np.where(smooth, ((after.velocity - before.velocity) * weights).sum(axis=1) / (2.0 * h), np.nan)


@pytest.mark.parametrize("name", ["torch", "jax"])
@pytest.mark.parametrize(("m", "damping"), [(3, iq.velocity.Adaptive(0.7, 0.3)), (5, 0.2), (7, None)])
def test_derivatives_are_those_of_finite_differences(name, m, damping):
    module = pytest.importorskip(name)
    if name == "jax" and m > 3:
        pytest.skip("JAX compiles each number of joints for seconds")
    values, ways, weights = varied(m)
    if name == "torch":
        module.set_num_threads(1)
        leaves = [module.tensor(v, requires_grad=True) for v in values]
        (solved(*leaves, damping).velocity * module.tensor(weights)).sum().backward()
        gradients = [leaf.grad.numpy() for leaf in leaves]
    else:
        module.config.update("jax_enable_x64", val=True)
        total = module.jit(module.grad(lambda v: (solved(*v, damping).velocity * weights).sum()))
        gradients = [np.asarray(g) for g in total([module.numpy.asarray(v) for v in values])]
    rates = sum((g * w).reshape(24, -1).sum(axis=1) for g, w in zip(gradients, ways, strict=True))
    expected = slopes(values, ways, weights, damping)
    smooth = np.isfinite(expected)
    assert smooth.sum() >= 20
    np.testing.assert_allclose(rates[smooth], expected[smooth], rtol=2e-5, atol=2e-5)
    active = solved(*values, damping).active != 0
    assert 3 < active.any(axis=1).sum() < 24


def test_shapes_of_rows():
    _, J, s, p, _ = rows(7, 12, 7)
    high = np.full(7, 0.5)
    all_at_once = batches.velocities(J, s, point=p[0], bounds=(-high, high)).velocity
    alone = batches.velocities(J[0], s[0], point=p[0], bounds=(-high, high))
    assert alone.velocity.shape == (7,)
    assert alone.status.shape == ()
    np.testing.assert_allclose(alone.velocity, all_at_once[0], atol=1e-14)
    grid = batches.velocities(J.reshape(3, 4, 6, 7), s.reshape(3, 4, 6), point=p[0], bounds=(-high, high))
    np.testing.assert_allclose(grid.velocity.reshape(12, 7), all_at_once, atol=1e-14)
    strided = np.asfortranarray(np.repeat(J, 2, axis=0))[::2]
    np.testing.assert_allclose(
        batches.velocities(strided, s[::-1][::-1], point=p[0], bounds=(-high, high)).velocity, all_at_once, atol=1e-14
    )
    none = batches.velocities(J[:0], s[:0], point=p[0], bounds=(-high, high))
    assert none.velocity.shape == (0, 7)
    one = batches.velocities(J[:1], s[:1], point=p[0], bounds=(-high, high))
    np.testing.assert_allclose(one.velocity, all_at_once[:1], atol=1e-14)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"J": np.ones((5, 4))}, r"J: found shape \(5, 4\)"),
        ({"twist": np.ones((3, 6))}, r"twist: found \(3,\) rows"),
        ({"point": np.ones(2)}, r"point: found shape \(2,\)"),
        ({"bounds": (np.ones(6), np.ones(7))}, r"bounds\[0\]: found shape \(6,\)"),
        ({"bounds": 3.0}, "bounds: found 3.0"),
        ({"damping": iq.velocity.Selective()}, "damping: found Selective"),
        ({"dt": -1.0}, "dt"),
    ],
)
def test_wrong_arguments_are_named(change, said):
    _, J, s, p, _ = rows(8, 12, 7)
    with pytest.raises(iq.BadInput, match=said):
        batches.velocities(**({"J": J, "twist": s, "point": p} | change))


def test_the_extra_is_named_where_it_is_missing(monkeypatch):
    monkeypatch.setattr("invariantqp.extras.is_installed", lambda package: package != "array_api_compat")
    with pytest.raises(iq.errors.MissingExtra, match=r"array_api_compat is not installed.*array-api-compat>="):
        batches.exps(np.zeros(6))


def test_two_libraries_at_once_are_refused():
    torch, jax = pytest.importorskip("torch"), pytest.importorskip("jax")
    with pytest.raises(iq.BadInput, match=r"arrays of jax.*torch"):
        batches.velocities(torch.ones(6, 2), jax.numpy.ones(6), point=np.zeros(3))
