"""Why the defaults are what they are: each is varied by itself, and a table shows what that costs.

    python examples/14_defaults.py                  everything, less than an hour on two cores
    python examples/14_defaults.py --tasks 8        a first look
    python examples/14_defaults.py --only length    the tables with this in their title

The tasks are those of the comparison (`invariantqp compare`), those at which methods fail (tasks/stability), and random
ones on ten arms: a path that is free, that leads through a singularity with feedforward and without, that is too fast
for a joint, or that goes past a position limit; a target that jumps, turns in place, or stays. The arm moves as
commanded. Each table shows, for each choice,

    mm, deg     largest errors
    rad/s^2     largest joint acceleration after the first tick
    s           settling time, to 1 mm and 1 deg, from when the target is at rest

Each is divided by that of the best choice on the same task. The columns are the geometric means over the first two
groups of tasks and over the random ones, and the 95th percentile over all tasks; then

    dominated   share of the tasks in which another choice is 5 % better in one of these figures and worse in none
    stays       how far joints move at most when the target stays and measured positions have noise [deg]
"""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from itertools import islice
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
from joblib import Parallel, delayed, parallel_config
from rich.console import Console
from rich.table import Table
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize
from shared.ten_arms import ARMS, arm, limits

import invariantqp as iq
from invariantqp.control import controller, tracking
from invariantqp.workbench.compare.arms import STARTS, chain_of
from invariantqp.workbench.compare.figures import NOT_SETTLED, figures
from invariantqp.workbench.compare.tasks import COUNTS, BedTask, bed, from_file, minimum_jerk, spec_of, twists_of
from invariantqp.workbench.runs.taskfile import LawSpec, law_options, load_task, shipped_tasks

DT = 0.01
# Kinds of the bed's tasks, and of the random ones.
BED = ("limits", "singular", "turn", "jump", "jump accelerations", "out of reach", "stay")
KINDS = ("free", "singular", "singular, no feedforward", "too fast", "past a limit", "jump", "turn", "stay")
# Below these nobody tells two runs apart [mm, deg, rad/s^2, s]: arms repeat to more than a hundredth of a millimetre.
FLOOR = np.array([1e-2, 1e-2, 1.0, 0.02])
# A choice is better than another where a figure is this much smaller.
BETTER = 1.05
# Gains are compared with this noise of encoders [rad] and so many ticks between a command and its effect.
NOISE, LATE = 1e-4, (1, 4)
SEED = 14


class Choice(NamedTuple):
    """One value of a default."""

    name: str
    options: Callable[[Any], dict[str, Any]] = lambda _: {}  # of the controller, for an arm
    constant: tuple[Any, str, float] | None = None  # of the package: module, name, value
    late: int = 0  # ticks by which the arm is late


class Study(NamedTuple):
    """The choices for one default, its own value first, and the least number of joints for which it counts."""

    choices: tuple[Choice, ...]
    joints: int = 1


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


def constants(module: Any, name: str, *values: float) -> tuple[Choice, ...]:
    """The constant as it is, and its other values."""
    own = getattr(module, name)
    values = (own, *(value for value in values if value != own))
    return tuple(Choice(f"{value:g}", constant=(module, name, value)) for value in values)


def pitched(robot: Any) -> dict[str, Any]:
    """A pitch form."""
    return {"form": reach(robot)}


def gains(late: int) -> Study:
    """Gains on an arm that moves a few ticks late."""
    own = tracking.TRACKING_SHARE
    shares = (own, *(k for k in (0.05, 0.1, 0.2, 0.4) if k != own))
    constant = tracking, "TRACKING_SHARE"
    return Study(tuple(Choice(f"{k:g}", fixed(gain=None), (*constant, k), late) for k in shares))


STUDIES: dict[str, Study] = {
    "SLACK: an error that may stay beside position limits [rad]": Study(
        constants(controller, "SLACK", 1e-3, 2e-3, 5e-3)
    ),
    "posture_gain [1/s]": Study(
        (Choice("1"), *(Choice(f"{g:g}", fixed(posture_gain=g)) for g in (0.0, 0.3, 3.0, 10.0))), joints=7
    ),
    **{f"TRACKING_SHARE: of the error in a tick; {NOISE:g} rad of noise, {n} ticks late": gains(n) for n in LATE},
    "form: what is attempted beyond the joints": Study(
        (
            Choice("none: least squares at the point"),
            Choice("pitch, the reach", pitched),
            Choice("pitch, four own lengths", lambda r: {"form": 4.0 * own_length(r)}),
            Choice("metric of a 1 kg tool", fixed(form=iq.CarriedMetric(np.repeat((0.0025, 1.0), 3)))),
            Choice("pitch, damping of 5 cm", lambda r: {"damping": 0.05, **pitched(r)}),
        )
    ),
    "point: where twists are measured (errors are the tool frame's)": Study(
        (
            Choice("tool frame's origin"),
            Choice("10 cm beyond it", fixed(point=[0.0, 0.0, 0.1])),
            Choice("the arm's own", fixed(point="own")),
        )
    ),
    "length: what a radian counts": Study(
        (
            Choice("the reach"),
            Choice("a third of it", lambda r: {"length": reach(r) / 3.0}),
            Choice("three times it", lambda r: {"length": 3.0 * reach(r)}),
            Choice("the own length", lambda r: {"length": own_length(r)}),
            Choice("one metre", fixed(length=1.0)),
        )
    ),
    "guard of a pitch form: share of what least squares gains": Study(
        (
            Choice("0.5", pitched),
            Choice("none", lambda r: {"guard": False, **pitched(r)}),
            Choice("0.9", lambda r: {"guard": iq.velocity.Guard(0.9), **pitched(r)}),
            Choice("1", lambda r: {"guard": iq.velocity.Guard(1.0), **pitched(r)}),
        )
    ),
}


def random_task(number: int) -> BedTask:
    """The random task of a number: the next arm each time, the next kind each time round."""
    rng = np.random.default_rng([SEED, number])
    name, kind = ARMS[number % len(ARMS)], KINDS[number // len(ARMS) % len(KINDS)]
    robot = arm(name)
    low, high = limits(robot)
    way = 0.5 * (low + high) + 0.5 * (high - low) * rng.uniform(-0.6, 0.6, (3, len(low)))
    for i in (1, 2):
        way[i] = np.clip(way[i], way[i - 1] - 0.7, way[i - 1] + 0.7)
    at_once = kind in ("jump", "turn", "stay")
    path = np.repeat(way[:1], round(3.0 / DT), axis=0) if at_once else timed_path(robot, way, kind, rng)
    targets = np.array([robot.pose(q) for q in path])
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    if kind == "jump":
        targets[:, :3, 3] += 0.15 * direction
    if kind == "turn":
        turn = iq.exp([*rng.uniform(0.4, 1.2) * direction, 0.0, 0.0, 0.0])
        targets[:, :3, :3] = turn[:3, :3] @ targets[:, :3, :3]
    spec = spec_of(robot, LawSpec(dt=DT))
    ahead = None if at_once or kind.endswith("no feedforward") else twists_of(targets, DT)
    noise = COUNTS * (kind == "stay") * rng.standard_normal(path.shape)
    at_rest = 0 if at_once else len(path) - round(1.0 / DT)
    return BedTask(f"random {number}", name, kind, spec, path[0], targets, ahead, noise, targets, spec, at_rest)


def timed_path(robot: Any, way: np.ndarray, kind: str, rng: np.random.Generator) -> np.ndarray:
    """(n, m) joint positions through three states (3, m), changed as the kind needs it, and a second at the last."""
    low, high = limits(robot)
    if kind.startswith("singular"):
        way[1] = singular(robot, way[1])
    if kind == "past a limit":
        joint, up = int(rng.integers(len(low))), bool(rng.random() < 0.5)
        edge, out = (high[joint], 1.0) if up else (low[joint], -1.0)
        way[:, joint] = edge + out * np.append(-0.3, rng.uniform(0.05, 0.3, 2))
    spline, u = CubicSpline([0.0, 0.5, 1.0], way), np.linspace(0.0, 1.0, 500)
    speed = np.abs(np.gradient(spline(minimum_jerk(u)), u, axis=0))  # if it took a second
    fastest = np.where(np.isfinite(robot.velocity_limit), robot.velocity_limit, 2.0)
    share = rng.uniform(0.6, 0.9) if kind == "too fast" else 1.5
    duration = np.clip(share * (speed / fastest).max(), 0.8, 3.0)
    return spline(minimum_jerk(np.arange(0.0, duration + 1.0, DT) / duration))


def singular(robot: Any, q: np.ndarray) -> np.ndarray:
    """A singular state near q."""

    def distance(x: np.ndarray) -> float:
        sigma = np.linalg.svd(robot.jacobian(x), compute_uv=False)
        return float((sigma[-1] / sigma[0]) ** 2)

    box = list(zip(q - 0.7, q + 0.7, strict=True))
    return np.asarray(minimize(distance, q, method="L-BFGS-B", bounds=box, tol=1e-14).x)


def other_tasks() -> Iterator[BedTask]:
    """The bed's tasks, arm by arm, and those of tasks/stability."""
    for name in STARTS:
        yield from bed([name], BED)
    for name in shipped_tasks("stability"):
        yield from_file(load_task(name))[0]


def measured(task: BedTask, choice: Choice) -> np.ndarray:
    """(5,) mm, deg, rad/s^2, s, and how far joints moved [deg]; NaN where the controller refuses a choice."""
    spec = task.spec
    robot = chain_of(spec)
    options = law_options(robot, LawSpec.model_validate(spec.law))
    try:
        with mock.patch.object(*choice.constant) if choice.constant else nullcontext():
            run = driven(task, iq.Controller(robot, **options | choice.options(robot)), choice.late)
    except iq.BadInput:
        return np.full(5, np.nan)
    found = figures(task, run)
    acceleration = np.abs(np.diff(run["velocities"], axis=0)).max() / spec.dt
    settling = NOT_SETTLED if found["settling"] is None else found["settling"]
    return np.array((found["mm"], found["deg"], acceleration, settling, found["joints_deg"]))


def driven(task: BedTask, loop: iq.Controller, late: int) -> dict[str, Any]:
    """A run as `figures` takes it; a late arm moves as commanded so many ticks ago, and its encoders have NOISE."""
    noise = np.random.default_rng(SEED).normal(0.0, NOISE, task.noise.shape) if late else task.noise
    ahead = [None] * len(noise) if task.feedforward is None else task.feedforward
    pending, positions, velocities = deque([np.zeros(len(task.q0))] * late), [task.q0], []
    for target, twist, off in zip(task.targets, ahead, noise, strict=True):
        pending.append(loop.step(positions[-1] + off, target, twist).velocity)
        velocities.append(pending.popleft())
        positions.append(positions[-1] + task.spec.dt * velocities[-1])
    return {"positions": positions, "velocities": velocities, "times_us": [0.0], "exceptions": {}, "stopped": []}


def compared(place: int | BedTask, titles: list[str]) -> dict[tuple[str, str], np.ndarray]:
    """All choices of some studies on a task, or on the random one of a number."""
    random = isinstance(place, int)
    task = random_task(place) if random else place
    kind = float(random), float(task.kind == "stay")
    found: dict[tuple[str, str], np.ndarray] = {}
    for title in titles:
        study = STUDIES[title]
        if len(task.q0) >= study.joints:
            runs = {(title, choice.name): np.append(measured(task, choice), kind) for choice in study.choices}
            found |= {} if np.isnan(list(runs.values())).any() else runs
    return found


def table_of(names: list[str], runs: np.ndarray) -> Table:
    """The table of one default, from (tasks, choices, 7) figures and kinds of tasks; its own value is the first."""
    random, stays = runs[:, 0, 5] > 0.0, runs[:, 0, 6] > 0.0
    floored = np.maximum(runs[:, :, :4], FLOOR)
    ratios = floored / floored.min(axis=1, keepdims=True)
    nowhere_worse = (floored[:, None] <= BETTER * floored[:, :, None]).all(axis=3)
    better = (BETTER * floored[:, None] < floored[:, :, None]).any(axis=3)
    dominated = (nowhere_worse & better).any(axis=2).mean(axis=0)
    heads = ("mm, deg, rad/s^2, s", "bed, stability", "random", "95 % of all", "dominated", "stays")
    table = Table(*heads, box=None)
    for k, name in enumerate(names):
        means = [
            _four(np.exp(np.log(ratios[part, k]).mean(axis=0))) if part.any() else "" for part in (~random, random)
        ]
        still = f"{runs[stays, k, 4].max():.3f}" if stays.any() else ""
        table.add_row(name, *means, _four(np.percentile(ratios[:, k], 95, axis=0)), f"{dominated[k]:.1%}", still)
    return table


def _four(figures: np.ndarray) -> str:
    return "  ".join(f"{x:4.3g}" if x >= 10.0 else f"{x:4.2f}" for x in figures)


def main() -> None:
    """Run the studies and print a table for each, the default first in it."""
    parser = argparse.ArgumentParser(description="What each default costs, and what other values would.")
    parser.add_argument("--tasks", type=int, default=160, help="number of random tasks, and of others at most")
    parser.add_argument("--only", default="", help="part of the titles of the tables to print")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    given = parser.parse_args()
    titles = [title for title in STUDIES if given.only.lower() in title.lower()]
    places = [*range(given.tasks), *islice(other_tasks(), given.tasks)]
    with parallel_config(backend="loky", inner_max_num_threads=1):
        runs = Parallel(n_jobs=given.jobs)(delayed(compared)(place, titles) for place in places)
    console = Console(width=140)
    for title in titles:
        names = [choice.name for choice in STUDIES[title].choices]
        found = [[r[title, name] for name in names] for r in runs if (title, names[0]) in r]
        if found:
            console.print(f"\n{title}; {len(found)} tasks", table_of(names, np.array(found)), sep="\n")


if __name__ == "__main__":
    main()
