"""Why the defaults are what they are: each is varied by itself, and what that costs is told in four figures.

    python examples/14_defaults.py                  everything, about twenty minutes on two cores
    python examples/14_defaults.py --tasks 8        a first look
    python examples/14_defaults.py --only damping   the tables with this in their title

The tasks are the comparison's everyday ones, those at which methods fail (tasks/stability), and random ones on ten
arms: a path that is free, that leads through a singularity with feedforward and without, that is too fast for a joint,
that goes past a position limit; a target that jumps, turns in place, or stays. Each table tells, for each choice,

    mm, deg     largest errors beyond those that the target's own jump makes
    rad/s^2     largest joint acceleration after the first tick
    s           settling time, to 1 mm and 1 deg, from when the target is at rest on

each as how many times that of the best choice of the same task, in the geometric mean over the everyday and stability
tasks, over the random ones, and what 95 % of all tasks are below; then

    dominated   share of the tasks in which another choice is 5 % better in one of these figures and worse in none
    stays       how far joints move at most where they are told to stay, positions read with noise [deg]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed, parallel_config
from rich.console import Console
from rich.table import Table
from scipy.optimize import minimize
from shared.ten_arms import ARMS, arm, limits, spec

import invariantqp as iq
from invariantqp.compare.measurements import EVERYDAY, figures, overshoot, watched_run, with_rest
from invariantqp.control import controller, tracking
from invariantqp.runs.controllers import law_options
from invariantqp.runs.plant import IdealPlant
from invariantqp.runs.prepare import Setup, prepare
from invariantqp.runs.taskfile import load_task, shipped_tasks, task_from
from invariantqp.velocity import damping, exact, law, tick

DT = 0.01
KINDS = ("free", "singular", "singular, no feedforward", "too fast", "past a limit", "jump", "turn", "stay")
# Below these nobody tells two runs apart [mm, deg, rad/s^2, s]: arms repeat to more than a hundredth of a millimetre.
FLOOR = np.array([1e-2, 1e-2, 1.0, 0.02])
# A choice is better than another where a figure is this much smaller.
BETTER = 1.05
# Noise of encoders that are told to stay [rad], a few of their counts; and of those that gains are compared with,
# where so many ticks lie between a command and its effect.
COUNTS, NOISE, LATE = 2e-5, 1e-4, (1, 4)
SEED = 14


class Problem(NamedTuple):
    """A task made ready, and whether it is a random one, and one in which joints are told to stay."""

    setup: Setup
    random: bool
    stays: bool


class InPython(iq.velocity.Adaptive):
    """The default damping as a policy of one's own, which the compiled core does not have: Python's constants count."""


class Choice(NamedTuple):
    """One value of a default: its name, options of the controller for an arm, constants, ticks that the arm is late."""

    name: str
    options: Callable[[Any], dict[str, Any]] = lambda _: {}
    constants: tuple[tuple[Any, str, float], ...] = ()
    late: int = 0


class Study(NamedTuple):
    """The choices for one default, and for which problems they are compared: those with so many joints, or random."""

    choices: tuple[Choice, ...]
    joints: int = 1
    random: bool = False


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


def constants(module: Any, name: str, *values: float, **options: Any) -> tuple[Choice, ...]:
    """The constant as it is, and its other values, in Python."""
    own = getattr(module, name)
    values = (own, *(value for value in values if value != own))
    told = fixed(damping=InPython(), **options)
    return tuple(Choice(f"{value:g}", told, ((module, name, value),)) for value in values)


def dampings() -> tuple[Choice, ...]:
    """Thresholds and ceilings, the default first."""
    own = damping.DEFAULT_THRESHOLD, damping.DEFAULT_CEILING
    grid = [(t, c) for t in (5e-3, 1e-2, 2e-2) for c in (3e-4, 1e-3, 2e-3, 3e-3)]
    pairs = (own, *(pair for pair in (*grid, law.PLANNED_DAMPING) if pair != own))
    return tuple(Choice(f"{t:g}, {c:g}", fixed(damping=iq.velocity.Adaptive(t, c))) for t, c in pairs)


def pitched(robot: Any) -> dict[str, Any]:
    """A pitch form."""
    return {"form": reach(robot)}


def guarded(name: str, *, guard: Any) -> Choice:
    """A guard of the pitch form."""
    return Choice(name, lambda r: {"guard": guard, **pitched(r)})


def gains(late: int) -> Study:
    """Gains on an arm that moves a few ticks late."""
    own = tracking.TRACKING_SHARE
    shares = (own, *(k for k in (0.05, 0.1, 0.2, 0.4) if k != own))
    return Study(tuple(Choice(f"{k:g}", fixed(gain=k / DT), late=late) for k in shares), random=True)


STUDIES: dict[str, Study] = {
    "damping: threshold, ceiling": Study(dampings()),
    "SLACK: what limits may take of a twist before they slow its chase down": Study(
        constants(controller, "SLACK", 1e-3, 2e-3, 5e-3)
    ),
    "POSTURE_PACE: the joint speed at which half of the posture is followed": Study(
        constants(tick, "POSTURE_PACE", 1e-3, 3e-3, 1e-2, 2e-2), joints=7
    ),
    "POSTURE_TIME: in which a posture may bring joints to full speed [s]": Study(
        constants(controller, "POSTURE_TIME", 1e-3, 0.05, 0.1, 0.2, 0.5), joints=7
    ),
    "posture_gain [1/s]": Study(
        (Choice("1"), *(Choice(f"{g:g}", fixed(posture_gain=g)) for g in (0.0, 0.3, 3.0, 10.0))), joints=7
    ),
    "CALM: damping that grows with the residual": Study(constants(tick, "CALM", 0.0, 0.25, 0.5, 1.0, 4.0)),
    "EXACT_CALM: the same of exact rows": Study(
        constants(exact, "EXACT_CALM", 0.15, 0.5, 1.0, 2.0, exact="position"), joints=4
    ),
    **{f"TRACKING_SHARE: of the error in a tick; {NOISE:g} rad of noise, {n} ticks late": gains(n) for n in LATE},
    "form: what is attempted beyond the joints": Study(
        (
            Choice("none: least squares at the point"),
            Choice("pitch, the reach", pitched),
            Choice("pitch, four own lengths", lambda r: {"form": 4.0 * own_length(r)}),
            Choice("metric of a 1 kg tool", fixed(form=iq.CarriedMetric(np.repeat((0.0025, 1.0), 3)))),
            Choice("[DS]'s problem, convexified", lambda r: {"form": iq.PitchForm(reach(r), convexified=True)}),
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
            guarded("none", guard=False),
            guarded("0.9", guard=iq.velocity.Guard(0.9)),
            guarded("1", guard=iq.velocity.Guard(1.0)),
        )
    ),
}


def random_problem(number: int) -> Problem:
    """The random task of a number: the next arm each time, the next kind each time round."""
    rng = np.random.default_rng([SEED, number])
    name, kind = ARMS[number % len(ARMS)], KINDS[number // len(ARMS) % len(KINDS)]
    robot = arm(name)
    low, high = limits(robot)
    mid, half = 0.5 * (low + high), 0.5 * (high - low)
    start = mid + half * rng.uniform(-0.6, 0.6, len(low))
    content: dict[str, Any] = {"name": f"{name}, {kind}", "law": {"dt": DT}}
    if kind in ("jump", "turn", "stay"):
        size = {"jump": 0.15, "turn": rng.uniform(0.4, 1.2), "stay": 0.0}[kind]
        way = rng.normal(size=3)
        way *= size / np.linalg.norm(way)
        content["path"] = {"kind": "hold", "duration": 2.0, "turn" if kind == "turn" else "move": way.tolist()}
        if kind == "stay":
            content["encoder_noise"] = COUNTS
    else:
        content["path"] = _joint_path(robot, start, kind, rng)
    content["robot"] = {**spec(name), "start": start.tolist()}
    setup = with_rest(prepare(task_from(content, name)))
    if kind == "singular, no feedforward":
        setup = replace(setup, problem=replace(setup.problem, feedforward=np.zeros_like(setup.problem.feedforward)))
    return Problem(setup, random=True, stays=kind == "stay")


def _joint_path(robot: Any, start: np.ndarray, kind: str, rng: np.random.Generator) -> dict[str, Any]:
    """A path through two random states near the start; `start` moves where the kind asks for it."""
    low, high = limits(robot)
    mid, half = 0.5 * (low + high), 0.5 * (high - low)
    way = [start]
    for _ in range(2):
        way.append(np.clip(mid + half * rng.uniform(-0.6, 0.6, len(low)), way[-1] - 0.7, way[-1] + 0.7))
    if kind.startswith("singular"):
        way[1] = singular(robot, way[1])
    if kind == "past a limit":
        joint, up = int(rng.integers(len(low))), bool(rng.random() < 0.5)
        edge, out = (high[joint], 1.0) if up else (low[joint], -1.0)
        start[joint] = edge - 0.3 * out
        for i in (1, 2):
            way[i][joint] = edge + rng.uniform(0.05, 0.3) * out
    speed = np.where(np.isfinite(robot.velocity_limit), robot.velocity_limit, 2.0)
    # Minimum jerk through both states is fastest at 1.9 times its mean speed.
    least = 1.9 * float(sum((np.abs(b - a) / speed).max() for a, b in pairwise(way)))
    duration = np.clip(least * (rng.uniform(0.6, 0.9) if kind == "too fast" else 1.5), 0.8, 3.0)
    return {"kind": "joints", "duration": float(duration), "waypoints": [q.tolist() for q in way[1:]]}


def singular(robot: Any, q: np.ndarray) -> np.ndarray:
    """A singular state near q."""

    def distance(x: np.ndarray) -> float:
        sigma = np.linalg.svd(robot.jacobian(x), compute_uv=False)
        return float((sigma[-1] / sigma[0]) ** 2)

    box = list(zip(q - 0.7, q + 0.7, strict=True))
    return np.asarray(minimize(distance, q, method="L-BFGS-B", bounds=box, tol=1e-14).x)


def shipped_problem(name: str) -> Problem:
    """An everyday task or a stability task."""
    return Problem(with_rest(prepare(load_task(name))), random=False, stays=name == "compare/stay")


def judged(problem: Problem, choice: Choice) -> np.ndarray:
    """(5,) mm, deg, rad/s^2, s, and how far joints moved [deg]; NaN where a choice is refused."""
    setup = problem.setup
    dt, start = setup.task.law.dt, setup.task.start()
    late = choice.late * dt or setup.task.physics.delay
    setup = replace(setup, plant=IdealPlant(setup.robot, start, dt, delay=late))
    if choice.late:
        setup = replace(setup, noise=np.random.default_rng(SEED).normal(0.0, NOISE, setup.noise.shape))

    def make(robot: Any, told: Any) -> iq.Controller:
        return iq.Controller(robot, **{**law_options(robot, told), **choice.options(robot)})

    with changed(choice):
        try:
            watched, trace = watched_run(setup, make)
        except iq.BadInput:
            return np.full(5, np.nan)
    mm, deg = overshoot(trace, setup.robot) * (1e3, np.degrees(1.0))
    found = figures(watched, trace)
    settled = min(found["settling_s"], float(setup.problem.time[-1]))
    moved = np.degrees(np.abs(trace.q - trace.q[0]).max())
    return np.array((mm, deg, found["acceleration"], settled, moved))


@contextmanager
def changed(choice: Choice) -> Iterator[None]:
    """The constants of a choice in place of those of the package."""
    before = [(module, name, getattr(module, name)) for module, name, _ in choice.constants]
    for module, name, value in choice.constants:
        setattr(module, name, value)
    try:
        yield
    finally:
        for module, name, value in before:
            setattr(module, name, value)


def measured(place: int | str, titles: list[str]) -> dict[tuple[str, str], np.ndarray]:
    """All choices of some studies on one problem, by number or name; what is the same run is made once."""
    problem = random_problem(place) if isinstance(place, int) else shipped_problem(place)
    joints = len(problem.setup.task.robot.start)
    kind = float(problem.random), float(problem.stays)
    usual = judged(problem, Choice(""))
    found: dict[tuple[str, str], np.ndarray] = {}
    for title in titles:
        study = STUDIES[title]
        if joints < study.joints or (study.random and not problem.random):
            continue
        runs = {}
        for choice in study.choices:
            as_it_is = choice._replace(name="") == Choice("")
            runs[title, choice.name] = np.append(usual if as_it_is else judged(problem, choice), kind)
        if not np.isnan(list(runs.values())).any():
            found |= runs
    return found


def table_of(names: list[str], runs: np.ndarray) -> Table:
    """The table of one default, from (tasks, choices, 7) figures and kinds of tasks; its own value is the first."""
    random, stays = runs[:, 0, 5] > 0.0, runs[:, 0, 6] > 0.0
    floored = np.maximum(runs[:, :, :4], FLOOR)
    ratios = floored / floored.min(axis=1, keepdims=True)
    nowhere_worse = (floored[:, None] <= BETTER * floored[:, :, None]).all(axis=3)
    better = (BETTER * floored[:, None] < floored[:, :, None]).any(axis=3)
    dominated = (nowhere_worse & better).any(axis=2).mean(axis=0)
    heads = ("mm, deg, rad/s^2, s", "everyday, stability", "random", "95 % of all", "dominated", "stays")
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
    parser.add_argument("--tasks", type=int, default=320, help="number of random tasks, and of others at most")
    parser.add_argument("--only", default="", help="part of the titles of the tables to print")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    given = parser.parse_args()
    titles = [title for title in STUDIES if given.only.lower() in title.lower()]
    shipped = [*dict.fromkeys((*EVERYDAY, *shipped_tasks("stability")))]
    places = [*range(given.tasks), *shipped[: given.tasks]]
    with parallel_config(backend="loky", inner_max_num_threads=1):
        runs = Parallel(n_jobs=given.jobs)(delayed(measured)(place, titles) for place in places)
    console = Console(width=140)
    for title in titles:
        names = [choice.name for choice in STUDIES[title].choices]
        found = [[r[title, name] for name in names] for r in runs if (title, names[0]) in r]
        if found:
            console.print(f"\n{title}; {len(found)} tasks", table_of(names, np.array(found)), sep="\n")


if __name__ == "__main__":
    main()
