"""The comparison as tables: a row a method, a column a task, so that no figure mixes two arms."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Any, NamedTuple

from invariantqp.compare.method import CANNOT, OURS, SCALED_LEAST_SQUARES
from invariantqp.compare.results import Results, kinds_in, results_of
from invariantqp.geometry.arrays import NEGLIGIBLE

NOTHING = "-"
# A change of a joint position above this many times the control, and above rounding, is a dependence.
ABOVE_CONTROL = 100.0
# How reports call the tasks of a full run.
TASKS = {
    "compare/panda": "Panda",
    "compare/panda_limits": "Panda, limits met",
    "compare/ur5": "UR5",
    "compare/ur5_limits": "UR5, limits met",
    "so101_line": "SO-101",
    "compare/so101_limits": "SO-101, limits met",
    "stability/out_of_reach": "Panda, out of reach",
    "stability/five_joints_out_of_reach": "SO-101, out of reach",
    "stability/reach_and_back": "UR5, out of reach and back",
    "stability/ur5_elbow": "UR5, led beyond its reach",
}
# How the table of everyday tasks calls them.
EVERYDAY = {
    "compare/stay": "told to stay",
    "compare/jump": "a jump of 150 mm",
    "compare/turn": "turned in place by 45 deg",
    "stability/ur5_wrist": "through a singularity",
    "compare/too_fast": "a third too fast",
    "stability/reach_and_back": "out of reach and back",
    "compare/late": "12 ms late, 10 rad/s^2",
}
# What its cells are, and those of a run's motion.
EVERYDAY_CELLS = (
    "In each cell: largest position error [mm] · orientation error [deg], both beyond those that the target's own "
    "jump makes · joint acceleration after the first tick [rad/s^2] · settling time, to 1 mm and 1 deg, from when the "
    "target is at rest on [s]. joints: how far they move where they are to stay."
)
MOTION_CELLS = (
    "In each cell: largest joint acceleration after the first tick [rad/s^2] · settling time after the path, to 1 mm "
    "and 1 deg [s]."
)
STABILITY_CELLS = (
    "Where methods fail. not finite, raised: ticks; excess: the largest over a limit; largest, last: errors of the run "
    "[mm], [deg]; tail: largest joint speed in its last tenth [rad/s]; chatter: total variation of the velocity over "
    f"that of the {SCALED_LEAST_SQUARES}, which is given the same."
)


class Table(NamedTuple):
    """Rows of strings under the names of their columns; the first column names the row."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


def figure(value: float | None, style: str = "{:.2g}") -> str:
    """A figure as text without a power of ten where it has one to four digits; a dash for None."""
    if value is None or not isfinite(value):
        return NOTHING
    text = style.format(value)
    return f"{float(text):g}" if "e" in text and 1e-4 <= abs(value) < 1e5 else text


def title(task: str) -> str:
    """How reports call a task."""
    return TASKS.get(task, task)


def shown(results: Results) -> list[str]:
    """The methods of the first table, or all if it would have none."""
    return [m["name"] for m in results["methods"] if m["shown"]] or [m["name"] for m in results["methods"]]


def not_taken(method: dict[str, Any]) -> str:
    """What a method does not take of what every row is given."""
    takes = method["takes"]
    cannot = [f"no {key}" for key in ("posture", "exact") if takes[key] == CANNOT]
    return ", ".join([*cannot, *(["clips"] if takes["limits"] == "clipped" else [])]) or "all"


def depends(loop: dict[str, Any]) -> bool:
    """Whether another tool frame changes a run by more than rounding in its start does."""
    frame, control = loop.get("frame"), loop.get("control")
    return frame is None or frame > max(NEGLIGIBLE, ABOVE_CONTROL * (control or 0.0))


def summary(results: Results, names: Sequence[str] | None = None) -> Table:
    """Time [us], largest errors [mm] and [deg] of every task; and the largest change by another tool frame [rad].

    No rows where neither was measured.
    """
    loops, ticks = results_of(results, "loop"), results_of(results, "tick")
    if not loops and not ticks:
        return Table((), ())
    table = {m["name"]: m for m in results["methods"]}
    rows = []
    for name in shown(results) if names is None else names:
        cells = []
        for task in results["tasks"]:
            loop, tick = loops.get((task, name), {}), ticks.get((task, name), {})
            parts = [
                figure(tick.get("median_us")),
                figure(loop.get("position_mm")),
                figure(loop.get("orientation_deg")),
            ]
            cells.append(" · ".join(parts) if loop or tick else NOTHING)
        worst = worst_frame(results, name)
        rows.append([name, not_taken(table[name]), *cells, figure(worst, "{:.0e}")])
    return Table(["method", "takes", *map(title, results["tasks"]), "frame, rad"], rows)


def motion(results: Results) -> Table:
    """Largest joint acceleration [rad/s^2] and settling time [s] of every task; no rows where none was measured."""
    loops = results_of(results, "loop")
    if not loops:
        return Table((), ())
    rows = [[name, *(_moved(loops.get((task, name), {})) for task in results["tasks"])] for name in shown(results)]
    return Table(["method", *map(title, results["tasks"])], rows)


def everyday(results: Results) -> Table:
    """Errors [mm], [deg], largest joint acceleration [rad/s^2] and settling time [s] of what users meet first."""
    found = results_of(results, "everyday")
    tasks = [task for task in EVERYDAY if any(task == place for place, _ in found)]
    rows = []
    for name in shown(results):
        runs = [found.get((task, name), {}) for task in tasks]
        if any(runs):
            cells = [
                " · ".join((figure(run.get("grown_mm")), figure(run.get("grown_deg")), _moved(run))) for run in runs
            ]
            rows.append([name, *cells, figure(found.get(("compare/stay", name), {}).get("joints_deg"))])
    return Table(["method", *(EVERYDAY[task] for task in tasks), "joints, deg"], rows)


def stability(results: Results) -> Table:
    """How each method does where methods fail; no rows where that was not measured."""
    rows = []
    for kind in (kind for kind in kinds_in(results) if kind == "stability" or kind.startswith("NaN in ")):
        found = results_of(results, kind)
        for (task, name), run in found.items():
            case = task.removeprefix("stability/") + ("" if kind == "stability" else f", {kind}")
            ticks = (f"{round(run[key] * run['ticks']) or ''}" for key in ("not_finite", "raised"))
            excess = "" if kept_limits(run) else figure(run["excess"])
            errors = (figure(run[key]) for key in ("position_mm", "orientation_deg", "final_mm", "final_deg", "tail"))
            least = found.get((task, SCALED_LEAST_SQUARES), {}).get("variation")
            chatter = figure(run["variation"] / least if least and run["variation"] is not None else None)
            rows.append([case, name, *ticks, excess, figure(run["peak"], "{:.3f}"), *errors, chatter])
    heads = ("not finite", "raised", "excess", "peak/limit", "largest mm", "deg", "last mm", "deg", "tail", "chatter")
    return Table(("case", "method", *heads), rows)


def kept_limits(run: dict[str, Any]) -> bool:
    """Whether a run was always inside its limits."""
    return run["excess"] is not None and run["excess"] <= NEGLIGIBLE


def failed_stability(results: Results) -> list[str]:
    """The tasks in which ours was not always finite and inside its limits, or could not be run."""
    mine = [(cell["task"], cell["result"]) for cell in results["cells"] if cell["method"] == OURS]
    return [task for task, run in mine if "failed" in run or run["not_finite"] or not kept_limits(run)]


def _moved(run: dict[str, Any]) -> str:
    """Joint acceleration and settling time."""
    settled = "never" if "settling_s" in run and run["settling_s"] is None else figure(run.get("settling_s"))
    return f"{figure(run.get('acceleration'))} · {settled}"


def worst_frame(results: Results, name: str, kind: str = "loop") -> float | None:
    """The largest change of a joint position by another tool frame, over the tasks of a measurement [rad]."""
    found = [r["frame"] for (_, n), r in results_of(results, kind).items() if n == name and r["frame"] is not None]
    return max(found, default=None)


def information(results: Results) -> Table:
    """What each method makes of what every row is given."""
    keys = ("posture", "exact", "limits", "damping", "feedforward")
    rows = [(m["name"], m["why"], *(m["takes"][key] for key in keys)) for m in results["methods"]]
    return Table(("method", "what it is", *keys), rows)


def listed(results: Results, kind: str) -> Table:
    """Every number that a measurement found, one row for each task and method."""
    found = results_of(results, kind)
    keys = list(dict.fromkeys(key for result in found.values() for key in result))
    rows = [
        [method, title(task), *(figure(result.get(key), "{:.3g}") for key in keys)]
        for (task, method), result in found.items()
    ]
    return Table(("method", "task", *keys), rows)
