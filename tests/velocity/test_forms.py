import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.optimize import lsq_linear
from support.random_systems import motion
from support.velocity_reference import tight_box

import invariantqp as iq

PLANAR = np.column_stack([iq.revolute((0, 0, 1), p) for p in ((0, 0, 0), (0.4, 0, 0), (0.5, 0.3, 0))])
SCARA = np.column_stack((PLANAR, iq.se3.prismatic((0, 0, 1))))
TILTS = np.eye(6)[:, [0, 1]]
SCARA_METRIC = np.array([1.0, 1.0, 1.0, 4.0])


def projected(J, Z, s):
    """x with Jx = P s, P = J(K'J)^-1 K', K from scipy."""
    K = null_space(Z.T)
    return np.linalg.solve(K.T @ J, K.T @ s)


@pytest.mark.parametrize("m", range(1, 6))
def test_a_complement_projects_along_itself(m):
    rng = np.random.default_rng(m)
    for _ in range(20):
        J, Z, s = rng.normal(size=(6, m)), rng.normal(size=(6, 6 - m)), rng.normal(size=6)
        solution = iq.solve_velocity(J, s, form=iq.Complement(Z), damping=0.0, guard=False)
        assert solution.method == "closed-form"
        expected = projected(J, Z, s)
        np.testing.assert_allclose(solution.velocity, expected, atol=1e-10 * (1.0 + np.linalg.norm(expected)))
        given_up = np.linalg.lstsq(Z, solution.residual, rcond=None)[0]  # s - Jx lies in Z
        np.testing.assert_allclose(Z @ given_up, solution.residual, atol=1e-9 * (1.0 + np.linalg.norm(expected)))


def test_the_h_complement_gives_the_h_pseudoinverse():
    rng = np.random.default_rng(9)
    J, s = rng.normal(size=(6, 4)), rng.normal(size=6)
    Z = iq.reciprocal(J, 0.4)
    solution = iq.solve_velocity(J, s, form=iq.Complement(Z), guard=False)
    np.testing.assert_allclose(solution.velocity, iq.pseudoinverse(J, 0.4) @ s, rtol=1e-9)


def test_planar_arm_and_scara_work_with_what_they_give_up():
    """No h works for either; tilts and, for the planar arm, the height are what they cannot do."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        s = rng.normal(size=6)
        height = np.eye(6)[:, [5]]
        planar = iq.solve_velocity(PLANAR, s, form=iq.Complement(np.hstack((TILTS, height))), guard=False)
        np.testing.assert_allclose(PLANAR @ planar.velocity, [0, 0, s[2], s[3], s[4], 0], atol=1e-12)
        scara = iq.solve_velocity(SCARA, s, form=iq.Complement(TILTS), joint_metric=SCARA_METRIC, guard=False)
        np.testing.assert_allclose(SCARA @ scara.velocity, [0, 0, *s[2:]], atol=1e-12)
        assert scara.method == "closed-form"
    for J in (PLANAR, SCARA):
        with pytest.raises(iq.BlindSystem):
            iq.principal_pitches(J)


def test_a_complement_under_limits_misses_least_at_the_arms_own_point():
    """For a planar arm that is the middle of its axes, with their RMS distance from it for a radian."""
    rng = np.random.default_rng(2)
    Z = np.hstack((TILTS, np.eye(6)[:, [5]]))
    axes = np.array([(0, 0), (0.4, 0), (0.5, 0.3)])
    middle = axes.mean(axis=0)
    length = np.sqrt(((axes - middle) ** 2).sum() / 3)

    def planar(twists):
        """(L omega_z; v in the plane, of the point in the middle)."""
        return np.array((length * twists[2], twists[3] - middle[1] * twists[2], twists[4] + middle[0] * twists[2]))

    for _ in range(10):
        s = rng.normal(size=6)
        bounds = tight_box(rng, 3, projected(PLANAR, Z, s))
        solution = iq.solve_velocity(PLANAR, s, form=iq.Complement(Z), bounds=bounds, guard=False)
        expected = lsq_linear(planar(PLANAR), planar(s), (bounds.lower, bounds.upper), method="bvls", tol=1e-14).x
        np.testing.assert_allclose(solution.velocity, expected, atol=1e-9)


def test_a_complement_with_joints_to_spare_is_met_undamped_by_the_shortest_velocity():
    rng = np.random.default_rng(4)
    for m in (5, 6, 7):
        J, Z, s = rng.normal(size=(6, m)), rng.normal(size=(6, 2)), rng.normal(size=6)
        K = null_space(Z.T)
        solution = iq.solve_velocity(J, s, form=iq.Complement(Z), damping=0.0, guard=False)
        assert solution.damping == 0.0
        np.testing.assert_allclose(solution.velocity, np.linalg.pinv(K.T @ J) @ K.T @ s, rtol=1e-8, atol=1e-8)


def test_a_complement_that_nearly_holds_a_motion_of_the_arm_is_damped_as_the_other_forms_are():
    """Undamped, the answer is as long as one over the angle between the two; damped it stays of the demand's size."""
    rng = np.random.default_rng(5)
    s = rng.normal(size=6)
    for J, other in (
        (PLANAR, np.hstack((TILTS, np.eye(6)[:, [5]]))),
        (rng.normal(size=(6, 3)), rng.normal(size=(6, 3))),
    ):
        lost, longest = J @ rng.normal(size=3), []
        for angle in (1e-3, 1e-5, 1e-8, 0.0):
            Z = other.copy()
            Z[:, 2] = lost + angle * other[:, 2]
            solution = iq.solve_velocity(J, s, form=iq.Complement(Z), guard=False)
            assert (solution.method, solution.status) == ("damped", "ok")
            assert "damped with lambda" in solution.reason
            longest.append(np.linalg.norm(solution.velocity))
            if angle == 1e-8:
                assert np.linalg.norm(projected(J, Z, s)) > 1e4 * longest[-1]
            A = iq.adjoint(motion(rng))
            there = iq.solve_velocity(A @ J, A @ s, form=iq.Complement(A @ Z), guard=False)
            np.testing.assert_allclose(there.velocity, solution.velocity, atol=1e-7 * (1.0 + longest[-1]))
            in_mm = np.repeat((1.0, 1e3), 3)
            scaled = iq.solve_velocity((in_mm * J.T).T, in_mm * s, form=iq.Complement((in_mm * Z.T).T), guard=False)
            np.testing.assert_allclose(scaled.velocity, solution.velocity, atol=1e-7 * (1.0 + longest[-1]))
        assert max(longest) < 1e4


def test_a_complement_moves_with_the_frame_and_does_not_read_its_own_basis():
    rng = np.random.default_rng(3)
    for m in (2, 3, 5):
        J, Z, s = rng.normal(size=(6, m)), rng.normal(size=(6, 6 - m)), rng.normal(size=6)
        x = iq.solve_velocity(J, s, form=iq.Complement(Z)).velocity
        A = iq.adjoint(motion(rng))
        there = iq.solve_velocity(A @ J, A @ s, form=iq.Complement(A @ Z @ rng.normal(size=(6 - m, 6 - m))))
        np.testing.assert_allclose(there.velocity, x, atol=1e-9 * (1.0 + np.linalg.norm(x)))


def test_a_complement_too_small_to_decide_is_refused():
    """With c + m < 6 what is left over would be judged by somebody's frame."""
    rng = np.random.default_rng(4)
    with pytest.raises(iq.BadInput, match=r"Z: found 2 columns; expected at least 3 for 3 joints"):
        iq.solve_velocity(rng.normal(size=(6, 3)), np.ones(6), form=iq.Complement(rng.normal(size=(6, 2))))


@pytest.mark.parametrize("m", range(1, 9))
def test_a_carried_metric_is_weighted_least_squares_at_its_body(m):
    rng = np.random.default_rng(20 + m)
    for _ in range(10):
        J, s, T = rng.normal(size=(6, m)), rng.normal(size=6), motion(rng)
        L = np.tril(rng.normal(size=(6, 6))) + 2.0 * np.eye(6)
        to_body = iq.adjoint(iq.inverse(T))
        expected = np.linalg.lstsq(L.T @ to_body @ J, L.T @ to_body @ s, rcond=None)[0]
        form = iq.CarriedMetric(L @ L.T, T)
        solution = iq.solve_velocity(J, s, form=form, guard=False, damping=0.0)
        condition = np.linalg.cond(L.T @ to_body @ J) ** 2
        size = np.linalg.norm(expected) + np.linalg.norm(s)
        np.testing.assert_allclose(solution.velocity, expected, atol=1e-14 * condition * size)


def test_a_carried_metric_moves_with_its_body():
    rng = np.random.default_rng(5)
    W = np.diag([0.1, 0.2, 0.3, 1.0, 1.0, 2.0])
    for m in (3, 5, 7):
        J, s, T, X = rng.normal(size=(6, m)), rng.normal(size=6), motion(rng), motion(rng)
        x = iq.solve_velocity(J, s, form=iq.CarriedMetric(W, T)).velocity
        there = iq.solve_velocity(iq.adjoint(X) @ J, iq.adjoint(X) @ s, form=iq.CarriedMetric(W, X @ T)).velocity
        np.testing.assert_allclose(there, x, atol=1e-9 * (1.0 + np.linalg.norm(x)))
    follower = iq.CarriedMetric(W)
    assert follower.follows_tool
    np.testing.assert_array_equal(
        iq.solve_velocity(J, s, form=follower.at(T)).velocity,
        iq.solve_velocity(J, s, form=iq.CarriedMetric(W, T)).velocity,
    )


def test_forms_say_what_they_are():
    assert iq.PitchForm(0.25).describe() == "pitch form h = 0.25"
    assert "the tool" in iq.CarriedMetric(np.eye(6)).describe()
    assert "the given pose" in iq.CarriedMetric(np.eye(6), np.eye(4)).describe()
    assert "dimension 2" in iq.Complement(TILTS).describe()
