"""Whether there is a screen to show a browser on, and where a page goes when there is none."""

from __future__ import annotations

import os
import re
import sys

from invariantqp.runs.taskfile import Task

# Set where nobody looks at this machine's screen, if it has one.
ELSEWHERE = ("CI", "SSH_CONNECTION", "SSH_TTY")
# Of these Linux and the BSDs set one where there is a screen.
SCREEN = ("DISPLAY", "WAYLAND_DISPLAY")


def has_display() -> bool:
    """Whether a browser opened here would be seen."""
    if any(os.environ.get(name) for name in ELSEWHERE):
        return False
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in SCREEN)


def page_name(task: Task) -> str:
    """The file a task's page is written to when nobody names one, in the current folder."""
    return f"{re.sub(r'[^A-Za-z0-9._-]+', '_', task.name)}.html"
