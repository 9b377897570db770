from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.random_systems import motion

import invariantqp as iq
from invariantqp.geometry import arrays

NAN, INF = float("nan"), float("inf")
SHEARED = np.eye(4)
SHEARED[0, 1] = 1e-3
MIRROR = np.diag([1.0, 1.0, -1.0, 1.0])


def chain(**limits):
    return iq.robots.Chain(np.eye(6), np.eye(4), **limits)


# what is called, the argument blamed, and a piece of what is said to have been found
REFUSED = {
    "text": (lambda: arrays.twist("abc"), "twist", "not numeric"),
    "ragged": (lambda: arrays.columns([[1.0], [1.0, 2.0]]), "J", "not numeric"),
    "none": (lambda: arrays.vector(None, 3, "q"), "q", "None"),
    "short twist": (lambda: arrays.twist([1.0] * 5), "twist", "shape (5,)"),
    "nan twist": (lambda: arrays.twist([0, 0, NAN, 0, 0, 0]), "twist", "index 2"),
    "inf in a column": (lambda: arrays.columns(np.full((6, 2), INF)), "J", "index (0, 0)"),
    "transposed": (lambda: arrays.columns(np.zeros((4, 6))), "J", "shape (4, 6)"),
    "no columns": (lambda: arrays.columns(np.zeros((6, 0))), "J", "shape (6, 0)"),
    "three axes": (lambda: arrays.columns(np.zeros((6, 2, 2))), "J", "shape (6, 2, 2)"),
    "matrix": (lambda: arrays.matrix(np.eye(2), (3, 3), "rotation"), "rotation", "shape (2, 2)"),
    "asymmetric": (lambda: arrays.positive_definite([[1.0, 0.5], [0.0, 1.0]], 2, "M"), "M", "not symmetric"),
    "indefinite": (lambda: arrays.positive_definite([1.0, -2.0], 2, "M"), "M", "smallest eigenvalue -2"),
    "semidefinite": (lambda: arrays.positive_definite([1.0, 0.0], 2, "M"), "M", "smallest eigenvalue 0"),
    "long diagonal": (lambda: arrays.positive_definite([1.0, 2.0, 3.0], 2, "M"), "M", "shape (3,)"),
    "nan metric": (lambda: arrays.positive_definite([[1.0, NAN], [NAN, 1.0]], 2, "M"), "M", "NaN"),
    "sheared": (lambda: arrays.pose(SHEARED), "pose", "not a rotation"),
    "mirrored": (lambda: arrays.pose(MIRROR), "pose", "not a rotation"),
    "scaled": (lambda: arrays.pose(np.diag([2.0, 2.0, 2.0, 1.0])), "pose", "not a rotation"),
    "last row": (lambda: arrays.pose(np.eye(4) + np.eye(4)[:, [3]] * np.array([0, 0, 0, 1e-3])), "pose", "last row"),
    "nan pose": (lambda: arrays.pose(np.eye(4) * NAN), "pose", "NaN"),
    "pose of text": (lambda: arrays.pose("tool"), "pose", "not numeric"),
    "word for a number": (lambda: arrays.number("fast", "dt"), "dt", "'fast'"),
    "no number": (lambda: arrays.number(None, "dt"), "dt", "None"),
    "nan number": (lambda: arrays.number(NAN, "dt"), "dt", "nan"),
    "zero tick": (lambda: arrays.number(0.0, "dt", positive=True), "dt", "0.0"),
    "pitch word": (lambda: iq.pitch_form("long"), "h", "'long'"),
    "pitch inf inverted": (lambda: iq.pitch_form_inverse(INF), "h", "inf"),
    "pitch -inf inverted": (lambda: iq.pitch_form_inverse(-INF), "h", "-inf"),
    "pencil": (lambda: iq.forms.invariant_form(1.0, INF), "beta", "inf"),
    "zero axis": (lambda: iq.revolute((0, 0, 0)), "axis", "zero vector"),
    "no pitch": (lambda: iq.se3.helical((0, 0, 1), pitch="steep"), "pitch", "'steep'"),
    "pitch of rest": (lambda: iq.se3.pitch(np.zeros(6)), "twist", "zero twist"),
    "axis of a slide": (lambda: iq.se3.axis([0, 0, 0, 1, 0, 0]), "twist", "omega = 0"),
    "exp of a turn beyond any scale": (lambda: iq.exp([1e200, 0, 0, 0, 0, 0]), "twist", "beyond any scale"),
    "exp of a way beyond any scale": (lambda: iq.exp([0.1, 0, 0, 0, 0, 1e200]), "twist", "beyond any scale"),
    "transform": (lambda: iq.transform(2.0 * np.eye(3)), "rotation", "not a rotation"),
    "transform of a quaternion": (lambda: iq.transform((0, 0, 0, 1)), "rotation", "shape (4,)"),
    "adjoint": (lambda: iq.adjoint(np.zeros((4, 4))), "pose", "not a rotation"),
    "coadjoint": (lambda: iq.coadjoint(np.full((4, 4), INF)), "pose", "NaN or infinity"),
    "inverse": (lambda: iq.inverse(SHEARED), "pose", "not a rotation"),
    "complex": (lambda: arrays.vector([1j] * 3, 3, "q"), "q", "complex numbers"),
    "complex number": (lambda: arrays.number(np.complex128(1 + 2j), "dt"), "dt", "1+2j"),
    "digits": (lambda: arrays.vector(["1", "2"], 2, "q"), "q", "not numeric"),
    "truth values": (lambda: arrays.vector([True, False], 2, "q"), "q", "not numeric"),
    "a truth value": (lambda: arrays.number(value=True, argument="dt"), "dt", "True"),
    "masked": (lambda: arrays.vector(np.ma.masked_array([1.0, 2.0], [0, 1]), 2, "q"), "q", "masked"),
    "a huge integer": (lambda: arrays.number(10**400, "dt"), "dt", "1000"),
    "huge integers": (lambda: arrays.vector([10**400], 1, "q"), "q", "not numeric"),
    "an array for a number": (lambda: arrays.number(np.ones(1), "dt"), "dt", "array([1.])"),
    "half": (lambda: arrays.count(0.5, "restarts"), "restarts", "0.5"),
    "too many": (lambda: arrays.count(7, "restarts", 6), "restarts", "7"),
    "a word of others": (lambda: arrays.choice("hld", "on_loss", ("hold", "leave")), "on_loss", "'hld'"),
    "no flag": (lambda: arrays.flag(1, "along"), "along", "1"),
    "a name for names": (lambda: arrays.strings("ab", "names"), "names", "'ab'"),
    "an array of no dimension": (lambda: arrays.strings(np.array(1.0), "names"), "names", "array(1.)"),
    "a lower limit of inf": (lambda: chain(position_lower=INF), "position_lower", "inf at joint 0"),
    "an upper limit of -inf": (lambda: chain(position_upper=-INF), "position_upper", "-inf at joint 0"),
    "poses of no dimension": (lambda: iq.solve_poses(chain(), np.array(1.0)), "targets", "array(1.)"),
    "a path of no dimension": (
        lambda: iq.PathFollower(iq.Controller(chain(), dt=0.1), np.array(1.0)),
        "path",
        "array(1.)",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_bad_input_says_what_was_found_and_expected(case):
    call, argument, found = REFUSED[case]
    with pytest.raises(iq.BadInput) as caught:
        call()
    error = caught.value
    assert error.argument == argument
    assert found in error.found
    assert error.expected
    assert str(error).startswith(f"{argument}: found {error.found}; expected {error.expected}.")
    assert isinstance(error, ValueError)
    assert isinstance(error, iq.InvariantQPError)


def test_the_error_of_a_transposed_jacobian_says_so():
    with pytest.raises(iq.BadInput, match=r"Transpose it\."):
        arrays.columns(np.zeros((4, 6)))


def test_infinity_is_accepted_on_request():
    assert arrays.number(INF, "h", infinite=True) == INF
    assert arrays.number(np.float32("-inf"), "h", infinite=True) == -INF
    with pytest.raises(iq.BadInput):
        arrays.number(NAN, "h", infinite=True)


def test_a_masked_array_without_masked_entries_is_an_array():
    assert arrays.vector(np.ma.masked_array([1.0, 2.0]), 2, "q").tolist() == [1.0, 2.0]


def test_fractions_and_decimals_are_numbers():
    assert arrays.vector([Fraction(1, 2), Decimal("0.25")], 2, "q").tolist() == [0.5, 0.25]
    assert arrays.number(Fraction(1, 2), "h") == 0.5


def test_a_float_array_is_not_copied():
    q = np.arange(3.0)
    assert arrays.vector(q, 3, "q") is q


def test_lists_integers_and_a_single_twist_are_accepted():
    assert arrays.columns([1, 0, 0, 0, 0, 0]).shape == (6, 1)
    assert arrays.columns([[1, 2]] * 6).dtype == np.float64
    assert arrays.positive_definite([1, 2], 2, "M").tolist() == [[1.0, 0.0], [0.0, 2.0]]
    assert arrays.number(np.float32(0.5), "x") == 0.5


def test_large_finite_numbers_are_not_taken_for_infinite():
    assert arrays.twist([1e200] * 6).tolist() == [1e200] * 6  # the sum of squares overflows


@pytest.mark.parametrize("parts", [[0.4, 0, 0.5], [0, 0, 0, 1.0], [0.4, 0, 0.5, 0, 0, 0, 1.0]])
def test_the_error_of_parts_of_a_pose_says_how_to_make_one(parts):
    with pytest.raises(iq.BadInput, match=r"iq\.transform\(rotation, position\) makes one; .*from_quat"):
        arrays.pose(parts, "target")


def test_the_error_of_a_pose_without_last_row_says_how_to_add_it():
    expected = r"target: found shape \(3, 4\); expected a \(4, 4\) .* np\.vstack\(\(T, \[0, 0, 0, 1\]\)\)"
    with pytest.raises(iq.BadInput, match=expected):
        arrays.pose(np.eye(4)[:3], "target")


def test_scipy_rotations_are_accepted_and_quaternions_refused():
    turned = Rotation.from_rotvec((0.1, -0.4, 0.3))
    np.testing.assert_array_equal(iq.transform(turned)[:3, :3], turned.as_matrix())
    with pytest.raises(iq.BadInput, match=r"quaternion's rotation .*from_quat"):
        iq.transform(turned.as_quat())


def test_a_pose_with_six_digits_passes():
    T = iq.exp([0.3, -0.2, 0.5, 1.0, 2.0, 3.0])
    assert arrays.pose(np.round(T, 6)).shape == (4, 4)


def test_rounding_does_not_make_a_metric_asymmetric():
    """R diag R' has entries that are rounding alone; relative to themselves they differ by anything."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        R = motion(rng)[:3, :3]
        M = R @ np.diag([1.0, 1.0, 1.0 + 1e-14]) @ R.T
        assert arrays.positive_definite(M, 3, "M") is not None
    M = np.array([[1.0, 3e-17], [-1e-17, 1.0]])
    assert arrays.positive_definite(M, 2, "M").tolist() == M.tolist()


def test_a_small_entry_is_judged_by_its_own_rows():
    """Entries in millimetres beside entries in metres: an asymmetry of the small ones is one."""
    with pytest.raises(iq.BadInput, match="not symmetric"):
        arrays.positive_definite([[1e12, 0, 0], [0, 1.0, 0.5], [0, 0.2, 1.0]], 3, "M")


def test_names_are_shortened():
    assert arrays.names(["a", "b"]) == "a, b"
    assert arrays.names(list("abcdefgh")) == "a, b, c, d, e, f, ... (8)"
