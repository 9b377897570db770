"""How far a joint trajectory moves when somebody puts the tool frame elsewhere: the same motion asked, both ways run.

change = max |q(t) - q'(t)|,    T_tool' = T_tool X,  T_target' = T_target X
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from invariantqp.compare.laws.baselines import controller_named
from invariantqp.compare.measure.displaced import displaced
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.progress import Progress
from invariantqp.runs.controllers import MakeController, our_controller
from invariantqp.runs.pilots import pilot_of
from invariantqp.runs.prepare import prepare
from invariantqp.runs.run import run
from invariantqp.runs.taskfile import Task

# Standard deviation of the random displacement of the tool frame, about what tool centre points are apart [m].
DISPLACEMENT = 0.25

LAWS: dict[str, MakeController] = {
    "invariantqp": our_controller,
    "Moore-Penrose, clipped": controller_named("Moore-Penrose, pinv"),
    "DLS, clipped": controller_named("DLS"),
}


@dataclass(frozen=True)
class FrameCheck:
    """What a displaced tool frame changed for one law.

    Attributes:
        law: its name.
        change: largest change of a joint position along the run [rad, m].
        worst_error_mm: largest tracking error with the tool frame as the task has it [mm].
    """

    law: str
    change: float
    worst_error_mm: float


def random_displacement(seed: int) -> Array:
    """A (4, 4) rigid motion: any rotation, and a translation of about a hand's width."""
    rng = np.random.default_rng(seed)
    return se3.transform(Rotation.from_quat(rng.standard_normal(4)).as_matrix(), DISPLACEMENT * rng.standard_normal(3))


def frame_check(
    task: Task, seed: int = 0, progress: Progress | None = None, laws: Mapping[str, MakeController] = LAWS
) -> list[FrameCheck]:
    """Run a task with the tool frame as it is and displaced at random, under our law and the usual ones.

    Args:
        task: from `load_task`.
        seed: of the displacement.
        progress: called with (ticks done, ticks in all).
        laws: what is run, by name.

    Returns:
        One FrameCheck a law.
    """
    tool = random_displacement(seed)
    checks = []
    done = 0
    total = 2 * len(laws) * task.ticks

    def count(_: int, __: int) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, total)

    for name, make in laws.items():
        as_told, moved = prepare(task), displaced(prepare(task), tool)
        plain = run(as_told, pilot_of(as_told.brief, make), count)
        change = float(np.abs(plain.q - run(moved, pilot_of(moved.brief, make), count).q).max())
        checks.append(FrameCheck(name, change, 1e3 * float(plain.position_error.max())))
    return checks
