"""Methods are what they say: by hand against their definitions, libraries against what all are given."""

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.optimize import linprog, lsq_linear

import invariantqp as iq
from invariantqp.errors import UnknownName
from invariantqp.workbench.compare import by_hand
from invariantqp.workbench.compare.arms import STARTS, arm
from invariantqp.workbench.compare.by_hand import (
    DAMPING_THRESHOLD,
    EPS,
    LAMBDA,
    MAX_DAMPING,
    ByHand,
    TickProblem,
    chiaverini,
    saturate,
)
from invariantqp.workbench.compare.drive import as_json
from invariantqp.workbench.compare.figures import figures
from invariantqp.workbench.compare.method import FAMILIES, OURS
from invariantqp.workbench.compare.sweep import METHODS, chosen, methods_named
from invariantqp.workbench.compare.tasks import bed, spec_of
from invariantqp.workbench.compare.worker import Run
from invariantqp.workbench.runs.taskfile import LawSpec

HERE = [
    row for row in methods_named(None) if not row.environment and all(map(find_spec, row.needs)) and not row.needs_pitch
]
BY_HAND = [row.name for row in METHODS.values() if row.family == "by hand"]
SLACK = 1e-7  # DAQP's
GIVEN = spec_of(arm("panda"), LawSpec(dt=0.002))


def problem(seed, m):
    rng = np.random.default_rng([seed, m])
    return rng.normal(size=(6, m)), rng.normal(size=6)


def tick(J, s, reach=1e3, **more):
    m = J.shape[1]
    reach = np.array(np.broadcast_to(reach, m))
    return TickProblem(J, s, s, -reach, reach, np.zeros(m))._replace(**more)


def solved(name, J, s, reach=1e3, **more):
    given = replace(GIVEN, names=tuple(f"joint{i}" for i in range(J.shape[1])), point=np.array([0.1, -0.2, 0.3]))
    return METHODS[name].loop(given).velocity(tick(J, s, reach, **more))


def measured(row, task):
    """The figures of a method on a task."""
    run = Run(row, as_json(task))
    run.run(len(task.targets))
    return figures(task, run.end())


def test_every_row_says_what_it_is_and_what_it_makes_of_what_it_is_given():
    assert next(iter(METHODS)) == OURS
    for name, row in METHODS.items():
        assert row.name == name
        assert row.family in FAMILIES
        assert row.about
        assert all(row.setting)
        assert bool(row.distribution) == (row.family != "by hand" and bool(row.needs))


def test_rivals_by_hand_need_nothing_that_this_library_does_not():
    assert all(not METHODS[name].needs for name in BY_HAND)


@pytest.mark.parametrize("m", [3, 5, 6, 8])
@pytest.mark.parametrize("name", ["Moore-Penrose", "SNS"])
def test_moore_penrose_is_the_shortest_least_squares_velocity(name, m):
    J, s = problem(1, m)
    x = solved(name, J, s)
    np.testing.assert_allclose(J.T @ (s - J @ x), 0.0, atol=1e-9)
    null_space = np.linalg.svd(J)[2][np.linalg.matrix_rank(J) :]
    np.testing.assert_allclose(null_space @ x, 0.0, atol=1e-10)


@pytest.mark.parametrize("m", [4, 6, 7])
def test_damped_methods_are_the_minima_of_their_costs(m):
    J, s = problem(2, m)
    for name, mu in (("DLS", LAMBDA**2), ("LM", 0.5 * s @ s + EPS)):
        x = solved(name, J, s)
        np.testing.assert_allclose(J.T @ (s - J @ x), mu * x, atol=1e-10)


@pytest.mark.parametrize("h", [-0.2, 0.3])
def test_the_pseudoinverse_of_a_pitch_is_this_library_s(h):
    J, s = problem(5, 5)
    given = replace(GIVEN, names=tuple("abcde"), law={**GIVEN.law, "form": h})
    x = METHODS["J^{+h}"].loop(given).velocity(tick(J, s))
    swap = [3, 4, 5, 0, 1, 2]  # the comparison's twists have the linear part first
    np.testing.assert_allclose(x, iq.pseudoinverse(J[swap], h) @ s[swap], atol=1e-9)


def test_a_method_of_a_pitch_takes_tasks_with_a_pitch():
    with_pitch = replace(GIVEN, law={**GIVEN.law, "form": 0.3})
    assert [METHODS["J^{+h}"].takes(given) for given in (GIVEN, with_pitch)] == [False, True]
    limited = replace(GIVEN, acceleration_limit=np.ones(7))
    assert [METHODS["mink"].takes(given) for given in (GIVEN, limited)] == [True, False]


def test_priorities_come_one_after_the_other():
    J, s = problem(2, 8)
    posture = np.linspace(-1.0, 1.0, 8)
    x = solved("task priority", J, s, posture_velocity=posture)
    np.testing.assert_allclose(J @ x, s, atol=1e-9)
    np.testing.assert_allclose(np.linalg.svd(J)[2][6:] @ (x - posture), 0.0, atol=1e-9)
    J, s = problem(3, 4)  # four joints: position is met, orientation as well as the fourth joint can
    x = solved("task priority", J, s)
    np.testing.assert_allclose(J[:3] @ x, s[:3], atol=1e-9)
    null = np.linalg.svd(J[:3])[2][3]
    assert abs(null @ J[3:].T @ (s[3:] - J[3:] @ x)) < 1e-9


@pytest.mark.parametrize("last", [0.0, 1e-9, 1e-3, 0.5])
def test_chiaverini_damps_small_singular_values_alone(last):
    J, _ = problem(4, 7)
    U, _, Vt = np.linalg.svd(J, full_matrices=False)
    sigma = np.r_[np.linspace(2.0, 1.0, 5), last]
    gains = np.linalg.svd(chiaverini(U * sigma @ Vt), compute_uv=False)
    assert gains.max() <= (1.0 if last > DAMPING_THRESHOLD else 0.0) / max(last, 1e-9) + 1.0 / MAX_DAMPING
    assert np.isclose(gains, 0.5).any()


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
        (velocity, scale), best = saturate(tick(J, s, reach)), largest_share(J, s, reach)
        assert (np.abs(velocity) <= reach).all()
        np.testing.assert_allclose(J @ velocity, scale * s, atol=1e-9 * np.linalg.norm(s))
        assert min(1.0, (reach / np.abs(x0)).min()) - 1e-9 <= scale <= best + 1e-9
        x = solved("scaling", J, s, reach)
        np.testing.assert_allclose(J @ x, best * s, atol=3e-3 * np.linalg.norm(s))


@pytest.mark.parametrize("m", [3, 5])
def test_with_few_joints_scaling_is_of_what_they_can_do(m):
    for seed in range(20):
        J, s = problem(seed, m)
        x0 = np.linalg.pinv(J) @ s
        x = solved("scaling", J, s, 0.5 * np.abs(x0).max())
        np.testing.assert_allclose(x, 0.5 * x0, atol=1e-5 * np.abs(x0).max())


@pytest.mark.parametrize("name", ["QP", "QP with length", "QP with |e|^2", "QP with both"])
@pytest.mark.parametrize("m", [5, 7])
def test_a_qp_is_the_least_squares_that_it_says(name, m):
    J, s = problem(6, m)
    towards = np.linspace(-1.0, 1.0, m)
    point, L = np.array([0.1, -0.2, 0.3]), GIVEN.length
    root = np.eye(6)
    if "QP with length" in name or "both" in name:
        root[:3, 3:] = [np.cross(w, point) for w in np.eye(3)]
        root[:3, 3:] = root[:3, 3:].T
        root[3:, 3:] *= L
    mu = 0.5 * np.sum((root @ s) ** 2) if "|e|^2" in name or "both" in name else 0.0
    A = np.vstack((root @ J, np.sqrt(EPS + mu) * np.eye(m)))
    b = np.concatenate((root @ s, EPS / np.sqrt(EPS + mu) * towards))
    reach = 0.4 * np.abs(np.linalg.lstsq(A, b, rcond=None)[0]).max()
    best = lsq_linear(A, b, (-reach, reach), tol=1e-14).x
    np.testing.assert_allclose(solved(name, J, s, reach, posture_velocity=towards), best, atol=1e-6)


@pytest.mark.parametrize("name", STARTS)
def test_pinocchio_and_this_library_read_the_same(name, monkeypatch):
    pytest.importorskip("pinocchio")
    robot, q = arm(name), np.array(STARTS[name])
    given, pose, ahead = spec_of(robot, LawSpec(dt=0.002)), robot.pose(q + 0.1), np.arange(6) / 10.0
    theirs = ByHand(given, by_hand.moore_penrose)
    monkeypatch.setattr(by_hand, "is_installed", lambda _: False)
    ours = ByHand(given, by_hand.moore_penrose)
    for a, b in zip(*(loop.read(q, loop.target(pose, ahead), ahead) for loop in (theirs, ours)), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)


@pytest.mark.parametrize("name", [name for name in BY_HAND if not METHODS[name].needs_pitch])
def test_methods_by_hand_keep_limits_of_position_speed_and_acceleration(name):
    """Targets far beyond all of them: each has a distance from which it brakes."""
    rng = np.random.default_rng(7)
    robot = arm("panda")
    loop = METHODS[name].loop(spec_of(robot, LawSpec(dt=0.01, acceleration_limit=5.0)))
    q, previous, stopped, nearest = np.array(STARTS["panda"]), np.zeros(7), 0, np.inf
    for k in range(400):
        if k % 100 == 0:
            target = loop.target(robot.pose(rng.uniform(robot.position_lower, robot.position_upper)), None)
        try:
            x = loop.step(q, target, None, previous)
        except RuntimeError:
            assert name == "scaling"  # with no share of the twist within reach it has no answer
            stopped, x = stopped + 1, np.clip(0.0, previous - 0.05, previous + 0.05)
        else:
            assert (np.abs(x - previous) <= 0.05 + SLACK).all()
            assert (np.abs(x) <= robot.velocity_limit + SLACK).all()
        q, previous = q + 0.01 * x, x
        room = np.minimum(robot.position_upper - q, q - robot.position_lower)
        assert (room >= -SLACK).all() or stopped
        nearest = min(nearest, room.min())
    assert nearest < 0.1 or name == "SNS"  # which may stand still: no share of the twist is inside its limits
    assert stopped < 200


@pytest.mark.parametrize("row", HERE, ids=lambda row: row.name)
def test_all_follow_a_slow_path_alike(row):
    """The same gain and feedforward: without limits no method is further off than another, but for damping."""
    (task,) = bed(["ur5e"], ["free"])
    n = 700
    task = replace(task, **{key: getattr(task, key)[:n] for key in ("targets", "feedforward", "noise", "desired")})
    found = measured(row, task)
    assert found["exceptions"] == found["violations"] == 0
    assert found["mm"] < (2.0 if row.name == "DLS" else 0.02)
    without = measured(row, replace(task, feedforward=None))
    assert without["mm"] > 2.0


@pytest.mark.parametrize(
    "row", [row for row in HERE if row.name not in {"SNS", "scaling"} and not row.slow], ids=lambda row: row.name
)
def test_the_point_that_a_row_takes_makes_it_free_of_the_tool_frame(row):
    (task,) = bed(["so101"], ["other tool frame"])
    """But for those that stand still on this path, and slow ones."""
    n = 150
    short = {key: getattr(task, key)[:n] for key in ("targets", "feedforward", "noise", "desired")}
    other, mine = replace(task, **short), replace(task.original, **{**short, "targets": task.original.targets[:n]})
    runs = []
    for t in (mine, other):
        run = Run(row, as_json(t))
        run.run(n)
        runs.append(np.array(run.end()["positions"]))
    change = np.abs(runs[0] - runs[1]).max()
    assert change < 1e-9 if row.setting.point.startswith("given") else change > 1e-5


def test_all_are_given_what_the_library_is_given():
    robot = arm("panda")
    given = spec_of(robot, LawSpec(dt=0.01, delay=0.05, posture_gain=2.0, point=(0.0, 0.0, 0.1)))
    assert given.gain == iq.Controller(robot, dt=0.01, delay=0.05).gain < iq.Controller(robot, dt=0.01).gain
    assert (given.posture_gain == 2.0).all()
    np.testing.assert_allclose(given.posture, 0.5 * (robot.position_lower + robot.position_upper))
    assert given.length == iq.Controller(robot, dt=0.01, point=[0.0, 0.0, 0.1]).measure.length
    limits = np.arange(1.0, 8.0)
    np.testing.assert_array_equal(
        spec_of(robot, LawSpec(acceleration_limit=limits.tolist())).acceleration_limit, limits
    )


def test_methods_are_chosen_by_name_family_or_part():
    def names(*words):
        return [method.name for method in methods_named(words)]

    assert methods_named(None)[0].name == OURS
    assert names("dls") == ["DLS"]
    assert names("dls ", "invariantqp") == ["invariantqp", "DLS"]
    assert set(names("by hand")) == set(BY_HAND)
    assert names("pin") == ["Pink"]
    assert names("qp") == ["QP"]  # a full name before parts of others
    assert names("pink, lm_damping 100.0") == ["Pink, lm_damping 100.0"]
    assert len(names("other settings")) > 20
    assert not set(names("other settings")) & {row.name for row in methods_named(None)}
    with pytest.raises(UnknownName, match="unknown method 'moore penrose'; did you mean"):
        names("DLS", "moore penrose")
    with pytest.raises(UnknownName, match="unknown kind ''"):
        chosen([""], ["free"], "kind")
