"""Joint positions for many poses: each on its own, in several processes, or along a path, each from the one before."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.pose.ik import PoseSearch, PoseSolution
from invariantqp.progress import PROGRESS, Progress
from invariantqp.robots.kinematics import Robot

# Targets handed to a worker process at a time.
CHUNK = 50
# More processes than any machine has cores.
MOST_JOBS = 10_000


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
        One PoseSolution a target, in order; without `along`, what `solve_pose` returns for each.

    Raises:
        BadInput: as `solve_pose`, and before anything is solved; a path on several processes.
    """
    search = PoseSearch(robot, **options)
    if progress is not None:
        arrays.function(progress, "progress", PROGRESS)
    listed = arrays.listed(targets, "targets", "a list of poses")
    wanted = [arrays.pose(target, f"targets[{i}]") for i, target in enumerate(listed)]
    path = arrays.flag(along, "along")
    starts = _starts(q0, len(wanted), len(robot.names), along=path)
    processes = _processes(jobs, along=path)
    parts = (
        _in_turn(search, wanted, starts, along=path) if processes == 1 else _parallel(search, wanted, starts, processes)
    )
    solutions: list[PoseSolution] = []
    for part in parts:
        solutions.extend(part)
        if progress is not None:
            progress(len(solutions), len(wanted))
    return solutions


def _processes(jobs: int, *, along: bool) -> int:
    """The number of processes, -1 for one a core."""
    processes = -1 if type(jobs) is int and jobs == -1 else arrays.count(jobs, "jobs", MOST_JOBS)
    if processes == 0:
        raise BadInput("jobs", "0", "a number of processes, or -1 for all cores")
    if along and processes != 1:
        raise BadInput("jobs", f"{jobs} for a path", "1", "Each pose of a path begins where the one before ended.")
    return processes


def _in_turn(
    search: PoseSearch, targets: list[Array], starts: list[Array | None], *, along: bool
) -> Iterator[list[PoseSolution]]:
    """One solution at a time; along a path each begins where the one before ended."""
    before: Array | None = None
    for target, start in zip(targets, starts, strict=True):
        solution = search.solve(target, start if before is None else before)
        before = solution.q if along else None
        yield [solution]


def _parallel(
    search: PoseSearch, targets: list[Array], starts: list[Array | None], processes: int
) -> Iterator[list[PoseSolution]]:
    """The solutions of one chunk of targets after the other."""
    from joblib import Parallel, delayed

    pieces = [slice(i, i + CHUNK) for i in range(0, len(targets), CHUNK)]
    work = (delayed(_piece)(search, targets[piece], starts[piece]) for piece in pieces)
    yield from Parallel(n_jobs=processes, return_as="generator")(work)


def _piece(search: PoseSearch, targets: list[Array], starts: list[Array | None]) -> list[PoseSolution]:
    """Some of the targets, in a worker process."""
    return [search.solve(target, start) for target, start in zip(targets, starts, strict=True)]


def _starts(q0: ArrayLike | None, n: int, m: int, *, along: bool) -> list[Array | None]:
    """The start of each target."""
    if q0 is None:
        return [None] * n
    begin = arrays.array(q0, "q0", f"{m} joint positions, or as many for each target")
    if begin.ndim == 2 and not along:
        return list(arrays.matrix(begin, (n, m), "q0"))
    return [arrays.vector(begin, m, "q0")] * n
