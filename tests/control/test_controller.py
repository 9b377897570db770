import warnings

import numpy as np
import pinocchio as pin
import pytest
from support.arms import ready
from support.loops import drive

import invariantqp as iq

PANDA = iq.load_robot("panda")
READY = ready("panda")
DT = 0.002


def controller(robot=PANDA, **options):
    return iq.Controller(robot, dt=DT, **options)


def target(error=(0.02, -0.01, 0.03, 0.02, 0.01, -0.03)):
    return iq.exp(error) @ PANDA.pose(READY)


def test_one_tick_removes_its_share_of_the_error():
    for share in (0.1, 1.0):
        small = iq.exp(1e-4 * np.ones(6)) @ PANDA.pose(READY)
        loop = controller(gain=share / DT, posture=False)
        q = READY + DT * loop.step(READY, small).velocity
        left, whole = np.linalg.norm(PANDA.state(q, PANDA.target(small)).error), np.linalg.norm(1e-4 * np.ones(6))
        assert left == pytest.approx((1.0 - share) * whole, abs=0.02 * whole)  # a loop sets off softly


class AsMatrix:
    """A pose as mink, jaxlie and SciPy have it."""

    def as_matrix(self):
        return target()


@pytest.mark.parametrize("kind", ["array", "columns", "list", "SE3", "as_matrix", "checked"])
def test_targets_of_every_kind(kind):
    wanted = {
        "array": target(),
        "columns": np.asfortranarray(target()),
        "list": target().tolist(),
        "SE3": pin.SE3(target()),
        "as_matrix": AsMatrix(),
        "checked": PANDA.target(target()),
    }[kind]
    expected = controller().step(READY, target()).velocity
    np.testing.assert_allclose(controller().step(READY.tolist(), wanted).velocity, expected, atol=1e-12)


BAD = {
    "negative dt": (lambda: iq.Controller(PANDA, dt=-0.001), "dt"),
    "zero dt": (lambda: iq.Controller(PANDA, dt=0.0), "dt"),
    "gain": (lambda: controller(gain=1.01 / DT), "gain"),  # 1/dt is the most
    "negative gain": (lambda: controller(gain=-1.0), "gain"),
    "exact": (lambda: controller(exact="orientation"), "exact"),
    "posture": (lambda: controller(posture=-1.0), "posture"),
    "damping": (lambda: controller(damping=-1.0), "damping"),
    "guard": (lambda: controller(guard="yes"), "guard"),
    "backend": (lambda: controller(backend=7), "backend"),
    "acceleration": (lambda: controller(acceleration_limit=0.0), "acceleration_limit"),
    "tool speed": (lambda: controller(tool_speed=0.0), "tool_speed"),
    "margin": (lambda: controller(position_margin=-0.1), "position_margin"),
    "infinite margin": (lambda: controller(position_margin=np.inf), "position_margin"),
    "margin that leaves no range": (lambda: controller(position_margin=10.0), "position_margin"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_arguments_of_a_controller_are_refused_by_name(case):
    call, argument = BAD[case]
    with pytest.raises(iq.BadInput, match=r": found .*; expected ") as caught:
        call()
    assert caught.value.argument == argument
    assert (case == "gain") == ("at most 1/dt. More overshoots." in str(caught.value))


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_outside_its_limits_it_comes_back_at_the_velocity_limit_and_slower_at_the_end(joint, side):
    q = READY.copy()
    limit = PANDA.position_upper[joint] if side > 0.0 else PANDA.position_lower[joint]
    q[joint] = limit + side * 0.1
    loop = controller()
    previous, ticks, rate = None, 0, loop.box.rate
    while side * (q[joint] - limit) > 1e-6:
        solution = loop.step(q, PANDA.pose(READY))
        assert solution.status != "held"
        assert (np.abs(solution.velocity) <= PANDA.velocity_limit).all()
        left = side * (q[joint] - limit)
        expected = -side * min(PANDA.velocity_limit[joint], rate * left)
        # one way back: at the limit while far, at the rate or deeper at the end
        assert side * solution.velocity[joint] <= side * expected + 1e-9
        if rate * left > PANDA.velocity_limit[joint]:
            assert solution.velocity[joint] == pytest.approx(expected)
        if previous is not None:
            assert side * (q[joint] - previous) <= 0.0
        previous = q[joint]
        q = q + DT * solution.velocity
        ticks += 1
    fastest = PANDA.velocity_limit[joint]
    slow = min(fastest / rate, 0.1)  # of the way
    assert ticks <= ((0.1 - slow) / fastest + np.log(slow / 1e-6) / rate) / DT + 2


def test_posture_keeps_seven_joints_in_the_middle_and_can_be_switched_off():
    goal, twist = PANDA.pose(READY), np.array([0.0, 0.2, 0.1, 0.1, 0.0, -0.05])
    middle = 0.5 * (PANDA.position_lower + PANDA.position_upper)
    without = controller(posture=False)
    for options, where in (
        ({}, middle),
        ({"posture_gain": 2.0}, middle),
        ({"posture": READY + 0.3 * np.eye(7)[2]}, READY + 0.3 * np.eye(7)[2]),
    ):
        loop = controller(**options)
        np.testing.assert_allclose(loop.step(READY, goal).velocity, 0.0, atol=1e-12)  # told to stay, it stays
        loop = controller(**options)
        for _ in range(12):  # it sets in softly
            pull = loop.step(READY, goal, twist).velocity - without.step(READY, goal, twist).velocity
        assert np.linalg.norm(pull) > 1e-3
        np.testing.assert_allclose(PANDA.jacobian(READY) @ pull, 0.0, atol=1e-10)
        assert pull @ (where - READY) > 0.0
    assert iq.Controller(iq.load_robot("ur5"), dt=DT).posture_gain == 0.0
    with pytest.raises(iq.BadInput, match=r"posture: found 2.0; expected .*posture_gain"):
        controller(posture=2.0)


def test_a_metric_that_follows_the_tool():
    W = np.diag([0.1, 0.1, 0.1, 1.0, 1.0, 1.0])
    so101 = iq.load_robot("so101")
    q = np.array([0.1, -0.4, 0.5, 0.6, 0.2])
    goal = iq.exp([0.05, 0.1, -0.1, 0.01, 0.02, -0.01]) @ so101.pose(q)
    follows = iq.Controller(so101, dt=DT, form=iq.CarriedMetric(W)).step(q, goal).velocity
    placed = iq.Controller(so101, dt=DT, form=iq.CarriedMetric(W, so101.pose(q))).step(q, goal).velocity
    np.testing.assert_allclose(follows, placed, atol=1e-12)


def test_the_default_is_the_metric_of_the_arms_reach_at_the_tool():
    so101 = iq.load_robot("so101")
    q = np.array([0.1, -0.4, 0.5, 0.6, 0.2])
    goal = iq.exp([0.05, 0.1, -0.1, 0.01, 0.02, -0.01]) @ so101.pose(q)
    plain = iq.Controller(so101, dt=DT).step(q, goal)
    told = iq.Controller(so101, dt=DT, form=iq.tool_metric(so101)).step(q, goal)
    np.testing.assert_allclose(plain.velocity, told.velocity, atol=1e-10)
    assert np.linalg.norm(plain.residual) > 0.1  # five joints: something is missed, and where is the metric's choice
    elsewhere = iq.Controller(so101, dt=DT, point=(0.0, 0.0, 0.3)).step(q, goal)
    assert np.abs(elsewhere.velocity - plain.velocity).max() > 0.05


def test_a_gantry_is_as_fast_in_millimetres():
    """It cannot turn its tool, and the error that stays damps the loop."""
    speeds = []
    for unit in (1.0, 1000.0):
        slides = np.column_stack([iq.se3.prismatic(axis) for axis in np.eye(3)])
        robot = iq.robots.Chain(slides, np.eye(4), (), [-2.0 * unit] * 3, [2.0 * unit] * 3, [unit] * 3)
        goal = iq.exp([0.5, 0.0, 0.0, 0.1 * unit, 0.02 * unit, 0.0])
        loop = iq.Controller(robot, dt=0.01, gain=5.0, length=unit)
        speeds.append(loop.step(np.zeros(3), goal).velocity / unit)
    np.testing.assert_allclose(*speeds, rtol=1e-12, atol=1e-15)


def test_what_a_loop_is_made_of_does_not_change():
    """The compiled core would go on with the old numbers."""
    loop = controller()
    for name, value in (("gain", 1.0), ("tool_speed", iq.limits.ToolSpeed(0.1)), ("form", 0.1)):
        with pytest.raises(AttributeError, match=f"{name} of a controller does not change"):
            setattr(loop, name, value)


def test_a_slide_counts_by_the_reach_in_any_unit_of_length():
    """Two slides beside two hinges: metres or millimetres, the joints go the same way."""
    Z, X = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
    goal = iq.exp([0.0, 0.0, 0.2, 0.1, -0.2, 0.0]) @ iq.transform(translation=(0.7, 0.0, 0.0))
    went = []
    for unit in (1.0, 1000.0):
        screws = [iq.revolute(Z), iq.se3.prismatic(X), iq.revolute(Z, (0.4 * unit, 0, 0)), iq.se3.prismatic((0, 1, 0))]
        target = goal.copy()
        target[:3, 3] *= unit
        chain = iq.robots.Chain(np.column_stack(screws), iq.transform(translation=(0.7 * unit, 0.0, 0.0)))
        x = iq.Controller(chain, dt=DT).step(np.zeros(4), target).velocity
        went.append(x / np.array([1.0, unit, 1.0, unit]))
    np.testing.assert_allclose(went[1], went[0], rtol=1e-9)


def test_an_arm_that_no_pitch_form_sees_needs_none():
    planar = iq.load_task("planar_3r").load_robot()
    q = np.array([0.3, 0.8, 0.4])
    goal = iq.exp([0.0, 0.0, 0.02, 0.01, -0.01, 0.0]) @ planar.pose(q)
    solution = iq.Controller(planar, dt=DT).step(q, goal)
    assert (solution.method, solution.status, solution.reason) == ("closed-form", "ok", "")
    assert np.linalg.norm(solution.residual) < 5e-3  # a loop sets off softly
    loop = iq.Controller(planar, dt=DT, form=0.3, guard=False)
    before = loop.state
    with pytest.raises(iq.NoPseudoinverse, match=r"no 0\.3-pseudoinverse"):
        loop.step(q, goal)
    assert loop.state == before


@pytest.mark.parametrize("side", [-0.3, 0.3])
@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_a_rail_goes_where_the_target_is_and_takes_the_share_that_it_costs(name, side):
    """Never the other way by the default posture; little of the way if it costs much, nearly all if it costs little."""
    robot, rng = iq.load_robot(name, base=iq.robots.rail([0.0, 1.0, 0.0], -2.0, 2.0, 0.5)), np.random.default_rng(0)
    m, shares = len(robot.names), []
    for _ in range(4):
        start = np.append(0.0, ready(name) + rng.uniform(-0.4, 0.4, m - 1))
        target = iq.transform(translation=[0.0, side, 0.0]) @ robot.pose(start)
        went = {}
        for cost, posture in ((None, True), (100.0, True), (0.001, False)):
            metric = None if cost is None else [cost] + [1.0] * (m - 1)
            q = drive(iq.Controller(robot, dt=0.01, joint_metric=metric, posture=posture), start, target, 400).q
            np.testing.assert_allclose(robot.pose(q[-1]), target, atol=1e-4)
            assert (q[:, 0] / side).min() > -0.01 / abs(side)
            went[cost] = q[-1, 0] / side
        assert went[100.0] < went[None]
        assert 0.9 < went[0.001] < 1.0
        shares.append(went[100.0])
    assert np.median(shares) < 0.2  # more next to singularities, where the arm cannot


# Gains, ticks and delays: what they are bounded by, and what they may be meant as.

ARM = iq.robots.Chain(iq.revolute([0, 0, 1], [0, 0, 0])[:, None], iq.transform(translation=[1.0, 0.0, 0.0]))


@pytest.mark.parametrize(("gain", "dt"), [(0.5, 0.002), (1.0, 0.02), (0.1, 0.01)])
def test_a_gain_that_may_be_a_share_of_the_error_warns_once(gain, dt):
    with pytest.warns(UserWarning, match=f"gain={gain:g} is {gain:g} 1/s here") as told:
        loop = iq.Controller(ARM, dt=dt, gain=gain)
    assert [one.filename for one in told] == [__file__]
    said = str(told[0].message)
    assert f"closes {100 * gain * dt:.2g} % of the error" in said
    assert f"gain={gain / dt:g} here" in said
    assert loop.gain == gain
    with warnings.catch_warnings(record=True) as later:
        loop.step([0.0], iq.transform(translation=[1.0, 0.1, 0.0]))
    assert later == []


@pytest.mark.parametrize(
    ("gain", "dt"), [(500.0, 0.002), (1.01, 0.002), (1.0, 0.021), (0.5, 0.1), (None, 0.002), (None, 0.2)]
)
def test_no_other_gain_warns(gain, dt):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        iq.Controller(ARM, dt=dt, gain=gain)


@pytest.mark.parametrize(("times", "said"), [({"dt": 2.0}, "2 ms are dt=0.002, a rate of 2 Hz is dt=0.5"),
                                              ({"dt": 0.002, "delay": 8.0}, "8 ms are delay=0.008")])  # fmt: skip
def test_milliseconds_and_rates_instead_of_seconds_warn(times, said):
    with pytest.warns(UserWarning, match=said) as told:
        iq.Controller(ARM, **times)
    assert [one.filename for one in told] == [__file__]


@pytest.mark.parametrize("number", [np.longdouble(0.01), np.array(0.01), np.float32(0.01), np.array(0.01, np.float16)])
def test_numbers_of_every_kind_are_numbers(number):
    loop = iq.Controller(ARM, dt=0.01, gain=np.longdouble(5.0), delay=number, position_margin=number)
    assert loop.gain == 5.0
    assert np.isfinite(loop.step([0.0], iq.transform(translation=[1.0, 0.1, 0.0])).velocity).all()
