"""`invariantqp inspect`: what an arm can do, and which form to give it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from invariantqp.cli.places import PICTURES, writable, write, writing
from invariantqp.errors import BadInput
from invariantqp.extras import require
from invariantqp.printing import print_clearance, print_inspection, progress

Q_EXPECTED = "numbers, one for each joint, such as 0 0.5 -1"


class ManyNumbers(TyperCommand):
    """A command in which every number after --q or --start belongs to it: --q 0 0.5 -1 means --q 0,0.5,-1."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Join the numbers before anything else reads the arguments: -1 is not an option."""
        joined: list[str] = []
        for word in args:
            before = joined[-2:]
            if len(before) == 2 and before[0] in {"--q", "--start"} and _is_numbers(before[1]) and _is_numbers(word):
                joined[-1] += f",{word}"
            else:
                joined.append(word)
        return super().parse_args(ctx, joined)


def _is_numbers(text: str) -> bool:
    try:
        numbers("--q", text)
    except BadInput:
        return False
    return True


def numbers(option: str, text: str) -> list[float]:
    """Numbers separated by commas or spaces.

    Raises:
        BadInput: something else, or none; names the option.
    """
    try:
        found = [float(word) for word in text.replace(",", " ").split()]
    except ValueError as error:
        raise BadInput(option, repr(text), Q_EXPECTED) from error
    if not found:
        raise BadInput(option, repr(text), Q_EXPECTED)
    return found


def inspect(
    robot: Annotated[str, typer.Argument(help="A robot's name, a URDF file, a task's name or a task file.")],
    tool: Annotated[
        str | None, typer.Option(metavar="FRAME", help="The tool frame; the robot's own if left out.")
    ] = None,
    q: Annotated[
        str | None, typer.Option("--q", metavar="NUMBERS", help="Joint positions; the middle of the range if left out.")
    ] = None,
    samples: Annotated[
        int | None, typer.Option(metavar="N", help="How many states of the joint range to look at.", min=1)
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write everything as JSON.")] = None,
    clearance: Annotated[
        bool, typer.Option("--clearance", help="Also say which links are kept apart, which not, and why.")
    ] = False,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Draw the principal pitches over the range (.png, .svg, .pdf)."),
    ] = None,
) -> None:
    """Say what ROBOT can do and which form to give it: rank, type, pitches to stay away from, blind directions."""
    from invariantqp.analysis.inspection import DEFAULT_SAMPLES
    from invariantqp.analysis.inspection import inspect as look
    from invariantqp.runs.taskfile import load_arm

    if q is not None and samples is not None:
        raise BadInput("--q", "--samples too", "one of them: --q for one state, --samples for the joint range")
    writable("--json", json_file)
    writable("--plot", plot, PICTURES)
    if plot is not None:
        require("pictures", "matplotlib")
    loaded = load_arm(robot, tool)
    state = None if q is None else numbers("--q", q)
    with progress("inspecting", samples is None) as report:
        found = look(loaded, name=robot, q=state, samples=samples or DEFAULT_SAMPLES, progress=report)
    kept = None
    if clearance:
        from invariantqp.control.clearance import Clearance

        kept = Clearance(loaded)
    if json_file is not None:
        more = {} if kept is None else {"clearance": {"pairs": kept.pairs, "dropped": kept.dropped}}
        write(json_file, json.dumps({**found.as_json(), **more}, indent=1) + "\n")
    if plot is not None:
        from invariantqp.pictures.pitches import pitch_picture

        with writing(plot):
            pitch_picture(found, loaded, plot)
    print_inspection(found)
    if kept is not None:
        print_clearance(kept)
