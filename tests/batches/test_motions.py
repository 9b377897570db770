"""exp, log and adjoint of rows, against those of one, and their derivatives."""

import numpy as np
import pytest

import invariantqp as iq
from invariantqp import batches


def twists():
    """Of all sizes, half turns about any axis, none at all."""
    rng = np.random.default_rng(0)
    w = rng.normal(size=(60, 3))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    angles = np.r_[0.0, np.geomspace(1e-12, 3.1, 49), np.pi - np.geomspace(1e-9, 1e-3, 10)]
    return np.hstack((w * angles[:, None], rng.normal(size=(60, 3))))


def test_rows_are_what_one_is():
    s = twists()
    T = batches.exps(s)
    for i, one in enumerate(s):
        np.testing.assert_allclose(T[i], iq.exp(one), rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(batches.logs(T)[i], iq.log(T[i]), rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(batches.adjoints(T)[i], iq.adjoint(T[i]), rtol=0.0, atol=1e-14)
    assert batches.logs(T.reshape(6, 10, 4, 4)).shape == (6, 10, 6)
    assert batches.exps(s[:0]).shape == (0, 4, 4)


def test_half_turns_about_every_axis():
    for axis in np.vstack((np.eye(3), -np.eye(3), np.ones(3) / np.sqrt(3.0))):
        T = iq.exp(np.r_[np.pi * axis, 0.1, 0.2, 0.3])
        np.testing.assert_allclose(batches.exps(batches.logs(T)), T, rtol=0.0, atol=1e-14)


def test_a_bad_row_stays_alone():
    s = twists()
    s[3, 1] = np.nan
    T = batches.exps(s)
    assert np.isfinite(np.delete(T, 3, axis=0)).all()
    assert np.isfinite(np.delete(batches.logs(T), 3, axis=0)).all()


def test_derivatives_exist_everywhere():
    torch = pytest.importorskip("torch")
    s = twists()[:50]
    way = np.random.default_rng(1).normal(size=s.shape)
    here = torch.tensor(s, requires_grad=True)
    for function, h in ((batches.exps, 1e-6), (lambda s: batches.logs(batches.exps(s)), 1e-6)):
        (found,) = torch.autograd.grad((function(here) ** 2).sum(), here)
        after, before = ((function(s + t * way) ** 2).reshape(50, -1).sum(axis=1) for t in (h, -h))
        np.testing.assert_allclose((found.numpy() * way).sum(axis=1), (after - before) / (2 * h), rtol=1e-5, atol=1e-6)
