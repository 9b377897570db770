"""Figures of the comparison, simulated again with nothing of this library but its robots and the targets.

Own loop, own logarithm, Pinocchio for the arm's own kinematics, DAQP called directly. To two digits.
"""

import json
from pathlib import Path

import daqp
import numpy as np
import pinocchio as pin
import pytest
from support.repeats import repeats

import invariantqp as iq
from invariantqp.workbench.compare.tasks import bed

RESULTS = json.loads((Path(__file__).parents[2] / "examples" / "comparison" / "results.json").read_text("utf-8"))
TWO_DIGITS = 0.02


def log(T):
    """(v; omega) with exp = T, by Rodrigues."""
    R, p = T[:3, :3], T[:3, 3]
    a = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    angle = np.arctan2(np.linalg.norm(a), 0.5 * (np.trace(R) - 1.0))
    w = a if angle < 1e-9 else a * angle / np.sin(angle)
    k = 1.0 / 12.0 if angle < 1e-4 else (1.0 - 0.5 * angle * np.sin(angle) / (1.0 - np.cos(angle))) / angle**2
    W = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    return np.r_[p - 0.5 * W @ p + k * W @ W @ p, w]


def least_squares_qp(J, s, lower, upper, pull):
    m = len(lower)
    H, f = J.T @ J + 1e-6 * np.eye(m), -J.T @ s - 1e-6 * pull
    return daqp.solve(H, f, np.zeros((0, m)), upper, lower, np.zeros(m, dtype=np.int32))[0]


def gradient_projection(J, s, lower, upper, pull):
    G = np.linalg.pinv(J)
    return G @ s + pull - G @ (J @ pull)


def damped(J, s, lower, upper, pull):
    G = J.T @ np.linalg.inv(J @ J.T + 0.2**2 * np.eye(6))
    return G @ s + pull - G @ (J @ pull)


def largest_error(arm, kind, solve):
    """The largest position error of a run [mm]."""
    (task,) = bed([arm], [kind], RESULTS["seed"])
    robot, dt, gain = iq.load_robot(arm), task.spec.dt, task.spec.gain
    model, data, frame = robot.model, robot.model.createData(), robot.model.getFrameId(robot.tool)
    low, high, speed = robot.position_lower, robot.position_upper, robot.velocity_limit
    q, worst, m = task.q0, 0.0, len(task.q0)
    for k, target in enumerate(task.targets):
        pin.forwardKinematics(model, data, q)
        T = pin.updateFramePlacement(model, data, frame).homogeneous
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL)
        worst = max(worst, 1e3 * float(np.linalg.norm(T[:3, 3] - target[:3, 3])))
        following = task.targets[min(k + 1, len(task.targets) - 1)]
        ahead = log(np.linalg.inv(T) @ following @ np.linalg.inv(target) @ T) / dt
        s = gain * log(np.linalg.inv(T) @ target) + ahead
        lower = np.clip((low - q) / dt, -speed, speed)
        upper = np.clip((high - q) / dt, -speed, speed)
        pull = 0.5 * (np.maximum(low, -np.pi) + np.minimum(high, np.pi)) - q if m > 6 else np.zeros(m)
        q = q + dt * np.clip(solve(J, s, lower, upper, pull), lower, upper)
    return worst


CASES = [
    ("so101", "limits", "QP", least_squares_qp),
    ("ur5e", "limits", "Moore-Penrose", gradient_projection),
    ("panda", "free", "DLS", damped),
]


@pytest.mark.parametrize(("arm", "kind", "method", "solve"), CASES[: repeats(3, 1)])
def test_an_independent_simulation_finds_the_same(arm, kind, method, solve):
    (told,) = [
        run["figures"]["mm"] for run in RESULTS["runs"] if (run["task"], run["method"]) == (f"{arm}/{kind}", method)
    ]
    assert largest_error(arm, kind, solve) == pytest.approx(told, rel=TWO_DIGITS)
