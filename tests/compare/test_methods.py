import numpy as np
import pytest
from scipy.optimize import linprog
from support.arms import ready

import invariantqp as iq
from invariantqp import extras
from invariantqp.compare.linear import LAMBDA, NEARLY_SINGULAR, chiaverini, saturate
from invariantqp.compare.method import CANNOT, FAMILIES, OURS, OURS_PYTHON, LoopSetting, TickInputs
from invariantqp.compare.registry import METHODS, chosen, controller_named, not_installed
from invariantqp.errors import BadInput, MissingExtra, UnknownName
from invariantqp.runs.taskfile import LawSpec

ROWS = {name: row for name, row in METHODS.items() if row.installed}
RESTING = {OURS, OURS_PYTHON}
READY = ready("panda")


def setting(m):
    return LoopSetting(m, 0.001, np.zeros(3), 1.0)


def plain(J, s, lower, upper):
    """A tick without posture and exact rows."""
    m = J.shape[1]
    return TickInputs(J, s, lower, upper, np.zeros(m), np.zeros((0, m)), np.zeros(0), np.zeros(m))


def solved(name, J, s, reach=1e3, **told):
    m = J.shape[1]
    reach = np.array(np.broadcast_to(reach, m))
    return ROWS[name].loop.keywords["make"](setting(m))(plain(J, s, -reach, reach)._replace(**told))


def problem(seed, m):
    rng = np.random.default_rng([seed, m])
    return rng.normal(size=(6, m)), rng.normal(size=6)


def first_tick(name, robot, q, dx=0.0, ticks=1, **law):
    """The joint velocity of the first tick, or a later one at the same q, towards a target dx [m] away along x."""
    target, loop = robot.pose(q), controller_named(name)(robot, LawSpec(dt=0.001, **law))
    target[0, 3] += dx
    return [loop.step(q, robot.target(target)).velocity for _ in range(ticks)][-1]


def test_every_row_says_what_it_is_and_what_it_takes():
    for name, row in METHODS.items():
        assert row.name == name
        assert row.family in FAMILIES
        assert row.why
        assert all(row.as_json()["takes"].values())
    assert next(iter(METHODS)) == OURS
    assert sum(row.shown for row in METHODS.values()) <= 10


@pytest.mark.parametrize("name", list(ROWS))
def test_what_a_row_says_of_the_posture_is_so(name, panda):
    """At rest on its target, every row that takes the posture moves the null space towards it, at one rate.

    Ours rests there, and moves the null space as fast 0.2 s after the tool moves.
    """
    x = first_tick(name, panda, READY)
    assert ROWS[name].takes.posture != CANNOT
    J, middle = panda.jacobian(READY), 0.5 * (panda.position_lower + panda.position_upper)
    wanted = (np.eye(7) - np.linalg.pinv(J) @ J) @ (middle - READY)
    if name in RESTING:
        assert np.abs(x).max() < 1e-9
        moving = {"dx": 0.05, "gain": 10.0, "ticks": 200}
        x = first_tick(name, panda, READY, **moving) - first_tick(name, panda, READY, **moving, posture=False)
    if name in {"DLS", "[DS] Lambda"}:
        assert x @ wanted > 0.9 * wanted @ wanted
    else:
        np.testing.assert_allclose(x, wanted, atol=0.01 * np.abs(wanted).max())
    assert np.abs(first_tick(name, panda, READY, posture=False)).max() < 1e-9


@pytest.mark.parametrize("name", list(ROWS))
def test_every_row_is_told_how_late_the_arm_is(name, panda):
    late, slow = (first_tick(name, panda, READY, 0.01, **told) for told in ({"delay": 0.1}, {"gain": 2.5}))
    np.testing.assert_array_equal(late, slow)
    assert np.abs(first_tick(name, panda, READY, 0.01)).max() > 2.0 * np.abs(late).max()


@pytest.mark.parametrize("name", list(ROWS))
def test_no_row_exceeds_the_acceleration_limits_that_it_is_told(name, panda):
    loop = controller_named(name)(panda, LawSpec(dt=0.001, acceleration_limit=5.0, posture=False))
    q, x, target = READY, np.zeros(7), panda.pose(READY)
    target[:3, 3] += (0.1, 0.05, 0.02)
    for _ in range(5):
        before, x = x, loop.step(q, panda.target(target)).velocity
        assert np.abs(x - before).max() <= 0.005 * (1.0 + 1e-6)
        q = q + 0.001 * x
    assert np.abs(x).max() > 0.01


@pytest.mark.parametrize("name", list(ROWS))
def test_what_a_row_says_of_exact_rows_is_so(name, so101):
    """Five joints cannot do the twist, but can meet the point: who says so meets it, who cannot does not."""
    robot, q = so101, np.array([0.1, -0.4, 0.5, 0.6, 0.2])
    target = iq.exp([0.02, 0.01, 0.0, 0.0, 0.0, 0.0]) @ robot.pose(q)
    point = np.array([0.02, -0.01, 0.03])
    law = LawSpec(dt=0.001, gain=10.0, exact="position", point=tuple(point.tolist()))
    x = controller_named(name)(robot, law).step(q, robot.target(target)).velocity
    places = robot.pose(q), target, robot.pose(q + 1e-6 * x)
    here, there, after = (T[:3, :3] @ point + T[:3, 3] for T in places)
    missed = np.linalg.norm((after - here) / 1e-6 - 10.0 * (there - here)) / np.linalg.norm(10.0 * (there - here))
    if name in {"scaling", "Drake"}:  # they stand still: no share of this twist can be done
        assert np.abs(x).max() < 1e-6
    else:
        assert (missed < 0.01) == (ROWS[name].takes.exact != CANNOT)


@pytest.mark.parametrize("name", list(ROWS))
def test_every_row_stays_inside_the_limits(name, panda):
    q = READY.copy()
    q[1] = panda.position_lower[1] + 1e-4
    x = first_tick(name, panda, q, dx=-0.05)
    assert np.isfinite(x).all()
    assert (np.abs(x) <= panda.velocity_limit * (1.0 + 1e-9)).all()
    assert q[1] + 0.001 * x[1] >= panda.position_lower[1] - 1e-9


@pytest.mark.parametrize("name", [n for n, row in ROWS.items() if row.takes.feedforward != "added to the twist"])
def test_a_target_ahead_is_as_good_as_a_feedforward(name, panda):
    ahead = np.array([0.02, 0.0, 0.01, 0.05, -0.03, 0.02])
    loop = controller_named(name)(panda, LawSpec(dt=0.001, posture=False))
    x = loop.step(READY, panda.target(panda.pose(READY)), ahead).velocity
    np.testing.assert_allclose(panda.jacobian(READY) @ x, ahead, atol=2e-5)


@pytest.mark.parametrize("m", [3, 5, 6, 8])
@pytest.mark.parametrize("name", ["Moore-Penrose", "SNS"])
def test_moore_penrose_is_the_shortest_least_squares_velocity(name, m):
    J, s = problem(1, m)
    x = solved(name, J, s)
    np.testing.assert_allclose(J.T @ (s - J @ x), 0.0, atol=1e-9)
    null_space = np.linalg.svd(J)[2][np.linalg.matrix_rank(J) :]
    np.testing.assert_allclose(null_space @ x, 0.0, atol=1e-10)


def test_priorities_come_one_after_the_other():
    J, s = problem(2, 8)
    posture, C = np.linspace(-1.0, 1.0, 8), J[3:]
    x = solved("task priority", J, s, C=C, e=s[3:], posture=posture)
    null_space = np.linalg.svd(J)[2][6:]
    np.testing.assert_allclose(J @ x, s, atol=1e-5)
    np.testing.assert_allclose(null_space @ (x - posture), 0.0, atol=1e-5)


@pytest.mark.parametrize("last", [0.0, 1e-9, 1e-3, 0.5])
def test_chiaverini_damps_small_singular_values_alone(last):
    J, _ = problem(4, 7)
    U, _, Vt = np.linalg.svd(J, full_matrices=False)
    sigma = np.r_[np.linspace(2.0, 1.0, 5), last]
    gains = np.linalg.svd(chiaverini(U * sigma @ Vt), compute_uv=False)
    assert gains.max() <= (1.0 if last > NEARLY_SINGULAR else 0.0) / max(last, 1e-9) + 1.0 / LAMBDA
    assert np.isclose(gains, 0.5).any()


@pytest.mark.parametrize("m", [4, 6, 7])
def test_damped_least_squares_is_the_minimum_of_its_cost(m):
    J, s = problem(2, m)
    x = solved("DLS", J, s)
    np.testing.assert_allclose(J.T @ (s - J @ x), LAMBDA**2 * x, atol=1e-12)


def largest_share(J, s, reach):
    """The most of s that any velocity inside the limits carries, by linear programming."""
    m = J.shape[1]
    limits = [*((-r, r) for r in reach), (0.0, 1.0)]
    return linprog(np.r_[np.zeros(m), -1.0], A_eq=np.c_[J, -s], b_eq=np.zeros(6), bounds=limits).x[-1]


@pytest.mark.parametrize("m", [6, 7, 9])
def test_saturation_and_scaling_keep_the_direction_inside_the_limits(m):
    for seed in range(20):
        J, s = problem(seed, m)
        x0 = np.linalg.pinv(J) @ s
        reach = np.random.default_rng(seed).uniform(0.5, 1.2, m) * np.abs(x0).max()
        (velocity, scale), best = saturate(plain(J, s, -reach, reach)), largest_share(J, s, reach)
        assert (np.abs(velocity) <= reach).all()
        np.testing.assert_allclose(J @ velocity, scale * s, atol=1e-9 * np.linalg.norm(s))
        assert min(1.0, (reach / np.abs(x0)).min()) - 1e-9 <= scale <= best + 1e-9
        x = solved("scaling", J, s, reach)
        np.testing.assert_allclose(J @ x, best * s, atol=3e-3 * np.linalg.norm(s))


def test_saturation_outside_its_limits_goes_the_way_back():
    J, s = problem(3, 7)
    lower, upper = np.full(7, -1.0), np.full(7, 1.0)
    lower[2] = 0.4
    x = saturate(plain(J, 5.0 * s, lower, upper))[0]
    assert (x >= lower).all()
    assert (x <= upper).all()


def names(*words):
    return [method.name for method in chosen(words)]


def test_methods_are_chosen_by_name_family_or_part():
    assert chosen()[0].name == "invariantqp"
    assert names("dls") == ["DLS"]
    assert names("dls ", "invariantqp") == ["invariantqp", "DLS"]
    assert {method.family for method in chosen(["damped"])} == {"damped"}
    assert names("pin") == ["Pink"]
    for words in (["moore penrose"], ["DLS", "moore penrose"]):
        with pytest.raises(UnknownName, match="unknown method 'moore penrose'; did you mean"):
            chosen(words)
    with pytest.raises(BadInput, match="--methods: found no method"):
        chosen([""])


def test_a_method_that_is_not_installed_says_what_it_needs(monkeypatch):
    monkeypatch.setattr(extras, "find_spec", lambda name: None if name == "mink" else object())
    assert not_installed(chosen()) == {"peers": ["mink"]}
    assert not_installed(chosen(["damped"])) == {}
    with pytest.raises(MissingExtra, match=r"mink is not installed\. Run: pip install 'mink>="):
        chosen(["mink"])


def test_exact_rows_that_limits_forbid_are_slowed_down_by_halves():
    J, s = problem(5, 6)
    row = np.zeros((1, 6))
    row[0, 0] = 1.0
    make = ROWS["QP with length and LM"].loop.keywords["make"](LoopSetting(6, 0.01, np.zeros(3), 0.5))
    for wanted, share in ((0.9, 1.0), (1.5, 0.5), (3.9, 0.25), (7.9, 0.125), (9.0, 0.0)):
        x = make(TickInputs(J, s, -np.ones(6), np.ones(6), np.zeros(6), row, np.array([wanted]), np.zeros(6)))
        assert x[0] == pytest.approx(share * wanted, abs=1e-9)
        assert (np.abs(x) <= 1.0 + 1e-9).all()
