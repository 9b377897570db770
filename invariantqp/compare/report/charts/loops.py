"""Methods as controllers: what a tick costs against what it tracks, and what singularities do to the joints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from invariantqp.compare.laws.invariant import OURS
from invariantqp.compare.measure.stability import YARDSTICK
from invariantqp.compare.report.charts.scatter import Point, front, positive, scatter
from invariantqp.compare.report.charts.style import chart, percent
from invariantqp.compare.report.findings import LU
from invariantqp.compare.results import Results, picked

# Methods that captions tell of.
TOLD = (OURS, LU, YARDSTICK, "Pink, posture")
# Errors below a nanometre are drawn there.
NANOMETRE = 1e-6
# Speeds over limit and chatter below this are drawn there.
STILL = 1e-3
SHIPPED = (
    f"A tick is pose, Jacobian, law and limits. {OURS} runs as shipped: with what the task file asks (a point met "
    "exactly, where it does) and a posture for joints to spare; single laws have neither, and cannot be told."
)


def ticks(results: Results, task: str) -> list[Point]:
    """Every method's time of a tick and the 99th percentile of its tracking error [mm] in one task."""
    times, runs = picked(results, "tick"), picked(results, "closed_loop")
    found = []
    for method in results["methods"]:
        key = (task, method["name"])
        if key in times and key in runs:
            error = positive(runs[key]["position_mm"]["p99"], NANOMETRE)
            if error is not None:
                found.append(Point(method["name"], times[key]["median_us"], error))
    return found


def tick_chart(results: Results, file: Path) -> None:
    """Time of a tick against the tracking error, task by task."""
    drawn = {task: found for task in results["tasks"] if (found := ticks(results, task))}
    with chart(file, len(drawn), height=3.9 * len(drawn)) as (figure, panels):
        for axes, task in zip(panels[:, 0], drawn, strict=True):
            axes.set_title(task)
            axes.set_ylabel("position error, 99th percentile [mm]")
        panels[-1, 0].set_xlabel("time of one whole tick, median [us]")
        scatter(figure, panels[:, 0], list(drawn.values()), results)


def tick_caption(results: Results) -> str:
    """Who is on the front of each task, and what else the runs say about ours and Moore-Penrose."""
    said = [SHIPPED]
    runs = picked(results, "closed_loop")
    for task in results["tasks"]:
        edge = front(ticks(results, task))
        if not edge:
            continue
        names = ", ".join(f"{p.method} ({p.x:.0f} us, {p.y:.2g} mm)" for p in edge)
        text = f"{task}: no method is both faster and nearer than {names}"
        listed = [f"{name} {_tracked(runs[task, name])}" for name in TOLD if (task, name) in runs]
        said.append(f"{text}; 99th percentiles: {'; '.join(listed)}." if listed else f"{text}.")
    return " ".join(said)


def _tracked(run: dict[str, Any]) -> str:
    return f"{run['position_mm']['p99']:.2g} mm and {run['orientation_deg']['p99']:.2g} deg"


def singular(results: Results) -> list[Point]:
    """Every method's worst chatter (over the least-squares QP's) and worst peak speed over the limit."""
    runs = picked(results, "singular")
    found = []
    for method in results["methods"]:
        mine = {task: run for (task, name), run in runs.items() if name == method["name"]}
        mine = {task: run for task, run in mine.items() if (task, YARDSTICK) in runs and run["peak"] is not None}
        if mine:
            chatter = max(run["variation"] / runs[task, YARDSTICK]["variation"] for task, run in mine.items())
            peak = max(run["peak"] for run in mine.values())
            found.append(Point(method["name"], max(chatter, STILL), max(peak, STILL)))
    return found


def singular_loops_chart(results: Results, file: Path) -> None:
    """Peak joint speed against chatter."""
    with chart(file, 1, height=5.2) as (figure, panels):
        axes = panels[0, 0]
        axes.set_xlabel("chatter: total variation of the joint velocity over the least-squares QP's, worst run")
        axes.set_ylabel("peak joint speed / limit of the joint, worst run")
        axes.axhline(1.0, color="#999999", linewidth=1.0, zorder=0)
        scatter(figure, [axes], [singular(results)], results)


def singular_loops_caption(results: Results) -> str:
    """Whose joints stay below their limits without being told of them."""
    points = {p.method: p for p in singular(results)}
    tasks = sorted({task.removeprefix("stability/") for task, _ in picked(results, "singular")})
    below = [name for name, p in points.items() if p.y <= 1.0]
    runs = f"Runs through singularities ({', '.join(tasks)}) by arms whose speed limits no method was told of"
    said = [f"{runs}; {len(below)} of {len(points)} stay below them all the same."]
    said += [
        f"{name}: {points[name].y:.3g} times the limit, chatter {points[name].x:.3g}."
        for name in (OURS, LU, "DLS", YARDSTICK)
        if name in points
    ]
    return " ".join(said)


def failed(results: Results) -> dict[str, dict[str, float]]:
    """Every method's shares of failed ticks, means over the hard runs: raised, not_finite, outside."""
    runs = picked(results, "hard")
    found = {}
    for method in results["methods"]:
        mine = [run for (_, name), run in runs.items() if name == method["name"]]
        if mine:
            found[method["name"]] = {
                way: float(np.mean([run[way] for run in mine])) for way in ("raised", "not_finite", "outside")
            }
    return found


def failed_caption(results: Results) -> str:
    """Who failed most, and who never."""
    shares = {name: sum(ways.values()) for name, ways in failed(results).items()}
    never = [name for name, share in shares.items() if share == 0.0]
    runs = sorted({task.removeprefix("stability/") for task, _ in picked(results, "hard")})
    text = f"Share of ticks in {', '.join(runs)} in which a law raised, answered NaN or infinity, or left its limits"
    text += f" further: none for {len(never)} of {len(shares)} methods"
    text += " (Moore-Penrose and its like are clipped by the loop around them)."
    if never != list(shares):
        worst = max(shares, key=lambda name: shares[name])
        text += f" Most: {worst}, {percent(shares[worst])}."
    if OURS in shares:
        text += f" {OURS}: {percent(shares[OURS])}."
    return text
