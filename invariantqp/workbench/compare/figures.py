"""The figures of a run: errors, accelerations, settling time, violations; and when one method dominates another.

Method A dominates B on a task if A raised no exception, violated no limit and did not stay motionless; none of five
figures (FLOORS) is more than 5 % worse, and at least one is 15 % better. Values below the floors count as these.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.workbench.compare.arms import chain_of
from invariantqp.workbench.compare.tasks import OTHER_FRAME, OTHER_UNIT, BedTask

Figures = dict[str, Any]
# The compared figures with the values below which two runs are equal: mm, degrees, rad/s^2, rad/s^2, s.
FLOORS = {"mm": 0.01, "deg": 0.005, "acceleration": 1.0, "acceleration_rms": 0.1, "settling": 0.02}
WORSE, BETTER = 1.05, 1.15
# The largest change of a joint position [rad] where the same motion is told otherwise, by kind of task. Such tasks do
# not count for dominance: they are the kind "limits" again.
CHANGES = {OTHER_FRAME: "frame_rad", OTHER_UNIT: "unit_rad"}
# The settling time of a run that does not settle [s].
NOT_SETTLED = 10.0
# A tool is settled within these [mm], [deg].
SETTLED = 1.0, 1.0
# An arm whose joints move by less is motionless [deg].
MOTIONLESS = 0.1
# Tolerances of limits, above those of solvers: beyond a position limit [rad], over velocity and acceleration limits.
POSITION_TOLERANCE, VELOCITY_TOLERANCE, ACCELERATION_TOLERANCE = 1e-5, 1e-3, 1e-2


def errors(task: BedTask, positions: Array) -> Array:
    """(n, 2) position errors at the point where accuracy counts [mm] and orientation errors [deg]."""
    spec = task.judged
    robot, at = chain_of(spec), np.append(spec.point, 1.0)
    poses = np.array([robot.pose(q) for q in positions])
    mm = 1e3 * np.linalg.norm((poses - task.desired)[:, :3].dot(at), axis=1)
    R = np.swapaxes(poses[:, :3, :3], 1, 2) @ task.desired[:, :3, :3]
    sine = np.stack((R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]), axis=1)
    angle = np.arctan2(np.linalg.norm(sine, axis=1), np.trace(R, axis1=1, axis2=2) - 1.0)
    return np.column_stack((mm, np.degrees(angle)))


def violations(task: BedTask, positions: Array, velocities: Array, accelerations: Array) -> Array:
    """(n,) whether a tick violated a limit of velocity, of acceleration, or of position by more than ever before."""
    spec = task.spec
    outside = np.maximum(np.maximum(spec.lower - positions, positions - spec.upper), 0.0)
    least = np.minimum.accumulate(outside, axis=0)[:-1]
    violated = (outside[1:] > least + POSITION_TOLERANCE) | (
        np.abs(velocities) > (1.0 + VELOCITY_TOLERANCE) * spec.velocity_limit
    )
    if spec.acceleration_limit is not None:
        violated |= np.abs(accelerations) > (1.0 + ACCELERATION_TOLERANCE) * spec.acceleration_limit
    return np.asarray(violated.any(axis=1))


def figures(task: BedTask, run: dict[str, Any]) -> Figures:
    """The figures of a run, from the result of `worker.Run.end`."""
    positions, velocities, times = (np.array(run[key]) for key in ("positions", "velocities", "times_us"))
    dt = task.spec.dt
    accelerations = np.diff(np.vstack((np.zeros(len(task.q0)), velocities)), axis=0) / dt
    e = errors(task, positions[:-1])
    violated = violations(task, positions, velocities, accelerations)
    violated[run["stopped"]] = False  # the arm was stopped, not the method's answer sent
    off = np.append(-1, np.flatnonzero((e[task.settles_from :] > SETTLED).any(axis=1)))
    settled = None if off[-1] == len(e) - task.settles_from - 1 else dt * (off[-1] + 1)
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
    if has_failed(one):
        return False
    pairs = list(zip(compared(one), compared(other), strict=True))
    return all(a <= WORSE * b for a, b in pairs) and any(BETTER * a < b for a, b in pairs)


def has_failed(run: Figures) -> bool:
    """Whether a method raised an exception, violated a limit or stood still off its target."""
    return bool(run["exceptions"] or run["violations"] or is_motionless(run))


def is_motionless(run: Figures) -> bool:
    """Whether the arm stood still off its target."""
    return bool(run["joints_deg"] < MOTIONLESS and (run["mm"] > SETTLED[0] or run["deg"] > SETTLED[1]))


def compared(run: Figures) -> Sequence[float]:
    """The compared figures, none below its floor."""
    return [max(floor, NOT_SETTLED if run[key] is None else run[key]) for key, floor in FLOORS.items()]
