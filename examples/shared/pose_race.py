"""Inverse kinematics for a pose: `solve_pose` and other solvers on the same random targets, from the same starts.

    target = T(q),   q and the start uniformly distributed over the joint range
    success: errors of at most 1e-6 m and 1e-6 rad, inside the joint limits, within the time limit

Newton's method with the pseudoinverse and Pink have no restarts of their own: a loop around them restarts them where
`solve_pose` does. The Robotics Toolbox's ik_LM has its default settings except for the tolerance. It has its own
restarts (100 of 30 steps, random in the joint range), ignores limits on the way, and rejects a solution outside them;
a joint without limits has a range of one turn there.

Reference: Corke & Haviland, Robotics Toolbox for Python.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from invariantqp.errors import BadInput
from invariantqp.extras import is_installed
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.pose.ik import RESTARTS, solve_pose
from invariantqp.robots.kinematics import Robot, joint_ranges
from invariantqp.robots.load import load_robot
from invariantqp.workbench.analysis.survey import spread
from invariantqp.workbench.compare.arms import as_chain, joint_frames
from invariantqp.workbench.compare.libraries import Pink
from invariantqp.workbench.compare.tasks import spec_of
from invariantqp.workbench.runs.taskfile import LawSpec
from invariantqp.workbench.runs.trace import distance

# From a target (4, 4) and a start (m,) to joint positions (m,), which may not reach the target.
Solver = Callable[[Array, Array], Array]
# From a robot and a time limit [s] to a solver.
SolverFactory = Callable[[Robot, float], Solver]
# From joint positions (m,) to the next step (m,).
Step = Callable[[Array], Array]

ROBOTS = ("panda", "ur5", "xarm7", "kinova", "so101")
SOLVE_POSE = "invariantqp solve_pose"
# Largest error of a success [m, rad], and largest time [s], the period of a controller at 20 Hz.
TOLERANCE = 1e-6
TIME_LIMIT = 0.05
# ik_LM compares 1/2 e'e with its tolerance: this is an error |e| of TOLERANCE.
LM_TOLERANCE = 0.5 * TOLERANCE**2
# Most steps of a try of an iterated method, and steps that must halve its error.
STEPS, STALL_WINDOW = 100, 10
# Targets solved before times are measured, since the first use imports or compiles modules.
WARM_UP = 3


@dataclass(frozen=True)
class RaceOutcome:
    """Results of one solver for one robot.

    Attributes:
        robot: its name.
        solver: its name.
        success: share of the targets reached inside the joint limits and within the time limit.
        median_ms: median time for a target, reached or not [ms].
        p99_ms: 99th percentile of that time [ms].
        outside: number of solutions outside the joint limits.
    """

    robot: str
    solver: str
    success: float
    median_ms: float
    p99_ms: float
    outside: int


def solver_factories() -> dict[str, SolverFactory]:
    """The installed solvers by name; ours is the first."""
    found: dict[str, SolverFactory] = {SOLVE_POSE: _ours}
    if is_installed("roboticstoolbox"):
        found["roboticstoolbox ik_LM (C++)"] = _toolbox
    if is_installed("pink"):
        found["Pink, DAQP, iterated"] = _pink
    found["pinv Newton, clipped"] = _pinv
    return found


def race(
    count: int,
    robots: tuple[str, ...] = ROBOTS,
    at_limits: int = 0,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> list[RaceOutcome]:
    """Run every solver on the same targets of every robot.

    Args:
        count: number of targets for each robot.
        robots: names or URDF files.
        at_limits: number of joints of a target's q that are moved to one of their limits.
        seed: seed of targets and starts.
        progress: called with (targets done, targets in all).

    Raises:
        BadInput: count is less than one.
    """
    if count < 1:
        raise BadInput("count", str(count), "one target or more")
    outcomes = []
    field = solver_factories()
    done = 0
    for name in robots:
        robot = load_robot(name)
        problems = _problems(robot, count, at_limits, np.random.default_rng(seed))
        for solver, make in field.items():
            solve = make(robot, TIME_LIMIT)
            for target, start in problems[:WARM_UP]:
                solve(target, start)
            solutions, times = [], []
            for target, start in problems:
                before = perf_counter()
                solutions.append(solve(target, start))
                times.append(perf_counter() - before)
                done += 1
                if progress is not None:
                    progress(done, count * len(robots) * len(field))
            outcomes.append(_outcome(robot, name, solver, problems, solutions, np.array(times)))
    return outcomes


def _problems(robot: Robot, count: int, at_limits: int, rng: np.random.Generator) -> list[tuple[Array, Array]]:
    """Target poses (4, 4) and starts (m,)."""
    low, high = joint_ranges(robot)
    limited = np.flatnonzero(np.isfinite(robot.position_lower) & np.isfinite(robot.position_upper))
    problems = []
    for _ in range(count):
        q, start = low + rng.random((2, len(low))) * (high - low)
        for joint in rng.permutation(limited)[:at_limits]:
            q[joint] = (low if rng.random() < 0.5 else high)[joint]
        problems.append((robot.pose(q), start))
    return problems


def _outcome(
    robot: Robot, name: str, solver: str, problems: list[tuple[Array, Array]], solutions: list[Array], times: Array
) -> RaceOutcome:
    """The outcome by our own check of every solution, whatever the solver reports."""
    inside = np.array(
        [bool((robot.position_lower <= q).all() and (q <= robot.position_upper).all()) for q in solutions]
    )
    reached = np.array(
        [max(distance(robot.pose(q), target)) <= TOLERANCE for q, (target, _) in zip(solutions, problems, strict=True)]
    )
    return RaceOutcome(
        robot=name,
        solver=solver,
        success=float(np.mean(reached & inside & (times <= TIME_LIMIT))),
        median_ms=1e3 * float(np.median(times)),
        p99_ms=1e3 * float(np.quantile(times, 0.99)),
        outside=int(np.count_nonzero(~inside)),
    )


def _ours(robot: Robot, time_limit: float) -> Solver:
    return lambda target, start: solve_pose(robot, target, q0=start, tolerance=TOLERANCE, time_limit=time_limit).q


def ets_of(robot: Robot) -> Any:
    """The robot as the Robotics Toolbox's elementary transforms; a joint without limits gets one turn, or one unit.

        T(q) = A_1 Z(q_1) A_1^-1 A_2 Z(q_2) A_2^-1 ... T(0),    with z of A_i along joint i at q = 0

    Raises:
        RobotModelError: the robot has a helical joint.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # importing it gives SyntaxWarnings about its own source
        import roboticstoolbox as rtb
    chain, before = as_chain(robot), np.eye(4)
    pieces: list[Any] = []
    for (slides, frame), low, high in zip(joint_frames(chain), *joint_ranges(robot), strict=True):
        pieces.append(rtb.ET.SE3(se3.inverse(before).dot(frame)))
        pieces.append((rtb.ET.tz if slides else rtb.ET.Rz)(qlim=np.array([low, high])))
        before = frame
    return rtb.ETS([*pieces, rtb.ET.SE3(se3.inverse(before).dot(chain.home))])


def _toolbox(robot: Robot, _time_limit: float) -> Solver:
    ets = ets_of(robot)
    return lambda target, start: np.asarray(ets.ik_LM(target, q0=start, tol=LM_TOLERANCE).q)


def _pinv(robot: Robot, time_limit: float) -> Solver:
    def solve(target: Array, start: Array) -> Array:
        desired = robot.target(target)

        def step(q: Array) -> Array:
            state = robot.state(q, desired)
            return np.asarray(np.linalg.pinv(state.J).dot(state.error))

        return _iterated(robot, desired, start, step, time_limit)

    return solve


def _pink(robot: Robot, time_limit: float) -> Solver:
    # A step is its velocity for one second.
    loop = Pink(spec_of(robot, LawSpec.model_validate({"dt": 1.0, "gain": 1.0, "posture": False})))
    # Pink's defaults. The control loop's damping and limits would double the number of steps here.
    model = loop.configuration.model
    loop.task.lm_damping, loop.options["limits"] = 0.0, [model.configuration_limit, model.velocity_limit]
    still = np.zeros(len(robot.names))

    def solve(target: Array, start: Array) -> Array:
        desired = loop.target(target, None)
        return _iterated(robot, robot.target(target), start, lambda q: loop.step(q, desired, None, still), time_limit)

    return solve


def _iterated(robot: Robot, target: Any, start: Array, step: Step, time_limit: float) -> Array:
    """Take steps from the start, then from other states spread over the joint range; returns the last q in any case."""
    deadline, goal = perf_counter() + time_limit, robot.target(target).homogeneous
    q = start
    for begin in _starts(robot, start):
        q, past = begin, [np.inf] * STALL_WINDOW
        for _ in range(STEPS):
            errors = distance(robot.pose(q), goal)
            if max(errors) <= TOLERANCE or perf_counter() > deadline:
                return q
            past.append(sum(errors))
            if past[-1] > 0.5 * past[-1 - STALL_WINDOW]:
                break
            try:
                x = step(q)
            except Exception:  # noqa: BLE001 (an exception of another library ends this try)
                break
            q = np.minimum(np.maximum(q + x, robot.position_lower), robot.position_upper)
    return q


def _starts(robot: Robot, start: Array) -> Iterator[Array]:
    yield start
    yield from spread(robot, RESTARTS)
