import sys

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.compare.cell import Cell
from invariantqp.compare.laws.mink_law import MinkLaw
from invariantqp.compare.laws.peers import joints_of
from invariantqp.compare.laws.pink_law import PinkLaw
from invariantqp.compare.laws.roboticstoolbox_law import RoboticsToolboxLaw
from invariantqp.compare.measure import closed_loop
from invariantqp.compare.measure.closed_loop import failures, tick_times, tracking, without_speed_limits
from invariantqp.compare.measure.frames import random_displacement
from invariantqp.compare.measure.rewrite import rewrite, scale_lengths
from invariantqp.compare.registry import methods
from invariantqp.compare.sweep import kinds
from invariantqp.errors import MissingExtra, RobotModelError
from invariantqp.geometry.screws import helical
from invariantqp.runs.run import run_task
from invariantqp.runs.taskfile import LawSpec, load_task
from invariantqp.velocity.solution import VelocitySolution

SYSTEMS = [name for name, method in methods().items() if method.family == "system"]
LAWS = {"pink": PinkLaw, "mink": MinkLaw, "roboticstoolbox": RoboticsToolboxLaw}


def asked(velocity):
    return VelocitySolution(velocity, "", "ok", "", (), np.full(6, np.nan), 1.0, 0.0, 0.0, "")


@pytest.fixture
def law(monkeypatch):
    """Puts a law of the test's own in the place of every method."""

    def use(step):
        class Law:
            def __init__(self, robot, spec):
                self.robot, self.tick = robot, 0

            def step(self, q, target, feedforward=None):
                self.tick += 1
                return asked(step(self, q))

        monkeypatch.setattr(closed_loop, "controller_named", lambda _: Law)

    return use


def test_mink_on_mujocos_kinematics_answers_as_pink_on_pinocchios():
    task = load_task("panda_path")
    robot = task.load_robot()
    pink, mink = PinkLaw(robot, task.law), MinkLaw(robot, task.law)
    rng = np.random.default_rng(0)
    for _ in range(5):
        q = task.start() + 0.2 * rng.standard_normal(7)
        target = robot.target(iq.exp(3e-3 * rng.standard_normal(6)) @ robot.pose(q))
        ahead = 0.2 * rng.standard_normal(6)
        np.testing.assert_allclose(
            mink.step(q, target, ahead).velocity, pink.step(q, target, ahead).velocity, atol=1e-6
        )


def test_a_toolbox_step_is_newtons_where_the_arm_is_regular():
    task = load_task("ur5_wrist")
    robot = task.load_robot()
    law = RoboticsToolboxLaw(robot, LawSpec(dt=0.01, gain=1.0), "LM")
    q = np.array([0.1, -1.2, 1.6, -0.6, -0.9, 0.3])
    twist = np.array([0.02, -0.01, 0.03, 0.04, 0.02, -0.03])
    target = robot.target(iq.exp(twist) @ robot.pose(q))
    newton = np.linalg.solve(robot.jacobian(q), twist)
    np.testing.assert_allclose(law.step(q, target).velocity, newton, atol=2e-4)


@pytest.mark.parametrize("name", [name for name in SYSTEMS if "posture" not in name])
def test_feedforward_is_the_velocity_of_the_path_where_the_error_is_none(name):
    robot = iq.load_robot("ur5")
    q = np.array([0.1, -1.2, 1.6, -0.6, -0.9, 0.3])
    twist = np.array([0.02, -0.01, 0.03, 0.04, 0.02, -0.03])
    law = methods()[name].system(robot, LawSpec(dt=0.01))
    x = law.step(q, robot.target(robot.pose(q)), twist).velocity
    np.testing.assert_allclose(x, np.linalg.solve(robot.jacobian(q), twist), rtol=0.02, atol=2e-4)


@pytest.mark.parametrize("name", SYSTEMS)
def test_every_system_follows_a_short_task(name):
    task = load_task("ur5_wrist")
    trace = run_task(task, controller=methods()[name].system, dt=0.02)
    assert trace.limit_violation < 1e-9
    assert trace.position_error[-1] < 1e-3


@pytest.mark.parametrize("module", LAWS)
def test_a_system_that_is_not_installed_says_which_extra_brings_it(monkeypatch, module):
    monkeypatch.setitem(sys.modules, module, None)
    robot = iq.load_robot("ur5")
    with pytest.raises(MissingExtra, match=r"invariantqp\[peers\]"):
        LAWS[module](robot, LawSpec())


def test_helical_joints_are_refused():
    chain = iq.load_robot(np.column_stack([helical([0, 0, 1], pitch=0.1), helical([1, 0, 0])]), np.eye(4))
    with pytest.raises(RobotModelError, match="joint1 is helical"):
        joints_of(chain)


@pytest.mark.parametrize("name", ["panda_path", "scara"])
def test_a_rewritten_arm_moves_as_before(name):
    task = load_task(name)
    robot, q, Y = task.load_robot(), task.start() + 0.05, random_displacement(1)
    written = rewrite(robot, base=Y, unit=1000.0, speed_limits=False)
    np.testing.assert_allclose(written.pose(q), Y @ scale_lengths(robot.pose(q), 1000.0), atol=1e-9)
    J = robot.jacobian(q)
    J[3:] *= 1000.0
    np.testing.assert_allclose(written.jacobian(q), iq.adjoint(Y) @ J, atol=1e-8)
    assert np.isinf(written.velocity_limit).all()
    assert type(written) is type(robot)
    assert np.isfinite(rewrite(robot).velocity_limit).all()


def test_a_run_tells_errors_speed_and_chatter_as_its_trace_has_them():
    cell = Cell("closed_loop", "ur5_wrist", ("DLS",), quick=True)
    found = tracking(cell)["DLS"]
    task = load_task("ur5_wrist")
    trace = run_task(task, controller=closed_loop.controller_named("DLS"), dt=closed_loop.COARSER * task.law.dt)
    assert found["position_mm"]["p99"] == pytest.approx(1e3 * np.percentile(trace.position_error, 99))
    assert found["peak"] == pytest.approx(np.max(np.abs(trace.velocity) / trace.velocity_limit))
    steps = [np.abs(b - a).sum() for a, b in zip(trace.velocity[:-1], trace.velocity[1:], strict=True)]
    assert found["variation"] == pytest.approx(sum(steps))
    assert found["failed_ticks"] == 0.0


def test_every_way_to_fail_a_tick_is_counted(law):
    def third(self, q):
        if self.tick % 4 == 1:
            raise ValueError
        if self.tick % 4 == 2:
            return np.full(len(q), np.nan)
        return np.where(self.tick % 4 == 3, 1.5, 0.5) * self.robot.velocity_limit * (-1.0) ** (self.tick // 4)

    law(third)
    found = failures(Cell("hard", "stability/jump", ("any",)))["any"]
    assert found["raised"] == found["not_finite"] == 0.25
    assert found["outside"] >= 0.25
    assert found["failed_ticks"] == pytest.approx(found["raised"] + found["not_finite"] + found["outside"])


def test_a_law_that_drives_on_past_its_position_limits_is_outside(law):
    law(lambda self, q: self.robot.velocity_limit)
    found = failures(Cell("hard", "stability/jump", ("any",)))["any"]
    assert 0.2 < found["outside"] < 0.9
    assert found["raised"] == found["not_finite"] == 0.0


def test_without_speed_limits_no_law_is_told_of_them(law):
    law(lambda self, q: np.where(np.isinf(self.robot.velocity_limit), 7.0, 0.0))
    limit = iq.load_robot("ur5").velocity_limit
    found = without_speed_limits(Cell("singular", "stability/ur5_wrist", ("any",)))["any"]
    assert found["peak"] == pytest.approx((7.0 / limit).max())
    assert found["variation"] == 0.0


def test_ticks_are_timed_side_by_side_and_what_cannot_be_had_says_why():
    found = tick_times(Cell("tick", "arm_3r", ("DLS", "Pink", "mink"), quick=True))
    assert "URDF" in found["Pink"]["failed"]
    for name in ("DLS", "mink"):
        assert 0.0 < found[name]["median_us"] <= found[name]["p99_us"]


def test_the_sweep_has_every_kind():
    table = kinds()
    assert {"closed_loop", "singular", "hard", "tick", "dependence", "trajectory", "failure_map"} <= set(table)
    assert [name for name in table if table[name].alone] == ["time", "tick", "growth"]
