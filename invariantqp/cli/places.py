"""Places to write to, refused before the work is done and not after."""

from __future__ import annotations

import os
from pathlib import Path

from invariantqp.errors import BadInput

PICTURES = (".png", ".svg", ".pdf")
PAGES = (".html",)


def writable(file: Path | None, suffixes: tuple[str, ...] = ()) -> None:
    """Refuse a file that cannot be written, or whose ending says that it is something else."""
    if file is None:
        return
    if not file.parent.is_dir():
        raise BadInput(str(file), "a folder that does not exist", "a file in an existing folder")
    if file.is_dir():
        raise BadInput(str(file), "a folder", "the name of a file")
    if not os.access(file if file.exists() else file.parent, os.W_OK):
        raise BadInput(str(file), "a place that may not be written to", "a file in a folder of yours")
    if suffixes and file.suffix.lower() not in suffixes:
        raise BadInput(str(file), f"the ending {file.suffix!r}", f"one of {', '.join(suffixes)}")


def folder(out: Path) -> None:
    """Refuse a folder that cannot be had."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput("--out", f"{out}: {error.strerror}", "a folder, or a place where one can be made") from error
    if not os.access(out, os.W_OK):
        raise BadInput("--out", f"{out}, which may not be written to", "a folder of yours")
