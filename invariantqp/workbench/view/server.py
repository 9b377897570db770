"""Serves the page of a run to this machine, while it runs and after: the page polls for new ticks.

A user sees it in a browser on this machine, on another machine over SSH, or later as a file.
"""

from __future__ import annotations

import json
import os
import re
import socket
import sys
from contextlib import suppress
from dataclasses import replace
from getpass import getuser
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Event, Thread
from typing import Any

import numpy as np

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.solution import VelocitySolution
from invariantqp.workbench.pictures.charts import CurveChart, extremes, frame_ends
from invariantqp.workbench.runs.plant import PlantState
from invariantqp.workbench.runs.taskfile import Task
from invariantqp.workbench.runs.trace import Trace, is_limit_active
from invariantqp.workbench.view.page import drawn, page
from invariantqp.workbench.view.timeline import FORCE, Timeline, states, timeline_before, timeline_of

# The port to serve at, and the last that there is.
PORT, LAST_PORT = 8080, 65535
# Environment variables of sessions without this machine's screen.
REMOTE = ("CI", "SSH_CONNECTION", "SSH_TTY")
# Environment variables of sessions with a screen on Linux and the BSDs.
SCREEN = ("DISPLAY", "WAYLAND_DISPLAY")


class Viewer:
    """Serves a page with robot, path, playback and charts of one run, to any number of browsers.

    Attributes:
        url: the address on this machine.
        tunnel: the SSH command that makes that address work on another machine.
    """

    def __init__(self, task: Task, port: int = PORT) -> None:
        """Serve the arm and its path, at a port or the next free one."""
        self._dt = task.law.dt
        self._before = timeline_before(task)
        self._result: Timeline | None = None
        # Of each tick: joint positions, velocities, the tool's force (3,) and position (3,), status, is a limit active.
        self._ticks: list[tuple[Array, Array, Array, Array, str, bool]] = []
        self._closed = Event()
        self._text = page(self._before, live=True)
        self._path = drawn(self._before)["arrays"]["path"]
        self._server = _listening(port)
        self._server.viewer = self
        Thread(target=self._server.serve_forever, args=(0.1,), daemon=True).start()
        at = self._server.server_address[1]
        self.url: str = f"http://localhost:{at}"
        self.tunnel: str = tunnel(at)

    def close(self) -> None:
        """Stop serving."""
        if not self._closed.is_set():
            self._closed.set()
            self._server.shutdown()
            self._server.server_close()

    def watch(self, tick: int, state: PlantState, solution: VelocitySolution) -> None:  # noqa: ARG002 (an observer)
        """An observer for `run_task`: records a tick for the browsers."""
        status, limited = str(solution.status), is_limit_active(solution)
        self._ticks.append((state.q, solution.velocity, -state.wrench[3:], state.pose[:3, 3], status, limited))

    def show(self, timeline: Timeline) -> None:
        """Serve a finished run."""
        self._result = timeline

    def play(self, trace: Trace) -> None:
        """Serve a finished run until interrupted or closed."""
        self.show(timeline_of(trace))
        while not self._closed.wait(0.1):  # Ctrl-C does not interrupt an endless wait on every system
            pass

    def text(self) -> str:
        """The current page."""
        return self._text if self._result is None else page(self._result)

    def update(self, tag: str) -> tuple[str, str | None]:
        """The tag of the newest state, and the state as JSON; None if the page has it already."""
        done, n = self._result, len(self._ticks)
        now = f"{n}" if done is None else "done"
        if now == tag or (done is None and not n):
            return now, None
        if done is not None:
            return now, json.dumps({**drawn(done), "about": done.about})
        so_far = drawn(self._so_far(n))
        so_far["arrays"]["path"] = self._path
        whole = {"duration": float(self._before.time[-1]), "travel_scale": self._before.travel_scale}
        return now, json.dumps({**so_far, **whole, "live": True})

    def _so_far(self, n: int) -> Timeline:
        """The first n ticks of the run."""
        q, speed, force, place, status, limited = zip(*self._ticks[:n], strict=True)
        before, push = self._before, np.array(force)
        ends = frame_ends(n)
        time = self._dt * ends
        frames = [before.frame(t) for t in time.tolist()]
        places = np.vstack((before.tool[0, :3, 3], place))[ends]
        size = extremes(np.linalg.norm(push, axis=1)[:, None], ends).T
        pressing = [CurveChart("contact force [N]", ("size",), size, (FORCE,))] if push.any() else []
        timeline = replace(
            before,
            time=time,
            q=np.vstack((before.q[0], q))[ends],
            speed=extremes(np.array(speed), ends),
            wanted=before.wanted[frames],
            solids=tuple(s if s.poses is None else s._replace(poses=s.poses[frames]) for s in before.solids),
            travel=np.gradient(places, time, axis=0),
            force=push[np.maximum(ends - 1, 0)] if push.any() else None,
            **states(status, limited, ends),
        )
        return replace(timeline, charts=(*pressing, *timeline.limit_charts))


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = os.name != "nt"  # Windows would take a port that is in use
    viewer: Viewer


def _listening(port: int) -> _Server:
    """A server for this machine only, at a port or at the next free one of a hundred."""
    first = arrays.count(port, "port", LAST_PORT)
    for at in range(first, min(first + 100, LAST_PORT + 1)):
        with suppress(OSError):
            return _Server(("127.0.0.1", at), _Handler)
    raise BadInput("port", f"{first}, which is taken, and all after it", "a port that is free", "0 takes any.")


class _Handler(BaseHTTPRequestHandler):
    """Answers the requests of the page."""

    server: _Server

    def do_GET(self) -> None:
        """Answer "/" with the page and "run?TAG" with the state since that tag."""
        where, _, tag = self.path.partition("?")
        if where == "/":
            self._send(200, "text/html; charset=utf-8", self.server.viewer.text(), "")
        elif where == "/run":
            now, state = self.server.viewer.update(tag)
            self._send(204 if state is None else 200, "application/json", state or "", now)
        else:
            self._send(404, "text/plain", "", "")

    def _send(self, status: int, kind: str, text: str, tag: str) -> None:
        body = text.encode()
        self.send_response(status)
        for name, value in (("Content-Type", kind), ("Content-Length", str(len(body))), ("Cache-Control", "no-store")):
            self.send_header(name, value)
        if tag:
            self.send_header("ETag", tag)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        """Print nothing: standard error is the run's."""


def has_display() -> bool:
    """Whether this session has a screen."""
    if any(os.environ.get(name) for name in REMOTE):
        return False
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in SCREEN)


def is_remote() -> bool:
    """Whether this is an interactive SSH session."""
    over_ssh = bool(os.environ.get("SSH_CONNECTION")) and not os.environ.get("CI")
    return over_ssh and sys.stdin is not None and sys.stdin.isatty()


def tunnel(port: int) -> str:
    """The SSH command that forwards a port of another machine to this one, by the address of the SSH session."""
    words = os.environ.get("SSH_CONNECTION", "").split()
    host, at = (words[2], words[3]) if len(words) == 4 else (socket.gethostname(), "22")
    try:
        user = f"{getuser()}@"
    except (KeyError, OSError):  # a container's user may have no name
        user = ""
    return f"ssh -L {port}:localhost:{port} {'' if at == '22' else f'-p {at} '}{user}{host}"


def page_name(task: Task) -> str:
    """The default file name of the page of a task."""
    return f"{re.sub(r'[^A-Za-z0-9._-]+', '_', task.name)}.html"
