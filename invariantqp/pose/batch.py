"""Many poses of one arm: each by itself, on as many processes as wanted, or along a path, each from the one before."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.pose.ik import PoseSearch, PoseSolution
from invariantqp.progress import Progress
from invariantqp.robots.kinematics import Robot

# Targets handed to a worker process at a time.
CHUNK = 50


def solve_poses(
    robot: Robot,
    targets: Sequence[Any],
    *,
    q0: ArrayLike | None = None,
    along: bool = False,
    jobs: int = 1,
    progress: Progress | None = None,
    **options: Any,
) -> list[PoseSolution]:
    """`solve_pose` for many targets.

    Args:
        robot: the arm.
        targets: tool poses, as `solve_pose` takes them.
        q0: (m,) where to begin, or (n, m), one for each target; None is the middle of the joint range.
        along: whether the targets are a path, each begun where the one before ended.
        jobs: processes; -1 is one a core.
        progress: called with (targets done, targets in all).
        options: of `solve_pose`: form, exact, tolerance, time_limit, restarts, seed.

    Returns:
        One PoseSolution a target, in order; for targets by themselves what `solve_pose` answers.

    Raises:
        BadInput: as `solve_pose`, and before anything is solved; a path on several processes.
    """
    wanted = [arrays.pose(target, f"targets[{i}]") for i, target in enumerate(targets)]
    starts = _starts(q0, len(wanted), len(robot.names), along=along)
    if along and jobs != 1:
        raise BadInput("jobs", f"{jobs} for a path", "1", "Each pose of a path begins where the one before ended.")
    search = PoseSearch(robot, **options)
    if jobs == 1:
        solutions: list[PoseSolution] = []
        for target, start in zip(wanted, starts, strict=True):
            begin = solutions[-1].q if along and solutions else start
            solutions.append(search.solve(target, begin))
            if progress is not None:
                progress(len(solutions), len(wanted))
        return solutions
    if jobs == 0:
        raise BadInput("jobs", "0", "a number of processes, or -1 for all cores")
    from joblib import Parallel, delayed

    pieces = [slice(i, i + CHUNK) for i in range(0, len(wanted), CHUNK)]
    work = (delayed(_piece)(search, wanted[piece], starts[piece]) for piece in pieces)
    solutions = []
    for part in Parallel(n_jobs=jobs, return_as="generator")(work):
        solutions.extend(part)
        if progress is not None:
            progress(len(solutions), len(wanted))
    return solutions


def _piece(search: PoseSearch, targets: list[Array], starts: list[Array | None]) -> list[PoseSolution]:
    """Some of the targets, in a process of their own."""
    return [search.solve(target, start) for target, start in zip(targets, starts, strict=True)]


def _starts(q0: ArrayLike | None, n: int, m: int, *, along: bool) -> list[Array | None]:
    """The start of each target."""
    if q0 is None:
        return [None] * n
    if np.ndim(q0) == 2 and not along:
        return list(arrays.matrix(q0, (n, m), "q0"))
    return [arrays.vector(q0, m, "q0")] * n
