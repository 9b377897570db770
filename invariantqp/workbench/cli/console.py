"""Shared by the commands: exit statuses, messages on standard error, lists of numbers, files to write.

Files that cannot be written are refused before the work, as far as that can be known.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from invariantqp.errors import BadInput
from invariantqp.workbench.writing import write_text


class Exit(IntEnum):
    """Exit statuses."""

    DONE = 0
    NOT_ACCEPTED = 1  # of a run or a comparison only
    BAD_INPUT = 2
    NOT_WRITTEN = 3  # standard output or a file: a full disk, a closed pipe
    DEFECT = 4  # of this program
    INTERRUPTED = 130  # by Ctrl-C, as shells have it


HELP = (
    "Exit status: 0 done, or accepted; 1 not accepted; 2 bad input; 3 output could not be written; 4 a defect of "
    "invariantqp; 130 interrupted."
)

# Options that several commands have.
JsonFile = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write everything as JSON.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing unless something is wrong.")]
ToolFrame = Annotated[
    str | None, typer.Option("--tool", metavar="FRAME", help="The tool frame; the robot's own if left out.")
]
PICTURES = (".png", ".svg", ".pdf")
PAGES = (".html",)
# Width of paragraphs and of tables without a terminal.
PLAIN_WIDTH, WIDEST = 100, 180


class NotAccepted(Exception):
    """A run or a comparison does not meet its acceptance numbers."""

    def __init__(self, reasons: list[str]) -> None:
        self.reasons = reasons
        super().__init__("; ".join(reasons))


class NotWritten(Exception):
    """A file could not be written completely; the message names it and says why."""


def say(sentence: str, *, style: str | None = None) -> None:
    """Print a message on standard error."""
    Console(stderr=True, highlight=False, soft_wrap=True).print(sentence, style=style, markup=False)


@contextmanager
def progress(what: str, quiet: bool) -> Iterator[Callable[[int, int], None] | None]:
    """A progress bar on standard error, set by (steps done, all steps); None if quiet or without a terminal."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    from rich.progress import Progress

    with Progress(console=console) as bar:
        job = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(job, completed=done, total=total)


def numbers(option: str, text: str) -> list[float]:
    """Numbers separated by commas or spaces."""
    try:
        values = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        values = []
    if not values:
        raise BadInput(option, repr(text), "numbers, such as 0,0.5,-1")
    return values


def writable(option: str, file: Path | None, suffixes: tuple[str, ...] = ()) -> None:
    """Refuse a file that cannot be written, or with another ending than `suffixes`."""
    if file is None:
        return
    if not file.name or file.is_dir():
        raise BadInput(option, f"{file}, a folder", "the name of a file")
    if not file.parent.is_dir():
        raise BadInput(option, f"{file}, in a folder that does not exist", "a file in an existing folder")
    if not os.access(file if file.exists() else file.parent, os.W_OK):
        raise BadInput(option, f"{file}, which may not be written to", "a file in a folder of yours")
    if suffixes and file.suffix.lower() not in suffixes:
        raise BadInput(option, f"{file}, with the ending {file.suffix!r}", f"one of {', '.join(suffixes)}")


def folder(option: str, out: Path) -> None:
    """Refuse a folder that can be neither written to nor made."""
    place = next(place for place in (out, *out.absolute().parents) if place.exists())
    if not place.is_dir():
        raise BadInput(option, f"{place}, a file", "a folder, or a place where one can be made")
    if not os.access(place, os.W_OK):
        raise BadInput(option, f"{place}, which may not be written to", "a folder of yours")


@contextmanager
def writing(file: Path) -> Iterator[None]:
    """Raise `NotWritten` with the name of the file if writing it fails."""
    try:
        yield
    except (OSError, BadInput) as error:
        cause = error if isinstance(error, OSError) else error.__cause__
        if not isinstance(cause, OSError):
            raise
        raise NotWritten(f"{file} could not be written: {cause.strerror or cause}") from error


def write(file: Path, text: str) -> None:
    """Write text to a file."""
    with writing(file):
        write_text(file, text)
