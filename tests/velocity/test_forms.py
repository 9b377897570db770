"""What a form says of a twist beyond the joints: projections where they exist, or an error that says why none does."""

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.optimize import lsq_linear
from support.random_systems import motion
from support.velocity_reference import regular_problem, root_of

import invariantqp as iq

PLANAR = np.column_stack([iq.revolute((0, 0, 1), p) for p in ((0, 0, 0), (0.4, 0, 0), (0.5, 0.3, 0))])
SCARA = np.column_stack((PLANAR, iq.se3.prismatic((0, 0, 1))))
TILTS = np.eye(6)[:, [0, 1]]
AT = {"point": (0.3, 0.1, 0.2), "length": 0.5}


def measured(J):
    return root_of(np.array(AT["point"]), AT["length"]) @ J


@pytest.mark.cases(4)
@pytest.mark.parametrize("m", range(1, 9))
def test_a_pitch_form_is_its_pseudoinverse(m):
    """A x = P_h s, to rounding times its condition."""
    rng = np.random.default_rng(m)
    for _ in range(60):
        J, s, h = regular_problem(rng, m)
        solution = iq.solve_velocity(J, s, form=h, **AT)
        assert solution.method == "closed-form"
        expected = iq.pseudoinverse(J, h) @ s
        np.testing.assert_allclose(solution.velocity, expected, rtol=0.0, atol=1e-11 * (1.0 + np.linalg.norm(expected)))


def test_towards_a_principal_pitch_it_grows_without_bound_unless_damped():
    """|P_h| is one over the distance, and there none exists; damped, it is `damped_pseudoinverse`."""
    rng = np.random.default_rng(3)
    J, s = rng.normal(size=(6, 4)), rng.normal(size=6)
    principal = float(iq.principal_pitches(J)[1])
    near, nearer = (np.linalg.norm(iq.solve_velocity(J, s, form=principal + d, **AT).velocity) for d in (1e-5, 1e-6))
    assert nearer == pytest.approx(10.0 * near, rel=1e-3)
    with pytest.raises(iq.NoPseudoinverse):
        iq.solve_velocity(J, s, form=principal, **AT)
    offsets = np.concatenate((-np.geomspace(0.5, 1e-15, 60), [0.0], np.geomspace(1e-15, 0.5, 60)))
    options = AT | {"damping": 0.05}
    path = np.array([iq.solve_velocity(J, s, form=principal + d, **options).velocity for d in offsets])
    expected = [iq.systems.damped_pseudoinverse(J, principal + d, 0.05) @ s for d in offsets]
    np.testing.assert_allclose(path, expected, atol=1e-10)


def test_no_form_changes_an_achievable_twist():
    rng = np.random.default_rng(8)
    for J, pitches in ((PLANAR, ()), (rng.normal(size=(6, 4)), (0.3, -2.0))):
        s = J @ rng.normal(size=J.shape[1])
        for form in (*pitches, iq.Complement(rng.normal(size=(6, 6 - J.shape[1])))):
            x = iq.solve_velocity(J, s, form=form, **AT).velocity
            np.testing.assert_allclose(J @ x, s, atol=1e-11)


@pytest.mark.cases(2)
@pytest.mark.parametrize("m", range(1, 6))
def test_a_complement_projects_along_itself(m):
    """x with Jx = P s, P = J(K'J)^-1 K', K from scipy."""
    rng = np.random.default_rng(m)
    for _ in range(120):
        J, Z, s = rng.normal(size=(6, m)), rng.normal(size=(6, 6 - m)), rng.normal(size=6)
        K = null_space(measured(Z).T)
        solution = iq.solve_velocity(J, s, form=iq.Complement(Z), **AT)
        assert solution.method == "closed-form"
        expected = np.linalg.solve(K.T @ measured(J), K.T @ measured(s))
        np.testing.assert_allclose(solution.velocity, expected, atol=1e-9 * (1.0 + np.linalg.norm(expected)))


def test_planar_arm_and_scara_work_with_what_they_give_up():
    """No h works for either; tilts and, for the planar arm, the height are what they cannot do."""
    rng = np.random.default_rng(1)
    height = np.eye(6)[:, [5]]
    options = {"point": (0, 0, 0), "length": 0.5}
    for _ in range(20):
        s = rng.normal(size=6)
        planar = iq.solve_velocity(PLANAR, s, form=iq.Complement(np.hstack((TILTS, height))), **options)
        np.testing.assert_allclose(PLANAR @ planar.velocity, [0, 0, s[2], s[3], s[4], 0], atol=1e-12)
        scara = iq.solve_velocity(SCARA, s, form=iq.Complement(TILTS), **options)
        np.testing.assert_allclose(SCARA @ scara.velocity, [0, 0, *s[2:]], atol=1e-12)
        assert scara.method == "closed-form"
    for J in (PLANAR, SCARA):
        with pytest.raises(iq.BlindSystem):
            iq.principal_pitches(J)


def test_under_limits_a_form_is_approximated_in_its_own_metric():
    rng = np.random.default_rng(2)
    for _ in range(20):
        J, s, h = regular_problem(rng, 4)
        mu, V = np.linalg.eigh(iq.systems.gram_matrix(J, h))
        own = {h: np.sqrt(np.abs(mu))[:, None] * V.T, iq.Complement(rng.normal(size=(6, 2))): measured(J)}
        for form, root in own.items():
            wanted = iq.solve_velocity(J, s, form=form, **AT).velocity
            reach = rng.uniform(0.1, 1.0, 4) * np.abs(wanted)
            solution = iq.solve_velocity(J, s, form=form, bounds=(-reach, reach), **AT)
            expected = lsq_linear(root, root @ wanted, (-reach, reach), method="bvls", tol=1e-14).x
            np.testing.assert_allclose(solution.velocity, expected, atol=1e-9)


def test_a_complement_that_nearly_holds_a_motion_of_the_arm_is_kept_inside_the_bounds():
    """Projecting along it is as fast as one over the angle between the two; where there is none, it is refused."""
    rng = np.random.default_rng(5)
    J, other, s = rng.normal(size=(6, 3)), rng.normal(size=(6, 3)), rng.normal(size=6)
    lost, one = J @ rng.normal(size=3), np.ones(3)
    for angle in (1e-3, 1e-8, 0.0):
        Z = other.copy()
        Z[:, 2] = lost + angle * other[:, 2]
        if angle == 0.0:
            with pytest.raises(iq.BadInput, match="shares the twist"):
                iq.solve_velocity(J, s, form=iq.Complement(Z), **AT)
            continue
        assert np.linalg.norm(iq.solve_velocity(J, s, form=iq.Complement(Z), **AT).velocity) > 1.0 / angle
        solution = iq.solve_velocity(J, s, form=iq.Complement(Z), bounds=(-one, one), **AT)
        assert np.abs(solution.velocity).max() <= 1.0


def test_a_complement_does_not_depend_on_its_basis():
    rng = np.random.default_rng(3)
    for m in (2, 3, 5):
        J, Z, s = rng.normal(size=(6, m)), rng.normal(size=(6, 6 - m)), rng.normal(size=6)
        x = iq.solve_velocity(J, s, form=iq.Complement(Z)).velocity
        mixed = iq.solve_velocity(J, s, form=iq.Complement(Z @ rng.normal(size=(6 - m, 6 - m)))).velocity
        np.testing.assert_allclose(mixed, x, atol=1e-9 * (1.0 + np.linalg.norm(x)))


@pytest.mark.parametrize("m", range(1, 9))
def test_a_carried_metric_is_weighted_least_squares_at_its_body(m):
    rng = np.random.default_rng(20 + m)
    for _ in range(10):
        J, s, T = rng.normal(size=(6, m)), rng.normal(size=6), motion(rng)
        L = np.tril(rng.normal(size=(6, 6))) + 2.0 * np.eye(6)
        to_body = iq.adjoint(iq.inverse(T))
        A = L.T @ to_body @ J
        expected = np.linalg.lstsq(A, L.T @ to_body @ s, rcond=None)[0]
        solution = iq.solve_velocity(J, s, form=iq.CarriedMetric(L @ L.T, T))
        size = np.linalg.norm(expected) + np.linalg.norm(s)
        np.testing.assert_allclose(solution.velocity, expected, atol=1e-14 * np.linalg.cond(A) ** 2 * size)


def test_a_carried_metric_on_the_tool_equals_point_and_length():
    rng = np.random.default_rng(6)
    p, length = rng.normal(size=3), 0.4
    metric = iq.CarriedMetric(np.repeat((length**2, 1.0), 3), iq.transform(translation=p))
    for m in (3, 5, 7):
        J, s, bounds = rng.normal(size=(6, m)), rng.normal(size=6), (np.full(m, -0.2), np.full(m, 0.2))
        carried = iq.solve_velocity(J, s, form=metric, bounds=bounds)
        named = iq.solve_velocity(J, s, point=p, length=length, bounds=bounds)
        np.testing.assert_allclose(carried.velocity, named.velocity, atol=1e-10)
    follower = iq.CarriedMetric(np.ones(6))
    assert follower.follows_tool
    np.testing.assert_allclose(follower.root(np.eye(4)), np.eye(6))


def test_a_user_form_is_accepted():
    class Height:
        """Only what moves along z is kept."""

        def matrix(self, inverse_root):
            z = inverse_root[5]
            return np.outer(z, z)

        def describe(self):
            return "height alone"

    J = iq.revolute((0, 1, 0), (-1.0, 0.0, 0.3)).reshape(6, 1)
    options = {"point": (0.0, 0.0, 0.3), "length": 0.2}
    solution = iq.solve_velocity(J, [0, 0, 0, 0.5, 0, -0.2], form=Height(), **options)
    moved = J[:, 0] * solution.velocity[0]
    assert moved[5] == pytest.approx(-0.2)  # v_z of the frame's own origin, which is what it reads


def test_forms_describe_themselves():
    assert iq.PitchForm(0.25).describe() == "pitch form h = 0.25"
    assert "the tool" in iq.CarriedMetric(np.eye(6)).describe()
    assert "the given pose" in iq.CarriedMetric(np.eye(6), np.eye(4)).describe()
    assert "dimension 2" in iq.Complement(TILTS).describe()
