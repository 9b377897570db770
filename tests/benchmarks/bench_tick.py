"""How long one tick takes, side by side in one run: ours, a hand-written Pinocchio + DAQP loop, and Pink with DAQP.

Run with `pytest tests/benchmarks/bench_tick.py --benchmark-enable -n 0`; a plain `pytest` does not collect it, and
nothing is asserted about time. Each tick is pose, Jacobian, law and limits for the Panda on the states of
tasks/compare/panda_limits.toml.
"""

import daqp
import numpy as np
import pink
import pinocchio as pin
import pytest

import invariantqp as iq

TASK = iq.load_task("compare/panda_limits")
DT = TASK.law.dt
GAIN = 0.1 / DT


@pytest.fixture(scope="module")
def states():
    """Joint positions, targets and feedforward along the path, limits active in some of them."""
    robot = TASK.load_robot()
    trace = iq.run_task(TASK)
    pose = TASK.path.along(robot, TASK.start())
    picked = range(0, len(trace.velocity), 7)
    targets = [pin.SE3(pose(t)) for t in trace.time]
    ahead = [iq.log(pose(t + DT) @ iq.inverse(pose(t))) / DT for t in trace.time[picked]]
    return robot, [(trace.q[k], targets[k], s) for k, s in zip(picked, ahead, strict=True)]


def over(states, step):
    """One call a state, in turn, so that the median is the path's median tick."""
    position = 0

    def one():
        nonlocal position
        position = (position + 1) % len(states)
        return step(*states[position])

    return one


@pytest.mark.benchmark(group="tick", warmup=True, min_rounds=20000)
def test_invariantqp(benchmark, states):
    robot, picked = states
    controller = iq.Controller(robot, dt=DT)
    benchmark(over(picked, controller.step))


@pytest.mark.benchmark(group="tick", warmup=True, min_rounds=20000)
def test_handwritten_pin_daqp_dls(benchmark, states):
    robot, picked = states
    model = robot.model
    data = model.createData()
    frame = model.getFrameId("panda_hand_tcp")
    low, high, v_max = model.lowerPositionLimit, model.upperPositionLimit, model.velocityLimit
    damping = 1e-6 * np.eye(7)
    nothing = np.zeros((0, 7))
    sense = np.zeros(7, dtype=np.int32)

    def step(q, target, ahead):
        pin.forwardKinematics(model, data, q)
        pose = pin.updateFramePlacement(model, data, frame)
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL)
        feedforward = pose.actInv(pin.Motion(ahead[3:], ahead[:3])).vector
        s = GAIN * pin.log6(pose.actInv(target)).vector + feedforward
        upper = np.minimum((high - q) / DT, v_max)
        lower = np.maximum((low - q) / DT, -v_max)
        return daqp.solve(J.T @ J + damping, -J.T @ s, nothing, upper, lower, sense)[0]

    benchmark(over(picked, step))


@pytest.mark.benchmark(group="tick", warmup=True, min_rounds=5000)
def test_pink_solve_ik_daqp(benchmark, states):
    robot, picked = states
    configuration = pink.Configuration(robot.model, robot.model.createData(), picked[0][0])
    task = pink.FrameTask("panda_hand_tcp", position_cost=1.0, orientation_cost=1.0, gain=GAIN * DT)

    def step(q, target, ahead):
        configuration.update(q)
        task.set_target(target)
        return pink.solve_ik(configuration, [task], DT, solver="daqp", damping=1e-6, safety_break=False)

    benchmark(over(picked, step))
