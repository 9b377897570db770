"""No jump: along any segment of twists, bounds and joint twists the velocity moves in proportion to the step.

Each segment is sampled, and its steepest step bisected down to 1e-12 of it: a jump keeps its height, a steep slope does
not. Set INVARIANTQP_SWEEPS=1000 for as many as the law is released with.
"""

import os
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from support.arms import KINDS, arm
from support.random_systems import motion

import invariantqp as iq
from invariantqp.velocity.law import Chase
from invariantqp.velocity.problem import problem_of
from invariantqp.velocity.solve import solve

SWEEPS = int(os.environ.get("INVARIANTQP_SWEEPS", "27"))
SAMPLES = 24
BISECTIONS = 36
# A step of 1e-12 of a segment that moves the velocity by more than this, relative to its size on the segment. Damping
# near a singularity has slopes of 1 / ceiling^2, 1e9 at most.
JUMP = 1e-3
# Of segments slower than this [rad/s]: an arm that is all but at rest.
SLOW = 0.1


def height(velocity):
    """The largest change of velocity(t) over 2^-36 of a step of [0, 1], relative to the largest velocity."""
    times = np.linspace(0.0, 1.0, SAMPLES + 1)
    path = [velocity(t) for t in times]
    size = max(SLOW, *(np.abs(x).max() for x in path))
    steps = [np.abs(b - a).max() for a, b in pairwise(path)]
    k = int(np.argmax(steps))
    low, high, x_low, x_high = times[k], times[k + 1], path[k], path[k + 1]
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        x = velocity(middle)
        if np.abs(x - x_low).max() >= np.abs(x_high - x).max():
            high, x_high = middle, x
        else:
            low, x_low = middle, x
        if np.abs(x_high - x_low).max() <= JUMP * size:
            break
    return np.abs(x_high - x_low).max() / size


def sweep(rng, kind, m, exact, dt, *, chased=False):
    """The velocity on the way between two questions about one kind of arm, in a loop of ticks dt.

    `chased` is whether part of the twist closes an error; that part, the limits that bend it, and its slack change too.
    """
    here = arm(rng, kind, m)
    T = iq.exp(0.1 * rng.normal(size=6))
    columns = rng.random(m) < 0.5
    J = [here.J, np.where(columns, iq.adjoint(T) @ here.J, here.J)]
    s = rng.normal(size=(2, 6)) if rng.random() < 0.5 else np.array([j @ rng.normal(size=m) for j in J])
    lower, upper = -rng.uniform(0.0, 1.5, (2, m)), rng.uniform(0.0, 1.5, (2, m))
    p = rng.normal(size=3)
    v = 0.3 * rng.normal(size=(2, 3))
    fixed = {
        "form": (None, 0.4, iq.CarriedMetric([0.1, 0.2, 0.3, 1.0, 1.0, 2.0], motion(rng, 0.5)))[rng.integers(3)],
        "point": p,
        "length": 0.8,
        "joint_metric": np.ones(m),
        "guard": (True, False, iq.Guard(0.9))[rng.integers(3)],
        "posture": rng.normal(size=m) if rng.random() < 0.5 else None,
    }
    ahead, still = rng.choice([0.0, 0.3, 1.0]) * rng.normal(size=(2, 6)), 0.1 * rng.normal(size=(2, 3))
    wider = rng.uniform(0.0, 2.0, (4, m)) * (rng.random((4, m)) < 0.8)
    placed = [lower - wider[:2], upper + wider[2:]]
    slack, fastest = 10.0 ** rng.uniform(-4.0, 0.0, 2), rng.uniform(0.5, 3.0, (2, m))
    before, change = 0.3 * rng.normal(size=(2, m)), rng.uniform(0.02, 0.5, (2, m))

    def velocity(t):
        def at(pair):
            return (1.0 - t) * pair[0] + t * pair[1]

        rows = iq.ExactRows.point(at(J), p, at(v)) if exact else None
        law, demand = problem_of(at(J), at(s), bounds=(at(lower), at(upper)), exact=rows, **fixed)
        if chased:
            first = None if rows is None else at(still)
            chase = Chase(at(ahead), first, at(placed[0]), at(placed[1]), float(at(slack)), apart=True)
            demand = demand._replace(chase=chase, fastest=at(fastest), before=at(before), change=at(change))
        return solve(replace(law, dt=dt), demand).velocity

    return velocity


@pytest.mark.cases(9)
@pytest.mark.parametrize("exact", [False, True], ids=["twist", "exact point"])
@pytest.mark.parametrize("kind", KINDS)
def test_no_sweep_jumps(kind, exact):
    """A point met exactly is followed in a loop: rows that the joints are losing end calmly, or not at all."""
    rng = np.random.default_rng(3)
    for k in range(max(1, SWEEPS // len(KINDS))):
        m = (6, 4, 7, 3, 5, 2, 8, 1)[k % 8]
        jump = height(sweep(rng, kind, m, exact, dt=0.01 if exact or k % 2 else 0.0))
        assert jump <= JUMP, (k, m, jump)


@pytest.mark.cases(9)
@pytest.mark.parametrize("exact", [False, True], ids=["twist", "exact point"])
@pytest.mark.parametrize("kind", KINDS)
def test_no_sweep_of_a_chase_jumps(kind, exact):
    """In the part that is chased, the limits that bend and that slow it, its slack, and what the posture waits for."""
    rng = np.random.default_rng(4)
    for k in range(max(1, SWEEPS // len(KINDS))):
        m = (6, 7, 5, 8, 4, 3, 2, 1)[k % 8]
        jump = height(sweep(rng, kind, m, exact, dt=0.01 if exact or k % 2 else 0.0, chased=True))
        assert jump <= JUMP, (k, m, jump)


@pytest.mark.cases(6)
@pytest.mark.parametrize("m", [2, 3, 5, 6, 7, 8])
@pytest.mark.parametrize("form", [None, 0.4])
def test_a_bound_that_comes_into_play_changes_nothing_at_first(m, form):
    """Both sides of the free solution agree to 1e-9, and no step of a sweep through it is larger than the bound's."""
    rng = np.random.default_rng(50 + m)
    for _ in range(4):
        J, s = rng.normal(size=(6, m)), rng.normal(size=6)
        x = iq.solve_velocity(J, s, form=form, bounds=(np.full(m, -1e3), np.full(m, 1e3))).velocity
        i, wide, size = int(np.abs(x).argmax()), 10.0 * np.abs(x).max(), np.linalg.norm(x)

        def at(share, i=i, x=x, J=J, s=s, wide=wide):
            lower, upper = np.full(m, -wide), np.full(m, wide)
            (upper if x[i] > 0.0 else lower)[i] = share * x[i]
            return iq.solve_velocity(J, s, form=form, bounds=(lower, upper))

        outside, inside = at(1.0 + 1e-12), at(1.0 - 1e-12)
        assert inside.method == "qp"
        assert outside.method != "qp"
        np.testing.assert_allclose(inside.velocity, outside.velocity, rtol=0.0, atol=1e-9 * size)
        sweep = np.array([at(share).velocity for share in np.linspace(0.98, 1.02, 41)])
        steps = np.linalg.norm(np.diff(sweep, axis=0), axis=1)
        assert steps.max() <= max(0.2 * np.linalg.norm(sweep[0] - sweep[-1]), 1e-9 * size)


def test_the_guards_share_is_continuous():
    rng = np.random.default_rng(8)
    J, s, direction = rng.normal(size=(6, 4)), rng.normal(size=6), rng.normal(size=6)
    bounds = (np.full(4, -0.1), np.full(4, 0.1))

    def at(t):
        return iq.solve_velocity(
            J, s + (2.0 * t - 1.0) * direction, form=0.3, bounds=bounds, point=np.ones(3), guard=iq.Guard(0.97)
        )

    assert 0.0 < max(at(t).guard for t in np.linspace(0.0, 1.0, 50)) <= 1.0
    assert height(lambda t: at(t).velocity) <= JUMP


def test_exact_rows_slow_down_without_a_jump_as_limits_come_in():
    """The share of the speed falls from one as the box shrinks, and so does every joint's velocity."""
    rng = np.random.default_rng(9)
    for _ in range(6):
        m = int(rng.integers(4, 8))
        J, s, b = rng.normal(size=(6, m)), rng.normal(size=6), rng.normal(size=3)
        rows, reach = iq.ExactRows(J[3:], b), rng.uniform(0.5, 1.5, m)

        def at(t, J=J, s=s, rows=rows, reach=reach):
            return iq.solve_velocity(J, s, exact=rows, bounds=(-reach * (1.0 - t), reach * (1.0 - t)))

        shares = np.array([at(t).scale for t in np.linspace(0.0, 1.0, 101)])
        assert (np.diff(shares) <= 1e-9).all()
        assert shares[-1] <= 1e-9
        assert height(lambda t: at(t).velocity) <= JUMP
        assert height(lambda t: np.array([at(t).scale])) <= JUMP
