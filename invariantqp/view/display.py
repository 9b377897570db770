"""Whether there is a screen for a browser, and the file for a page when there is none."""

from __future__ import annotations

import os
import re
import sys

from invariantqp.runs.taskfile import Task

# Environment variables that say that nobody looks at this machine's screen, if it has one.
ELSEWHERE = ("CI", "SSH_CONNECTION", "SSH_TTY")
# Environment variables of which Linux and the BSDs set one where there is a screen.
SCREEN = ("DISPLAY", "WAYLAND_DISPLAY")


def has_display() -> bool:
    """Whether a browser opened here would be seen."""
    if any(os.environ.get(name) for name in ELSEWHERE):
        return False
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in SCREEN)


def page_name(task: Task) -> str:
    """The file, in the current folder, for the page of a task when nobody names one."""
    return f"{re.sub(r'[^A-Za-z0-9._-]+', '_', task.name)}.html"
