"""Screw systems of every type, moved by random rigid motions and mixed by random basis changes."""

from __future__ import annotations

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.systems.classification import normal_form

MODULUS_NAMES = {
    (1, "h"): ("h",),
    (1, "h=inf"): (),
    (2, "IA"): ("h_a", "h_b"),
    (2, "IIA"): ("h",),
    (2, "IB"): ("p",),
    (2, "IIB"): ("h",),
    (2, "IIC"): (),
    (3, "IA1"): ("h_a", "h_b", "h_c"),
    (3, "IA2"): ("h_a", "h_b"),
    (3, "IIA"): ("h",),
    (3, "IB0"): ("h", "p"),
    (3, "IB3"): ("h_a", "h_b"),
    (3, "IIB"): ("h",),
    (3, "IC"): ("p",),
    (3, "IIC"): ("h",),
    (3, "IID"): (),
}
CLASSES = sorted(MODULUS_NAMES)
every_class = pytest.mark.parametrize("key", CLASSES, ids=[f"{k}-{n}" for k, n in CLASSES])
# Three parallel hinges: no pitch works.
PLANAR = np.column_stack([iq.revolute((0, 0, 1), p) for p in ((0, 0, 0), (0.4, 0, 0), (0.7, 0.3, 0))])
DISTINCT = {(2, "IA"), (3, "IA1"), (3, "IA2"), (3, "IB3")}  # whose pitches must differ
WITHOUT = {"h=inf", "IC", "IIC", "IID", "IB3"}  # and IIB, of either dimension: no h works


def admits(name):
    return name not in WITHOUT | {"IIB"}


def moduli(rng, key):
    names = MODULUS_NAMES[key]
    values = [abs(rng.uniform(-1.0, 1.0)) if n == "p" else rng.uniform(-1.0, 1.0) for n in names]
    return tuple(sorted(values)) if key in DISTINCT - {(3, "IA2")} else tuple(values)


def motion(rng, reach=2.0):
    """A random rotation (uniform) and a translation of a few units."""
    T = iq.exp(np.concatenate((rng.normal(size=3) * 2.0, np.zeros(3))))
    T[:3, 3] = rng.normal(size=3) * reach
    return T


def reciprocal_of(S):
    """The reciprocal system by numpy alone: the orthogonal complement of Q_0 S."""
    U = np.linalg.svd(np.vstack((S[3:], S[:3])))[0]
    return U[:, S.shape[1] :]


def sample(rng, key, *, upper=False, noise=0.0, extra=0):
    """(J, moduli): a random member of a class (or of its reciprocals) from k + extra columns.

    Noise is that of a model file: relative to the system, before it is moved.
    """
    values = moduli(rng, key)
    S = normal_form(*key, values)
    if upper:
        S = reciprocal_of(S)
    k = S.shape[1]
    J = S @ rng.normal(size=(k, k + extra))
    J = J + noise * np.abs(J).max() * rng.normal(size=J.shape)
    return iq.adjoint(motion(rng)) @ J, values


def distance(S, R):
    """Sine of the largest angle between the spans of S (k columns) and R (any number), by numpy alone."""
    k = S.shape[1]
    outside = np.linalg.svd(S)[0][:, k:]
    inside = np.linalg.svd(R)[0][:, :k]
    return np.linalg.norm(outside.T @ inside, 2) if outside.shape[1] else 0.0
