"""Where a person looks: at a browser on this machine's screen, from another machine over SSH, or at a file later."""

from __future__ import annotations

import os
import re
import socket
import sys
from getpass import getuser

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


def is_remote() -> bool:
    """Whether somebody sits at a terminal of this machine over SSH."""
    over_ssh = bool(os.environ.get("SSH_CONNECTION")) and not os.environ.get("CI")
    return over_ssh and sys.stdin is not None and sys.stdin.isatty()


def tunnel(port: int) -> str:
    """The command that, on another machine, makes http://localhost:PORT there show what is served here.

    This machine is named by the address that SSH came to, else by its name.
    """
    words = os.environ.get("SSH_CONNECTION", "").split()
    host, at = (words[2], words[3]) if len(words) == 4 else (socket.gethostname(), "22")
    try:
        user = f"{getuser()}@"
    except (KeyError, OSError):  # a container's user may have no name
        user = ""
    return f"ssh -L {port}:localhost:{port} {'' if at == '22' else f'-p {at} '}{user}{host}"


def page_name(task: Task) -> str:
    """The file, in the current folder, for the page of a task when nobody names one."""
    return f"{re.sub(r'[^A-Za-z0-9._-]+', '_', task.name)}.html"
