"""Exit statuses. 1 says that a run was not accepted, and is used for nothing else."""

from __future__ import annotations

DONE = 0
NOT_ACCEPTED = 1
BAD_INPUT = 2
# Standard output or a file could not be written: a full disk, a reader that is gone.
NOT_WRITTEN = 3
# A defect of this program.
DEFECT = 4
# By Ctrl-C, as shells have it.
INTERRUPTED = 130

HELP = (
    "Exit status: 0 done, or accepted; 1 not accepted; 2 bad input; 3 output could not be written; 4 a defect of "
    "invariantqp; 130 interrupted."
)


class NotAccepted(Exception):
    """A run or a comparison is done, and its acceptance numbers are not met.

    Attributes:
        reasons: one sentence each.
    """

    def __init__(self, reasons: list[str]) -> None:
        self.reasons = reasons
        super().__init__("; ".join(reasons))


class NotWritten(Exception):
    """A file could not be written to its end.

    Attributes:
        file: its name.
        why: in words.
    """

    def __init__(self, file: str, why: str) -> None:
        self.file = file
        self.why = why
        super().__init__(f"{file} could not be written: {why}")
