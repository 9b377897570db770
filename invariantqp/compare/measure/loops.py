"""Every method as a controller: how far off it is, how the joints move, and what another tool frame changes.

    loop     the task as it is: largest errors of the run, jumps of the joint velocity, failed ticks, limits met
    frame    max |q(t) - q'(t)|, q' the same motion asked of a tool frame put elsewhere on the tool; and beside it
             max |q(t) - q''(t)|, q'' the run from a start moved by 1e-12: what is not above that is no dependence
    turns    ten turns of a closed path: how far the joints are from where they were after the first
    noise    the task with encoders that are wrong by 0.1 mrad: largest error, variation of the joint velocities

A tick fails if the method raises, if its answer is not finite, or if the arm is further outside its limits after it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from invariantqp.compare.measure.cell import Cell, Kind, Result, with_law
from invariantqp.compare.measure.displaced import displaced
from invariantqp.compare.measure.frames import largest_change, moved_start, random_displacement
from invariantqp.compare.measure.stability import INSIDE, Watched, quietly
from invariantqp.compare.registry import controller_named
from invariantqp.runs.pilots import pilot_of
from invariantqp.runs.prepare import Setup, prepare
from invariantqp.runs.run import run
from invariantqp.runs.trace import Trace

# Displaced tool frames of a full run and of a quick one.
FRAMES, QUICK_FRAMES = 3, 1
# A joint closer than this to a position limit, or this share of its speed below the largest, is at its limit.
AT_LIMIT = 1e-9
# Targets out of reach, where frames matter most.
FRAME_TASKS = tuple(
    f"stability/{name}" for name in ("out_of_reach", "five_joints_out_of_reach", "reach_and_back", "ur5_elbow")
)
TURNS, TURN_TASK, TURN_DT = 10, "compare/panda", 0.005
NOISE = 1e-4


def run_of(setup: Setup, method: str) -> tuple[Watched, Trace]:
    """A run under a method whose arm stops for a tick that fails."""
    law = Watched(controller_named(method)(setup.brief.robot, setup.brief.law))
    with quietly():
        return law, run(setup, pilot_of(setup.brief, lambda *_: law))


def loops(cell: Cell) -> dict[str, Result]:
    """Errors, motion, failures and frame dependence of one method on one task."""
    task = cell.load()
    setup = prepare(task)
    law, trace = run_of(setup, cell.method)
    frames = range(QUICK_FRAMES if cell.quick else FRAMES)
    changes = []
    for k in frames:
        other = displaced(prepare(task), random_displacement(cell.seed + k))
        changes.append(largest_change(trace.q, run_of(other, cell.method)[1].q))
    control = largest_change(trace.q, run_of(moved_start(task, setup), cell.method)[1].q)
    return {cell.method: {**figures(law, trace), "frame": max(changes), "control": control}}


def figures(law: Watched, trace: Trace) -> Result:
    """What a run is judged by."""
    low, high = trace.position_limits
    speed, ticks = np.abs(trace.velocity), len(trace.velocity)
    at_speed = speed >= trace.velocity_limit * (1.0 - AT_LIMIT)
    at_end = (trace.q[1:] <= low + AT_LIMIT) | (trace.q[1:] >= high - AT_LIMIT)
    outside = np.maximum(np.maximum(low - trace.q, trace.q - high), 0.0)
    left = (np.diff(outside, axis=0) > INSIDE) | (speed - trace.velocity_limit > INSIDE)
    jumps = np.abs(np.diff(trace.velocity, axis=0))
    ways: dict[str, Any] = {
        "raised": law.exceptions / ticks,
        "not_finite": law.not_finite / ticks,
        "outside": float(left.any(axis=1).mean()),
    }
    return {
        "position_mm": 1e3 * float(trace.position_error.max()),
        "orientation_deg": float(np.degrees(trace.orientation_error.max())),
        "final_mm": 1e3 * float(trace.position_error[-1]),
        "limits_met": float((at_speed | at_end).any(axis=1).mean()),
        "jump": float(jumps.max()),
        "variation": float(jumps.sum()),
        "ticks": ticks,
        **ways,
        "failed_ticks": sum(ways.values()),
    }


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
    found = figures(*run_of(prepare(task), cell.method))
    return {cell.method: {key: found[key] for key in ("position_mm", "orientation_deg", "variation", "jump")}}


KINDS = {
    "loop": Kind(loops),
    "beyond": Kind(loops, tasks=FRAME_TASKS),
    "turns": Kind(turns, tasks=(TURN_TASK,), slow=True),
    "noise": Kind(noise, tasks=("panda_path", "compare/so101_limits"), slow=True),
}
