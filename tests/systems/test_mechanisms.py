"""Constraints of limbs by name and mobility of parallel mechanisms, against published ones and plain null spaces."""

import numpy as np
import pytest
from support.random_systems import motion

import invariantqp as iq
from invariantqp.systems import limb_constraints, mobility


def columns(*twists):
    return np.column_stack(twists)


def around(limb, n=3):
    return [limb(2.0 * np.pi * i / n + 0.3) for i in range(n)]


def place(radius, angle, height=0.0):
    return np.array([radius * np.cos(angle), radius * np.sin(angle), height])


def rps(angle):
    """Revolute across the radius, prismatic, spherical."""
    base, top = place(1.0, angle), place(0.6, angle, 1.0)
    hinge = iq.revolute((-np.sin(angle), np.cos(angle), 0.0), base)
    return columns(hinge, iq.se3.prismatic(top - base), *(iq.revolute(u, top) for u in np.eye(3)))


def upu(angle):
    """Universal, prismatic, universal, with the outer axes parallel and the inner axes parallel."""
    base, top = place(1.0, angle), place(0.5, angle, 1.0)
    outer = np.array([-np.sin(angle), np.cos(angle), 0.0])
    inner = np.cross(outer, top - base)
    slide = iq.se3.prismatic(top - base)
    return columns(
        *(iq.revolute(u, p) for u, p in ((outer, base), (inner, base))),
        slide,
        iq.revolute(inner, top),
        iq.revolute(outer, top),
    )


def ups(angle):
    base, top = place(1.0, angle), place(0.5, angle + 0.4, 1.0)
    return columns(
        *(iq.revolute(u, base) for u in np.eye(3)[:2]),
        iq.se3.prismatic(top - base),
        *(iq.revolute(u, top) for u in np.eye(3)),
    )


def rrr(angle):
    points = place(1.0, angle), place(0.8, angle + 0.4), place(0.3, angle)
    return columns(*(iq.revolute((0, 0, 1), p) for p in points))


def sarrus(axis):
    across = np.cross(axis, (0, 0, 1))
    return columns(
        *(iq.revolute(axis, x * across + np.array([0, 0, z])) for x, z in ((0.3, 0.0), (0.5, 0.5), (0.3, 1.0)))
    )


PUBLISHED = {
    # K. H. Hunt, Structural kinematics of in-parallel-actuated robot arms, 1983
    "3-RPS": (around(rps), 3, 0, {"rotation": 2, "translation": 1}, {"force": 1}),
    # L.-W. Tsai, Kinematics of a three-DOF platform with extensible limbs, 1996
    "3-UPU": (around(upu), 3, 0, {"translation": 3}, {"couple": 1}),
    # Gough and Whitehall 1962, Stewart 1965
    "6-UPS": (around(ups, 6), 6, 0, {"rotation": 3, "translation": 3}, {}),
    # Gosselin and Angeles 1988: planar, each of three limbs leaves the same three freedoms
    "3-RRR": (around(rrr), 3, 6, {"rotation": 1, "translation": 2}, {"force": 1, "couple": 2}),
    # Sarrus 1853: a straight line from six hinges, one constraint more than needed
    "Sarrus": ([sarrus((1, 0, 0)), sarrus((0, 1, 0))], 1, 1, {"translation": 1}, {"force": 1, "couple": 2}),
}


def delta(angle):
    """A hinge, a parallelogram between two parallel hinges (it slides the far link), and a hinge: Clavel 1991."""
    base, elbow, top = place(0.2, angle), place(0.4, angle, -0.2), place(0.05, angle, -0.8)
    axis = np.array([-np.sin(angle), np.cos(angle), 0.0])
    return columns(
        *(iq.revolute(axis, p) for p in (base, elbow, top)), iq.se3.prismatic(np.cross(axis, top - elbow) + axis)
    )


PUBLISHED["Delta"] = (around(delta), 3, 3, {"translation": 3}, {"couple": 2})


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_mechanisms(name):
    limbs, freedoms, overconstraints, motions, constraints = PUBLISHED[name]
    rng = np.random.default_rng(4)
    for frame, unit in [(np.eye(4), 1.0), *((motion(rng, 3.0), unit) for unit in (1.0, 1e3, 1e-3) for _ in range(6))]:
        scale = np.repeat([1.0, unit], 3)[:, None]
        found = mobility([scale * (iq.adjoint(frame) @ limb) for limb in limbs])
        assert (found.degrees_of_freedom, found.overconstraints) == (freedoms, overconstraints)
        kinds = [f.kind for f in found.freedoms]
        assert {kind: kinds.count(kind) for kind in kinds} == motions
        for limb in found.constraints:
            assert {c.kind: sum(o.kind == c.kind for o in limb) for c in limb} == constraints


def test_the_force_of_an_rps_limb_is_through_its_ball_along_its_hinge():
    """Hunt 1983: a line through the centre of the spherical joint, parallel to the axis of the revolute one."""
    (force,) = limb_constraints(rps(0.7))
    assert force.kind == "force"
    np.testing.assert_allclose(np.abs(force.direction @ (-np.sin(0.7), np.cos(0.7), 0.0)), 1.0)
    np.testing.assert_allclose(np.cross(place(0.6, 0.7, 1.0) - force.point, force.direction), 0.0, atol=1e-12)
    assert str(force).startswith("force along (")


def test_random_limbs_leave_independent_constraints_that_do_no_work():
    rng = np.random.default_rng(0)
    for _ in range(300):
        n = int(rng.integers(0, 7))
        pitches = rng.choice([0.0, 0.0, 0.2, np.inf], size=n)
        J = np.array([iq.se3.helical(*rng.normal(size=(2, 3)), pitch=h) for h in pitches]).T.reshape(6, n)
        found = limb_constraints(J)
        W = np.array([c.screw for c in found]).T.reshape(6, len(found))
        assert len(found) == 6 - np.linalg.matrix_rank(J, tol=1e-9) if n else 6
        np.testing.assert_allclose(W.T @ J, 0.0, atol=1e-8 * (1.0 + np.abs(W).max(initial=0.0)))
        assert not found or np.linalg.matrix_rank(W, tol=1e-9) == len(found)
        for c in found:
            screw = iq.se3.screw_of_wrench(c.screw)
            assert (screw.pitch == np.inf) == (c.kind == "couple")
            assert screw.pitch == pytest.approx(c.pitch, abs=1e-8)


def test_the_platform_moves_as_every_limb_does():
    """Against the null space of all constraints stacked, by numpy alone."""
    rng = np.random.default_rng(1)
    for _ in range(100):
        shared = rng.normal(size=(6, int(rng.integers(1, 3))))
        limbs = [
            np.hstack((shared, rng.normal(size=(6, 2)))) @ rng.normal(size=(shared.shape[1] + 2,) * 2) for _ in range(3)
        ]
        limbs[0] = np.hstack((limbs[0], limbs[0][:, :1]))  # a joint that moves nothing but the limb
        found = mobility(limbs)
        held = np.hstack([np.linalg.svd(J)[0][:, np.linalg.matrix_rank(J) :] for J in limbs])
        free = 6 - np.linalg.matrix_rank(held, tol=1e-9)
        assert found.twists.shape == (6, free)
        np.testing.assert_allclose(held.T @ found.twists, 0.0, atol=1e-9)
        assert found.degrees_of_freedom == free + 1
        assert found.overconstraints == held.shape[1] - (6 - free)
        named = np.array([f.screw for f in found.freedoms]).T
        np.testing.assert_allclose(held.T @ named, 0.0, atol=1e-7 * (1.0 + np.abs(named).max()))


def test_rigid_limbs_and_fixed_platforms():
    assert [c.kind for c in limb_constraints(np.zeros((6, 0)))] == ["force"] * 3 + ["couple"] * 3
    assert limb_constraints(np.eye(6)) == ()
    held = mobility([np.zeros((6, 0)), np.eye(6)])
    assert (held.freedoms, held.degrees_of_freedom, held.overconstraints) == ((), 0, 0)
    with pytest.raises(iq.BadInput, match="limbs"):
        mobility([])
    with pytest.raises(iq.BadInput, match=r"limbs\[1\]"):
        mobility([np.eye(6), np.eye(5)])


def test_freedoms_and_constraints_in_words():
    hinge = iq.revolute((0, 0, 1), (1, 0, 0))
    words = {str(c) for c in limb_constraints(hinge)}
    assert "force along (0, 0, 1) through (1, 0, 0)" in words
    assert "couple about (1, 0, 0)" in words
    bolt = mobility([iq.se3.helical((0, 0, 1), pitch=0.01)]).freedoms
    assert [str(f) for f in bolt] == ["screw of pitch 0.01 along (0, 0, 1) through (0, 0, 0)"]
    lines = str(mobility([hinge, hinge])).split("\n")
    assert lines[0] == "1 degrees of freedom, 5 redundant constraints"
    assert lines[1] == "platform: rotation about (0, 0, 1) through (1, 0, 0)"
    assert len(lines) == 4
    assert "float64" not in str(lines)
    door = mobility([hinge]).freedoms
    assert [str(f) for f in door] == ["rotation about (0, 0, 1) through (1, 0, 0)"]
