"""No jump: along any segment of twists and bounds the velocity moves in proportion to the step."""

import numpy as np
import pytest
from support.continuity import JUMP, height

import invariantqp as iq


@pytest.mark.cases(6)
@pytest.mark.parametrize("m", [2, 3, 5, 6, 7, 8])
@pytest.mark.parametrize("form", [None, 0.4])
def test_the_velocity_is_continuous_where_a_bound_becomes_active(m, form):
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


def test_the_scale_of_exact_rows_is_continuous_as_limits_shrink():
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
