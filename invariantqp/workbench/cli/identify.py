"""`invariantqp identify`: the contact that a recording shows, as a table and on a page."""

from __future__ import annotations

import json
from collections.abc import Iterator
from math import degrees
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from invariantqp.errors import BadInput
from invariantqp.extras import require
from invariantqp.workbench.cli.console import PAGES, PLAIN_WIDTH, JsonFile, ToolFrame, numbers, say, writable, write

if TYPE_CHECKING:
    from invariantqp.geometry.arrays import Array
    from invariantqp.identification.candidate import Candidate
    from invariantqp.identification.identify import Identification
    from invariantqp.robots.kinematics import Robot

# A pitch above this [length/rad] is printed as a slide, one below its inverse as a turn.
MAX_PITCH = 1e3


def identify(
    recording: Annotated[
        Path,
        typer.Argument(
            help="A .csv with a header (joints or x..qw; fx..fz, mx..mz) or an .npz (q or poses; force, moment)."
        ),
    ],
    reads: Annotated[
        str,
        typer.Option(
            metavar="reaction|action", help="What the sensor reads: what the world does to the tool, or the opposite."
        ),
    ],
    robot: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of joint positions: a robot's name or a URDF file.")
    ] = None,
    tool: ToolFrame = None,
    mount: Annotated[
        str, typer.Option(metavar="NUMBERS", help="The sensor's frame in the tool frame: x,y,z, or x,y,z,qx,qy,qz,qw.")
    ] = "0,0,0",
    mass: Annotated[float, typer.Option(help="Beyond the sensor, where its weight is among the readings [kg].")] = 0.0,
    centre: Annotated[
        str, typer.Option(metavar="NUMBERS", help="Of that mass, in the sensor's frame: x,y,z.")
    ] = "0,0,0",
    accuracy: Annotated[
        str | None,
        typer.Option(
            metavar="DEG,LENGTH", help="How far a real contact may be off: clearance, bending, the arm's geometry."
        ),
    ] = None,
    kind: Annotated[list[str] | None, typer.Option(metavar="KIND", help="Only these; may be repeated.")] = None,
    json_file: JsonFile = None,
    view: Annotated[
        Path | None,
        typer.Option("--view", metavar="FILE", help="Write a page with the contact on the recorded path (.html)."),
    ] = None,
) -> None:
    """Say which contact RECORDING shows, where it is, and what the recording leaves open."""
    from invariantqp.force.sensor import WrenchSensor
    from invariantqp.identification.identify import identify as identify_contact
    from invariantqp.identification.recording_files import read_recording
    from invariantqp.workbench.runs.taskfile import load_arm

    writable("--json", json_file)
    writable("--view", view, PAGES)
    if view is not None:
        require("pictures", "jinja2")
    if tool is not None and robot is None:
        raise BadInput("--tool", "no --robot beside it", "--robot too")
    tolerance = None if accuracy is None else numbers("--accuracy", accuracy)
    if tolerance is not None and len(tolerance) != 2:
        raise BadInput("--accuracy", accuracy or "", "two numbers: degrees and a length")
    loaded: Robot | None = None if robot is None else load_arm(robot, tool)
    file = read_recording(recording, loaded)
    frame, centre_of_mass = _frame(mount), numbers("--centre", centre)
    sensor = WrenchSensor(frame, order="moment first", reads=reads, mass=mass, centre=centre_of_mass)  # type: ignore[arg-type]
    if file.unused_columns:
        say(f"note: not used: {', '.join(file.unused_columns)}", style="yellow")
    steps = np.diff(file.seconds)
    if len(steps) and steps.max() > 1.5 * np.median(steps):  # a sample is missing
        say("note: samples are missing: time has gaps, and samples are taken as evenly spaced", style="yellow")
    options: dict[str, Any] = {"kinds": kind, "sensor": sensor}
    if tolerance is not None:
        options["accuracy"] = (np.deg2rad(tolerance[0]), tolerance[1])
    result = identify_contact(file.poses, file.readings, **options)
    if json_file is not None:
        write(json_file, json.dumps(result.as_json(), indent=1) + "\n")
    if view is not None:
        from invariantqp.workbench.view.page import page
        from invariantqp.workbench.view.recorded import timeline_of_recording

        write(view, page(timeline_of_recording(result, file, sensor, loaded, robot, recording.stem)))
    print_identification(result, recording.name, file.seconds)


def _frame(text: str) -> Any:
    """(4, 4) of x, y, z, or x, y, z, qx, qy, qz, qw."""
    from invariantqp.identification.recording_files import POSE_COLUMNS, quaternion_poses

    values = numbers("--mount", text)
    if len(values) not in (3, len(POSE_COLUMNS)):
        raise BadInput("--mount", repr(text), "3 numbers, x,y,z, or 7, x,y,z,qx,qy,qz,qw")
    values += [0.0, 0.0, 0.0, 1.0][: len(POSE_COLUMNS) - len(values)]
    return quaternion_poses(np.array([values]), "--mount")[0]


def print_identification(result: Identification, name: str, time: Array) -> None:
    """Print the identified contacts, where they are, and what the recording leaves open."""
    console = Console(highlight=False, soft_wrap=True)
    for part in result.segments:
        kind = f"[bold]{part.kind}[/bold]" if part.kind else "[bold]undecided[/bold]"
        console.print(f"{escape(name)}, {time[part.start]:.2f} to {time[part.stop - 1]:.2f} s: {kind}")
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
        for other, why in part.refuted.items():
            console.print(f"no {other}: {why}", markup=False, style="dim")


def _places(c: Candidate) -> Iterator[str]:
    """Normal, axis, point and pitch of a contact, with standard deviations."""
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
            known = "unknown accuracy" if off == float("inf") else f"{degrees(off):.2g} deg" if angle else f"{off:.2g}"
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
    if abs(h) > MAX_PITCH:
        return f"a slide along ({direction(twist[3:] / np.linalg.norm(twist[3:]))})"
    along, place = axis(twist)
    screw = "" if abs(h) < 1.0 / MAX_PITCH else f", sliding by {h:.2g} a radian"
    return f"a turn about ({direction(along)}) through ({direction(place)}){screw}"
