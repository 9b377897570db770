"""Why the defaults are what they are: each is varied by itself over random tasks on ten arms, and its costs told.

    python examples/14_defaults.py              300 tasks, under ten minutes on two cores
    python examples/14_defaults.py --tasks 20   a first look

A task is a path of joint positions that the tool follows: free, through a singularity, too fast for a joint, or past a
position limit; the last two are half of them. A run is judged by its largest position and orientation error after its
first fifth. Each table tells, for each choice of one default,

    mm, deg     how many times the error of the best choice of the same task, in the geometric mean
    variation   likewise for the total variation of the joint velocities: what chatter costs
    dominated   share of the tasks in which another choice is better by 5 % in both errors
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed, parallel_config
from rich.console import Console
from rich.table import Table
from scipy.optimize import minimize
from shared.ten_arms import ARMS, arm, limits

import invariantqp as iq
from invariantqp.velocity import stages

DT = 0.01
# Kinds of tasks: as many of each.
KINDS = ("free", "singular", "too fast", "past a limit")
# Errors below a micrometre and a thousandth of a degree, and variations below 0.1 rad/s, are the same to anybody.
FLOOR = np.array([1e-3, 1e-3, 0.1])
# A choice is better than another where both of its errors are this much smaller.
BETTER = 1.05
# The share of a run that does not count: it starts anywhere in the null space, and on the path.
START = 0.2
# Gains are compared with noise of the encoders [rad], and with so many ticks between a command and its effect.
NOISE, LATE = 1e-4, (1, 4)
SEED = 14


class Task(NamedTuple):
    """An arm, where it starts (m,), the n + 1 poses that the tool follows, and the n twists between them."""

    robot: Any
    start: np.ndarray
    poses: list[np.ndarray]
    twists: list[np.ndarray]


class InPython(iq.velocity.Adaptive):
    """The default damping as a policy of one's own, which the compiled core does not have: Python's CALM counts."""


class Choice(NamedTuple):
    """One value of a default: its name and how a run differs from all defaults."""

    name: str
    options: Callable[[Any], dict[str, Any]] = lambda _: {}
    calm: float | None = None
    late: int = 0


def reach(robot: Any) -> float:
    """L as the controller takes it."""
    return float(iq.Controller(robot, dt=DT).measure.length)


def own_length(robot: Any) -> float:
    """|J_v| / |J_omega| at the point that the joints move least."""
    low, high = limits(robot)
    return float(iq.systems.centre(robot.jacobian(0.5 * (low + high))).length)


def fixed(**options: Any) -> Callable[[Any], dict[str, Any]]:
    """The same options for every arm."""
    return lambda _: options


def calmed(calm: float) -> Choice:
    """Another CALM."""
    return Choice(f"{calm:g}", fixed(damping=InPython()), calm=calm)


def adaptive(threshold: float, ceiling: float) -> Choice:
    """A damping."""
    return Choice(f"{threshold:g}, {ceiling:g}", fixed(damping=iq.velocity.Adaptive(threshold, ceiling)))


def pitched(robot: Any) -> dict[str, Any]:
    """A pitch form."""
    return {"form": reach(robot)}


def guarded(name: str, *, guard: Any) -> Choice:
    """A guard of the pitch form."""
    return Choice(name, lambda r: {"guard": guard, **pitched(r)})


def gains(late: int) -> tuple[tuple[Choice, ...], Callable[[int], bool]]:
    """Gains on an arm that moves a few ticks late."""
    others = (Choice(f"{k:g}", fixed(gain=k / DT), late=late) for k in (0.05, 0.2, 0.4))
    return (Choice("0.1", late=late), *others), lambda _: True


DEFAULT = Choice("")
# Each default: what it is, its choices (the default first), and for which arms it says anything.
STUDY: dict[str, tuple[tuple[Choice, ...], Callable[[int], bool]]] = {
    "form: what is attempted beyond the joints": (
        (
            DEFAULT._replace(name="none: least squares at the point"),
            Choice("pitch, the reach", pitched),
            Choice("pitch, four own lengths", lambda r: {"form": 4.0 * own_length(r)}),
            Choice("metric of a 1 kg tool", fixed(form=iq.CarriedMetric(np.repeat((0.0025, 1.0), 3)))),
            Choice("[DS]'s problem, convexified", lambda r: {"form": iq.PitchForm(reach(r), convexified=True)}),
        ),
        lambda _: True,
    ),
    "point: where twists are measured (errors are the tool frame's)": (
        (
            DEFAULT._replace(name="tool frame's origin"),
            Choice("10 cm beyond it", fixed(point=[0.0, 0.0, 0.1])),
            Choice("the arm's own", fixed(point="own")),
        ),
        lambda _: True,
    ),
    "length: what a radian counts": (
        (
            DEFAULT._replace(name="the reach"),
            Choice("a third of it", lambda r: {"length": reach(r) / 3.0}),
            Choice("three times it", lambda r: {"length": 3.0 * reach(r)}),
            Choice("the own length", lambda r: {"length": own_length(r)}),
            Choice("one metre", fixed(length=1.0)),
        ),
        lambda _: True,
    ),
    "damping: threshold, ceiling": (
        (
            DEFAULT._replace(name="0.001, 3e-05"),
            adaptive(1e-3, 1e-4),
            adaptive(1e-3, 1e-3),
            adaptive(1e-2, 1e-3),
            adaptive(1e-2, 1e-2),
        ),
        lambda _: True,
    ),
    "guard of a pitch form: share of what least squares gains": (
        (
            Choice("0.5", pitched),
            guarded("none", guard=False),
            guarded("0.9", guard=iq.velocity.Guard(0.9)),
            guarded("1", guard=iq.velocity.Guard(1.0)),
        ),
        lambda _: True,
    ),
    "posture: gain [1/s]": (
        (DEFAULT._replace(name="1"), *(Choice(f"{g:g}", fixed(posture=g)) for g in (0.0, 0.3, 3.0, 10.0))),
        lambda m: m > 6,
    ),
    "calm: damping that grows with the residual": (
        (DEFAULT._replace(name="0.25"), *map(calmed, (0.0, 0.5, 1.0, 4.0))),
        lambda _: True,
    ),
    **{f"gain: share of the error in a tick; {NOISE:g} rad of noise, {n} ticks late": gains(n) for n in LATE},
}


def random_task(number: int) -> Task:
    """The task of a number: the next arm each time, the next kind each time round."""
    rng = np.random.default_rng([SEED, number])
    name, kind = ARMS[number % len(ARMS)], KINDS[number // len(ARMS) % len(KINDS)]
    robot = arm(name)
    low, high = limits(robot)
    mid, half = 0.5 * (low + high), 0.5 * (high - low)
    q = [mid + half * rng.uniform(-0.6, 0.6, len(low))]
    for _ in range(2):
        q.append(np.clip(mid + half * rng.uniform(-0.6, 0.6, len(low)), q[-1] - 0.7, q[-1] + 0.7))
    if kind == "singular":
        q[1] = singular(robot, q[1])
    if kind == "past a limit":
        joint, up = int(rng.integers(len(low))), bool(rng.random() < 0.5)
        edge, out = (high[joint], 1.0) if up else (low[joint], -1.0)
        q[0][joint] = edge - 0.3 * out
        for i in (1, 2):
            q[i][joint] = edge + rng.uniform(0.05, 0.3) * out
    speed = np.where(np.isfinite(robot.velocity_limit), robot.velocity_limit, 2.0)
    # A leg q0 to q1 along (1 - cos) / 2 has its largest speed, pi / 2 of the mean, in the middle.
    least = max(0.5 * np.pi * float((np.abs(b - a) / speed).max()) for a, b in pairwise(q))
    leg = np.clip(least * (rng.uniform(0.6, 0.9) if kind == "too fast" else 1.5), 0.5, 1.2)
    u = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, round(leg / DT) + 1))[:, None]
    poses = [robot.pose(x) for x in np.vstack((q[0] + u * (q[1] - q[0]), (q[1] + u * (q[2] - q[1]))[1:]))]
    return Task(robot, np.clip(q[0], low, high), poses, [moved(a, b) / DT for a, b in pairwise(poses)])


def moved(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(6,) the twist, for unit time, from one pose to another."""
    return iq.log(after @ iq.inverse(before, check=False), check=False)


def singular(robot: Any, q: np.ndarray) -> np.ndarray:
    """A singular state near q."""

    def distance(x: np.ndarray) -> float:
        sigma = np.linalg.svd(robot.jacobian(x), compute_uv=False)
        return float((sigma[-1] / sigma[0]) ** 2)

    box = list(zip(q - 0.7, q + 0.7, strict=True))
    return np.asarray(minimize(distance, q, method="L-BFGS-B", bounds=box, tol=1e-14).x)


def judged(task: Task, choice: Choice) -> np.ndarray:
    """(3,) largest errors [mm, deg] after the start, total variation [rad/s]; infinite where a choice is refused."""
    before = stages.CALM
    stages.CALM = before if choice.calm is None else choice.calm
    try:
        loop = iq.Controller(task.robot, dt=DT, **choice.options(task.robot))
        return run(task, loop, choice.late)
    except iq.BadInput:
        return np.full(3, np.inf)
    finally:
        stages.CALM = before


def run(task: Task, loop: Any, late: int) -> np.ndarray:
    """The figures of one run."""
    rng = np.random.default_rng(SEED)
    robot, q = task.robot, task.start
    low, high = limits(robot)
    reached, velocities, queue = [], [], [np.zeros(len(q))] * late
    for now, ahead in zip(task.poses, task.twists, strict=False):
        read = np.clip(q + NOISE * rng.standard_normal(len(q)), low, high) if late else q
        queue.append(loop.step(read, now, ahead).velocity)
        velocities.append(queue.pop(0))
        q = np.clip(q + DT * velocities[-1], low, high)  # a late arm would be past its limits
        reached.append(robot.pose(q))
    counted = slice(int(START * len(reached)), None)
    apart = [
        (then[:3, 3] - here[:3, 3], moved(here, then)[:3])
        for here, then in zip(reached[counted], task.poses[1:][counted], strict=True)
    ]
    mm, turn = np.linalg.norm(apart, axis=2).max(axis=0)
    return np.array((1e3 * mm, np.degrees(turn), np.abs(np.diff(velocities, axis=0)).sum()))


def measured(number: int) -> dict[tuple[str, str], np.ndarray]:
    """All choices on one task; what is the same run is made once."""
    task = random_task(number)
    joints = len(task.start)
    runs: dict[Choice, np.ndarray] = {}
    found: dict[tuple[str, str], np.ndarray] = {}
    for title, (choices, fits) in STUDY.items():
        for choice in choices if fits(joints) else ():
            unnamed = choice._replace(name="")
            if unnamed not in runs:
                runs[unnamed] = judged(task, choice)
            found[title, choice.name] = runs[unnamed]
    return found


def table_of(names: list[str], figures: np.ndarray) -> Table:
    """The table of one default, from figures (tasks, choices, 3)."""
    floored = np.maximum(figures, FLOOR)
    ratios = np.exp(np.log(floored / floored.min(axis=1, keepdims=True)).mean(axis=0))
    worse = (floored[:, :, None, :2] > BETTER * floored[:, None, :, :2]).all(axis=3).any(axis=2).mean(axis=0)
    table = Table("", "mm", "deg", "variation", "dominated", box=None)
    for name, (mm, deg, variation), share in zip(names, ratios, worse, strict=True):
        table.add_row(name, f"{mm:.2f}", f"{deg:.2f}", f"{variation:.2f}", f"{share:.1%}")
    return table


def main() -> None:
    """Run the study and print its tables, the default first in each."""
    parser = argparse.ArgumentParser(description="What each default costs, and what other values would.")
    parser.add_argument("--tasks", type=int, default=300, help="number of random tasks")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    given = parser.parse_args()
    with parallel_config(backend="loky", inner_max_num_threads=1):
        runs = Parallel(n_jobs=given.jobs)(delayed(measured)(number) for number in range(given.tasks))
    console = Console(width=110)
    for title, (choices, _) in STUDY.items():
        names = [choice.name for choice in choices]
        found = [[r[title, name] for name in names] for r in runs if (title, names[0]) in r]
        if found:
            console.print(f"\n{title}; {len(found)} tasks", table_of(names, np.array(found)), sep="\n")


if __name__ == "__main__":
    main()
