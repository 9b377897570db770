"""`invariantqp inspect`: the properties of an arm, and the pitch to split its twists by."""

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
    from invariantqp.geometry.arrays import Array
    from invariantqp.limits import Clearance
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
    from invariantqp.control.controller import Controller
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
    options = {} if samples is None else {"samples": samples}
    inspection = inspect_arm(loaded, name=robot, q=state, **options)
    if state is not None:
        Controller(loaded, dt=0.001, posture=False).checked_positions(inspection.q, "--q")
    limit = None
    if clearance:
        from invariantqp.limits import Clearance

        limit = Clearance(loaded)
    if json_file is not None:
        content = inspection.as_json()
        if limit is not None:
            nearest = limit.at(inspection.q)
            content["clearance"] = {
                "bodies": {name: len(shapes) for name, shapes in limit.bodies.items()},
                "nearest": {"bodies": nearest[:2], "distance": nearest.distance} if nearest.first else None,
                "pairs": limit.pairs,
                "dropped": limit.dropped,
            }
        write(json_file, json.dumps(content, indent=1) + "\n")
    if plot is not None:
        with writing(plot):
            if limit is None:
                from invariantqp.workbench.pictures.inspection import pitch_picture

                pitch_picture(inspection, loaded, plot)
            else:
                from invariantqp.workbench.pictures.inspection import bodies_picture

                bodies_picture(limit, inspection.q, plot)
    print_inspection(inspection)
    if limit is not None:
        print_clearance(limit, inspection.q)


def print_inspection(inspection: Inspection) -> None:
    """Print the state, the joint range, and the pitch to split twists by."""
    console = Console(highlight=False, soft_wrap=True)
    width = console.width if console.is_terminal else PLAIN_WIDTH
    advice = inspection.recommended
    use = "no form, and no pitch for splits" if advice.h is None else f"no form; for splits the pitch h = {advice.h:g}"
    console.print(
        f"[bold]{escape(inspection.robot)}[/bold], {len(inspection.joints)} joints to {escape(inspection.tool)}"
    )
    for title, words in (
        ("to use it", inspection.use_words()),
        (f"{inspection.where}, q = ({', '.join(f'{x:.4g}' for x in inspection.q)})", inspection.state_words()),
        (f"over the joint range, {len(inspection.survey.q)} states", inspection.range_words()),
        (f"recommended: {use}", (advice.reason,)),
    ):
        console.print(f"\n[bold]{title}[/bold]")
        for sentence in words:
            paragraph = fill(sentence, width, initial_indent="  ", subsequent_indent="  ")
            console.print(paragraph, markup=False)


def print_clearance(clearance: Clearance, q: Array) -> None:
    """Print the bodies of an arm, the nearest two at joint positions q (m,), and the pairs kept apart or dropped."""
    console = Console(highlight=False, soft_wrap=True)
    console.print("\n[bold]bodies[/bold]")
    for name, shapes in clearance.bodies.items():
        kinds = Counter(shape.label for shape in shapes)
        console.print(f"  {name}: {', '.join(f'{n} x {kind}' for kind, n in kinds.items())}", markup=False)
    nearest = clearance.at(q)
    console.print(
        f"  nearest where the arm is: {nearest}" if nearest.first else "  no two of them can touch", markup=False
    )
    console.print(f"\n[bold]clearance: {len(clearance.pairs)} pairs of links are kept apart[/bold]")
    for name in dict.fromkeys(first for first, _ in clearance.pairs):
        others = ", ".join(second for first, second in clearance.pairs if first == name)
        console.print(f"  {name} from {others}", markup=False)
    console.print(f"\n[bold]{len(clearance.dropped)} are not[/bold]")
    reasons = dict.fromkeys(dropped.reason for dropped in clearance.dropped)
    for reason in reasons:
        pairs = ", ".join(f"{one} and {other}" for one, other, why in clearance.dropped if why == reason)
        console.print(f"  {reason}: {pairs}", markup=False)
