"""Tables of a comparison, a row for each method or task."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from math import exp, isfinite, log
from typing import Any, NamedTuple

from invariantqp.workbench.compare.figures import (
    BETTER,
    CHANGES,
    FLOORS,
    WORSE,
    Figures,
    compared,
    dominates,
    is_motionless,
)
from invariantqp.workbench.compare.method import OURS
from invariantqp.workbench.compare.results import Results, TaskRuns, failures, measured, tick_us
from invariantqp.workbench.compare.tasks import KINDS, OTHER_FRAME

NOTHING, ROUNDING, NEGLIGIBLE = "-", 1e-12, 1e-7
RULE = (
    "Method A dominates B on a task if A raised no exception, violated no limit and did not stay motionless; none of "
    "five figures (largest position and orientation error, largest and rms joint acceleration, settling time) is more "
    f"than {100 * (WORSE - 1):.0f} % worse, and at least one is {100 * (BETTER - 1):.0f} % better. Values below "
    f"{FLOORS['mm']:g} mm, {FLOORS['deg']:g} deg, {FLOORS['acceleration']:g} and {FLOORS['acceleration_rms']:g} "
    f"rad/s^2 and {FLOORS['settling']:g} s count as these. frame: the largest change of a joint position when the same "
    "motion is asked of a tool frame elsewhere on the tool; unit: in millimetres."
)
CELLS = (
    "In each cell: largest position error [mm] · largest orientation error [deg] · largest joint acceleration "
    "[rad/s^2], geometric means over arms · longest settling time, to 1 mm and 1 deg [s]."
)


COMPARED = "mm · deg · rad/s^2 · rms rad/s^2 · s until settled"
# The columns of the table of stability, and the kinds of tasks that they are made of.
WHERE_METHODS_FAIL = {
    "beyond a limit at the start": ("outside",),
    "limits that contradict each other": ("accelerations",),
    "singular": ("singular",),
    "out of reach": ("out of reach",),
    "late": ("stale", "jitter"),
    "NaN": ("NaN",),
    "at a principal pitch": ("principal pitch",),
    **{kind: (kind,) for kind in CHANGES},
}
OUTCOMES = (
    "In each cell, first what is worst: the run failed; the method raised an exception, or its answer was not finite; "
    "it violated a limit; the arm stood still off its target; it did not come back to 1 mm and 1 deg where another "
    "method does. Then the largest joint acceleration [rad/s^2] and position error [mm], geometric means over the "
    "runs that did not fail. Where the same motion is told otherwise: the largest change of a joint position [rad]."
)


class Table(NamedTuple):
    """Rows of strings; the first column names the row."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


def figure(value: float | None, style: str = "{:.2g}") -> str:
    """A figure as text, without an exponent from 1e-4 to 1e5; a dash for None and NaN."""
    if value is None or not isfinite(value):
        return NOTHING
    text = style.format(value)
    return f"{float(text):g}" if "e" in text and 1e-4 <= abs(value) < 1e5 else text


def names_of(results: Results) -> list[str]:
    """The names of the methods."""
    return [method["name"] for method in results["methods"]]


def summary(results: Results) -> Table:
    """Every method: tick times, dominance, exceptions, limit violations, change in another tool frame."""
    tasks = measured(results)
    failed = failures(results)
    rows = []
    for name in names_of(results):
        runs = [(task, task.runs[name]) for task in tasks if name in task.runs]
        counted = [(task, run) for task, run in runs if task.is_compared]
        both = [(run, task.runs[OURS]) for task, run in counted if OURS in task.runs and name != OURS]
        over, under = sum(dominates(a, b) for a, b in both), sum(dominates(b, a) for a, b in both)
        by_any = sum(bool(task.dominating(name)) for task, _ in counted)
        times = (figure(value, "{:.3g}") for value in tick_us(tasks, name))
        raised = sum(run["exceptions"] > 0 for _, run in runs) + sum(method == name for method, _, _ in failed)
        left = sum(run["violations"] > 0 for _, run in runs)
        against = [NOTHING, NOTHING] if name == OURS else [str(over), str(under)]
        changes = [figure(change(tasks, name, kind), "{:.0e}") for kind in CHANGES]
        rows.append([name, *times, *against, f"{by_any} of {len(counted)}", str(raised), str(left), *changes])
    heads = ("dominates ours", "ours dominates", "dominated by any", "exceptions", "limit violations")
    return Table(("method", "tick us", "p99", *heads, "frame, rad", "unit, rad"), rows)


def by_kind(results: Results, kinds: Sequence[str] | None = None) -> Table:
    """Errors, accelerations and settling times of every method, a column for each kind of task."""
    tasks = measured(results)
    present = list(dict.fromkeys(task.kind for task in tasks))
    columns = [kind for kind in present if kinds is None or kind in kinds]
    rows = []
    for name in names_of(results):
        cells = [[t.runs[name] for t in tasks if t.kind == kind and name in t.runs] for kind in columns]
        rows.append([name, *map(cell, cells)])
    return Table(("method", *columns), rows if columns else ())


def cell(runs: Sequence[Figures]) -> str:
    """The cell of some runs, as CELLS says."""
    if not runs:
        return NOTHING
    means = [mean(runs, key) for key in ("mm", "deg", "acceleration")]
    return " · ".join([*means, settling([run["settling"] for run in runs])])


def mean(runs: Sequence[Figures], key: str) -> str:
    """The geometric mean of a figure as text; zero is what is below NEGLIGIBLE."""
    value = geometric_mean([run[key] for run in runs], 0.0)
    return figure(value) if value > NEGLIGIBLE else "0"


def geometric_mean(values: Sequence[float], least: float) -> float:
    """The geometric mean of values, none below `least` nor below rounding."""
    return exp(sum(log(max(value, least, ROUNDING)) for value in values) / len(values))


def settling(times: Sequence[float | None]) -> str:
    """The longest settling time [s]; "never" if one is None."""
    return "never" if None in times else figure(max(time for time in times if time is not None))


def losses(results: Results) -> Table:
    """The tasks in which methods dominate ours, worst first: by the largest ratio of a figure to that of the best."""
    found = []
    for task in measured(results):
        by = {name: ratio(task, name) for name in task.dominating(OURS)} if OURS in task.runs else {}
        if by:
            best = max(by, key=by.__getitem__)
            found.append((by[best], [task.name, one(task, OURS), f"{best}: {one(task, best)}", ", ".join(by)]))
    rows = [[*row[:3], figure(worst), row[3]] for worst, row in sorted(found, key=lambda pair: -pair[0])]
    return Table(("task", OURS, "the best of these", "ratio", "dominated by"), rows)


def ratio(task: TaskRuns, name: str) -> float:
    """The largest ratio of a compared figure of ours to that of a method."""
    pairs = zip(compared(task.runs[OURS]), compared(task.runs[name]), strict=True)
    return max(ours / theirs for ours, theirs in pairs)


def stability(results: Results) -> Table:
    """What each method does where methods fail, as OUTCOMES says."""
    tasks = measured(results)
    failed = {(name, task) for name, task, _ in failures(results)}
    columns = [c for c, names in WHERE_METHODS_FAIL.items() if any(task.kind in names for task in tasks)]
    rows = []
    for name in names_of(results):
        cells = []
        for column in columns:
            here = [task for task in tasks if task.kind in WHERE_METHODS_FAIL[column]]
            moved = change(here, name, column) if column in CHANGES else None
            count = sum((name, task.name) in failed for task in here)
            cells.append(outcome(here, name, count) if moved is None else figure(moved, "{:.0e}"))
        rows.append([name, *cells])
    return Table(("method", *columns), rows if columns else ())


def outcome(tasks: Sequence[TaskRuns], name: str, failed: int) -> str:
    """The cell of a method: its worst outcome in words and in how many tasks, and its figures."""
    pairs = [(task, task.runs[name]) for task in tasks if name in task.runs]
    if not pairs and not failed:
        return NOTHING
    words = {
        "fails": failed,
        "raises": sum(run["exceptions"] > 0 for _, run in pairs),
        "over limits": sum(run["violations"] > 0 for _, run in pairs),
        "stands still": sum(is_motionless(run) for _, run in pairs),
        "not back": sum(
            run["settling"] is None and any(other["settling"] is not None for other in task.runs.values())
            for task, run in pairs
        ),
    }
    worst = next((f"{word} {count}/{len(pairs) + failed}; " for word, count in words.items() if count), "")
    if not pairs:
        return worst.removesuffix("; ")
    return worst + " · ".join(mean([run for _, run in pairs], key) for key in ("acceleration", "mm"))


def lost_kinds(results: Results) -> Table:
    """The kinds of tasks in which methods dominate ours: how many tasks, and which methods most often."""
    rows = []
    tasks = [task for task in measured(results) if OURS in task.runs and task.is_compared]
    for kind in dict.fromkeys(task.kind for task in tasks):
        found = [task.dominating(OURS) for task in tasks if task.kind == kind]
        names = Counter(name for by in found for name in by)
        if names:
            most = ", ".join(f"{name} ({count})" for name, count in names.most_common(3))
            rows.append([kind, f"{sum(map(bool, found))} of {len(found)}", most])
    return Table(("kind of task", "tasks", "by, most often"), rows)


def one(task: TaskRuns, name: str) -> str:
    """The compared figures of a run."""
    run = task.runs[name]
    values = [figure(run[key]) for key in ("mm", "deg", "acceleration", "acceleration_rms")]
    return " · ".join([*values, settling([run["settling"]])])


def kinds(results: Results) -> Table:
    """The kinds of tasks and their number."""
    present = [task["kind"] for task in results["tasks"]]
    return Table(
        ("kind", "what it is", "tasks"),
        [(kind, about, str(present.count(kind))) for kind, (about, _) in KINDS.items() if kind in present],
    )


def settings(results: Results) -> Table:
    """The methods and how they use what all are given."""
    keys = ("posture", "limits", "damping", "feedforward", "point")
    rows = [(m["name"], m["about"], *(m["setting"][key] for key in keys)) for m in results["methods"]]
    return Table(("method", "what it is", *keys), rows)


def listed(results: Results) -> Table:
    """Every figure of every run."""
    runs = [run for run in results["runs"] if "failed" not in run["figures"]]
    keys = list(dict.fromkeys(key for run in runs for key in run["figures"] if key != "why"))
    rows = [(run["task"], run["method"], *(figure(run["figures"].get(key), "{:.3g}") for key in keys)) for run in runs]
    return Table(("task", "method", *keys), rows)


def change(tasks: Sequence[TaskRuns], name: str, kind: str = OTHER_FRAME) -> float | None:
    """The largest change of a joint position in another tool frame, or unit [rad]; None of an arm that stood still."""
    runs = [task.runs[name] for task in tasks if name in task.runs and not is_motionless(task.runs[name])]
    found: list[Any] = [run.get(CHANGES[kind]) for run in runs]
    return max((value for value in found if value is not None), default=None)


def broken_promises(results: Results) -> list[str]:
    """Failures of our law, task by task: an exception, a violated limit, no measurement."""
    found = []
    for run in results["runs"]:
        figures = run["figures"]
        if run["method"] == OURS and "failed" in figures:
            found.append(f"{run['task']}: {OURS} could not be measured: {figures['failed']}")
        elif run["method"] == OURS and (figures["violations"] or figures["exceptions"]):
            found.append(f"{run['task']}: {OURS} violated a limit, raised or returned a velocity that is not finite")
    return found
