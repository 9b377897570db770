import numpy as np
import pytest
from support.velocity_reference import regular_problem, tight_box

import invariantqp as iq
from invariantqp.velocity.forms import FEW_JOINTS_PITCH
from invariantqp.velocity.request import UnitsMixed


@pytest.mark.parametrize("m", range(1, 9))
def test_the_closed_form_is_the_pseudoinverse(m):
    rng = np.random.default_rng(m)
    for k in range(30):
        J, s, h = regular_problem(rng, m)
        A = rng.normal(size=(m, m))
        M = A @ A.T + 0.5 * np.eye(m) if k % 2 else None
        solution = iq.solve_velocity(J, s, form=h, joint_metric=M, guard=False)
        assert (solution.method, solution.status, solution.reason) == ("closed-form", "ok", "")
        assert (solution.active, solution.scale, solution.damping, solution.guard) == ((), 1.0, 0.0, 0.0)
        P = iq.pseudoinverse(J, h, joint_metric=M)
        size = np.linalg.norm(P) * np.linalg.norm(s)
        np.testing.assert_allclose(solution.velocity, P @ s, rtol=0.0, atol=1e-11 * size)
        np.testing.assert_allclose(solution.residual, s - J @ solution.velocity, atol=1e-12 * size)


def test_undamped_and_near_singular_it_is_still_the_pseudoinverse():
    """Asked not to damp, the law uses the factored route: the Gram matrix has lost ten digits here."""
    rng = np.random.default_rng(0)
    for m in (3, 5, 6, 7):
        U, _ = np.linalg.qr(rng.normal(size=(6, min(m, 6))))
        V, _ = np.linalg.qr(rng.normal(size=(m, m)))
        J = U * np.geomspace(1.0, 1e-5, min(m, 6)) @ V[: min(m, 6)]
        s = rng.normal(size=6)
        solution = iq.solve_velocity(J, s, form=0.6, damping=0.0, guard=False)
        expected = iq.pseudoinverse(J, 0.6) @ s
        assert solution.method == "closed-form"
        np.testing.assert_allclose(solution.velocity, expected, atol=1e-13 * np.linalg.norm(expected))


@pytest.mark.parametrize("m", range(1, 9))
def test_which_way_is_known_beforehand(m):
    rng = np.random.default_rng(30 + m)
    seen = set()
    for k in range(40):
        J, s, h = regular_problem(rng, m, ratio=1e-7)
        damping = (None, 0.0, 0.05)[k % 3]
        free = iq.solve_velocity(J, s, form=h, damping=damping, guard=False).velocity
        options = {
            "form": h,
            "damping": damping,
            "bounds": tight_box(rng, m, free) if k % 2 else None,
            "exact": iq.ExactRows(J[3:4], s[3:4]) if k % 5 == 0 else None,
        }
        choice, solution = iq.velocity.method_for(J, s, **options), iq.solve_velocity(J, s, **options)
        assert choice.method == solution.method
        assert choice.reason
        assert 0.0 <= choice.conditioning <= 1.0
        if solution.status != "scaled":
            assert choice.damping == pytest.approx(solution.damping)
        seen.add(choice.method)
    assert seen == {"closed-form", "damped", "qp"}


@pytest.mark.parametrize("guard", [False, True])
@pytest.mark.parametrize("m", [2, 3, 5, 6, 7, 8])
def test_the_law_is_continuous_as_a_bound_comes_into_play(m, guard):
    """A bound swept through the free solution: both sides agree to 1e-9, and no step is larger than the bound's."""
    rng = np.random.default_rng(50 + m)
    for _ in range(5):
        J, s, h = regular_problem(rng, m)
        x = iq.solve_velocity(J, s, form=h, guard=False).velocity
        i = int(np.abs(x).argmax())
        wide = 10.0 * np.abs(x).max()

        def at(share, i=i, x=x, J=J, s=s, h=h, wide=wide):
            lower, upper = np.full(m, -wide), np.full(m, wide)
            (upper if x[i] > 0.0 else lower)[i] = share * x[i]
            return iq.solve_velocity(J, s, form=h, bounds=iq.Bounds(lower, upper), guard=guard)

        outside, inside = at(1.0 + 1e-12), at(1.0 - 1e-12)
        assert inside.method == "qp"
        assert outside.method == "closed-form"
        size = np.linalg.norm(x)
        np.testing.assert_allclose(inside.velocity, outside.velocity, rtol=0.0, atol=1e-9 * size)
        sweep = [at(share).velocity for share in np.linspace(0.98, 1.02, 81)]
        steps = np.linalg.norm(np.diff(sweep, axis=0), axis=1)
        coarse = np.linalg.norm(sweep[0] - sweep[-1])
        # Lipschitz in the bound: the steepest of 80 steps is no jump, whatever the slope.
        assert steps.max() <= max(0.2 * coarse, 1e-9 * np.linalg.norm(x))


def test_bounds_are_never_left():
    rng = np.random.default_rng(70)
    for k in range(300):
        m = 1 + k % 8
        J, s = rng.normal(size=(6, m)), 10.0 ** rng.uniform(-6, 6) * rng.normal(size=6)
        centre, reach = rng.normal(size=m), 10.0 ** rng.uniform(-6, 2, size=m)
        bounds = iq.Bounds(centre - reach, centre + reach)  # zero need not be inside
        solution = iq.solve_velocity(J, s, form=float(rng.uniform(-1, 1)), bounds=bounds)
        assert (bounds.lower <= solution.velocity).all()
        assert (solution.velocity <= bounds.upper).all()
        assert solution.status in {"ok", "guarded"}
        at = np.flatnonzero((solution.velocity == bounds.lower) | (solution.velocity == bounds.upper))
        assert set(at) <= set(solution.active)


def test_a_joint_held_in_place_and_all_joints_held():
    rng = np.random.default_rng(1)
    J, s, h = regular_problem(rng, 4)
    lower, upper = np.full(4, -5.0), np.full(4, 5.0)
    lower[2] = upper[2] = 0.0
    solution = iq.solve_velocity(J, s, form=h, bounds=iq.Bounds(lower, upper))
    assert solution.velocity[2] == 0.0
    assert 2 in solution.active
    stuck = iq.solve_velocity(J, s, form=h, bounds=iq.Bounds(np.zeros(4), np.zeros(4)))
    np.testing.assert_array_equal(stuck.velocity, np.zeros(4))
    assert stuck.active == (0, 1, 2, 3)


@pytest.mark.parametrize("m", [7, 8])
def test_posture_takes_the_null_space_and_nothing_else(m):
    """The velocity nearest the posture (in M) among those that meet the twist."""
    rng = np.random.default_rng(m)
    for k in range(20):
        J, s, h = regular_problem(rng, m)
        A = rng.normal(size=(m, m))
        M = A @ A.T + 0.5 * np.eye(m) if k % 2 else np.eye(m)
        wanted = rng.normal(size=m)
        solution = iq.solve_velocity(J, s, form=h, joint_metric=M if k % 2 else None, posture=wanted)
        right = np.linalg.solve(M, J.T) @ np.linalg.inv(J @ np.linalg.solve(M, J.T))
        np.testing.assert_allclose(solution.velocity, wanted + right @ (s - J @ wanted), atol=1e-10)
        np.testing.assert_allclose(J @ solution.velocity, s, atol=1e-10)
        none = iq.solve_velocity(J, s, form=h, joint_metric=M if k % 2 else None)
        np.testing.assert_allclose(none.velocity, right @ s, atol=1e-10)


def test_posture_gives_way_to_limits_before_the_task_does():
    rng = np.random.default_rng(2)
    worst = 0.0
    for _ in range(30):
        J, s, h = regular_problem(rng, 7, ratio=1e-2)
        x = iq.solve_velocity(J, s, form=h).velocity
        wide = 3.0 * np.abs(x).max()
        lower, upper = np.full(7, -wide), np.full(7, wide)
        null = np.linalg.svd(J)[2][6]
        i = int(np.abs(null).argmax())
        upper[i], lower[i] = x[i] + 0.02, x[i] - 0.02
        solution = iq.solve_velocity(
            J, s, form=h, bounds=iq.Bounds(lower, upper), posture=np.sign(null[i]) * null, guard=False
        )
        assert i in solution.active
        worst = max(worst, np.linalg.norm(solution.residual) / np.linalg.norm(s))
    assert worst < 1e-3


def test_a_joint_metric_decides_what_a_limit_costs():
    rng = np.random.default_rng(3)
    J, s, h = regular_problem(rng, 7)
    x = iq.solve_velocity(J, s, form=h).velocity
    heavy = np.ones(7)
    heavy[0] = 1e4
    assert abs(iq.solve_velocity(J, s, form=h, joint_metric=heavy).velocity[0]) < abs(x[0])


def test_mixed_joints_are_warned_about_unless_a_metric_is_given():
    J = np.column_stack([iq.revolute((0, 0, 1)), iq.se3.prismatic((1, 0, 0))])
    with pytest.warns(UnitsMixed, match="joint_metric"):
        iq.solve_velocity(J, np.ones(6), form=0.5)
    iq.solve_velocity(J, np.ones(6), form=0.5, joint_metric=[1.0, 4.0])


def test_the_default_form_has_the_arms_own_length():
    rng = np.random.default_rng(4)
    for m, times in ((4, FEW_JOINTS_PITCH), (6, 1.0), (7, 1.0)):
        J, s = rng.normal(size=(6, m)), rng.normal(size=6)
        bounds = iq.Bounds(np.full(m, -0.3), np.full(m, 0.3))
        own = iq.solve_velocity(J, s, form=times * iq.systems.centre(J).length, bounds=bounds)
        np.testing.assert_array_equal(iq.solve_velocity(J, s, bounds=bounds).velocity, own.velocity)
    gantry = np.column_stack([iq.se3.prismatic(u) for u in np.eye(3)])
    np.testing.assert_allclose(iq.solve_velocity(gantry, [0, 0, 0, 1, 2, 3]).velocity, [1, 2, 3])
    wrist = np.column_stack([iq.revolute(u) for u in np.eye(3)])
    np.testing.assert_allclose(iq.solve_velocity(wrist, [1, 2, 3, 0, 0, 0]).velocity, [1, 2, 3])


def test_a_zero_twist_and_a_zero_jacobian():
    rng = np.random.default_rng(5)
    J = rng.normal(size=(6, 5))
    solution = iq.solve_velocity(J, np.zeros(6), form=0.5)
    np.testing.assert_array_equal(solution.velocity, np.zeros(5))
    assert solution.status == "ok"
    nothing = iq.solve_velocity(np.zeros((6, 3)), np.ones(6), form=0.5)
    np.testing.assert_array_equal(nothing.velocity, np.zeros(3))


def test_at_a_singularity_it_is_damped_and_says_so():
    rng = np.random.default_rng(6)
    J = rng.normal(size=(6, 6))
    J[:, 5] = J[:, :5] @ rng.normal(size=5) + 1e-9 * J[:, 5]
    solution = iq.solve_velocity(J, rng.normal(size=6), form=0.4)
    assert solution.method == "damped"
    assert "damped with lambda" in solution.reason
    assert np.linalg.norm(solution.velocity) < 1e5


NAN = np.full(6, np.nan)
J6 = np.random.default_rng(0).normal(size=(6, 6))
ONE = np.ones(6)
BAD = {
    "J": lambda: iq.solve_velocity(J6 * np.nan, ONE),
    "J inf": lambda: iq.solve_velocity(J6 * np.inf, ONE),
    "J shape": lambda: iq.solve_velocity(J6[:5], ONE),
    "twist": lambda: iq.solve_velocity(J6, NAN),
    "twist shape": lambda: iq.solve_velocity(J6, ONE[:3]),
    "form nan": lambda: iq.solve_velocity(J6, ONE, form=np.nan),
    "form inf": lambda: iq.solve_velocity(J6, ONE, form=np.inf),
    "form word": lambda: iq.solve_velocity(J6, ONE, form="auto"),
    "form bool": lambda: iq.solve_velocity(J6, ONE, form=True),
    "damping": lambda: iq.solve_velocity(J6, ONE, damping=np.nan),
    "damping negative": lambda: iq.solve_velocity(J6, ONE, damping=-1.0),
    "bounds type": lambda: iq.solve_velocity(J6, ONE, bounds=(-ONE, ONE)),
    "bounds length": lambda: iq.solve_velocity(J6, ONE, bounds=iq.Bounds([-1.0], [1.0])),
    "exact type": lambda: iq.solve_velocity(J6, ONE, exact=(J6, ONE)),
    "exact width": lambda: iq.solve_velocity(J6, ONE, exact=iq.ExactRows(np.eye(5), np.ones(5))),
    "exact A": lambda: iq.ExactRows(J6 * np.nan, ONE),
    "exact A shape": lambda: iq.ExactRows(ONE, ONE),
    "exact A empty": lambda: iq.ExactRows(np.zeros((0, 6)), []),
    "exact b": lambda: iq.ExactRows(J6, NAN),
    "exact b inf": lambda: iq.ExactRows(J6, ONE * np.inf),
    "exact b length": lambda: iq.ExactRows(J6, ONE[:2]),
    "metric": lambda: iq.solve_velocity(J6, ONE, joint_metric=NAN),
    "metric sign": lambda: iq.solve_velocity(J6, ONE, joint_metric=-ONE),
    "metric length": lambda: iq.solve_velocity(J6, ONE, joint_metric=np.ones(5)),
    "posture": lambda: iq.solve_velocity(J6, ONE, posture=NAN),
    "posture length": lambda: iq.solve_velocity(J6, ONE, posture=np.ones(7)),
    "guard": lambda: iq.solve_velocity(J6, ONE, guard=0.5),
    "guard fraction": lambda: iq.Guard(fraction=1.5),
    "guard fraction nan": lambda: iq.Guard(fraction=np.nan),
    "guard point": lambda: iq.Guard(point=NAN[:3]),
    "guard length": lambda: iq.Guard(length=0.0),
    "carried": lambda: iq.CarriedMetric(np.diag(NAN), np.eye(4)),
    "carried pose": lambda: iq.CarriedMetric(np.eye(6), np.full((4, 4), np.nan)),
    "carried word": lambda: iq.CarriedMetric(np.eye(6), "base"),
    "carried nowhere": lambda: iq.solve_velocity(J6, ONE, form=iq.CarriedMetric(np.eye(6))),
    "carried indefinite": lambda: iq.CarriedMetric(iq.pitch_form(0.3), np.eye(4)),
    "complement": lambda: iq.Complement(NAN),
    "complement dependent": lambda: iq.Complement(np.ones((6, 2))),
    "pitch form": lambda: iq.PitchForm(np.nan),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(case):
    with pytest.raises(iq.BadInput, match=r"^\w+: found .*; expected .*\.") as caught:
        BAD[case]()
    assert caught.value.found
    assert caught.value.expected


def test_which_way_refuses_what_the_law_refuses():
    with pytest.raises(iq.BadInput, match="twist: found NaN"):
        iq.velocity.method_for(J6, NAN)


def test_lists_will_do():
    listed = iq.solve_velocity(J6.tolist(), ONE.tolist(), form=0.3, bounds=iq.Bounds([-1] * 6, [1] * 6))
    given = iq.solve_velocity(J6, ONE, form=iq.PitchForm(0.3), bounds=iq.Bounds(-ONE, ONE))
    np.testing.assert_array_equal(listed.velocity, given.velocity)
