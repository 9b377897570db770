"""Figures of the comparison, simulated again with nothing of this library but its robots and the path asked for.

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


def least_squares_qp(J, s, lower, upper, pull, rows):
    m = len(lower)
    C, e = rows
    sense = np.r_[np.zeros(m), np.full(len(e), 5)].astype(np.int32)
    H, f = J.T @ J + 1e-6 * np.eye(m), -J.T @ s - 1e-6 * pull
    return daqp.solve(H, f, C, np.r_[upper, e], np.r_[lower, e], sense)[0]


def gradient_projection(J, s, lower, upper, pull, _):
    G = np.linalg.pinv(J)
    return G @ s + pull - G @ (J @ pull)


def damped(J, s, lower, upper, pull, _):
    G = J.T @ np.linalg.inv(J @ J.T + 0.05**2 * np.eye(6))
    return G @ s + pull - G @ (J @ pull)


def largest_error(name, solve):
    """The largest position error of a run [mm]."""
    task = iq.load_task(name)
    robot, dt = task.load_robot(), task.law.dt * (10.0 if RESULTS["quick"] else 1.0)
    model, data, frame = robot.model, robot.model.createData(), robot.model.getFrameId(robot.tool)
    low, high, speed = robot.position_lower, robot.position_upper, robot.velocity_limit
    q, wanted, worst = task.start(), task.path.along(robot, task.start()), 0.0
    ticks, m = round(task.path.duration / dt), len(q)
    poses = [wanted(k * dt) for k in range(ticks + 1)]
    for k in range(ticks):
        pin.forwardKinematics(model, data, q)
        T = pin.updateFramePlacement(model, data, frame).homogeneous
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL)
        gap = np.linalg.inv(T) @ poses[k]
        ahead = log(np.linalg.inv(T) @ poses[k + 1] @ np.linalg.inv(poses[k]) @ T)
        s = 0.1 / dt * log(gap) + ahead / dt
        rows = (np.zeros((0, m)), np.zeros(0))
        if task.law.exact == "position":
            there = gap[:3, 3]
            rows = J[:3], 0.1 / dt * there + (ahead[:3] + np.cross(ahead[3:], there)) / dt
        lower, upper = np.maximum((low - q) / dt, -speed), np.minimum((high - q) / dt, speed)
        pull = 0.5 * (low + high) - q if m > 6 else np.zeros(m)
        q = q + dt * np.clip(solve(J, s, lower, upper, pull, rows), lower, upper)
        pin.forwardKinematics(model, data, q)
        reached = pin.updateFramePlacement(model, data, frame).translation
        worst = max(worst, 1e3 * float(np.linalg.norm(reached - poses[k + 1][:3, 3])))
    return worst


CASES = [
    ("compare/so101_limits", "hand-written loop", least_squares_qp),
    ("compare/ur5_limits", "Moore-Penrose", gradient_projection),
    ("compare/panda", "DLS", damped),
]


@pytest.mark.parametrize(("task", "method", "solve"), CASES[: repeats(3, 1)])
def test_an_independent_simulation_finds_the_same(task, method, solve):
    (told,) = [
        cell["result"]["position_mm"]
        for cell in RESULTS["cells"]
        if (cell["kind"], cell["task"], cell["method"]) == ("loop", task, method)
    ]
    assert largest_error(task, solve) == pytest.approx(told, rel=TWO_DIGITS)
