"""`invariantqp inspect`: what an arm can do, and which form to give it."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.markup import escape

from invariantqp.errors import BadInput
from invariantqp.extras import require
from invariantqp.workbench.cli.console import (
    PICTURES,
    PLAIN_WIDTH,
    JsonFile,
    ToolFrame,
    numbers,
    writable,
    write,
    writing,
)

if TYPE_CHECKING:
    from invariantqp.control.clearance import Clearance
    from invariantqp.geometry.arrays import Array
    from invariantqp.workbench.analysis.inspection import Inspection


def inspect(
    robot: Annotated[str, typer.Argument(help="A robot's name, a URDF file, a task's name or a task file.")],
    tool: ToolFrame = None,
    q: Annotated[
        str | None,
        typer.Option("--q", metavar="NUMBERS", help="Joint positions, 0,0.5,-1; the middle of the range if left out."),
    ] = None,
    samples: Annotated[
        int | None, typer.Option(metavar="N", help="How many states of the joint range to look at.", min=1)
    ] = None,
    json_file: JsonFile = None,
    clearance: Annotated[
        bool,
        typer.Option(
            "--clearance",
            help="Also say what bodies the links are, how near they come, which are kept apart, and which not.",
        ),
    ] = False,
    plot: Annotated[
        Path | None,
        typer.Option(
            "--plot",
            metavar="FILE",
            help="Draw the principal pitches over the range, or with --clearance the bodies (.png, .svg, .pdf).",
        ),
    ] = None,
) -> None:
    """Say what ROBOT can do and which form to give it: rank, type, pitches to stay away from, blind directions."""
    from invariantqp.control.plausibility import bounds_against_degrees, require_plausible
    from invariantqp.workbench.analysis.inspection import inspect as inspect_arm
    from invariantqp.workbench.runs.taskfile import load_arm

    if q is not None and samples is not None:
        raise BadInput("--q", "--samples too", "one of them: --q for one state, --samples for the joint range")
    writable("--json", json_file)
    writable("--plot", plot, PICTURES)
    if plot is not None:
        require("pictures", "matplotlib")
    loaded = load_arm(robot, tool)
    state = None if q is None else numbers("--q", q)
    many = {} if samples is None else {"samples": samples}
    found = inspect_arm(loaded, name=robot, q=state, **many)
    if state is not None:
        require_plausible(loaded, found.q, bounds_against_degrees(loaded, loaded.jacobian(found.q)), "--q")
    apart = None
    if clearance:
        from invariantqp.control.clearance import Clearance

        apart = Clearance(loaded)
    if json_file is not None:
        content = found.as_json()
        if apart is not None:
            near = apart.at(found.q)
            content["clearance"] = {
                "bodies": {name: len(shapes) for name, shapes in apart.bodies.items()},
                "nearest": {"bodies": near[:2], "distance": near.distance} if near.first else None,
                "pairs": apart.pairs,
                "dropped": apart.dropped,
            }
        write(json_file, json.dumps(content, indent=1) + "\n")
    if plot is not None:
        with writing(plot):
            if apart is None:
                from invariantqp.workbench.pictures.inspection import pitch_picture

                pitch_picture(found, loaded, plot)
            else:
                from invariantqp.workbench.pictures.inspection import bodies_picture

                bodies_picture(apart, found.q, plot)
    print_inspection(found)
    if apart is not None:
        print_clearance(apart, found.q)


def print_inspection(found: Inspection) -> None:
    """An arm in words: the given state, its joint range, and the pitch to split twists by."""
    console = Console(highlight=False, soft_wrap=True)
    width = console.width if console.is_terminal else PLAIN_WIDTH
    advice = found.recommended
    use = "no form, and no pitch for splits" if advice.h is None else f"no form; for splits the pitch h = {advice.h:g}"
    console.print(f"[bold]{escape(found.robot)}[/bold], {len(found.joints)} joints to {escape(found.tool)}")
    for title, words in (
        ("to use it", found.use_words()),
        (f"{found.where}, q = ({', '.join(f'{x:.4g}' for x in found.q)})", found.state_words()),
        (f"over the joint range, {len(found.survey.q)} states", found.range_words()),
        (f"recommended: {use}", (advice.reason,)),
    ):
        console.print(f"\n[bold]{title}[/bold]")
        for sentence in words:
            paragraph = fill(sentence, width, initial_indent="  ", subsequent_indent="  ")
            console.print(paragraph, markup=False)


def print_clearance(clearance: Clearance, q: Array) -> None:
    """The bodies of an arm, how near they are at joint positions q (m,), and which are kept apart, or why not."""
    console = Console(highlight=False, soft_wrap=True)
    console.print("\n[bold]bodies[/bold]")
    for name, shapes in clearance.bodies.items():
        kinds = Counter(shape.called for shape in shapes)
        console.print(f"  {name}: {', '.join(f'{n} x {kind}' for kind, n in kinds.items())}", markup=False)
    near = clearance.at(q)
    console.print(f"  nearest where the arm is: {near}" if near.first else "  no two of them can touch", markup=False)
    console.print(f"\n[bold]clearance: {len(clearance.pairs)} pairs of links are kept apart[/bold]")
    for name in dict.fromkeys(first for first, _ in clearance.pairs):
        others = ", ".join(second for first, second in clearance.pairs if first == name)
        console.print(f"  {name} from {others}", markup=False)
    console.print(f"\n[bold]{len(clearance.dropped)} are not[/bold]")
    reasons = dict.fromkeys(dropped.reason for dropped in clearance.dropped)
    for reason in reasons:
        pairs = ", ".join(f"{one} and {other}" for one, other, why in clearance.dropped if why == reason)
        console.print(f"  {reason}: {pairs}", markup=False)
