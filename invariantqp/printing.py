"""What the commands print: tables and sentences on standard output, progress and errors on standard error."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from math import degrees
from textwrap import fill
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from invariantqp.errors import install_command
from invariantqp.progress import Progress

if TYPE_CHECKING:
    from pathlib import Path

    from invariantqp.analysis.inspection import Inspection
    from invariantqp.compare.stability import StabilityOutcome
    from invariantqp.control.clearance import Clearance
    from invariantqp.geometry.arrays import Array
    from invariantqp.identification.candidate import Candidate
    from invariantqp.identification.identify import Identification
    from invariantqp.runs.taskfile import Task
    from invariantqp.runs.trace import PathTrace, Trace

# Width of paragraphs where no terminal says how wide it is.
PLAIN_WIDTH = 100
# Width of tables there.
WIDEST = 180
# A pitch above this many lengths a radian is a slide, one below its inverse a turn, in words.
FLAT = 1e3
# How many times a progress bar is drawn.
STEPS = 200


def say(sentence: str, *, style: str | None = None) -> None:
    """Print on standard error what is not a result."""
    Console(stderr=True, highlight=False, soft_wrap=True).print(sentence, style=style, markup=False)


@contextmanager
def progress(what: str, quiet: bool) -> Iterator[Progress | None]:
    """A progress bar on standard error; nothing at all when quiet or when nobody watches."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    from rich import progress as bars

    with bars.Progress(
        bars.TextColumn(what),
        bars.BarColumn(),
        bars.TextColumn("{task.percentage:3.0f} %"),
        bars.TimeRemainingColumn(),
        console=console,
    ) as bar:
        job = bar.add_task(what, total=None)

        def report(done: int, total: int) -> None:
            if done % max(1, total // STEPS) == 0 or done == total:
                bar.update(job, completed=done, total=total)

        yield report


def print_run(trace: Trace) -> None:
    """A run's figures, and whether it is accepted."""
    figures = trace.summary()
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"[bold]{escape(figures['task'])}[/bold]  {escape(trace.task.about)}")
    table = Table("", "median", "p99", "max", box=None)
    for label, key, form in (
        ("position error, mm", "position_error_mm", "{:.2g}"),
        ("orientation error, deg", "orientation_error_deg", "{:.2g}"),
        ("time of a tick, us", "tick_us", "{:.1f}"),
    ):
        spread = figures[key]
        table.add_row(label, *(form.format(spread[k]) for k in ("median", "p99", "max")))
    console.print(table)
    for line in _run_lines(trace, figures):
        console.print(line)


def _run_lines(trace: Trace, figures: dict[str, Any]) -> Iterator[str]:
    if figures["physics"] != "ideal":
        yield f"physics: {figures['physics']}"
    read = figures["force_error_relative_rms_measured"]
    if read is not None:
        error = (
            f"{_percent(trace.force_error or 0.0)} rms of the wanted force, {_percent(read)} as the controller read it"
        )
        yield f"force error: {error}; counted from {trace.time[trace.counted_from]:g} s on, after contact has settled"
    if trace.along is not None:
        yield from _path_lines(trace.along, figures)
    yield f"{figures['ticks']} ticks; a limit was active in {_percent(figures['limits_active'])} of them"
    speed, acceleration = figures["peak_speed"], figures["peak_acceleration"]
    yield (
        f"largest joint speed: {speed:.3g}, acceleration: {acceleration:.3g}, counted from rest "
        "(rad/s, rad/s^2; of a slide m/s, m/s^2)"
    )
    yield f"largest excess over a limit: {figures['limit_violation']:.1e} (SI units)"
    if figures["form"]:
        yield f"attempted of a twist beyond the joints: by the {figures['form']}"
    yield f"methods: {_shares(figures['methods'])}; statuses: {_shares(figures['statuses'])}"
    for warning in figures["warnings"]:
        yield f"[yellow]note:[/yellow] {escape(warning)}"
    yield "[green]accepted[/green]" if figures["passed"] else "[red]not accepted[/red]"


def _path_lines(along: PathTrace, figures: dict[str, Any]) -> Iterator[str]:
    end = "arrived" if along.status == "done" else "stopped"
    yield (
        f"path: {end} {figures['path_lag']:.3g} s late; speed along it {figures['path_speed']['median']:.2g} of its "
        f"timing's in the median, {along.driven.min():.2g} to {along.driven.max():.2g}"
    )
    slowed = ", ".join(f"{name} {_percent(share)}" for name, share in along.slowed.items())
    yield f"slowed down by: {slowed or 'nothing'}"


def print_inspection(found: Inspection) -> None:
    """An arm in words: the state asked for, its joint range, and the pitch to split twists by."""
    console = Console(highlight=False, soft_wrap=True)
    width = console.width if console.is_terminal else PLAIN_WIDTH
    advice = found.recommended
    use = (
        f"no form; for splits the pitch h = {advice.h:g}"
        if advice.h is not None
        else "no form, and no pitch for splits"
    )
    console.print(f"[bold]{escape(found.robot)}[/bold], {len(found.joints)} joints to {escape(found.tool)}")
    for title, words in (
        (f"{found.where}, q = ({', '.join(f'{x:.4g}' for x in found.q)})", found.state_words()),
        (f"over the joint range, {len(found.survey.q)} states", found.range_words()),
        (f"recommended: {use}", (advice.reason,)),
    ):
        console.print(f"\n[bold]{title}[/bold]")
        for sentence in words:
            paragraph = fill(sentence, width, initial_indent="  ", subsequent_indent="  ")
            console.print(paragraph, markup=False)


def print_clearance(kept: Clearance) -> None:
    """Which links a clearance keeps apart, and which it does not, with the reason."""
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"\n[bold]clearance: {len(kept.pairs)} pairs of links are kept apart[/bold]")
    for name in dict.fromkeys(first for first, _ in kept.pairs):
        others = ", ".join(second for first, second in kept.pairs if first == name)
        console.print(f"  {name} from {others}", markup=False)
    console.print(f"\n[bold]{len(kept.dropped)} are not[/bold]")
    reasons = dict.fromkeys(dropped.reason for dropped in kept.dropped)
    for reason in reasons:
        pairs = ", ".join(f"{one} and {other}" for one, other, why in kept.dropped if why == reason)
        console.print(f"  {reason}: {pairs}", markup=False)


def print_frame_check(task: Task, seed: int) -> None:
    """How much another tool frame changes a run under each law."""
    from invariantqp.compare.frames import frame_check

    with progress("displacing the tool frame", quiet=False) as report:
        checks = frame_check(task, seed, report)
    table = Table("law", "change of joint positions, rad", "start moved by 1e-12", "largest error, mm", box=None)
    for check in checks:
        table.add_row(check.law, f"{check.change:.1e}", f"{check.control:.1e}", f"{check.worst_error_mm:.2g}")
    console = Console(highlight=False)
    console.print("\nThe same motion of the tool, asked of a tool frame displaced at random:")
    console.print(table)


def print_contact_frame_check(task: Task, seed: int, physics: str) -> None:
    """How much other frames of tool, sensor and contact change a run under each controller."""
    from invariantqp.compare.frames import contact_frame_check

    with progress("displacing frames", quiet=False) as report:
        checks = contact_frame_check(task, seed, physics, report)
    told = ("path error, mm", "in displaced frames", "force error", "in displaced frames")
    columns = ("law", "change of joint velocities, rad/s", *told)
    table = Table(*columns, box=None)
    for c in checks:
        errors = (f"{c.error_mm:.2g}", f"{c.displaced_error_mm:.2g}")
        forces = (_percent(f or 0.0) for f in (c.force_error, c.displaced_force_error))
        table.add_row(c.law, f"{c.change:.1e}", *errors, *forces)
    console = Console(highlight=False)
    console.print("\nThe same task, with the frames of tool, sensor and contact displaced at random:")
    console.print(table)


def print_not_installed(missing: dict[str, list[str]]) -> None:
    """What a comparison will leave out, on standard error, and how to install it; {extra: names}."""
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    for extra, names in missing.items():
        listed = "; ".join(names)
        console.print(f"not installed, so left out: {listed}. Run: {install_command(extra)}", markup=False)


def print_stability(outcomes: list[StabilityOutcome]) -> None:
    """A table of how each law did in each difficult case, with failures in red."""
    table = Table(box=None)
    before = ""
    for run in outcomes:
        row = (
            ("case", "" if run.case == before else escape(run.case)),
            ("law", escape(run.law)),
            ("finite", "yes" if run.finite else f"[red]no: {run.not_finite}[/red]"),
            ("inside limits", "yes" if run.inside else f"[red]{run.excess:.1e}[/red]"),
            ("peak/limit", f"{run.peak:.3f}"),
            ("largest mm", f"{run.largest_mm:.3g}"),
            ("deg", f"{run.largest_deg:.3g}"),
            ("last mm", f"{run.error_mm:.3g}"),
            ("deg", f"{run.error_deg:.3g}"),
            ("tail rad/s", f"{run.tail:.1e}"),
            ("chatter", f"{run.chatter:.2f}"),
            ("raised", f"{run.exceptions}" if run.exceptions else ""),
        )
        if not table.columns:
            for heading, _ in row:
                table.add_column(heading)
        table.add_row(*(cell for _, cell in row))
        before = run.case
    console = Console(highlight=False, width=None if Console().is_terminal else WIDEST)
    console.print(table)
    console.print(
        "finite: number of ticks without a finite answer; inside limits: largest excess over a limit; largest, last: "
        "errors of the run; tail: largest joint speed in its last tenth; chatter: total variation of the velocity "
        "relative to the least-squares QP that is told the same; raised: number of ticks in which the law raised."
    )


def print_comparison(results: dict[str, Any], files: list[Path], agreement: dict[str, float] | None) -> None:
    """The tables of a comparison, its verdict, and the files that were written."""
    from invariantqp.compare.results import kinds_in
    from invariantqp.compare.tables import EVERYDAY_CELLS, everyday, summary
    from invariantqp.compare.verdict import short

    console = Console(highlight=False, width=None if Console().is_terminal else WIDEST)
    parts = [(summary(results), "")] if {"loop", "tick"} & kinds_in(results) else []
    if "everyday" in kinds_in(results):
        parts.append((everyday(results), EVERYDAY_CELLS.replace("*", "")))
    for found, cells in parts:
        table = Table(*found.columns, box=None)
        for row in found.rows:
            table.add_row(*(escape(cell) for cell in row))
        console.print(table)
        if cells:
            console.print(cells, markup=False)
    for sentence in short(results):
        console.print(f"- {sentence}", markup=False)
    failed = sum("failed" in cell["result"] for cell in results["cells"])
    if failed:
        console.print(f"{failed} of {len(results['cells'])} measurements failed: the report says why.")
    for place, rho in (agreement or {}).items():
        console.print(f"ranks by time, {place}: Spearman {rho:.3f}", markup=False)
    console.print(f"written: {', '.join(str(file) for file in files)}", markup=False)


def _shares(counts: dict[str, Any]) -> str:
    return ", ".join(f"{name} {_percent(share)}" for name, share in sorted(counts.items(), key=lambda i: -i[1]))


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"


def print_identification(found: Identification, name: str, time: Array) -> None:
    """Which contact a recording shows, where it is, and what it leaves open."""
    console = Console(highlight=False, soft_wrap=True)
    for part in found.segments:
        told = f"[bold]{part.kind}[/bold]" if part.kind else "[bold]not told[/bold]"
        console.print(f"{escape(name)}, {time[part.start]:.2f} to {time[part.stop - 1]:.2f} s: {told}")
        if part.reason:
            console.print(fill(f"{part.reason}.", PLAIN_WIDTH), markup=False)
        table = Table("kind", "surface on", "type", "misfit", "where", box=None)
        for c in part.candidates:
            misfit = f"{max(c.misfit, c.wrench_misfit):.2f}"
            table.add_row(c.kind, c.fixed_to, c.gibson_hunt, misfit, "; ".join(_places(c)))
        if part.candidates:
            console.print(table)
        for twist in part.unexcited.T:
            console.print(f"never tried: {_motion(twist)}", markup=False)
        for kind, why in part.refuted.items():
            console.print(f"no {kind}: {why}", markup=False, style="dim")


def _places(c: Candidate) -> Iterator[str]:
    """Where a contact is, with standard deviations."""
    deviations = c.deviations
    surface, tip = {"tool": ("tool", "base"), "base": ("base", "tool"), "both": ("base", "base")}[c.fixed_to]
    edge = c.kind == "line"
    for key, value, frame in (
        ("normal", c.normal, surface),
        ("axis", c.axis, tip if edge else surface),
        ("point", c.point, tip),
    ):
        if value is not None and key in deviations:
            angle = key != "point"
            off = deviations[key]
            known = "not told" if off == float("inf") else f"{degrees(off):.2g} deg" if angle else f"{off:.2g}"
            numbers = ", ".join(f"{x:.4f}" for x in value)
            yield f"{'edge' if edge and key == 'axis' else key} ({numbers}) in the {frame} frame, to {known}"
    if c.kind == "screw":
        yield f"pitch {c.pitch:.4g} a radian, to {deviations['pitch']:.2g}"
    if c.kind == "sphere":
        yield f"radius {c.radius:.4g}, to {deviations['radius']:.2g}"


def _motion(twist: Array) -> str:
    """A twist in words."""
    from invariantqp.geometry.screws import axis, pitch

    def direction(a: Array) -> str:
        return ", ".join(f"{x:.2f}" for x in a)

    h = pitch(twist)
    if abs(h) > FLAT:
        return f"a slide along ({direction(twist[3:] / max(sum(x * x for x in twist[3:]) ** 0.5, 1e-300))})"
    along, place = axis(twist)
    screw = "" if abs(h) < 1.0 / FLAT else f", sliding by {h:.2g} a radian"
    return f"a turn about ({direction(along)}) through ({direction(place)}){screw}"
