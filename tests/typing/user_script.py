"""What a user writes, read by a type checker: every line must be understood as what it is, none as Any or unknown.

Checked by basedpyright in strict mode (.ci/run); it never runs.
"""

from typing import assert_type

import numpy as np
from numpy.typing import NDArray

import invariantqp as iq
from invariantqp.pink import InvariantFrameTask

Vector = NDArray[np.float64]


def algebra(J: Vector, s: Vector) -> None:
    """The invariant algebra on plain arrays, or lists."""
    assert_type(iq.pitch_form(0.3), Vector)
    assert_type(iq.adjoint(np.eye(4)), Vector)
    assert_type(iq.pseudoinverse(J, 0.3), Vector)
    assert_type(iq.pseudoinverse([[1.0], [0.0], [0.0], [0.0], [0.0], [0.0]], 0.3), Vector)
    assert_type(iq.has_pseudoinverse(J, 0.3), bool)
    assert_type(iq.principal_pitches(J), Vector)
    kind = iq.gibson_hunt(J)
    assert_type(kind.admits_pseudoinverse, bool)
    try:
        iq.pseudoinverse(J, 0.0)
    except iq.NoPseudoinverse as refusal:
        assert_type(refusal.principal_pitches, Vector)
    solution = iq.solve_velocity(J, s, form=0.3, bounds=iq.Bounds([-1.0], [1.0]), damping=0.1)
    assert_type(solution, iq.velocity.VelocitySolution)
    assert_type(solution.velocity, Vector)
    assert_type(solution.status, iq.Status)
    assert_type(solution.method, str)
    assert_type(solution.reason, str)
    iq.solve_velocity(J, s, form=iq.PitchForm(0.3), exact=iq.ExactRows.point(J, [0.0, 0.0, 0.0], [0.0, 0.0, 0.1]))


def wall(q: Vector) -> iq.limits.LimitRows:
    """Rows that depend on where the arm is."""
    return iq.limits.LimitRows([[1.0, -1.0]], [-np.inf], [1.0 - q[0]])


class Table(iq.limits.Limit):
    """A limit of the user's."""

    name = "the table"

    def for_loop(self, loop: iq.limits.Loop) -> iq.limits.Limit:
        """It knows the tick."""
        self.dt: float = loop.dt
        return self

    def rows(self, q: Vector, velocity: Vector) -> iq.limits.LimitRows | None:
        """Nothing, while the joints rest."""
        return wall(q) if velocity.any() else None


class Descent:
    """A solver of the user's."""

    name = "descent"

    def solve(self, qp: iq.velocity.BoxQP) -> Vector:
        """Whatever it can do."""
        return np.asarray(np.clip(np.linalg.solve(qp.H, qp.c), qp.lower, qp.upper), dtype=np.float64)


def loop() -> None:
    """The controller with everything a user may hand it."""
    robot = iq.load_robot("panda", tool="panda_hand_tcp")
    assert_type(robot.names, tuple[str, ...])
    assert_type(robot.tool, str)
    assert_type([link.name for link in robot.links], list[str])
    assert_type(robot.with_limits(velocity_limit=1.0).with_tool(np.eye(4)), iq.robots.Chain)
    pen = [iq.limits.Capsule((0.0, 0.0, -0.1), (0.0, 0.0, 0.0), 0.01)]
    assert_type(robot.with_tool(np.eye(4), pen, name="pen", without=["hand"]), iq.robots.Chain)
    assert_type(iq.load_task("panda_path").load_robot(), iq.robots.Chain)
    assert_type(iq.robots.relative(robot, robot), iq.robots.Chain)
    controller = iq.Controller(
        robot,
        dt=0.001,
        form=iq.CarriedMetric([0.1, 0.1, 0.1, 1.0, 1.0, 1.0], "tool"),
        damping=1e-3,
        backend=Descent(),
        guard=iq.Guard(0.6),
        exact=[iq.control.ExactPoint(), iq.control.ExactAxis((0.0, 0.0, 1.0))],
        acceleration_limit=8.0,
        tool_speed=iq.limits.ToolSpeed(0.25),
        rows=wall,
        limits=[wall, Table(), iq.limits.JointLimits(velocity_limit=0.5), iq.limits.AccelerationLimit(9.0)],
    )
    q = np.zeros(7)
    solution = controller.step(q, robot.pose(q), feedforward=[0.0, 0.0, 0.0, 0.0, 0.1, 0.0])
    assert_type(solution.active, tuple[int, ...])
    assert_type(solution.reason, str)
    assert_type(solution.reasons, tuple[iq.velocity.Reason, ...])
    q = q + controller.dt * solution.velocity
    iq.Controller(
        iq.robots.Chain(np.eye(6), np.eye(4), names=["a", "b", "c", "d", "e", "f"]), dt=0.01, point="own", length=0.5
    )


def tasks() -> None:
    """Task files and traces."""
    task = iq.load_task("panda_path")
    assert_type(task, iq.tasks.Task)
    trace = iq.run_task(task, dt=0.002)
    assert_type(trace.q, Vector)
    summary = trace.summary()
    print(summary["passed"])
    iq.workbench.picture(trace, "path.png")


def inside_pink() -> None:
    """The adapter's own names."""
    task = InvariantFrameTask("tool0", 1.0, 0.5, gain=0.5, form=0.3, point=(0.0, 0.0, 0.1))
    assert_type(task.form, iq.forms.Form | iq.CarriedMetric | None)
