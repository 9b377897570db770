"""How long a tick takes with the compiled core, in Python alone, and in a hand-written Pinocchio + DAQP loop.

    python tests/benchmarks/table.py

Medians and 99th percentiles in microseconds, and the ratio of medians to the hand-written loop. The three take turns at
every tick, so that a busy machine slows all of them down alike. A tick is pose, Jacobian, law and limits. The
hand-written loop is damped least squares in metres and radians inside the same joint limits, with rows for an exact
position; it has no posture, no status and no tool speed.
"""

from __future__ import annotations

from contextlib import contextmanager
from time import perf_counter_ns

import daqp
import numpy as np
import pinocchio as pin

import invariantqp as iq
from invariantqp.velocity import batch, solve

ROUNDS = 40
TICKS = 100
ROWS = 4096


class HandWritten:
    """One tick of damped least squares by DAQP, as a user would write it."""

    def __init__(self, robot, dt, gain, exact):
        self.model, self.dt, self.gain, self.exact = robot.model, dt, gain, exact
        self.data, self.frame = robot.model.createData(), robot.model.getFrameId(robot.tool)
        m = robot.model.nv
        self.damping, self.sense = 1e-6 * np.eye(m), np.zeros(m, dtype=np.int32)
        self.rows = np.zeros((0, m))
        if exact:
            self.sense = np.concatenate((self.sense, np.full(3, 5))).astype(np.int32)

    def step(self, q, target, ahead):
        model, data = self.model, self.data
        pin.forwardKinematics(model, data, q)
        pose = pin.updateFramePlacement(model, data, self.frame)
        J = pin.computeFrameJacobian(model, data, q, self.frame, pin.LOCAL)
        feedforward = pose.actInv(pin.Motion(ahead[3:], ahead[:3])).vector
        s = self.gain * pin.log6(pose.actInv(target)).vector + feedforward
        upper = np.minimum((model.upperPositionLimit - q) / self.dt, model.velocityLimit)
        lower = np.maximum((model.lowerPositionLimit - q) / self.dt, -model.velocityLimit)
        rows = self.rows
        if self.exact:
            rows, upper, lower = J[:3], np.concatenate((upper, s[:3])), np.concatenate((lower, s[:3]))
        return daqp.solve(J.T @ J + self.damping, -J.T @ s, rows, upper, lower, self.sense)[0]


@contextmanager
def python_alone(controller):
    """The same controller without the core."""
    loop, core = controller._compiled, solve.core
    controller._compiled = solve.core = None
    yield
    controller._compiled, solve.core = loop, core


def ticks_of(task, wanted, **options):
    """Up to TICKS ticks of the task's path that are as wanted, and a controller for them."""
    robot = task.load_robot()
    controller = iq.Controller(robot, dt=task.law.dt, **options)
    pose, dt, q, found = task.path.along(robot, task.start()), task.law.dt, task.start(), []
    for k in range(int(task.path.duration / dt)):
        target, ahead = pin.SE3(pose(k * dt)), iq.log(pose((k + 1) * dt) @ iq.inverse(pose(k * dt))) / dt
        solution = controller.step(q, target, ahead)
        if wanted(solution):
            found.append((q, target, ahead))
        q = q + dt * solution.velocity
    return controller, found[:: max(1, len(found) // TICKS)]


def times(controller, ticks, hand):
    """Microseconds of the three, (3, ROUNDS x ticks)."""
    took = [[], [], []]
    for _ in range(ROUNDS):
        for tick in ticks:
            took[0].append(timed(controller.step, tick))
            with python_alone(controller):
                took[1].append(timed(controller.step, tick))
            if hand is not None:
                took[2].append(timed(hand.step, tick))
    return took


def timed(call, arguments):
    start = perf_counter_ns()
    call(*arguments)
    return 1e-3 * (perf_counter_ns() - start)


def line(name, took):
    medians = [float(np.median(each)) if each else np.nan for each in took]
    tails = [float(np.quantile(each, 0.99)) if each else np.nan for each in took]
    cells = [
        f"{median:.1f} ({tail:.0f})" if median == median else "-" for median, tail in zip(medians, tails, strict=True)
    ]
    ratios = [f"{median / medians[2]:.2f}" if medians[2] == medians[2] else "-" for median in medians[:2]]
    print(f"| {name} | {' | '.join(cells)} | {' | '.join(ratios)} |")


def rows_a_second(width):
    """Rows of `solve_velocities` a second: the core, Python alone."""
    robot, rng = iq.load_robot("panda"), np.random.default_rng(0)
    J = np.array([robot.jacobian(q) for q in rng.uniform(robot.position_lower, robot.position_upper, (ROWS, 7))])
    s, bounds = 0.1 * rng.normal(size=(ROWS, 6)), iq.Bounds(-width * np.ones(7), width * np.ones(7))
    best = []
    for core in (batch.core, None):
        was, batch.core, solve.core = batch.core, core, core
        took = [
            timed(lambda: iq.solve_velocities(J, s, bounds=bounds, point=np.zeros(3), length=1.0), ()) for _ in range(5)
        ]
        batch.core = solve.core = was
        best.append(1e6 * ROWS / min(took))
    return best


def main():
    if not iq.native:
        raise SystemExit("this installation has no compiled core")
    print("| tick | compiled | Python | hand-written | compiled / hand-written | Python / hand-written |")
    print("|---|---|---|---|---|---|")
    cases = (
        ("Panda, free", "panda_path", lambda s: not s.active, {}),
        ("Panda, limits met", "panda_path", lambda s: s.active, {}),
        ("UR5, near a singularity", "ur5_wrist", lambda s: s.damping > 0.0, {}),
        ("SO-101, exact position", "so101_line", lambda s: not s.active, {"exact": "position"}),
        ("SO-101, exact position, limits met", "stability/limit_all_along", lambda s: s.active, {"exact": "position"}),
        ("Panda, exact position, limits met", "panda_path", lambda s: s.active, {"exact": "position"}),
        ("Panda, tool speed met", "panda_path", lambda s: s.method == "qp", {"tool_speed": 0.1}),
        ("Panda, acceleration limits", "panda_path", lambda _: True, {"acceleration_limit": 10.0}),
    )
    for name, task, wanted, options in cases:
        controller, ticks = ticks_of(iq.load_task(task), wanted, **options)
        robot, fast = controller.robot, "tool_speed" in options
        hand = None if fast else HandWritten(robot, controller.dt, controller.gain, "exact" in options)
        if ticks:
            line(name, times(controller, ticks, hand))
    for name, width in (("free", 10.0), ("tight box", 0.05)):
        core, python = rows_a_second(width)
        print(f"\nbatch of {ROWS} Panda rows, {name}: {core:,.0f} rows/s compiled, {python:,.0f} in Python", end="")
    print()


if __name__ == "__main__":
    main()
