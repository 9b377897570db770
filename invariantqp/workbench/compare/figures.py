"""What a run is judged by, and when one method dominates another.

Method A dominates B on a task if A raised no exception, violated no limit and did not stay motionless; none of five
figures (FLOORS) is more than 5 % worse, and at least one is 15 % better. Values below the floors count as these.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.workbench.compare.tasks import BedTask

Figures = dict[str, Any]
# The figures that are compared, and what is as good as nothing: mm, degrees, rad/s^2, rad/s^2, s.
FLOORS = {"mm": 0.01, "deg": 0.005, "acceleration": 1.0, "acceleration_rms": 0.1, "settling": 0.02}
WORSE, BETTER = 1.05, 1.15
# Settling that did not happen counts as this [s].
NOT_SETTLED = 10.0
# A tool is settled within these [mm], [deg].
SETTLED = 1.0, 1.0
# An arm whose joints move by less is motionless [deg].
MOTIONLESS = 0.1
# A limit is violated by more than this beyond a position limit [rad], and by more than these shares of a limit of
# velocities and of accelerations: solvers stop at less.
POSITION, VELOCITY, ACCELERATION = 1e-5, 1e-3, 1e-2


def poses_of(screws: Array, home: Array, positions: Array) -> Array:
    """(n, 4, 4) tool poses of joint positions (n, m), by the product of exponentials of hinges, slides and helices."""
    T = np.broadcast_to(np.eye(4), (len(positions), 4, 4))
    for screw, q in zip(screws.T, positions.T, strict=True):
        W, v, size = se3.cross_matrix(screw[:3]), screw[3:], float(np.linalg.norm(screw[:3]))
        step = np.tile(np.eye(4), (len(q), 1, 1))
        step[:, :3, 3] = q[:, None] * v
        if size:
            angle = (size * q)[:, None, None]
            a, b, c = np.sin(angle) / size, (1.0 - np.cos(angle)) / size**2, (angle - np.sin(angle)) / size**3
            step[:, :3, :3] += a * W + b * W.dot(W)
            step[:, :3, 3] += (b * W + c * W.dot(W)).dot(v)
        T = T @ step
    return np.asarray(T @ home)


def errors(task: BedTask, positions: Array) -> Array:
    """(n, 2) distances from the desired poses, [mm] at the point where accuracy counts and [deg]."""
    spec = task.judged
    poses, at = poses_of(spec.screws, spec.home, positions), np.append(spec.point, 1.0)
    mm = 1e3 * np.linalg.norm((poses - task.desired)[:, :3].dot(at), axis=1)
    R = np.swapaxes(poses[:, :3, :3], 1, 2) @ task.desired[:, :3, :3]
    sine = np.stack((R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]), axis=1)
    angle = np.arctan2(np.linalg.norm(sine, axis=1), np.trace(R, axis1=1, axis2=2) - 1.0)
    return np.column_stack((mm, np.degrees(angle)))


def violations(task: BedTask, positions: Array, velocities: Array, accelerations: Array) -> Array:
    """(n,) whether a tick violated a limit: further outside a position limit than ever, too fast, too sudden."""
    spec = task.spec
    outside = np.maximum(np.maximum(spec.lower - positions, positions - spec.upper), 0.0)
    least = np.minimum.accumulate(outside, axis=0)[:-1]
    found = (outside[1:] > least + POSITION) | (np.abs(velocities) > (1.0 + VELOCITY) * spec.velocity_limit)
    if spec.acceleration_limit is not None:
        found |= np.abs(accelerations) > (1.0 + ACCELERATION) * spec.acceleration_limit
    return np.asarray(found.any(axis=1))


def figures(task: BedTask, run: dict[str, Any]) -> Figures:
    """The figures of a run: what `worker.Run.end` returns of a task."""
    positions, velocities, times = (np.array(run[key]) for key in ("positions", "velocities", "times_us"))
    dt = task.spec.dt
    accelerations = np.diff(np.vstack((np.zeros(len(task.q0)), velocities)), axis=0) / dt
    e = errors(task, positions[:-1])
    violated = violations(task, positions, velocities, accelerations)
    violated[run["stopped"]] = False  # the arm was stopped, not the method's answer sent
    off = np.flatnonzero((e[task.settles_from :] > SETTLED).any(axis=1))
    settled = None if len(off) and off[-1] == len(e) - task.settles_from - 1 else dt * (off[-1] + 1 if len(off) else 0)
    (mm, deg), (mm_rms, deg_rms) = e.max(axis=0), np.sqrt((e**2).mean(axis=0))
    return {
        "mm": mm,
        "deg": deg,
        "mm_rms": mm_rms,
        "deg_rms": deg_rms,
        "acceleration": np.abs(accelerations).max(),
        "acceleration_rms": np.sqrt((accelerations**2).mean()),
        "settling": settled,
        "violations": int(violated.sum()),
        "exceptions": sum(run["exceptions"].values()),
        "why": next(iter(run["exceptions"]), ""),
        "joints_deg": np.degrees(np.abs(positions - positions[0]).max()),
        "us": np.median(times),
        "us_p99": np.percentile(times, 99.0),
    }


def dominates(one: Figures, other: Figures) -> bool:
    """Whether one run dominates another of the same task."""
    motionless = one["joints_deg"] < MOTIONLESS and (one["mm"] > SETTLED[0] or one["deg"] > SETTLED[1])
    if one["exceptions"] or one["violations"] or motionless:
        return False
    pairs = list(zip(compared(one), compared(other), strict=True))
    return all(a <= WORSE * b for a, b in pairs) and any(BETTER * a < b for a, b in pairs)


def compared(run: Figures) -> Sequence[float]:
    """The figures that are compared, none below its floor."""
    return [max(floor, NOT_SETTLED if run[key] is None else run[key]) for key, floor in FLOORS.items()]
