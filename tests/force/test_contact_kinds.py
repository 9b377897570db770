"""Contacts: what moves is free, what presses does no work on it, in whatever frame they are expressed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_systems import distance, motion
from support.repeats import repeats

import invariantqp as iq

P, N = np.array([0.4, -0.1, 0.3]), np.array([0.2, 0.1, 1.0])
ALL = {
    "point": (iq.point_contact(P, N), 5),
    "rolling point": (iq.point_contact(P, N, slip=False), 3),
    "line": (iq.contacts.line_contact(P, [1.0, 0.2, 0.0], N), 4),
    "rolling line": (iq.contacts.line_contact(P, [1.0, 0.2, 0.0], N, slip=False), 1),
    "face": (iq.contacts.face_contact(P, N), 3),
    "sticking face": (iq.contacts.face_contact(P, N, slip=False), 0),
    "pivoting face": (iq.contacts.face_contact(P, N, slip=False, twist=True), 1),
    "ball": (iq.contacts.ball_joint(P), 3),
    "peg": (iq.contacts.peg_in_hole(P, N), 2),
    "hinge": (iq.contacts.hinge(P, N), 1),
    "bolt": (iq.contacts.hinge(P, N, pitch=0.02), 1),
    "drawer": (iq.contacts.hinge(P, N, pitch=np.inf), 1),
    "sphere": (iq.contacts.surface_contact(P, normal=lambda p: p), 5),
    "corner": (iq.contacts.two_contacts(iq.point_contact(P, N), iq.point_contact(P, [1.0, 0.0, -0.2])), 4),
}


def velocity_of(twist, point):
    return twist[3:] + np.cross(twist[:3], point)


@pytest.mark.parametrize("name", ALL)
def test_every_contact_is_dual_by_construction(name):
    contact, k = ALL[name]
    S, W = contact.freedoms, contact.constraints
    assert S.shape == (6, k)
    assert W.shape == (6, 6 - k)
    np.testing.assert_allclose(W.T @ S, 0.0, atol=1e-15)
    assert np.linalg.matrix_rank(np.hstack((S, W[[3, 4, 5, 0, 1, 2]]))) >= max(k, 6 - k)
    if k:
        assert np.linalg.matrix_rank(S) == k
    assert np.linalg.matrix_rank(W) == 6 - k
    np.testing.assert_allclose(contact.point, P, atol=1e-15)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**31), name=st.sampled_from(sorted(ALL)))
def test_contacts_move_and_are_relabelled_in_any_frame(seed, name):
    rng = np.random.default_rng(seed)
    contact, _ = ALL[name]
    T, X = motion(rng), motion(rng, 0.3)
    moved = contact.moved(T)
    np.testing.assert_allclose(moved.freedoms, iq.adjoint(T) @ contact.freedoms, atol=1e-12)
    np.testing.assert_allclose(moved.constraints, iq.coadjoint(T) @ contact.constraints, atol=1e-12)
    other = contact.relabelled(X)  # the same twists in the base frame
    np.testing.assert_allclose(other.freedoms, contact.freedoms, atol=1e-12)
    np.testing.assert_allclose(other.constraints, contact.constraints, atol=1e-12)
    np.testing.assert_allclose(other.point, contact.point, atol=1e-12)
    np.testing.assert_allclose(other.pose, contact.pose @ X, atol=1e-15)


def random_contact(rng):
    p, n, t = rng.normal(size=(3, 3))
    slip = bool(rng.integers(2))
    return [
        lambda: iq.point_contact(p, n, slip=slip),
        lambda: iq.contacts.line_contact(p, t, n, slip=slip),
        lambda: iq.contacts.face_contact(p, n, slip=slip, twist=True),
        lambda: iq.contacts.peg_in_hole(p, n),
        lambda: iq.contacts.hinge(p, n, pitch=rng.choice([0.0, rng.normal(), np.inf])),
        lambda: iq.contacts.surface_contact(p, normal=lambda q: q, slip=slip),
    ][rng.integers(6)]()


def random_split(rng, S):
    R = rng.normal(size=(6, 6))
    if rng.integers(2):
        try:
            return iq.dual_projectors(S, h=rng.normal())
        except iq.NoProjectors:
            pass
    return iq.dual_projectors(S, metric=R @ R.T + 0.1 * np.eye(6))


def test_no_power_leaks_over_random_contacts_and_frames():
    """W'P s = 0 for any twist s in any frame."""
    rng = np.random.default_rng(0)
    worst = 0.0
    for _ in range(repeats(1000, 100)):
        contact = random_contact(rng)
        split = random_split(rng, contact.freedoms)
        for _ in range(10):
            T = motion(rng, reach=3.0)
            W, P, s = contact.moved(T).constraints, split.moved(T).motion, rng.normal(size=6)
            power, terms = np.abs(W.T @ (P @ s)), np.abs(W).T @ np.abs(P) @ np.abs(s)
            assert (power <= 1e-12 * terms).all()
            worst = max(worst, float((power[terms > 0.0] / terms[terms > 0.0]).max(initial=0.0)))
    assert worst > 0.0  # rounding, not a comparison that cannot fail


def test_a_point_slides_and_turns_about_itself():
    contact, n = ALL["point"][0], N / np.linalg.norm(N)
    speeds = np.array([velocity_of(s, P) for s in contact.freedoms.T])
    np.testing.assert_allclose(speeds @ n, 0.0, atol=1e-15)
    assert np.linalg.matrix_rank(speeds) == 2
    rolling = ALL["rolling point"][0]
    np.testing.assert_allclose([velocity_of(s, P) for s in rolling.freedoms.T], 0.0, atol=1e-15)


def test_the_press_is_a_force_into_the_surface_through_the_point():
    for name in ("point", "rolling point", "line", "rolling line", "face", "sticking face", "pivoting face"):
        contact = ALL[name][0]
        press = contact.constraints[:, 0]
        n = N / np.linalg.norm(N)
        np.testing.assert_allclose(press, np.concatenate((np.cross(P, -n), -n)), atol=1e-15)
        assert contact.kind.presses == 1
        np.testing.assert_allclose(velocity_of(iq.adjoint(contact.pose) @ contact.kind.out, P), n, atol=1e-15)


def test_an_edge_keeps_along_its_line_and_off_its_end():
    contact, n = ALL["line"][0], N / np.linalg.norm(N)
    along = contact.pose[:3, 0]
    other = P + 0.2 * along
    for s in contact.freedoms.T:  # no point of the edge leaves the surface
        assert abs(velocity_of(s, P) @ n) < 1e-15
        assert abs(velocity_of(s, other) @ n) < 1e-15
    assert abs(along @ n) < 1e-15
    for s in ALL["rolling line"][0].freedoms.T:
        np.testing.assert_allclose(velocity_of(s, other), 0.0, atol=1e-15)


def test_a_face_stays_on_its_plane():
    contact, n = ALL["face"][0], N / np.linalg.norm(N)
    for offset in contact.pose[:3, :2].T:
        for s in contact.freedoms.T:
            assert abs(velocity_of(s, P + offset) @ n) < 1e-15
    (turn,) = ALL["pivoting face"][0].freedoms.T
    np.testing.assert_allclose(np.cross(turn[:3], n), 0.0, atol=1e-15)


@pytest.mark.parametrize(("name", "pitch"), [("hinge", 0.0), ("screw", -0.02), ("slide", np.inf), ("slide", -np.inf)])
def test_a_screw_has_its_name(name, pitch):
    assert iq.contacts.hinge([0.1, 0.2, 0.3], [0, 1, 1], pitch).name == name


@pytest.mark.parametrize(("name", "pitch"), [("hinge", 0.0), ("bolt", 0.02), ("drawer", np.inf)])
def test_a_hinge_is_one_screw(name, pitch):
    (screw,) = ALL[name][0].freedoms.T
    assert iq.se3.pitch(screw) == pytest.approx(pitch, abs=1e-15)
    expected = iq.se3.helical(N, P, pitch)
    np.testing.assert_allclose(screw, expected, atol=1e-15)


def test_a_peg_is_free_about_and_along_its_axis():
    free = np.column_stack((iq.revolute(N, P), iq.se3.prismatic(N)))
    assert distance(ALL["peg"][0].freedoms, free) < 1e-14
    np.testing.assert_allclose(
        iq.adjoint(ALL["peg"][0].pose) @ ALL["peg"][0].kind.out, -iq.se3.prismatic(N), atol=1e-15
    )


def test_surfaces_that_are_not_flat():
    def ball(p):
        return p @ p - 1.0

    p = np.array([0.48, -0.6, 0.64])
    exact = iq.contacts.surface_contact(p, normal=lambda q: 3.0 * q)
    found = iq.contacts.surface_contact(p, implicit=ball)
    np.testing.assert_allclose(exact.constraints[3:, 0], -p, atol=1e-15)
    np.testing.assert_allclose(found.constraints, exact.constraints, atol=1e-9)
    assert iq.contacts.surface_contact(p, implicit=ball, slip=False).name == "rolling point"


def test_which_contacts_have_a_pitch():
    """The line and the face are blind for every pitch; the rest split at h = 0.3."""
    without = set()
    for name, (contact, k) in ALL.items():
        try:
            iq.dual_projectors(contact.freedoms if k else np.empty((6, 0)), h=0.3)
        except iq.NoProjectors:
            without.add(name)
    assert without == {"line", "face", "drawer"}


def test_contacts_of_ones_own():
    kind = iq.contacts.ContactKind("wheel", np.eye(6)[:, [0, 1, 2, 3]])
    np.testing.assert_allclose(np.asarray(kind.constraints).T @ np.asarray(kind.freedoms), 0.0, atol=1e-15)
    assert iq.contacts.Contact(kind, np.eye(4)).name == "wheel"
    assert kind.presses == 0


@pytest.mark.parametrize(
    ("make", "argument"),
    [
        (lambda: iq.point_contact(P, [0, 0, 0]), "normal"),
        (lambda: iq.point_contact(P, N, tangent=N), "tangent"),
        (lambda: iq.contacts.line_contact(P, N, N), "direction"),
        (lambda: iq.contacts.peg_in_hole(P, [0, 0, 0]), "axis"),
        (lambda: iq.contacts.surface_contact(P), "normal"),
        (lambda: iq.contacts.surface_contact(P, normal=lambda p: p, implicit=lambda p: 0.0), "normal"),
        (lambda: iq.contacts.surface_contact(P, implicit=lambda p: 0.0), "implicit"),
        (lambda: iq.contacts.surface_contact(P, implicit=lambda p: None), "implicit"),
        (lambda: iq.contacts.ContactKind("x", np.eye(6)[:, :2], np.eye(6)[:, 1:5]), "constraints"),
        (lambda: iq.contacts.ContactKind("x", np.eye(6)[:, :2], np.eye(6)[:, 2:5]), "constraints"),
        (lambda: iq.contacts.ContactKind("x", np.ones((6, 2))), "freedoms"),
    ],
)
def test_bad_contacts_are_refused(make, argument):
    with pytest.raises(iq.BadInput) as caught:
        make()
    assert caught.value.argument == argument


def test_an_edge_stays_with_its_contact():
    desk = iq.contacts.surface_contact(P, implicit=lambda p: p[2], extent=lambda p: 0.5 - p[0])
    assert desk.edge == pytest.approx(0.1)
    T = motion(np.random.default_rng(0))
    assert (desk.moved(T).edge, desk.relabelled(T).edge) == (desk.edge, desk.edge)
    wall = iq.point_contact(P, [1.0, 0.0, 0.0])
    assert iq.contacts.two_contacts(desk, wall).edge == iq.contacts.two_contacts(wall, desk).edge == desk.edge
    over = iq.contacts.Contact(wall.kind, wall.pose, edge=-0.5)
    assert iq.contacts.two_contacts(desk, over).edge == iq.contacts.two_contacts(over, desk).edge == -0.5
    assert iq.point_contact(P, N).edge is None


def test_a_frame_displaced_by_rounding_alone_changes_no_kind():
    nearly = np.eye(4)
    nearly[0, 2] = 1e-19
    kind = iq.point_contact(P, N).kind
    np.testing.assert_allclose(kind.relabelled(nearly).constraints, kind.constraints, atol=1e-15)
