"""One tick: the twist met, or missed by least squares at a point, inside the limits, with the reason for it."""

import numpy as np
import pytest
from support.velocity_reference import damped_velocity, reach_of, regular_problem, root_of

import invariantqp as iq
from invariantqp.velocity.definition import NULL_WEIGHT

FEW = iq.robots.Chain(
    np.column_stack(
        [iq.revolute([0, 0, 1], point=[0.012, 0, 0])]
        + [iq.revolute([0, 1, 0], point=p) for p in ([0.012, 0, 0.0765], [0.036, 0, 0.2045], [0.16, 0, 0.2045])]
    ),
    iq.transform(translation=[0.286, 0, 0.2045]),
    velocity_limit=4.8,
)


@pytest.mark.parametrize(
    ("robot", "q", "share"),
    [(FEW, [0.0, -0.6, 0.5, 0.4], 20), (iq.load_robot("so101"), [0.0, -0.3, 0.5, 0.4, 0.1], 38)],
)
@pytest.mark.parametrize("backend", [None, "daqp"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_arm_with_few_joints_reports_the_achievable_share(robot, q, share, backend, sign):
    """30 mm/s along y for a second, as in OpenMANIPULATOR-X and SO-101; the advice is followed, too."""
    twist = [0.0, 0.0, 0.0, 0.0, sign * 0.03, 0.0]
    for exact, done in ((None, share / 100.0), ("position", 1.0)):
        loop, at = iq.Controller(robot, dt=0.02, exact=exact, backend=backend), np.array(q)
        said = set()
        for _ in range(50):
            solution = loop.follow(at, twist)
            said.add(str(solution.status))
            at = at + 0.02 * solution.velocity
        moved = sign * (robot.pose(at) - robot.pose(np.array(q)))[1, 3] / 0.03
        assert moved == pytest.approx(done, abs=0.02)
        assert said == {"limited" if exact is None else "ok"}
        if exact is None:
            assert (
                f"six joints ({len(q)}) can achieve {share}% of this twist; exact="
                in loop.follow(np.array(q), twist).reason
            )
            assert solution.reasons[0].code is iq.velocity.Code.FEW_JOINTS


@pytest.mark.cases(4)
@pytest.mark.parametrize("m", range(1, 9))
def test_unachievable_twists_are_missed_by_least_squares_at_the_point(m):
    rng = np.random.default_rng(m)
    for k in range(20):
        J, s, _ = regular_problem(rng, m)
        p, length = rng.normal(size=3), float(rng.uniform(0.2, 2.0))
        A = rng.normal(size=(m, m))
        M = A @ A.T + 0.5 * np.eye(m) if k % 2 else np.eye(m)
        root = root_of(p, length)
        options = {"joint_metric": M if k % 2 else None, "damping": 0.0, "point": p, "length": length}
        solution = iq.solve_velocity(J, s, **options)
        short = np.linalg.norm(root @ (s - J @ solution.velocity)) > 0.05 * np.linalg.norm(root @ s)
        assert (solution.method, solution.status) == ("closed-form", "limited" if short else "ok")
        share = (root @ s) @ (root @ J @ solution.velocity) / ((root @ s) @ (root @ s))
        told = f"fewer than six joints ({m}) can achieve {share:.0%} of this twist"
        assert (
            solution.reason.startswith(told)
            == (share < 0.95)
            == any(r.code.name == "FEW_JOINTS" for r in solution.reasons)
        )
        assert ("exact=" in solution.reason) == (share < 0.95 and m >= 3)
        assert short == (m < 6) or m == 3
        assert (solution.active, solution.scale, solution.damping, solution.guard) == ((), 1.0, 0.0, 0.0)
        T = np.linalg.inv(np.linalg.cholesky(M)).T
        expected = T @ np.linalg.lstsq(root @ J @ T, root @ s, rcond=None)[0]
        size = np.linalg.norm(expected)
        np.testing.assert_allclose(solution.velocity, expected, rtol=0.0, atol=1e-11 * size)
        np.testing.assert_allclose(solution.residual, s - J @ solution.velocity, atol=1e-12 * size)


@pytest.mark.cases(6)
@pytest.mark.parametrize("damping", [None, 0.02])
@pytest.mark.parametrize("m", [2, 3, 5, 6, 7, 8])
def test_near_a_singularity_the_velocity_is_exact_to_rounding(m, damping):
    """The filter from its formula in 40 digits; a direction below 1e-9 of the strongest moves nothing."""
    rng, p = np.random.default_rng(20 + m), np.ones(3)
    root, weight = root_of(p, 1.0), (damping or 0.0) ** 2
    for weakest in (1.0, 0.3, 9e-3, 9e-4, 1e-6, 1e-13, 0.0):
        U, V = (np.linalg.qr(rng.normal(size=(k, k)))[0] for k in (6, m))
        sigma = np.ones(min(m, 6))
        sigma[-1] = weakest
        J, s = np.linalg.inv(root) @ (U[:, : len(sigma)] * sigma) @ V[: len(sigma)], rng.normal(size=6)
        posture = rng.normal(size=m) if damping is None and rng.random() < 0.5 else None
        bounds = (np.full(m, -1e9), np.full(m, 1e9)) if rng.random() < 0.5 else None
        solution = iq.solve_velocity(J, s, point=p, length=1.0, posture=posture, bounds=bounds, damping=damping)
        expected = damped_velocity(root @ J, root @ s, posture, weight)
        # Rounding of J, relative to the weakest direction that counts; below, the null space's weight holds it.
        rounding = 3e-13 / max(weakest, damping or 0.0) if weakest > 1e-9 else 5e-13 + weakest / NULL_WEIGHT
        size = np.linalg.norm(root @ s) + np.abs(expected).max()
        np.testing.assert_allclose(solution.velocity, expected, rtol=0.0, atol=rounding * size)
        assert (solution.method, solution.damping) == (("damped", damping) if damping else ("closed-form", 0.0))


@pytest.mark.parametrize("m", range(1, 9))
@pytest.mark.parametrize("damping", [1e-3, 0.05, 1.0, 30.0])
def test_the_closed_loop_gains_are_in_zero_to_one(m, damping):
    """The map b -> A x in the measure is symmetric with gains sigma^2 / (sigma^2 + lambda^2), and x is bounded."""
    rng = np.random.default_rng(m)
    J, p = rng.normal(size=(6, m)), rng.normal(size=3)
    root = root_of(p, 0.7)
    A = root @ J
    columns = []
    for e in np.eye(6):
        solution = iq.solve_velocity(J, np.linalg.solve(root, e), damping=damping, point=p, length=0.7)
        assert solution.method == "damped"
        assert solution.damping == pytest.approx(damping)
        columns.append(A @ solution.velocity)
        assert np.linalg.norm(solution.velocity) <= 1.0 / (2.0 * damping) * (1.0 + 1e-12)
    gains = np.linalg.eigvalsh(np.column_stack(columns))
    sigma = np.linalg.svd(A, compute_uv=False)
    expected = np.concatenate((np.zeros(6 - len(sigma)), sigma**2 / (sigma**2 + damping**2)))
    np.testing.assert_allclose(gains, np.sort(expected), atol=1e-12)


def test_the_reach_is_the_default_length():
    rng = np.random.default_rng(4)
    for m in range(2, 6):
        J = np.column_stack([iq.revolute(rng.normal(size=3), rng.normal(size=3)) for _ in range(m)])
        s, p = rng.normal(size=6), rng.normal(size=3)
        named = iq.solve_velocity(J, s, point=p, damping=0.0)
        told = iq.solve_velocity(J, s, point=p, length=reach_of(J, p), damping=0.0)
        np.testing.assert_allclose(named.velocity, told.velocity, rtol=1e-11, atol=1e-12)
        own = iq.systems.centre(J, s).point
        np.testing.assert_allclose(
            iq.solve_velocity(J, s, damping=0.0).velocity,
            iq.solve_velocity(J, s, damping=0.0, point=own).velocity,
            rtol=1e-9,
            atol=1e-10,
        )


def test_where_all_axes_meet_the_point_the_twist_determines_the_length():
    """A gantry and a wrist have no length: any will do for them alone, and none may come from the units."""
    gantry = np.column_stack([iq.se3.prismatic(u) for u in np.eye(3)])
    wrist = np.column_stack([iq.revolute(u) for u in np.eye(3)])
    for J, s, x in ((gantry, [1, 2, 3, 1, 2, 3], [1, 2, 3]), (wrist, [1, 2, 3, 4, 5, 6], [1, 2, 3])):
        solution = iq.solve_velocity(J, s, point=(0, 0, 0))
        np.testing.assert_allclose(solution.velocity, x, atol=1e-12)
        assert solution.status == "limited"  # three joints do half of six
        assert "fewer than six joints (3) can achieve " in solution.reason
        assert ("exact=" in solution.reason) == (J is gantry)  # a wrist moves no point


def test_a_length_of_a_prismatic_joint_counts_as_a_radian():
    rng = np.random.default_rng(5)
    J = np.column_stack(
        [*(iq.revolute(rng.normal(size=3), rng.normal(size=3)) for _ in range(6)), iq.se3.prismatic((1, 2, 3))]
    )
    s, p = rng.normal(size=6), rng.normal(size=3)
    L = reach_of(J, p)
    mixed = iq.solve_velocity(J, s, point=p).velocity
    weighed = iq.solve_velocity(J, s, point=p, joint_metric=[1.0] * 6 + [1.0 / L**2]).velocity
    np.testing.assert_allclose(mixed, weighed, rtol=1e-12)
    assert np.linalg.norm(mixed - iq.solve_velocity(J, s, point=p, joint_metric=np.ones(7)).velocity) > 1e-3
    np.testing.assert_allclose(J @ mixed, s, atol=1e-12)


def test_bounds_are_kept():
    rng = np.random.default_rng(70)
    for k in range(300):
        m = 1 + k % 8
        J, s = rng.normal(size=(6, m)), 10.0 ** rng.uniform(-6, 6) * rng.normal(size=6)
        centre, reach = rng.normal(size=m), 10.0 ** rng.uniform(-6, 2, size=m)
        bounds = iq.Bounds(centre - reach, centre + reach)  # zero need not be inside
        form = (None, float(rng.uniform(-1, 1)))[k % 2]
        solution = iq.solve_velocity(J, s, form=form, bounds=bounds, guard=k % 3 == 0)
        assert (bounds.lower <= solution.velocity).all()
        assert (solution.velocity <= bounds.upper).all()
        assert solution.status in {"ok", "guarded", "limited"}
        told = any(why in solution.reason for why in ("no velocity reduces", "of the twist is missed", "six joints"))
        assert told or solution.status != "limited"
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
    stuck = iq.solve_velocity(J, s, form=h, bounds=(np.zeros(4), np.zeros(4)))
    np.testing.assert_array_equal(stuck.velocity, np.zeros(4))
    assert stuck.active == (0, 1, 2, 3)
    assert stuck.status == "limited"
    assert "no velocity reduces the error" in stuck.reason


@pytest.mark.parametrize("m", [7, 8])
def test_a_posture_moves_the_null_space_alone(m):
    """The velocity nearest the posture (in M) among those that meet the twist."""
    rng = np.random.default_rng(m)
    for k in range(20):
        J, s, h = regular_problem(rng, m)
        A = rng.normal(size=(m, m))
        M = A @ A.T + 0.5 * np.eye(m) if k % 2 else np.eye(m)
        wanted = rng.normal(size=m)
        options = {"form": (None, h)[k % 2], "joint_metric": M if k % 2 else None, "damping": 0.0}
        solution = iq.solve_velocity(J, s, posture=wanted, **options)
        right = np.linalg.solve(M, J.T) @ np.linalg.inv(J @ np.linalg.solve(M, J.T))
        np.testing.assert_allclose(solution.velocity, wanted + right @ (s - J @ wanted), atol=1e-10)
        np.testing.assert_allclose(J @ solution.velocity, s, atol=1e-10)
        np.testing.assert_allclose(iq.solve_velocity(J, s, **options).velocity, right @ s, atol=1e-10)


def test_limits_affect_the_posture_before_the_task():
    rng = np.random.default_rng(2)
    for _ in range(30):
        J, s, _ = regular_problem(rng, 7)
        x = iq.solve_velocity(J, s).velocity
        wide = 3.0 * np.abs(x).max()
        lower, upper = np.full(7, -wide), np.full(7, wide)
        null = np.linalg.svd(J)[2][6]
        i = int(np.abs(null).argmax())
        upper[i], lower[i] = x[i] + 0.02, x[i] - 0.02
        solution = iq.solve_velocity(
            J, s, bounds=(lower, upper), posture=np.sign(null[i]) * null, point=np.zeros(3), length=1.0
        )
        assert i in solution.active
        # The limit takes d of joint i along H^-1 e_i, H = J'J + w n n': at most this much from the task.
        d, sigma = abs(null[i]) - 0.02, np.linalg.svd(J, compute_uv=False)
        assert np.linalg.norm(solution.residual) < d * NULL_WEIGHT * np.vdot(J, J) / (sigma[-1] * null[i] ** 2)


def test_a_zero_twist_and_a_zero_jacobian():
    rng = np.random.default_rng(5)
    J = rng.normal(size=(6, 5))
    solution = iq.solve_velocity(J, np.zeros(6), form=0.5)
    np.testing.assert_array_equal(solution.velocity, np.zeros(5))
    assert solution.status == "ok"
    nothing = iq.solve_velocity(np.zeros((6, 3)), np.ones(6))
    np.testing.assert_array_equal(nothing.velocity, np.zeros(3))
    assert nothing.status == "limited"  # a twist is asked for that no joint can do anything about


VALUES = [
    iq.PitchForm(0.3),
    iq.Complement(np.eye(6)[:, :2]),
    iq.CarriedMetric(np.ones(6)),
    iq.CarriedMetric(np.eye(6), np.eye(4)),
    iq.Guard(0.7),
    iq.ExactRows([[1.0, 2.0]], [0.5]),
    iq.Bounds([-1.0], [1.0]),
    iq.limits.LimitRows([[1.0, 2.0]], [-1.0], [1.0]),
    iq.limits.ToolSpeed(0.25, (0.0, 0.0, 1.0)),
    iq.velocity.TwistTask(np.eye(6), np.ones(6), form=0.3),
    iq.velocity.JointTask([1.0, 2.0]),
]


NAN = np.full(6, np.nan)
J6 = np.random.default_rng(0).normal(size=(6, 6))
ONE = np.ones(6)
BAD = {
    "J inf": lambda: iq.solve_velocity(J6 * np.inf, ONE),
    "form inf": lambda: iq.solve_velocity(J6, ONE, form=np.inf),
    "form word": lambda: iq.solve_velocity(J6, ONE, form="auto"),
    "form bool": lambda: iq.solve_velocity(J6, ONE, form=True),
    "damping negative": lambda: iq.solve_velocity(J6, ONE, damping=-1.0),
    "damping policy": lambda: iq.solve_velocity(J6, ONE, damping=iq.Guard(0.5)),
    "bounds type": lambda: iq.solve_velocity(J6, ONE, bounds=(-ONE, ONE, ONE)),
    "bounds crossed": lambda: iq.solve_velocity(J6, ONE, bounds=(ONE, -ONE)),
    "bounds length": lambda: iq.solve_velocity(J6, ONE, bounds=iq.Bounds([-1.0], [1.0])),
    "exact type": lambda: iq.solve_velocity(J6, ONE, exact=(J6, ONE)),
    "exact width": lambda: iq.solve_velocity(J6, ONE, exact=iq.ExactRows(np.eye(5), np.ones(5))),
    "exact A shape": lambda: iq.ExactRows(ONE, ONE),
    "exact A empty": lambda: iq.ExactRows(np.zeros((0, 6)), []),
    "exact b inf": lambda: iq.ExactRows(J6, ONE * np.inf),
    "exact b length": lambda: iq.ExactRows(J6, ONE[:2]),
    "exact of_twist": lambda: iq.ExactRows(J6, ONE, np.eye(5)),
    "exact with others": lambda: iq.ExactRows(J6, ONE).with_rows(iq.ExactRows(np.eye(5), np.ones(5))),
    "metric sign": lambda: iq.solve_velocity(J6, ONE, joint_metric=-ONE),
    "point": lambda: iq.solve_velocity(J6, ONE, point=NAN[:3]),
    "point word": lambda: iq.solve_velocity(J6, ONE, point="tool"),
    "length": lambda: iq.solve_velocity(J6, ONE, length=0.0),
    "guard": lambda: iq.solve_velocity(J6, ONE, guard=0.5),
    "guard fraction": lambda: iq.Guard(fraction=1.5),
    "carried word": lambda: iq.CarriedMetric(np.eye(6), "base"),
    "carried nowhere": lambda: iq.solve_velocity(J6, ONE, form=iq.CarriedMetric(np.eye(6))),
    "carried indefinite": lambda: iq.CarriedMetric(iq.pitch_form(0.3), np.eye(4)),
    "complement dependent": lambda: iq.Complement(np.ones((6, 2))),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(case):
    with pytest.raises(iq.BadInput, match=r"^\w+(\[\d\])?: found .*; expected .*\.") as caught:
        BAD[case]()
    assert caught.value.found
    assert caught.value.expected


def test_lists_are_accepted():
    listed = iq.solve_velocity(J6.tolist(), ONE.tolist(), form=0.3, bounds=([-1] * 6, [1] * 6))
    given = iq.solve_velocity(J6, ONE, form=iq.PitchForm(0.3), bounds=iq.Bounds(-ONE, ONE))
    assert listed == given


def test_a_twist_of_absurd_size_is_refused():
    """At the largest size there is, the limits are those of any large twist; above, no answer is given."""
    J, s, bounds = np.random.default_rng(5).normal(size=(6, 7)), np.arange(-2.0, 4.0) / 3.0, ([-1.0] * 7, [1.0] * 7)
    first, last = (iq.solve_velocity(J, size * s, bounds=bounds).velocity for size in (1e9, 1e12))
    np.testing.assert_allclose(first, last, atol=1e-8)
    for function in (iq.solve_velocity, iq.solve_velocities, iq.velocity.TwistTask):
        stack = J[None] if function is iq.solve_velocities else J
        with pytest.raises(iq.BadInput, match=r"found an entry of size 1e\+22; expected entries up to 1e\+12"):
            function(stack, 1e22 * s)


@pytest.mark.parametrize("size", [1e-200, 1e-40, 1e40, 1e200])
def test_joint_twists_and_lengths_that_overflow_are_refused(size):
    for function in (iq.solve_velocity, iq.solve_velocities, iq.velocity.TwistTask):
        stack = J6[None] if function is iq.solve_velocities else J6
        with pytest.raises(
            iq.BadInput, match=r"J: found a largest entry of .*; expected a largest entry from 1e-30 to"
        ):
            function(size * stack, ONE)
        assert function(0.0 * stack, ONE) is not None
        if size > 1.0:
            with pytest.raises(iq.BadInput, match=r"point: found an entry of size .*; expected entries up to 1e\+30"):
                function(stack, ONE, point=[size, 0.0, 0.0])
        if function is not iq.velocity.TwistTask:
            with pytest.raises(iq.BadInput, match=r"length: found .*; expected a length from 1e-30 to"):
                function(stack, ONE, length=size)


@pytest.mark.parametrize("size", [1e-320, 1e-200, 1e-100, 1e-30, 1e30, 1e100, 1e200, 1e300])
def test_a_tick_that_overflows_is_held_without_warning_or_exception(size):
    ones, bounds = np.ones(6), iq.Bounds(-ONE, ONE)
    options = (
        {"posture": size * ones},
        {"posture": size * ones, "bounds": bounds},
        {"exact": iq.ExactRows(np.eye(6)[:2], size * np.ones(2)), "bounds": bounds},
        {"exact": iq.ExactRows(size * np.eye(6)[:2], np.ones(2)), "bounds": bounds},
        {"rows": iq.limits.LimitRows(size * np.ones((1, 6)), [-0.1], [0.1]), "bounds": bounds},
        {"tool_speed": iq.limits.ToolSpeed(0.1, size * np.ones(3)), "bounds": bounds},
        {"joint_metric": size * ones, "bounds": bounds},
        {"damping": min(size, 1e30), "bounds": bounds},
    )
    held = 0
    for some in options:
        for solution in (
            iq.solve_velocity(J6, ONE, **some),
            iq.solve_velocities(J6[None], ONE, **some)[0]
            if not some.keys() & {"exact", "rows", "tool_speed"}
            else None,
            iq.velocity.solve_tasks([iq.velocity.TwistTask(J6, ONE)], **some) if "posture" not in some else None,
        ):
            if solution is None:
                continue
            assert np.isfinite(solution.velocity).all()
            assert "bounds" not in some or (np.abs(solution.velocity) <= 1.0).all()
            held += "too large or too small" in solution.reason
    assert held == 0 or not 1e-100 <= size <= 1e100
