"""Methods as controllers: time of a tick against tracking error, and joint motion near singularities."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from invariantqp.compare.names import DLS, LEAST_SQUARES, LU, OURS, PINK_POSTURE
from invariantqp.compare.report.charts.scatter import Point, front, positive, scatter
from invariantqp.compare.report.charts.style import chart_file, percent
from invariantqp.compare.results import Results, results_of
from invariantqp.pictures.palette import SHADE

# Methods in captions.
TOLD = (OURS, LU, LEAST_SQUARES, PINK_POSTURE)
# Smaller errors are drawn at a nanometre [mm], smaller speeds and chatter at this value: the axes are logarithmic.
NANOMETRE = 1e-6
STILL = 1e-3
SHIPPED = (
    f"A tick computes pose, Jacobian, law and limits. {OURS} runs as it is shipped, with the exact rows of the task "
    "file, if any, and a posture for redundant joints, as does the least-squares QP that is told all; other methods "
    "have neither, except where their name says so."
)


def ticks(results: Results, task: str) -> list[Point]:
    """For each method the time of a tick and the 99th percentile of the position error [mm] in one task."""
    times, runs = results_of(results, "tick"), results_of(results, "closed_loop")
    found = []
    for method in results["methods"]:
        key = (task, method["name"])
        if key in times and key in runs:
            error = positive(runs[key]["position_mm"]["p99"], NANOMETRE)
            if error is not None:
                found.append(Point(method["name"], times[key]["median_us"], error))
    return found


def tick_chart(results: Results, file: Path) -> None:
    """Time of a tick against the tracking error, one panel for each task."""
    drawn = {task: found for task in results["tasks"] if (found := ticks(results, task))}
    with chart_file(file, max(1, len(drawn)), height=3.9 * max(1, len(drawn))) as (figure, panels):
        for axes, task in zip(panels[:, 0], drawn, strict=False):
            axes.set_title(task)
            axes.set_ylabel("position error, 99th percentile [mm]")
        panels[-1, 0].set_xlabel("time of one whole tick, median [us]")
        scatter(figure, panels[: len(drawn), 0], list(drawn.values()), results)


def tick_caption(results: Results) -> str:
    """The methods on the front of each task, and the errors of a few methods."""
    sentences = [SHIPPED]
    runs = results_of(results, "closed_loop")
    for task in results["tasks"]:
        edge = front(ticks(results, task))
        if not edge:
            continue
        names = "; ".join(f"{p.method} ({p.x:.0f} us, {p.y:.2g} mm)" for p in edge)
        text = f"{task}: on the Pareto front are {names}"
        listed = [f"{name} {_tracked(runs[task, name])}" for name in TOLD if (task, name) in runs]
        sentences.append(f"{text}; 99th percentiles of the errors: {'; '.join(listed)}." if listed else f"{text}.")
    return " ".join(sentences)


def _tracked(run: dict[str, Any]) -> str:
    return f"{run['position_mm']['p99']:.2g} mm and {run['orientation_deg']['p99']:.2g} deg"


def singular(results: Results) -> list[Point]:
    """For each method the largest chatter relative to the least-squares QP, and the largest speed over its limit."""
    runs = results_of(results, "singular")
    found = []
    for method in results["methods"]:
        mine = {task: run for (task, name), run in runs.items() if name == method["name"]}
        mine = {task: run for task, run in mine.items() if (task, LEAST_SQUARES) in runs and run["peak"] is not None}
        if mine:
            chatter = max(run["variation"] / runs[task, LEAST_SQUARES]["variation"] for task, run in mine.items())
            peak = max(run["peak"] for run in mine.values())
            found.append(Point(method["name"], max(chatter, STILL), max(peak, STILL)))
    return found


def singular_loops_chart(results: Results, file: Path) -> None:
    """Peak joint speed against chatter."""
    with chart_file(file, 1, height=5.2) as (figure, panels):
        axes = panels[0, 0]
        axes.set_xlabel("chatter: total variation of the joint velocity relative to the least-squares QP, worst run")
        axes.set_ylabel("peak joint speed / speed limit of the joint, worst run")
        axes.axhline(1.0, color=SHADE, linewidth=1.0, zorder=0)
        scatter(figure, [axes], [singular(results)], results)


def singular_loops_caption(results: Results) -> str:
    """Which methods stay below the speed limits without knowing them."""
    points = {p.method: p for p in singular(results)}
    tasks = sorted({task.removeprefix("stability/") for task, _ in results_of(results, "singular")})
    below = [name for name, p in points.items() if p.y <= 1.0]
    runs = f"Runs through singularities ({', '.join(tasks)}) in which no method knows the speed limits of the joints"
    sentences = [f"{runs}; {len(below)} of {len(points)} methods stay below them nevertheless."]
    sentences += [
        f"{name}: {points[name].y:.3g} times the limit, chatter {points[name].x:.3g}."
        for name in (OURS, LU, DLS, LEAST_SQUARES)
        if name in points
    ]
    return " ".join(sentences)


def failed(results: Results) -> dict[str, dict[str, float]]:
    """For each method the mean share of failed ticks over the difficult runs, by cause: raised, not_finite, outside."""
    runs = results_of(results, "hard")
    found = {}
    for method in results["methods"]:
        mine = [run for (_, name), run in runs.items() if name == method["name"]]
        if mine:
            found[method["name"]] = {
                way: float(np.mean([run[way] for run in mine])) for way in ("raised", "not_finite", "outside")
            }
    return found


def failed_caption(results: Results) -> str:
    """Which method fails most often, and which ones never fail."""
    shares = {name: sum(ways.values()) for name, ways in failed(results).items()}
    never = [name for name, share in shares.items() if share == 0.0]
    runs = sorted({task.removeprefix("stability/") for task, _ in results_of(results, "hard")})
    text = (
        f"Share of ticks in {', '.join(runs)} in which a method raised an exception, gave a velocity that is not "
        f"finite, or moved the arm further outside its limits. It is zero for {len(never)} of {len(shares)} methods "
        "(methods that do not know the limits are clipped to them)."
    )
    if never != list(shares):
        worst = max(shares, key=lambda name: shares[name])
        text += f" Most: {worst}, {percent(shares[worst])}."
    if OURS in shares:
        text += f" {OURS}: {percent(shares[OURS])}."
    return text
