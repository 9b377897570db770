"""No frame and no unit of length can be read off the answer.

Velocities in two frames agree to 1e-10 relative to |x|; where the answer nearly cancels, relative to |s| / |J|, the
size of what was asked. Both differ by rounding alone, multiplied by the condition of the Gram matrix.
"""

import numpy as np
import pytest
from support.random_systems import motion
from support.repeats import repeats
from support.velocity_reference import tight_box

import invariantqp as iq

FRAMES = repeats(1000, 250)
AGREE = 1e-10


def difference(x, y, J, s):
    return np.linalg.norm(x - y) / max(np.linalg.norm(x), np.linalg.norm(s) / np.linalg.norm(J))


def point_rows(J, s, point):
    """The velocity of a point, demanded exactly: three rows in the axes of the frame."""
    v = J[3:] + np.cross(J[:3], point, axis=0)
    return iq.ExactRows(v, s[3:] + np.cross(s[:3], point))


def form_pair(kind, rng, m, T):
    """A form and the same one seen from another frame."""
    if kind == "pitch":
        h = float(rng.uniform(-1.5, 1.5))
        return h, h
    if kind == "own length":
        return None, None
    if kind == "carried":
        A, X = rng.normal(size=(6, 6)), motion(rng, 0.5)
        W = A @ A.T + np.eye(6)
        return iq.CarriedMetric(W, X), iq.CarriedMetric(W, T @ X)
    Z = rng.normal(size=(6, max(1, 6 - m)))
    return iq.Complement(Z), iq.Complement(iq.adjoint(T) @ Z)


def scenes(seed, frames, kinds=("pitch", "own length", "carried", "complement")):
    """J, s, a frame, a form in both, m = 1..12 in turn."""
    rng = np.random.default_rng(seed)
    for k in range(frames):
        m = 1 + k % 12
        kind = kinds[(k // 12) % len(kinds)]
        if kind == "complement" and m > 5:
            kind = "pitch"
        J, s, T = rng.normal(size=(6, m)), rng.normal(size=6), motion(rng, 1.0)
        yield rng, J, s, T, form_pair(kind, rng, m, T)


def agreement(limited, exact):
    worst, ways = 0.0, set()
    for rng, J, s, T, (here, there) in scenes(seed=17, frames=FRAMES):
        m = J.shape[1]
        A = iq.adjoint(T)
        rows = (None, None)
        if exact and m > 3:
            p = rng.normal(size=3)
            rows = point_rows(J, s, p), point_rows(A @ J, A @ s, (T @ np.append(p, 1.0))[:3])
        damping, guard = (None, 0.1)[rng.integers(2)], bool(rng.integers(2))
        options = {"posture": rng.normal(size=m), "damping": damping, "guard": guard}
        if limited:
            free = iq.solve_velocity(J, s, form=here, exact=rows[0], **options)
            options["bounds"] = tight_box(rng, m, free.velocity)
        a = iq.solve_velocity(J, s, form=here, exact=rows[0], **options)
        b = iq.solve_velocity(A @ J, A @ s, form=there, exact=rows[1], **options)
        assert (a.method, a.status) == (b.method, b.status)
        worst = max(worst, difference(a.velocity, b.velocity, J, s))
        ways.add((a.method, a.status))
    return worst, ways


@pytest.mark.cases(2)
@pytest.mark.parametrize("limited", [False, True], ids=["free", "limited"])
@pytest.mark.parametrize("exact", [False, True], ids=["form alone", "exact point"])
def test_frames_change_nothing(limited, exact):
    worst, ways = agreement(limited, exact)
    assert worst < AGREE
    assert {("closed-form", "limited"), ("damped", "limited")} <= ways
    if limited:
        assert {("qp", "ok"), ("qp", "limited"), ("qp", "guarded")} <= ways
        assert not exact or ("qp", "scaled") in ways
    else:
        assert {("closed-form", "ok"), ("closed-form", "guarded"), ("damped", "guarded")} <= ways


@pytest.mark.cases(1)
@pytest.mark.parametrize("limited", [False, True], ids=["free", "limited"])
def test_millimetres_change_nothing(limited):
    """h and lambda are lengths; everything else is the joints' own."""
    worst = 0.0
    D = np.array([1.0] * 3 + [1e3] * 3)
    for rng, J, s, _, (h, _) in scenes(seed=23, frames=400, kinds=("pitch", "own length")):
        m = J.shape[1]
        lam = (None, 0.05)[rng.integers(2)]
        options = {"posture": rng.normal(size=m)}
        if limited:
            free = iq.solve_velocity(J, s, form=h, damping=lam, **options)
            options["bounds"] = tight_box(rng, m, free.velocity)
        a = iq.solve_velocity(J, s, form=h, damping=lam, **options)
        in_mm = {"form": None if h is None else 1e3 * h, "damping": None if lam is None else 1e3 * lam}
        b = iq.solve_velocity(D[:, None] * J, D * s, **in_mm, **options)
        assert (a.method, a.status) == (b.method, b.status)
        worst = max(worst, difference(a.velocity, b.velocity, J, s))
    assert worst < AGREE


def test_moore_penrose_would_not_pass():
    """Five joints: the very same comparison, and the textbook's answer moves by tens of percent."""
    rng = np.random.default_rng(0)
    changes, units = [], []
    for _ in range(200):
        J, s, A = rng.normal(size=(6, 5)), rng.normal(size=6), iq.adjoint(motion(rng, 0.25))
        x = np.linalg.pinv(J) @ s
        changes.append(difference(x, np.linalg.pinv(A @ J) @ (A @ s), J, s))
        D = np.diag([1.0] * 3 + [1e3] * 3)
        units.append(difference(x, np.linalg.pinv(D @ J) @ (D @ s), J, s))
    assert np.median(changes) > 0.03
    assert np.median(units) > 0.03


def test_a_form_tied_to_a_body_must_be_carried():
    """Left where it was, a metric changes the answer: what it is tied to matters, and only that."""
    rng = np.random.default_rng(1)
    W = np.diag([0.1, 0.1, 0.1, 1.0, 1.0, 1.0])
    changes = []
    for _ in range(50):
        J, s, A = rng.normal(size=(6, 4)), rng.normal(size=6), iq.adjoint(motion(rng))
        here = iq.solve_velocity(J, s, form=iq.CarriedMetric(W, np.eye(4))).velocity
        left = iq.solve_velocity(A @ J, A @ s, form=iq.CarriedMetric(W, np.eye(4))).velocity
        changes.append(difference(here, left, J, s))
    assert np.median(changes) > 0.1
