import numpy as np
import pytest
from scipy.optimize import linprog

import invariantqp as iq
from invariantqp.compare import names
from invariantqp.compare.laws.damped import DLS_DAMPING, MANIPULABILITY, NEARLY_SINGULAR
from invariantqp.compare.laws.saturation import saturate
from invariantqp.compare.laws.unit_consistent import scaling, unit_consistent_inverse
from invariantqp.compare.method import FAMILIES, Setting
from invariantqp.compare.registry import chosen, left_out, methods
from invariantqp.errors import BadInput, UnknownName

SOLVERS = {name: method for name, method in methods().items() if method.make is not None}
INVARIANT = [n for n, m in SOLVERS.items() if m.family == "invariant" or n.startswith("QP, ")]
WIDE = 1e3


def solved(name, J, s, reach=WIDE, **setting):
    m = J.shape[1]
    reach = np.array(np.broadcast_to(reach, m))
    return SOLVERS[name].make(Setting(m, **setting))(J, s, -reach, reach)


def problem(seed, m):
    rng = np.random.default_rng([seed, m])
    return rng.normal(size=(6, m)), rng.normal(size=6)


def null_space(J):
    return np.linalg.svd(J)[2][np.linalg.matrix_rank(J) :].T


def test_every_method_says_what_it_is():
    for name, method in methods().items():
        assert method.name == name
        assert method.family in FAMILIES
        assert method.why
        assert (method.make is None) <= (method.system is not None)
    assert {method.family for method in methods().values()} >= {"invariant", "Moore-Penrose", "damped", "QP"}


@pytest.mark.parametrize("name", list(SOLVERS))
def test_every_installed_solver_answers(name):
    if not SOLVERS[name].installed:
        pytest.skip(f"needs {SOLVERS[name].needs}")
    for m in (7,) if name == "QP, CVXPY" else (4, 6, 7):  # it writes its problem anew for each size
        J, s = problem(0, m)
        x = solved(name, J, s, reach=0.3 * np.ones(m))
        assert x.shape == (m,)
        assert np.isfinite(x).all()


@pytest.mark.parametrize("m", [3, 5, 6, 8])
@pytest.mark.parametrize("name", [n for n, m in SOLVERS.items() if m.problem == "least squares"])
def test_moore_penrose_is_the_shortest_least_squares_velocity(name, m):
    for seed in range(5):
        J, s = problem(seed, m)
        x = solved(name, J, s)
        size = np.linalg.norm(s)
        np.testing.assert_allclose(J.T @ (s - J @ x), 0.0, atol=1e-9 * size)
        np.testing.assert_allclose(null_space(J).T @ x, 0.0, atol=1e-10 * np.linalg.norm(x))


@pytest.mark.parametrize("m", [6, 8])
def test_weighted_moore_penrose_is_shortest_in_units_of_the_bounds(m):
    J, s = problem(1, m)
    reach = np.random.default_rng(1).uniform(100.0, 1000.0, m)
    x = solved("weighted Moore-Penrose", J, s, reach)
    np.testing.assert_allclose(J @ x, s, atol=1e-9)
    np.testing.assert_allclose(null_space(J).T @ (x / reach**2), 0.0, atol=1e-12)


@pytest.mark.parametrize("m", [3, 6, 7])
def test_the_unit_consistent_inverse_commutes_with_changes_of_units(m):
    rng = np.random.default_rng(m)
    J = rng.normal(size=(6, m))
    J[rng.random((6, m)) < 0.2] = 0.0
    X = unit_consistent_inverse(J)
    D, E = np.diag(10.0 ** rng.uniform(-3, 3, 6)), np.diag(10.0 ** rng.uniform(-3, 3, m))
    changed = np.linalg.inv(E) @ X @ np.linalg.inv(D)
    np.testing.assert_allclose(
        unit_consistent_inverse(D @ J @ E), changed, rtol=1e-8, atol=1e-12 * np.abs(changed).max()
    )
    np.testing.assert_allclose(J @ X @ J, J, atol=1e-12)
    np.testing.assert_allclose(X @ J @ X, X, atol=1e-11 * np.abs(X).max())
    d, e = scaling(J)
    logs = np.log(np.abs(d[:, None] * J * e), where=J != 0.0, out=np.zeros_like(J))
    np.testing.assert_allclose(logs.sum(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(logs.sum(axis=1), 0.0, atol=1e-12)


def largest_share(J, s, reach):
    """The most of s that any velocity inside the limits carries, by linear programming."""
    m = J.shape[1]
    limits = [*((-r, r) for r in reach), (0.0, 1.0)]
    return linprog(np.r_[np.zeros(m), -1.0], A_eq=np.c_[J, -s], b_eq=np.zeros(6), bounds=limits).x[-1]


@pytest.mark.parametrize("m", [6, 7, 9])
def test_saturation_keeps_the_direction_inside_the_limits(m):
    whole = 0
    for seed in range(60):
        J, s = problem(seed, m)
        x0 = np.linalg.pinv(J) @ s
        reach = np.random.default_rng(seed).uniform(0.5, 1.2, m) * np.abs(x0).max()
        found = saturate(J, s, -reach, reach)
        assert (np.abs(found.velocity) <= reach).all()
        np.testing.assert_allclose(J @ found.velocity, found.scale * s, atol=1e-9 * np.linalg.norm(s))
        best = largest_share(J, s, reach)
        assert found.scale <= best + 1e-9
        assert found.scale >= min(1.0, (reach / np.abs(x0)).min()) - 1e-9  # no worse than slowing Moore-Penrose down
        if m == 6:
            assert found.scale == pytest.approx(best, abs=1e-9)
        whole += found.scale == 1.0 and len(found.saturated) > 0
    assert whole >= (0 if m == 6 else 5)


def test_saturation_outside_its_limits_goes_the_way_back():
    J, s = problem(3, 7)
    lower, upper = np.full(7, -1.0), np.full(7, 1.0)
    lower[2] = 0.4
    x = saturate(J, 5.0 * s, lower, upper).velocity
    assert (x >= lower).all()
    assert (x <= upper).all()
    open_side = saturate(J, s, np.r_[-0.01, np.full(6, -np.inf)], np.r_[0.01, np.full(6, np.inf)])
    assert abs(open_side.velocity[0]) <= 0.01
    np.testing.assert_allclose(J @ open_side.velocity, s, atol=1e-9)


@pytest.mark.parametrize("m", [4, 6, 7])
def test_damped_least_squares_is_the_minimum_of_its_cost(m):
    J, s = problem(2, m)
    x = solved("DLS", J, s)
    np.testing.assert_allclose(J.T @ (s - J @ x), DLS_DAMPING**2 * x, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "onset"), [("DLS, manipulability", MANIPULABILITY), ("DLS, filtered", NEARLY_SINGULAR)]
)
@pytest.mark.parametrize("m", [5, 6, 7])
def test_adaptive_damping_leaves_regular_states_alone_and_bounds_singular_ones(name, onset, m):
    J, s = problem(4, m)
    U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
    sigma = np.linspace(2.0, 1.0, len(sigma))
    regular = U * sigma @ Vt
    np.testing.assert_allclose(solved(name, regular, s), np.linalg.pinv(regular) @ s, atol=1e-10)
    for last in (0.0, 1e-9, 1e-3 * onset):
        sigma[-1] = last
        singular = U * sigma @ Vt
        assert np.linalg.norm(solved(name, singular, s)) <= (1.0 + 0.5 / (0.9 * DLS_DAMPING)) * np.linalg.norm(s)


def test_the_transpose_goes_as_far_as_helps():
    J, s = problem(5, 7)
    x = solved("Jacobian transpose", J, s)
    direction = J.T @ s
    (best,), *_ = np.linalg.lstsq((J @ direction)[:, None], s, rcond=None)
    np.testing.assert_allclose(x, best * direction, rtol=1e-12)
    assert not solved("Jacobian transpose", J, np.zeros(6)).any()


@pytest.mark.parametrize("name", INVARIANT)
def test_no_invariant_method_sees_where_the_frame_is(name):
    if not SOLVERS[name].installed:
        pytest.skip(f"needs {SOLVERS[name].needs}")
    rng = np.random.default_rng(7)
    J, s = rng.normal(size=(6, 5)), rng.normal(size=6)
    reach = 0.7 * np.abs(iq.pseudoinverse(J, 0.4) @ s).max()
    T = iq.exp(rng.normal(size=6))
    A, point = iq.adjoint(T), np.array([0.3, -0.1, 0.2])
    x = solved(name, J, s, reach, pitch=0.4, point=point)
    moved = solved(name, A @ J, A @ s, reach, pitch=0.4, point=T[:3, :3] @ point + T[:3, 3], body=T)
    loose = any(word in name for word in ("OSQP", "ProxQP", "PIQP", "Clarabel", "HiGHS", "CVXPY"))
    np.testing.assert_allclose(moved, x, rtol=0.0, atol=(2e-2 if loose else 1e-10) * np.abs(x).max())


def test_methods_are_chosen_by_name_family_or_part():
    everything = chosen()
    assert next(iter(everything)) == "invariantqp"
    assert list(chosen("dls")) == ["DLS"]
    assert list(chosen(["QP, DAQP", "dls ", "invariantqp, h"])) == ["invariantqp, h", "DLS", "QP, DAQP"]
    assert {m.family for m in chosen("damped").values()} == {"damped"}
    assert len(chosen("osqp")) == 12
    assert list(chosen(["h, eigen"])) == ["h, eigen"]
    with pytest.raises(UnknownName, match="unknown method 'moore penrose'; did you mean"):
        chosen("moore penrose")
    with pytest.raises(BadInput, match="--methods: found no method"):
        chosen("")
    assert list(chosen("Moore-Penrose, pinv")) == ["Moore-Penrose, pinv"]


def test_all_unknown_names_are_told_at_once_with_similar_ones():
    with pytest.raises(BadInput, match=r"no method called 'pinf' \(similar: .*\) or 'xyz'; expected .*'QP, DAQP'"):
        chosen(["DLS", "pinf", "xyz"])
    with pytest.raises(BadInput, match=r"no method called 'invariantqp,DLS' .* Give each name a --methods of its own"):
        chosen("invariantqp,DLS")
    with pytest.raises(UnknownName, match=r"known: .*; QP, DAQP; "):
        chosen("xyz")


def test_names_that_reports_look_for_are_names_of_methods():
    told = {value for key, value in vars(names).items() if key.isupper()}
    assert len(told) > 10
    assert told <= set(methods())


def test_a_method_that_is_not_installed_says_what_it_needs(monkeypatch):
    from invariantqp.compare import method as module

    monkeypatch.setattr(module, "find_spec", lambda name: None if name == "piqp" else object())
    assert "QP, PIQP" not in chosen()
    assert [method.name for method in left_out()] == ["QP, PIQP"]
    assert left_out("damped") == []
    with pytest.raises(BadInput, match=r"QP, PIQP, which needs piqp; .* Run: pip install 'invariantqp\[compare\]'"):
        chosen(["QP, PIQP"])


def test_every_method_that_needs_a_module_says_which_extra_brings_it():
    assert {method.name for method in methods().values() if bool(method.needs) != bool(method.extra)} == set()
