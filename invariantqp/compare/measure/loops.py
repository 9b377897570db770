"""Every method as a controller: how far off it is, how the joints move, and what another tool frame changes.

    loop     the task, with a second of rest at its end: largest errors of the run, largest joint acceleration after the
             first tick, settling time, failed ticks, limits met
    everyday the same of what users meet first, without a frame put elsewhere: stay, jump, turn in place, a singularity,
             too fast, out of reach and back, a late arm; errors beyond those that the target's own jump makes
    frame    max |q(t) - q'(t)|, q' the same motion asked of a tool frame put elsewhere on the tool; and beside it
             max |q(t) - q''(t)|, q'' the run from a start moved by 1e-12: what is not above that is no dependence
    turns    ten turns of a closed path: how far the joints are from where they were after the first
    noise    the task with encoders that are wrong by 0.1 mrad: largest error, variation of the joint velocities

A tick fails if the method raises, if its answer is not finite, or if the arm is further outside its limits after it.
"""

from __future__ import annotations

import numpy as np

from invariantqp.compare.measure.cell import Cell, Kind, Result, with_law
from invariantqp.compare.measure.displaced import displaced
from invariantqp.compare.measure.frames import largest_change, moved_start, random_displacement
from invariantqp.compare.measure.watched import Watched, figures, grown_errors, quietly, rested, watched_run
from invariantqp.compare.registry import controller_named
from invariantqp.runs.prepare import prepare
from invariantqp.runs.taskfile import load_task

# Displaced tool frames of a full run and of a quick one.
FRAMES, QUICK_FRAMES = 3, 1
# Targets out of reach, where frames matter most.
FRAME_TASKS = tuple(
    f"stability/{name}" for name in ("out_of_reach", "five_joints_out_of_reach", "reach_and_back", "ur5_elbow")
)
# What users meet first.
EVERYDAY = (
    "compare/stay",
    "compare/jump",
    "compare/turn",
    "stability/ur5_wrist",
    "compare/too_fast",
    "stability/reach_and_back",
    "compare/late",
)
TURNS, TURN_TASK, TURN_DT = 10, "compare/panda", 0.005
NOISE = 1e-4


def loops(cell: Cell) -> dict[str, Result]:
    """Errors, motion, failures and frame dependence of one method on one task."""
    task, make = cell.load(), controller_named(cell.method)
    setup = rested(prepare(task))
    law, trace = watched_run(setup, make)
    frames = range(QUICK_FRAMES if cell.quick else FRAMES)
    changes = []
    for k in frames:
        other = displaced(rested(prepare(task)), random_displacement(cell.seed + k))
        changes.append(largest_change(trace.q, watched_run(other, make)[1].q))
    control = largest_change(trace.q, watched_run(moved_start(task, setup), make)[1].q)
    return {cell.method: {**figures(law, trace), "frame": max(changes), "control": control}}


def everyday(cell: Cell) -> dict[str, Result]:
    """The figures of `loop`, how far errors grow beyond the target's jumps, and how far joints move; never quick."""
    setup = rested(prepare(load_task(cell.task)))
    law, trace = watched_run(setup, controller_named(cell.method))
    mm, deg = grown_errors(trace, setup.robot) * (1e3, np.degrees(1.0))
    moved = float(np.degrees(np.abs(trace.q - trace.q[0]).max()))
    found = {**figures(law, trace), "grown_mm": float(mm), "grown_deg": float(deg), "joints_deg": moved}
    return {cell.method: found}


def turns(cell: Cell) -> dict[str, Result]:
    """Joint drift over ten turns of the same closed path, with the posture and without."""
    found: Result = {}
    task = with_law(cell.load(), dt=TURN_DT)
    once = round(task.path.duration / TURN_DT)
    for name, posture in (("posture", True), ("none", False)):
        setup = prepare(with_law(task, posture=posture))
        law = Watched(controller_named(cell.method)(setup.robot, setup.brief.law))
        q, ends = task.start(), []
        with quietly():
            for _ in range(TURNS):
                for k in range(once):
                    target = setup.robot.target(setup.brief.poses[k])
                    q = q + TURN_DT * law.step(q, target, setup.brief.feedforward[k]).velocity
                ends.append(q)
        found[name] = {
            "last_turn": float(np.abs(ends[-1] - ends[-2]).max()),
            "all_turns": float(np.abs(ends[-1] - ends[0]).max()),
        }
    return {cell.method: found}


def noise(cell: Cell) -> dict[str, Result]:
    """The task with noisy encoders; the figures of `loop`."""
    task = cell.load().model_copy(update={"encoder_noise": NOISE})
    found = figures(*watched_run(prepare(task), controller_named(cell.method)))
    return {cell.method: {key: found[key] for key in ("position_mm", "orientation_deg", "variation", "acceleration")}}


KINDS = {
    "loop": Kind(loops),
    "beyond": Kind(loops, tasks=FRAME_TASKS),
    "everyday": Kind(everyday, tasks=EVERYDAY),
    "turns": Kind(turns, tasks=(TURN_TASK,), slow=True),
    "noise": Kind(noise, tasks=("compare/panda_limits", "compare/so101_limits"), slow=True),
}
