"""The law of velocity/definition.py: its problem in CVXPY, forms, frames and units, continuity, contradictions."""

from dataclasses import replace

import numpy as np
import pytest
from support.continuity import height

import invariantqp as iq
from invariantqp.velocity.definition import (
    MIN_PROGRESS,
    NULL_WEIGHT,
    RESIDUAL_DAMPING,
    SCALE_WEIGHT,
    SMOOTHING,
    Rows,
    Tick,
    objective,
    velocity,
)
from invariantqp.velocity.measure import root_at

TIGHT = {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11}
# Tighter than Clarabel gets in every case, and then it says so; the comparison decides.
pytestmark = pytest.mark.filterwarnings("ignore:Solution may be inaccurate")


def random_tick(rng, *, limits=True):
    """A tick of a loop with limits around standing still, and any of: rows, a tool speed, a metric, a posture."""
    m = int(rng.integers(3, 9))
    J, s = rng.normal(size=(6, m)), rng.normal(size=6)
    if rng.random() < 0.3:
        J[:, -1] = J[:, 0] + 10.0 ** rng.uniform(-3.0, -1.0) * J[:, -1]
    part = rng.choice((0.0, 1.0, rng.random()))
    fast = float(np.abs(np.linalg.lstsq(J, s, rcond=None)[0]).max())
    side = fast * (rng.uniform(0.1, 1.0, (2, m)) if limits else np.full((2, m), np.inf))
    wide = rng.uniform(1.0, 3.0, (2, m))
    rows = None
    if limits and rng.random() < 0.5:
        k, P = int(rng.integers(0, 4)), rng.normal(size=(3, m)) if rng.random() < 0.5 else None
        rows = Rows(rng.normal(size=(k, m)), -fast * rng.random(k), fast * rng.random(k), (), P, 0.5 * fast)
    M = rng.normal(size=(m, m))
    return Tick(
        J=J,
        root=root_at(rng.normal(size=3), 0.6),
        feedforward=part * s,
        error=(1.0 - part) * s,
        lower=-side[0],
        upper=side[1],
        position_lower=-wide[0] * side[0],
        position_upper=wide[1] * side[1],
        rows=rows,
        posture=rng.normal(size=m) if rng.random() < 0.5 else None,
        velocity_limit=np.full(m, 5.0) if rng.random() < 0.5 else None,
        metric=M.dot(M.T) + np.eye(m) if rng.random() < 0.3 else None,
        hold_time=0.01,
        last_velocity=0.3 * fast * rng.normal(size=m),
        last_residual=float(rng.random()),
    )


def by_cvxpy(cp, tick, pace):
    """The docstring's problem, once more: x at a pace, a root of H, and what that pace costs and the best."""
    m = tick.J.shape[1]
    A, M = tick.root @ tick.J, np.eye(m) if tick.metric is None else tick.metric
    f, e = tick.root @ tick.feedforward, tick.root @ tick.error
    L = np.linalg.cholesky(M)
    size = np.linalg.norm(A @ np.linalg.inv(L).T) ** 2
    mu, nu, w = (
        RESIDUAL_DAMPING * tick.hold_time * np.sqrt(size) * tick.last_residual,
        SMOOTHING * size,
        NULL_WEIGHT * size,
    )
    _, sigma, Vt = np.linalg.svd(A @ np.linalg.inv(L).T)
    N = Vt[int(np.sum(sigma > 1e-9 * sigma[0])) :] @ L.T
    x_p = np.zeros(m)
    if tick.posture is not None:
        x_p = tick.posture
        if tick.velocity_limit is not None:
            bare = replace(tick, posture=None)
            problem = objective(bare, np.linalg.inv(L).T, 1.0)
            start, way = (np.linalg.inv(L).T @ np.linalg.solve(problem.H, c) for c in (problem.f, problem.e))
            c = max(0.0, 1.0 - MIN_PROGRESS * (e @ e) / max(e @ A @ way, 1e-300)) if e.any() else 1.0
            t, t_p = (np.abs(x / tick.velocity_limit).max() for x in (start + c * way, tick.posture))
            x_p = min(1.0, t / t_p) ** 2 * tick.posture

    def least(p):
        x = cp.Variable(m)
        cost = cp.sum_squares(A @ x - f - p * e) + mu * cp.sum_squares(L.T @ x)
        cost += nu * cp.sum_squares(L.T @ (x - tick.last_velocity))
        cost += w * cp.sum_squares(N @ (x - x_p)) if len(N) else 0.0
        limits = [x >= tick.position_lower, x <= tick.position_upper]
        cp.Problem(cp.Minimize(0.5 * cost), limits).solve(
            "CLARABEL", tol_gap_abs=1e-13, tol_gap_rel=1e-13, tol_feas=1e-13
        )
        return x.value

    H = A.T @ A + (mu + nu) * M + w * N.T @ N
    root, root_K = (np.linalg.cholesky(S).T for S in (H, A.T @ A + (mu + NULL_WEIGHT * size) * M))
    y_0, y_1 = least(0.0), least(1.0)
    d = y_1 - y_0
    d = d * (max(0.0, 1.0 - MIN_PROGRESS * (e @ e) / max(e @ A @ d, 1e-300)) if e.any() else 1.0)
    long = np.linalg.norm(root_K @ d)
    x, p = cp.Variable(m), cp.Variable()
    cost = 0.5 * cp.sum_squares(root_K @ (x - y_0 - p * d)) + np.linalg.norm(f) * long * (1.0 - p)
    cost += 0.5 * SCALE_WEIGHT * long**2 * cp.square(1.0 - p)
    limits = [x >= tick.lower, x <= tick.upper]
    if tick.rows is not None:
        if len(tick.rows.C):
            limits += [tick.rows.C @ x >= tick.rows.lower, tick.rows.C @ x <= tick.rows.upper]
        limits += [] if tick.rows.P is None else [cp.norm(tick.rows.P @ x) <= tick.rows.speed]
    costs = [cp.Problem(cp.Minimize(cost), [*limits, *of_p]) for of_p in ([p == pace], [p >= 0.0, p <= 1.0])]
    costs = [problem.solve("CLARABEL", **TIGHT) for problem in costs]
    cp.Problem(cp.Minimize(cp.sum_squares(root @ (x - y_0 - pace * d))), limits).solve("CLARABEL", **TIGHT)
    return x.value, root, *costs


@pytest.mark.parametrize("seed", [*range(40), 178, 256])
def test_a_tick_is_the_problem_of_the_docstring(seed):
    cp = pytest.importorskip("cvxpy")
    tick = random_tick(np.random.default_rng(seed))
    answer = velocity(tick)
    x, root, cost, best = by_cvxpy(cp, tick, answer.approach_scale)
    assert cost <= best + 1e-9 * np.sum((root @ x) ** 2)
    assert np.linalg.norm(root @ (answer.velocity - x)) <= 1e-5 * np.linalg.norm(root @ x)
    assert kept(tick, answer.velocity)


def kept(tick, x, margin=1e-7):
    """Whether all limits of a tick are kept."""
    above, below, rows = x - tick.upper, tick.lower - x, tick.rows
    if rows is not None:
        above, below = np.append(above, rows.C @ x - rows.upper), np.append(below, rows.lower - rows.C @ x)
        above = above if rows.P is None else np.append(above, np.linalg.norm(rows.P @ x) - rows.speed)
    return max(above.max(), below.max()) <= margin


@pytest.mark.parametrize("form", [None, iq.PitchForm(0.4)])
@pytest.mark.parametrize("seed", range(20))
def test_frames_and_units_do_not_matter(seed, form):
    """The same tick in a frame a metre away and turned, and in millimetres."""
    rng = np.random.default_rng(seed)
    tick = random_tick(rng)
    tick = tick if form is None else replace(tick, form=form, damping=0.3, guard=0.1)
    x = velocity(tick).velocity
    X = iq.adjoint(iq.exp(rng.normal(size=6)))
    unit = np.diag(np.repeat([1.0, 1000.0], 3))
    for change, scale in ((X, 1.0), (unit, 1000.0)):
        there = replace(
            tick,
            J=change @ tick.J,
            feedforward=change @ tick.feedforward,
            error=change @ tick.error,
            root=scale * tick.root @ np.linalg.inv(change),
            last_residual=scale * tick.last_residual,
            form=form if scale == 1.0 or form is None else iq.PitchForm(scale * form.h),
            damping=scale * tick.damping,
        )
        assert velocity(there).velocity == pytest.approx(x, abs=1e-10 * max(1.0, np.abs(x).max()))


@pytest.mark.parametrize("seed", [*range(12), 26, 89, 131])  # the last three stand at several limits at once
def test_the_velocity_is_continuous(seed):
    """Along a segment between two ticks with all numbers changed."""
    rng = np.random.default_rng(seed)
    a = random_tick(rng)
    b = replace(
        a,
        J=a.J + 0.5 * rng.normal(size=a.J.shape),
        feedforward=a.feedforward + rng.normal(size=6),
        error=a.error + rng.normal(size=6),
        lower=a.lower * rng.uniform(0.3, 1.0),
        upper=a.upper * rng.uniform(0.3, 1.0),
        last_residual=3.0 * rng.random(),
    )
    names = ("J", "feedforward", "error", "lower", "upper", "last_residual")

    def at(t):
        mixed = {name: (1.0 - t) * getattr(a, name) + t * getattr(b, name) for name in names}
        return velocity(replace(a, **mixed)).velocity

    assert height(at, 1e-4) < 1e-4


def test_conflicting_rows_are_relaxed_by_the_least_and_named():
    tick = replace(random_tick(np.random.default_rng(4)), metric=None)
    m = len(tick.lower)
    row = np.eye(m)[:1]
    above = tick.upper[0] + 0.25
    answer = velocity(replace(tick, rows=Rows(row, np.array([above]), np.array([np.inf]), ("plane",))))
    assert answer.velocity[0] == pytest.approx(tick.upper[0], abs=1e-5)
    assert answer.relaxed == (("plane", pytest.approx(0.25, rel=1e-3)),)
    P = np.zeros((3, m))
    P[0, 0] = 1.0
    held = replace(tick, lower=np.where(np.arange(m) == 0, 0.5 * tick.upper[0], tick.lower))
    fast = velocity(replace(held, rows=Rows(np.zeros((0, m)), np.zeros(0), np.zeros(0), (), P, 0.25 * tick.upper[0])))
    assert fast.relaxed == (("the tool's speed", pytest.approx(0.25 * tick.upper[0], rel=1e-3)),)


def one_joint(**options):
    """A tick of one joint that moves the tool along x, in a loop that stood still."""
    J, free = np.eye(6)[:, 3:4], np.array([np.inf])
    given = {
        "feedforward": np.zeros(6),
        "error": np.zeros(6),
        "hold_time": 0.01,
        "last_velocity": np.zeros(1),
        **options,
    }
    return Tick(
        **{"J": J, "root": np.eye(6), "lower": -free, "upper": free, **given}, position_lower=-free, position_upper=free
    )


def test_limits_bind_where_exact_rows_leave_nothing_free():
    """3 - 2 of the rows is the limit of 1, and no share of the other part alone."""
    exact, e = (np.eye(1), np.array([3.0]), np.array([-2.0])), np.eye(6)[4]
    assert velocity(one_joint(exact=exact, error=e, lower=-np.ones(1), upper=np.ones(1))).velocity <= 1.0 + 1e-9
    exact = (np.eye(1), np.ones(1), np.zeros(1))
    x = velocity(one_joint(exact=exact, feedforward=np.eye(6)[3], lower=-np.ones(1), upper=np.ones(1) - 2e-5)).velocity
    assert x <= 1.0 - 2e-5
    assert velocity(one_joint(exact=(np.zeros((0, 1)), np.zeros(0), np.zeros(0)))).velocity == pytest.approx(0.0)


def test_a_tool_speed_limit_holds_with_conflicting_exact_rows():
    J, free, E = np.eye(6)[:, :2], np.full(2, np.inf), np.array([[1.0, -1.0]])
    speed = Rows(np.zeros((0, 2)), np.zeros(0), np.zeros(0), (), np.eye(3)[:, :2], 0.5001)
    low, high = np.array([-1.0, 0.5]), np.array([1.0, 0.5])
    exact = (E, np.ones(1), np.zeros(1))
    loop = {"hold_time": 0.01, "last_velocity": np.zeros(2)}
    tick = Tick(J, np.eye(6), np.eye(6)[0], np.zeros(6), low, high, -free, free, speed, exact, **loop)
    assert np.linalg.norm(velocity(tick).velocity) <= 0.5001 * (1.0 + 1e-6)


def test_a_small_conflict_next_to_a_large_one_is_relaxed_too():
    J, free, one = np.eye(6)[:, :2], np.full(2, np.inf), np.ones(2)
    rows = Rows(np.eye(2), np.array([1e5, 1.5]), free)
    tick = Tick(J, np.eye(6), np.eye(6)[0], np.zeros(6), -one, one, -free, free, rows)
    answer = velocity(tick)
    assert answer.velocity == pytest.approx(one, abs=5e-5)  # limits are widened by 3e-5 of what gives way
    assert [name for name, _ in answer.relaxed] == ["row 0", "row 1"]
