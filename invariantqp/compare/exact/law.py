"""Exact answers of the law that ships, inside the limits, in 50 digits.

    minimise |A x - b|^2 + x'L^2 x + mu |x|^2,    A = root J,   b = root s,   L^2 from S = A'A
    L^2 = V diag(c^2 e max(0, 1 - e_i / (t^2 e))^2) V',      e_i the eigenvalues of S, e the largest

mu is from the residual of the answer for mu = 0 (`velocity.damping.calm`).

Reference: `velocity.damping.Adaptive`, `velocity.objective`.
"""

from __future__ import annotations

from typing import Any

import mpmath as mp

from invariantqp.compare.exact.box import active_set
from invariantqp.compare.exact.linear import Numbers, matrix
from invariantqp.compare.method import Question, Setting
from invariantqp.velocity.damping import CALM, DEFAULT_CEILING, DEFAULT_THRESHOLD, DEVIATION_SHARE, QUIET_SHARE
from invariantqp.velocity.measure import root_at
from invariantqp.velocity.objective import NULL_RATIO


def shipped(question: Question, setting: Setting) -> Numbers:
    """The answer."""
    A, b = _measured(question, setting)
    e, V = mp.eigsy(A.T * A)
    largest = max(e)
    H = V * mp.diag([v + w for v, w in zip(e, _squares(list(e), largest), strict=True)]) * V.T
    x = active_set(H, A.T * b, question.lower.tolist(), question.upper.tolist())
    seen = V.T * x
    moving = [v for v, size in zip(seen, e, strict=True) if size > (NULL_RATIO**2) * largest]
    H += _calm(A, b, x, mp.norm(moving), setting.dt) * mp.eye(setting.m)
    return active_set(H, A.T * b, question.lower.tolist(), question.upper.tolist())


def _measured(question: Question, setting: Setting) -> tuple[Any, Any]:
    """A and b."""
    W = matrix(root_at(setting.point, setting.length))
    return W * matrix(question.J), W * mp.matrix(question.s.tolist())


def _squares(e: list[Any], largest: Any) -> list[Any]:
    """lambda_i^2 for eigenvalues of S."""
    threshold = mp.mpf(DEFAULT_THRESHOLD) ** 2 * largest
    return [mp.mpf(DEFAULT_CEILING) ** 2 * largest * max(mp.mpf(0), 1 - v / threshold) ** 2 for v in e]


def _calm(A: Any, b: Any, x: Any, speed: Any, dt: float) -> Any:
    """mu for an answer x."""
    size = mp.mnorm(A, "f")
    step = mp.mpf(dt)
    excess = max(mp.mpf(0), mp.mpf(DEVIATION_SHARE) * step * size * speed * speed - mp.norm(b))
    mu = mp.mpf(CALM) * step * (mp.norm(b - A * x) + excess) * size / 2
    return max(mp.mpf(0), mu - mp.mpf(QUIET_SHARE) * size * size)
