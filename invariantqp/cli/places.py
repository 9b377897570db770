"""Files and folders to write to. What cannot be written is refused before the work is done, as far as can be known."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from invariantqp.cli.status import NotWritten
from invariantqp.errors import BadInput

PICTURES = (".png", ".svg", ".pdf")
PAGES = (".html",)


def writable(option: str, file: Path | None, suffixes: tuple[str, ...] = ()) -> None:
    """Refuse a file that cannot be written, or whose ending is that of another kind of file.

    Raises:
        BadInput: why it cannot be.
    """
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
    """Make a folder, or refuse one that cannot be had.

    Raises:
        BadInput: why it cannot be.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(option, f"{out}: {error.strerror}", "a folder, or a place where one can be made") from error
    if not os.access(out, os.W_OK):
        raise BadInput(option, f"{out}, which may not be written to", "a folder of yours")


@contextmanager
def writing(file: Path) -> Iterator[None]:
    """Say which file it was that could not be written.

    Raises:
        NotWritten: the operating system refused, for lack of space for instance.
    """
    try:
        yield
    except OSError as error:
        raise NotWritten(str(file), error.strerror or str(error)) from error


def write(file: Path, text: str) -> None:
    """Write text to a file.

    Raises:
        NotWritten: it cannot be written to its end.
    """
    with writing(file):
        file.write_text(text, encoding="utf-8")
