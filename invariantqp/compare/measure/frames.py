"""How much a joint trajectory changes when another tool frame is chosen for the same motion of the tool.

change    max |q(t) - q'(t)|,     T_tool' = T_tool X,  T_target' = T_target X
control   max |q(t) - q''(t)|,    q'' from a start moved by 1e-12: a change that is not above it is no dependence
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from invariantqp.compare.measure.displaced import displaced
from invariantqp.compare.names import DLS, LEAST_SQUARES, OURS, PENROSE
from invariantqp.compare.registry import controller_named
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.progress import Progress
from invariantqp.runs.controllers import MakeController, our_controller
from invariantqp.runs.pilots import pilot_of
from invariantqp.runs.prepare import Setup, prepare
from invariantqp.runs.run import run
from invariantqp.runs.taskfile import Task

# Standard deviation of the random displacement along each axis [m], about the length of a tool.
DISPLACEMENT = 0.25
# By how much the start of the control is moved, all joints alike [rad, m].
NUDGE = 1e-12

LAWS: dict[str, MakeController] = {name: controller_named(name) for name in (OURS, LEAST_SQUARES, PENROSE, DLS)}


@dataclass(frozen=True)
class FrameCheck:
    """What another tool frame changed for one law.

    Attributes:
        law: its name.
        change: largest change of a joint position during the run [rad, m].
        control: the same for a start moved by 1e-12, in the tool frame of the task [rad, m].
        worst_error_mm: largest position error of the tool with the tool frame of the task [mm].
    """

    law: str
    change: float
    control: float
    worst_error_mm: float


def random_displacement(seed: int) -> Array:
    """A random (4, 4) rigid motion: any rotation, and a translation with this standard deviation along each axis."""
    rng = np.random.default_rng(seed)
    return se3.transform(Rotation.from_quat(rng.standard_normal(4)).as_matrix(), DISPLACEMENT * rng.standard_normal(3))


def moved_start(task: Task, setup: Setup) -> Setup:
    """The same motion of the tool from a start that is moved by rounding."""
    start = [x + NUDGE for x in task.robot.start]
    other = prepare(task.model_copy(update={"robot": task.robot.model_copy(update={"start": start})}))
    told = setup.brief
    brief = replace(other.brief, time=told.time, poses=told.poses, feedforward=told.feedforward)
    return replace(other, brief=brief, wanted=setup.wanted, noise=setup.noise)


def frame_check(task: Task, seed: int = 0, progress: Progress | None = None) -> list[FrameCheck]:
    """Run a task under each law with its own tool frame, with one that is displaced at random, and with a start moved.

    The laws are ours, least squares by a QP, Moore-Penrose and damped, and for an elastic path, which the others do not
    have, ours. Runs of such a path may differ in length: the shorter one rests at its end.

    Args:
        task: from `load_task`.
        seed: seed of the displacement.
        progress: called with (ticks done, ticks in all).

    Returns:
        One FrameCheck for each law.
    """
    tool = random_displacement(seed)
    laws = LAWS if task.path.timing == "fixed" else {OURS: our_controller}
    checks = []
    done = 0
    total = 3 * len(laws) * task.ticks

    def count(_: int, __: int) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(min(done, total), total)

    for name, make in laws.items():
        as_told, moved = prepare(task), displaced(prepare(task), tool)
        plain, other, nudged = (
            run(setup, pilot_of(setup.brief, make), count) for setup in (as_told, moved, moved_start(task, as_told))
        )
        change, control = (largest_change(plain.q, trace.q) for trace in (other, nudged))
        checks.append(FrameCheck(name, change, control, 1e3 * float(plain.position_error.max())))
    return checks


def largest_change(a: Array, b: Array) -> float:
    """The largest difference of two joint trajectories (n, m) and (k, m)."""
    n = max(len(a), len(b))
    return float(max(np.abs(a[min(i, len(a) - 1)] - b[min(i, len(b) - 1)]).max() for i in range(n)))
