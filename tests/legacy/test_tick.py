"""The blend of a form's velocity and least squares."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from invariantqp.legacy.tick import blend


@given(seed=st.integers(0, 10**9), eta=st.floats(0.0, 1.0), mu=st.sampled_from([0.0, 1e-3, 1.0]))
@settings(max_examples=150, deadline=None, derandomize=True)
def test_the_blend_keeps_the_inequality_of_its_proof(seed, eta, mu):
    """f(x) >= eta f(x_W) for any x_f, and t = 0 where x_f does it alone; it is the smallest such t."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 9))
    A, b, x_f = rng.normal(size=(6, m)), rng.normal(size=6), 3.0 * rng.normal(size=m)
    x_W = np.linalg.lstsq(np.vstack((A, np.sqrt(mu) * np.eye(m))), np.append(b, np.zeros(m)), rcond=None)[0]

    def f(x):
        r = b - A @ x
        return 0.5 * (b @ b - r @ r - mu * x @ x)

    t = blend(A, b, mu, x_f, x_W, eta)
    rounding = 1e-9 * (b @ b + f(x_W) - f(x_f))
    assert 0.0 <= t <= 1.0
    assert f((1.0 - t) * x_f + t * x_W) >= eta * f(x_W) - rounding
    if t > 0.0:
        less = 0.999 * t
        assert f((1.0 - less) * x_f + less * x_W) <= eta * f(x_W) + rounding
    else:
        assert f(x_f) >= eta * f(x_W) - rounding
