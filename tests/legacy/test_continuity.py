"""No jump: along any segment of twists, bounds and joint twists the velocity moves in proportion to the step.

Each segment is sampled, and its steepest step bisected down to 1e-12 of it: a jump keeps its height, a steep slope does
not. Set INVARIANTQP_SWEEPS=1000 for as many as the law is released with.
"""

import os
from dataclasses import replace

import numpy as np
import pytest
from support.arms import KINDS, arm
from support.continuity import JUMP, height
from support.random_systems import motion

import invariantqp as iq
from invariantqp.legacy.law import Chase
from invariantqp.legacy.problem import problem_of
from invariantqp.legacy.solve import solve

SWEEPS = int(os.environ.get("INVARIANTQP_SWEEPS", "27"))


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
