"""`invariantqp drag`: a live arm in the browser, with ghosts of other methods beside it."""

from __future__ import annotations

import time
import webbrowser
from contextlib import suppress
from typing import Annotated

import typer

from invariantqp.errors import BadInput
from invariantqp.extras import require
from invariantqp.workbench.cli.console import Quiet, ToolFrame, say


def drag(
    ctx: typer.Context,
    robot: Annotated[str, typer.Argument(help="A robot's name, or a URDF or MJCF file.")] = "panda",
    against: Annotated[
        str, typer.Option(metavar="NAMES", help="Ghosts by these methods of `compare`, separated by commas.")
    ] = "",
    tool: ToolFrame = None,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Who may connect: 127.0.0.1 is this machine, 0.0.0.0 everybody.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(metavar="N", help="The port, or the next free one.", min=0, max=65535)] = 8080,
    dark: Annotated[bool, typer.Option("--dark", help="A dark page.")] = False,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Whether to open a browser.")] = True,
    quiet: Quiet = False,
) -> None:
    """Drag the target of ROBOT in a browser, and see what the arm makes of it.

    At limits, at a singularity, out of reach; with other forms, with fewer joints; beside ghosts of other methods.
    """
    require("drag", "viser")
    from invariantqp.robots.load import load_robot
    from invariantqp.workbench.compare.sweep import methods_named
    from invariantqp.workbench.drag.page import DragPage
    from invariantqp.workbench.drag.session import Session

    methods = methods_named([word for word in against.split(",") if word.strip()]) if against.strip() else []
    for method in methods:
        if method.environment or method.needs_pitch or method.family == "ours":
            raise BadInput("--against", method.name, "a method by hand, or a library of this environment")
    page = DragPage(Session(load_robot(robot, tool), robot, methods), host, port, dark=dark)
    if not quiet:
        say(f"the arm is at {page.url}; Ctrl-C ends it")
    if browser:
        webbrowser.open(page.url)
    ctx.call_on_close(page.close)
    with suppress(KeyboardInterrupt):
        while True:  # Ctrl-C does not interrupt an endless wait on every system
            time.sleep(0.5)
