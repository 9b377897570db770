"""Late, not off: a path whose timing the arm cannot keep, driven by the path follower and by the laws without it.

    python examples/15_elastic_paths.py               200 tasks, about three minutes on two cores
    python examples/15_elastic_paths.py --tasks 10    a first look

A task is a path of the tool that ten kinds of arms can reach: the poses of a spline through four random joint
positions. Its timing asks for 1.2 to 3 times the velocity limits. The follower drives it as fast as velocity and
acceleration limits allow; the two others follow the timing with the same gain, posture and velocity limits, and without
acceleration limits. Told are

    mm, deg      largest distance from the path: to the nearest of its poses
    time         over that of TOPP-RA, which times the joint path that the follower drove, with both limits; in less
                 time than that no arm stays on the path

Then come bends (corners that a joint cannot take at any speed) and blocked paths, before whose end the follower is to
stop: past a position limit to a pose for which `solve_pose` finds no joint positions in a hundred tries, or two metres
straight on, beyond the sum of the arm's lengths.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed, parallel_config
from rich.console import Console
from rich.table import Table
from scipy.interpolate import CubicSpline
from shared.ten_arms import ARMS, arm, limits

import invariantqp as iq
from invariantqp.workbench.compare.by_hand import ByHand, qp
from invariantqp.workbench.compare.tasks import spec_of
from invariantqp.workbench.runs.taskfile import LawSpec

DT = 0.001
# Joints reach their full speed in this time [s].
RISE = 0.2
# The bars of the path follower: what nobody sees on paper.
MM, DEG = 0.05, 0.01
SEED = 15
# Poses of a path among which the nearest is looked for first.
PLACES = 400
# A past-limit path is drawn so often at most until no other posture reaches its end.
DRAWS = 20
# A run that takes longer than this has stalled [s].
REQUEST_TIMEOUT = 60.0


class Task(NamedTuple):
    """An arm, the joint motion on [0, 1] whose poses are the path, and how long its timing gives for it [s]."""

    robot: Any
    joints: Callable[[float], np.ndarray]
    duration: float

    def pose(self, u: float) -> np.ndarray:
        """The tool's pose at a place."""
        return self.robot.pose(self.joints(u))


class Run(NamedTuple):
    """What happened: joint positions (n + 1, m) and velocities (n, m), places (n + 1,) and the last status."""

    q: np.ndarray
    velocity: np.ndarray
    places: np.ndarray
    status: str


def speeds(robot: Any) -> np.ndarray:
    """Velocity limits, 2 rad/s where there is none."""
    return np.where(np.isfinite(robot.velocity_limit), robot.velocity_limit, 2.0)


def waypoints(robot: Any, rng: np.random.Generator, count: int) -> np.ndarray:
    """Joint positions, each at most 0.7 rad from the one before."""
    low, high = limits(robot)
    mid, half = 0.5 * (low + high), 0.5 * (high - low)
    q = [mid + half * rng.uniform(-0.6, 0.6, len(mid))]
    for _ in range(count - 1):
        q.append(np.clip(mid + half * rng.uniform(-0.6, 0.6, len(mid)), q[-1] - 0.7, q[-1] + 0.7))
    return np.array(q)


def random_task(number: int) -> Task:
    """The task of a number: the next arm each time."""
    rng = np.random.default_rng([SEED, number])
    robot = arm(ARMS[number % len(ARMS)])
    joints = CubicSpline(np.linspace(0.0, 1.0, 4), waypoints(robot, rng, 4))
    # Timed by (1 - cos) / 2, whose rate is pi / 2 of its mean in the middle and falls to both sides.
    u = np.linspace(0.0, np.pi, 500)
    needed = np.abs(joints(0.5 - 0.5 * np.cos(u), 1)) * (0.5 * np.pi * np.sin(u))[:, None] / speeds(robot)
    return Task(robot, joints, float(needed.max()) / rng.uniform(1.2, 3.0))


def bend_task(number: int) -> Task:
    """A path with two corners: straight lines between joint positions."""
    rng = np.random.default_rng([SEED, 1, number])
    robot = arm(ARMS[number % len(ARMS)])
    q = waypoints(robot, rng, 4)
    return Task(robot, lambda u: np.array([np.interp(3.0 * u, range(4), c) for c in q.T]), 1.0)


def blocked_task(number: int) -> tuple[Task, Callable[[float], np.ndarray]]:
    """A task that starts as the arm can and ends where it cannot in any posture, and its poses."""
    rng = np.random.default_rng([SEED, 2, number])
    robot = arm(ARMS[number % len(ARMS)])
    low, high = limits(robot)  # more than six joints may find another way round their limits, fewer stray from any line
    past_limit = len(low) < 6 or (len(low) == 6 and number // len(ARMS) % 2 == 0)
    for _ in range(DRAWS if past_limit else 0):
        q = waypoints(robot, rng, 2)
        bounded = np.flatnonzero(np.isfinite(robot.position_lower) & np.isfinite(robot.position_upper))
        i, up = int(rng.choice(bounded)), bool(rng.random() < 0.5)
        q[0, i], q[1, i] = (high[i] - 0.3, high[i] + 0.4) if up else (low[i] + 0.3, low[i] - 0.4)
        if not iq.solve_pose(robot, robot.pose(q[1]), time_limit=np.inf).success:
            task = Task(robot, lambda u, q=q: q[0] + u * (q[1] - q[0]), 1.0)
            return task, task.pose
    q = waypoints(robot, rng, 1)
    start = robot.pose(q[0])
    way = start[:3, 3] / np.linalg.norm(start[:3, 3])  # straight away from the base, out of reach

    def pose(u: float) -> np.ndarray:
        return iq.transform(start[:3, :3], start[:3, 3] + 2.0 * u * way)

    return Task(robot, lambda _: q[0], 1.0), pose


def controller(task: Task) -> Any:
    """The loop with velocity and acceleration limits."""
    return iq.Controller(task.robot, dt=DT, acceleration_limit=speeds(task.robot) / RISE)


def follow(task: Task, pose: Callable[[float], np.ndarray]) -> Run:
    """The path follower, on an ideal arm."""
    follower = iq.PathFollower(controller(task), pose)
    q = task.joints(0.0).copy()
    follower.prepare(q)
    steps, velocities, places = [q], [], [0.0]
    status = ""
    while status not in ("done", "blocked") and len(steps) * DT < REQUEST_TIMEOUT:
        answer = follower.step(q)
        q = q + DT * answer.velocity
        steps.append(q)
        velocities.append(answer.velocity)
        places.append(answer.place)
        status = answer.status
    return Run(np.array(steps), np.array(velocities), np.array(places), status)


def keep_time(task: Task, step: Callable[..., np.ndarray]) -> Run:
    """A law without the follower: in every tick it is given the target pose and its twist.

    `step` returns joint velocities, of joint positions, the target, its twist, and the velocities of the tick before.
    """
    n = max(round(task.duration / DT), 10)
    places = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, n + 1))
    poses = [task.pose(u) for u in places]
    q = task.joints(0.0).copy()
    steps, velocities = [q], [np.zeros(len(q))]
    for now, then in pairwise(poses):
        velocities.append(step(q, now, iq.log(then @ np.linalg.inv(now)) / DT, velocities[-1]))
        q = q + DT * velocities[-1]
        steps.append(q)
    return Run(np.array(steps), np.array(velocities[1:]), places, "")


def off_path(task: Task, run: Run, pose: Callable[[float], np.ndarray], each: int = 1) -> np.ndarray:
    """(2,) the largest distance from the path [mm, deg]: from the nearest pose, in the measure of the arm.

    Every tick of the follower, which tells where it is; of the others, which do not, one in `each`.
    """
    length = iq.Controller(task.robot, dt=DT).measure.length
    grid = np.linspace(0.0, 1.0, PLACES + 1)
    poses = np.array([pose(u) for u in grid])

    def error(T: np.ndarray, u: float) -> np.ndarray:
        W = pose(u)
        return np.append(length * turn(T[:3, :3] @ W[:3, :3].T), T[:3, 3] - W[:3, 3])

    largest = np.zeros(2)
    for q, told in zip(run.q[::each], run.places[::each], strict=True):
        T, near = task.robot.pose(q), float(told)
        if each > 1:
            turned = np.linalg.norm(poses[:, :3, :3] - T[:3, :3], axis=(1, 2)) / np.sqrt(2.0)
            near = float(grid[np.argmin(np.hypot(length * turned, np.linalg.norm(poses[:, :3, 3] - T[:3, 3], axis=1)))])
        best = error(T, near)
        a, b = max(near - 1e-6, 0.0), min(near + 1e-6, 1.0)
        along = (error(T, b) - error(T, a)) / (b - a)
        if along.any():  # Gauss and Newton's step along the path
            there = error(T, float(np.clip(near - along @ best / (along @ along), 0.0, 1.0)))
            best = min(best, there, key=np.linalg.norm)
        largest = np.maximum(largest, (1e3 * np.linalg.norm(best[3:]), np.degrees(np.linalg.norm(best[:3]) / length)))
    return largest


def turn(R: np.ndarray) -> np.ndarray:
    """(3,) the rotation vector of a matrix, of less than half a turn."""
    w = 0.5 * np.array((R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]))
    sine = float(np.linalg.norm(w))
    return w if sine < 1e-12 else w * (np.arctan2(sine, 0.5 * (np.trace(R) - 1.0)) / sine)


def optimal_time(run: Run, task: Task) -> float:
    """How long TOPP-RA takes for the joint path of a run, with the same limits [s]."""
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

    toppra.setup_logging("ERROR")
    kept = np.append(np.arange(0, len(run.q) - 1, 8), len(run.q) - 1)
    places, first = np.unique(run.places[kept], return_index=True)
    way = toppra.SplineInterpolator(places, run.q[kept][first])
    v = speeds(task.robot)
    limits = [JointVelocityConstraint(np.c_[-v, v]), JointAccelerationConstraint(np.c_[-v, v] / RISE)]
    found = TOPPRA(limits, way, gridpoints=np.linspace(places[0], places[-1], 801)).compute_trajectory()
    return float("nan") if found is None else float(found.duration)


def measured(number: int) -> np.ndarray:
    """(9,) one task: mm and deg of the follower, the law and the QP; their times over TOPP-RA's; 1 where it arrived."""
    task = random_task(number)
    ours = follow(task, task.pose)
    loop = iq.Controller(task.robot, dt=DT)
    law = keep_time(task, lambda q, target, twist, _: loop.step(q, target, twist).velocity)
    rival = ByHand(spec_of(task.robot, LawSpec(dt=DT)), partial(qp, length=True, by_error=True))
    other = keep_time(task, lambda q, target, *more: rival.step(q, rival.target(target, None), *more))
    errors = [off_path(task, ours, task.pose), *(off_path(task, r, task.pose, 5) for r in (law, other))]
    times = np.array([len(ours.velocity), len(law.velocity)]) * DT / optimal_time(ours, task)
    return np.array([*np.ravel(errors), *times, ours.status == "done"])


def bent(number: int) -> np.ndarray:
    """(3,) one path with corners: mm, deg, 1 where it arrived."""
    task = bend_task(number)
    run = follow(task, task.pose)
    return np.array([*off_path(task, run, task.pose), run.status == "done"])


def stopped(number: int) -> np.ndarray:
    """(5,) one blocked path: mm, deg, 1 where the arm stopped, 1 where it says that it arrived, excess of limits."""
    task, pose = blocked_task(number)
    run = follow(task, pose)
    low, high = task.robot.position_lower, task.robot.position_upper
    jumps = np.abs(np.diff(run.velocity, axis=0, prepend=0.0 * run.velocity[:1])) / DT
    excess = max(
        float(e.max())
        for e in (
            low - run.q,
            run.q - high,
            np.abs(run.velocity) - speeds(task.robot),
            jumps - speeds(task.robot) / RISE,
        )
    )
    at_rest = np.abs(run.velocity[-1]).max() < 1e-2
    return np.array([*off_path(task, run, pose), run.status == "blocked" and at_rest, run.status == "done", excess])


def main() -> None:
    """Run the study and print its tables."""
    parser = argparse.ArgumentParser(description="Paths whose timing the arm cannot keep.")
    parser.add_argument("--tasks", type=int, default=200, help="number of random tasks")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    given = parser.parse_args()
    quarter = max(given.tasks // 4, 1)
    with parallel_config(backend="loky", inner_max_num_threads=1):
        run = Parallel(n_jobs=given.jobs)
        tasks = np.array(run(delayed(measured)(n) for n in range(given.tasks)))
        bends = np.array(run(delayed(bent)(n) for n in range(quarter)))
        stops = np.array(run(delayed(stopped)(n) for n in range(quarter)))
    console = Console(width=100)
    table = Table("", "mm off, median", "largest", "deg off, median", "largest", "time, median", "largest", box=None)
    for i, name in enumerate(("path follower", "the law without it", "a least-squares QP")):
        mm, deg, time = tasks[:, 2 * i], tasks[:, 2 * i + 1], tasks[:, 6 + min(i, 1)]
        told = [f"{f(x):.2g}" for x in (mm, deg) for f in (np.median, np.max)]
        table.add_row(name, *told, f"{np.nanmedian(time):.3f}", f"{np.nanmax(time):.3f}")
    table.add_row("bends", *(f"{f(bends[:, k]):.2g}" for k in (0, 1) for f in (np.median, np.max)))
    table.add_row("blocked", *(f"{f(stops[:, k]):.2g}" for k in (0, 1) for f in (np.median, np.max)))
    console.print(table)
    time, kept = tasks[:, 6], (tasks[:, 0] < MM) & (tasks[:, 1] < DEG) & (tasks[:, 8] == 1.0)
    console.print(
        f"\nwithin {MM} mm and {DEG} deg to the end: {kept.sum()} of {len(tasks)} tasks; "
        f"time over TOPP-RA's: median {np.nanmedian(time):.3f}, largest {np.nanmax(time):.3f}\n"
        f"bends within them: {int(((bends[:, 0] < MM) & (bends[:, 1] < DEG) & (bends[:, 2] == 1.0)).sum())} of "
        f"{len(bends)}; of {len(stops)} paths that end past a position limit or out of reach: stopped before "
        f"that {int(stops[:, 2].sum())}, told to have arrived {int(stops[:, 3].sum())}; excess over limits "
        f"at most {stops[:, 4].max():.1g}"
    )
    worst = np.flatnonzero(~kept).tolist()
    if worst:
        console.print(f"not within them: tasks {worst}")


if __name__ == "__main__":
    main()
