"""`invariantqp inspect`: what an arm can do, and which form to give it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from invariantqp.cli.places import PICTURES, writable
from invariantqp.errors import BadInput
from invariantqp.printing import print_inspection, progress


class ManyNumbers(TyperCommand):
    """A command in which every number after --q belongs to it: --q 0 0.5 -1 means --q 0,0.5,-1."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Join them before anything else looks at them: -1 is no option."""
        joined: list[str] = []
        for word in args:
            before = joined[-2:]
            if len(before) == 2 and before[0] == "--q" and _is_numbers(before[1]) and _is_numbers(word):
                joined[-1] += f",{word}"
            else:
                joined.append(word)
        return super().parse_args(ctx, joined)


def _is_numbers(text: str) -> bool:
    try:
        _numbers(text)
    except BadInput:
        return False
    return True


def _numbers(text: str) -> list[float]:
    """Numbers apart by commas or spaces."""
    try:
        return [float(word) for word in text.replace(",", " ").split()]
    except ValueError as error:
        raise BadInput("--q", repr(text), "numbers, one a joint, such as --q 0 0.5 -1") from error


def inspect(
    robot: Annotated[str, typer.Argument(help="A robot's name, a URDF file, a task's name or a task file.")],
    tool: Annotated[
        str | None, typer.Option(metavar="FRAME", help="The tool frame; the robot's own if left out.")
    ] = None,
    q: Annotated[
        str | None, typer.Option("--q", metavar="NUMBERS", help="Joint positions; the middle of the range if left out.")
    ] = None,
    samples: Annotated[
        int | None, typer.Option(metavar="N", help="States of the joint range to look at.", min=1)
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write everything as JSON.")] = None,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Draw the principal pitches over the range (.png, .svg, .pdf)."),
    ] = None,
) -> None:
    """Tell what ROBOT can do and which form to give it: rank, type, pitches to stay away from, blind directions."""
    from invariantqp.analysis.inspection import DEFAULT_SAMPLES
    from invariantqp.analysis.inspection import inspect as look
    from invariantqp.runs.arm import arm

    if q is not None and samples is not None:
        raise BadInput("--q", "--samples beside it", "one of them: a state, or the range")
    writable(json_file)
    writable(plot, PICTURES)
    loaded = arm(robot, tool)
    state = None if q is None else _numbers(q)
    with progress("looking", samples is None) as report:
        found = look(loaded, name=robot, q=state, samples=samples or DEFAULT_SAMPLES, progress=report)
    print_inspection(found)
    if json_file is not None:
        json_file.write_text(json.dumps(found.as_json(), indent=1) + "\n", encoding="utf-8")
    if plot is not None:
        from invariantqp.pictures.pitches import pitch_picture

        pitch_picture(found, loaded, plot)
