"""Files that are written completely or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile

# What the files of a comparison take at most [bytes].
ROOM = 8_000_000


@contextmanager
def complete_file(file: Path | str) -> Iterator[Path]:
    """A file beside the given one, with the same ending, to write to: it replaces it when the block ends.

    After an error it is removed, and the given file is what it was. What is no ordinary file, such as /dev/stdout, is
    given itself.
    """
    place = Path(file).resolve()
    if place.exists() and not place.is_file():
        yield Path(file)
        return
    part = place.with_name(f"{place.stem}.part{place.suffix}")
    try:
        yield part
        part.replace(place)
    finally:
        part.unlink(missing_ok=True)


def write_text(file: Path | str, text: str) -> None:
    """Write text to a file, completely or not at all.

    Raises:
        OSError: the file cannot be written; it is what it was.
    """
    with complete_file(file) as part:
        part.write_text(text, encoding="utf-8")


def require_room(folder: Path) -> None:
    """Write ROOM bytes into a folder and remove them.

    Raises:
        OSError: the folder cannot be written to, or its disk is full.
    """
    with TemporaryFile(dir=folder) as probe:
        probe.write(bytes(ROOM))
        probe.flush()
