"""The answer depends on the arm, the motion, the limits and one physical point: on no frame, on no unit of length."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.arms import KINDS, arm
from support.random_systems import motion
from support.repeats import repeats

import invariantqp as iq

AGREE = 1e-10
SCENES = settings(max_examples=repeats(80, 12), deadline=None, derandomize=True)


def options_in(here, T, unit, told):
    """`told` for the frame moved by T and the unit of length: the same physical question."""
    lengths = np.repeat((1.0, unit), 3)
    joints = here.joints_in(unit)
    point = unit * (T[:3, :3] @ told["at"] + T[:3, 3])
    seen = here.in_frame(T).in_units(unit)
    options = {"bounds": told["bounds"] and (told["bounds"][0] * joints, told["bounds"][1] * joints)}
    options["posture"] = told["posture"] * joints
    if told["named"]:
        options["point"] = seen.point
    if told["lengthless"]:
        options["length"] = unit * 0.7
    if told["form"] == "pitch":
        options["form"] = unit * told["h"]
    elif told["form"] == "complement":
        options["form"] = iq.Complement(lengths[:, None] * (iq.adjoint(T) @ told["Z"]))
    elif told["form"] == "carried":
        pose = T @ told["pose"]
        pose[:3, 3] *= unit
        options["form"] = iq.CarriedMetric(told["W"] / lengths[:, None] / lengths, pose)
    J = seen.J
    rows = [
        iq.ExactRows.point(J, point, unit * T[:3, :3] @ told["v"]),
        iq.ExactRows.axis(J, T[:3, :3] @ told["axis"], T[:3, :3] @ told["omega"]),
    ]
    if told["exact"]:
        options["exact"] = {"point": rows[0], "axis": rows[1], "both": rows[0].with_rows(rows[1])}[told["exact"]]
    if told["rows"] is not None:
        options["rows"] = iq.limits.LimitRows(told["rows"] / joints, [-0.3] * 2, [0.2] * 2)
    return J, lengths * (iq.adjoint(T) @ told["s"]), options


def question(rng, here, form, exact, limited, achievable, rows, named):
    """What is asked of the arm, in numbers of one frame."""
    m = here.J.shape[1]
    A = rng.normal(size=(6, 6))
    return {
        "s": here.J @ rng.normal(size=m) if achievable else rng.normal(size=6),
        "at": rng.normal(size=3),
        "named": named,
        "lengthless": here.slides.all(),
        "form": form,
        "h": rng.uniform(-1.0, 1.0),
        "Z": rng.normal(size=(6, max(1, 6 - m))),
        "W": A @ A.T + np.eye(6),
        "pose": motion(rng, 0.5),
        "bounds": (-rng.uniform(0.05, 1.5, m), rng.uniform(0.05, 1.5, m)) if limited else None,
        "posture": rng.normal(size=m),
        "exact": exact,
        "v": 0.3 * rng.normal(size=3),
        "axis": rng.normal(size=3),
        "omega": 0.3 * rng.normal(size=3),
        "rows": rng.normal(size=(2, m)) if rows else None,
    }


@pytest.mark.cases(5)
@pytest.mark.parametrize("kind", KINDS)
@given(
    seed=st.integers(0, 10**9),
    m=st.sampled_from([1, 2, 3, 4, 4, 5, 5, 6, 7, 9, 12]),
    exact=st.sampled_from([None, None, None, "point", "axis", "both"]),
    limited=st.booleans(),
    achievable=st.booleans(),
    rows=st.booleans(),
    named=st.booleans(),
)
@SCENES
def test_frames_and_units_change_nothing(kind, seed, m, exact, limited, achievable, rows, named):
    rng = np.random.default_rng(seed)
    here = arm(rng, kind, m)
    # An arm that has no point of its own is asked about one that somebody names; one without a length, with that.
    named = named or kind in {"gantry", "mixed", "scara"} or (kind == "concurrent" and exact is not None) or m == 1
    T, unit = motion(rng, 1.0), 10.0 ** rng.uniform(-3.0, 3.0)
    for form in (None, "pitch", "complement", "carried")[: 4 if m <= 5 else 2]:
        # A complement is read at the point, which parallel axes leave open along them.
        at_point = named or form == "complement"
        told = question(rng, here, form, exact, limited, achievable, rows, at_point)
        J, s, options = options_in(here, np.eye(4), 1.0, told)
        try:
            x = iq.solve_velocity(J, s, **options)
        except (iq.NoPseudoinverse, iq.BadInput) as refusal:
            with pytest.raises(type(refusal)):
                iq.solve_velocity(*(there := options_in(here, T, unit, told))[:2], **there[2])
            continue
        J, s, options = options_in(here, T, unit, told)
        y = iq.solve_velocity(J, s, **options)
        assert (y.status, y.method) == (x.status, x.method)
        # A millimetre in a metre: three digits cancel. Self-motions count 1e-6, and have ten digits.
        agree = 1e3 * AGREE if kind == "nearly concurrent" else 10.0 * AGREE
        difference = np.abs(y.velocity / here.joints_in(unit) - x.velocity).max()
        assert difference <= agree * max(np.abs(x.velocity).max(), 1e-3), (form, x.reason)


@pytest.mark.cases(9)
@pytest.mark.parametrize("kind", KINDS)
def test_nor_where_limits_leave_almost_no_room(kind):
    """No joint may stand still, as with acceleration limits in mid-motion: exact rows may be left no speed at all."""
    stopped = 0
    for seed in (*range(1010, repeats(1030, 1020)), 1094, 1111):  # the last two and 1018 are hard ones
        rng = np.random.default_rng(seed)
        m = int(rng.integers(2, 13))
        here = arm(rng, kind, m)
        exact = ("point", "axis", "both")[seed % 3]
        told = question(rng, here, None, exact, limited=True, achievable=False, rows=False, named=True)
        before, wide = rng.uniform(-1.0, 1.0, m), 10.0 ** rng.uniform(-3.0, -0.5, m)
        told["bounds"] = before - wide, before + wide
        answers = []
        for T in (np.eye(4), motion(rng, 1.0)):
            J, s, options = options_in(here, T, 1.0, told)
            answers.append(iq.solve_velocity(J, s, **options))
        x, y = answers
        assert y.status == x.status
        assert np.abs(y.velocity - x.velocity).max() <= AGREE * np.abs(x.velocity).max(), (seed, x.reason)
        stopped += x.scale < 1e-9
    assert stopped >= 2


@pytest.mark.parametrize("kind", KINDS)
def test_displacing_the_tool_frame_changes_nothing_where_the_twist_can_be_met(kind):
    """Nor does the point: it only says where a twist that cannot be met is missed by least."""
    rng = np.random.default_rng(1)
    for m in (1, 2, 4, 6, 7):
        here = arm(rng, kind, m)
        s = here.J @ rng.normal(size=m)
        one, other = (iq.solve_velocity(here.J, s, point=p, joint_metric=np.ones(m)) for p in rng.normal(size=(2, 3)))
        if one.damping == other.damping == 0.0:
            np.testing.assert_allclose(other.velocity, one.velocity, atol=1e-9 * (1.0 + np.abs(one.velocity).max()))


def test_the_speed_limit_of_a_point_moves_with_the_frame():
    rng = np.random.default_rng(6)
    worst, acted = 0.0, 0
    for k in range(60):
        m = 2 + k % 7
        here = arm(rng, "general", m)
        s, p, T = rng.normal(size=6), rng.normal(size=3), motion(rng, 1.0)
        limit, bounds = rng.uniform(0.05, 0.5), (-rng.uniform(0.05, 1.0, m), rng.uniform(0.05, 1.0, m))
        there = here.in_frame(T)
        x, y = (
            iq.solve_velocity(J, t, tool_speed=iq.limits.ToolSpeed(limit, q), bounds=bounds, point=q)
            for J, t, q in ((here.J, s, p), (there.J, iq.adjoint(T) @ s, T[:3, :3] @ p + T[:3, 3]))
        )
        assert x.status == y.status
        assert np.linalg.norm(here.J[3:] @ x.velocity + np.cross(here.J[:3] @ x.velocity, p)) <= limit * (1.0 + 1e-9)
        worst = max(worst, np.linalg.norm(x.velocity - y.velocity) / np.linalg.norm(x.velocity))
        acted += x.method == "qp"
    assert acted > 30
    assert worst < 1e-7


@pytest.mark.parametrize("eps", [0.0, 1e-18, 1e-16, 1e-12])
@pytest.mark.parametrize("batch", [False, True])
def test_axes_that_meet_in_the_frames_origin_but_for_rounding_meet(eps, batch):
    """Without a point the length would be that rounding, and another answer than in a moved frame."""
    rng = np.random.default_rng(2)
    axes = rng.normal(size=(3, 3))
    wrist = np.vstack((axes / np.linalg.norm(axes, axis=0), eps * rng.normal(size=(3, 3))))
    J, twist = np.column_stack((wrist, iq.se3.prismatic([0, 0, 1]))), np.array([0.4, -0.3, 0.2, 0.5, -0.1, 0.3])
    bounds, answers = (np.full(4, -0.2), np.full(4, 0.2)), []
    for frame in (np.eye(4), iq.transform(translation=[0.7, 0.2, 0.1]), iq.exp([0.3, 0.2, 0.1, 0.0, 0.0, 0.0])):
        A, s = iq.adjoint(frame) @ J, iq.adjoint(frame) @ twist
        if batch:
            answers.append(iq.solve_velocities(A[None], s[None], bounds=(bounds[0][None], bounds[1][None])).velocity[0])
        else:
            answers.append(iq.solve_velocity(A, s, bounds=bounds).velocity)
    np.testing.assert_allclose(answers[1:], [answers[0]] * 2, atol=1e-9)
