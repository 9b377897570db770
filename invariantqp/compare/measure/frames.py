"""How much a joint trajectory changes when another tool frame is chosen for the same motion of the tool.

change = max |q(t) - q'(t)|,    T_tool' = T_tool X,  T_target' = T_target X
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from invariantqp.compare.measure.displaced import displaced
from invariantqp.compare.names import DLS, OURS, PINV
from invariantqp.compare.registry import controller_named
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.progress import Progress
from invariantqp.runs.controllers import MakeController, our_controller
from invariantqp.runs.pilots import pilot_of
from invariantqp.runs.prepare import prepare
from invariantqp.runs.run import run
from invariantqp.runs.taskfile import Task

# Standard deviation of the random displacement along each axis [m], about the length of a tool.
DISPLACEMENT = 0.25

LAWS: dict[str, MakeController] = {
    OURS: our_controller,
    "Moore-Penrose, clipped": controller_named(PINV),
    "DLS, clipped": controller_named(DLS),
}


@dataclass(frozen=True)
class FrameCheck:
    """What another tool frame changed for one law.

    Attributes:
        law: its name.
        change: largest change of a joint position during the run [rad, m].
        worst_error_mm: largest position error of the tool with the tool frame of the task [mm].
    """

    law: str
    change: float
    worst_error_mm: float


def random_displacement(seed: int) -> Array:
    """A random (4, 4) rigid motion: any rotation, and a translation with this standard deviation along each axis."""
    rng = np.random.default_rng(seed)
    return se3.transform(Rotation.from_quat(rng.standard_normal(4)).as_matrix(), DISPLACEMENT * rng.standard_normal(3))


def frame_check(
    task: Task, seed: int = 0, progress: Progress | None = None, laws: Mapping[str, MakeController] = LAWS
) -> list[FrameCheck]:
    """Run a task twice under each law, with its own tool frame and with one that is displaced at random.

    Args:
        task: from `load_task`.
        seed: seed of the displacement.
        progress: called with (ticks done, ticks in all).
        laws: the laws by name; ours, Moore-Penrose and damped least squares by default.

    Returns:
        One FrameCheck for each law.
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
