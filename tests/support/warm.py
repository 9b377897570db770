"""Command lines as processes that start at once: each is forked from one that has loaded what they need."""

import json
import os
import socket
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from types import SimpleNamespace

# Each child ends as any Python process does, so that what it could not write is seen. What it was born with is frozen:
# most of the end would be to look for garbage there.
SERVER = """
import gc, json, os, socket, sys
from invariantqp.workbench import cli
from invariantqp.workbench.analysis import inspection
from invariantqp.workbench.runs import run
asked = socket.socket(fileno=int(sys.argv[1]))
gc.freeze()
while True:
    words, streams, _, _ = socket.recv_fds(asked, 4096, 2)
    if not words:
        break
    child = os.fork()
    if not child:
        for stream, place in zip(streams, (1, 2)):
            os.dup2(stream, place)
        sys.argv[1:] = json.loads(words)
        cli.main()
    for stream in streams:
        os.close(stream)
    asked.send(bytes([os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])]))
"""


class Warm:
    """Runs command lines one after the other; their standard output is buffered, as it is for most users."""

    def __init__(self):
        self._asks, answers = socket.socketpair()
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
        command, kept = [sys.executable, "-c", SERVER, str(answers.fileno())], [answers.fileno()]
        self._server = subprocess.Popen(command, pass_fds=kept, stdout=subprocess.DEVNULL, env=environment)
        answers.close()

    def __call__(self, *words, stdout=None, stderr=None):
        """The exit status, and what was written where no stream is given."""
        with ExitStack() as files:
            kept = [files.enter_context(tempfile.TemporaryFile("w+")) if s is None else s for s in (stdout, stderr)]
            streams = [stream if isinstance(stream, int) else stream.fileno() for stream in kept]
            socket.send_fds(self._asks, [json.dumps([str(word) for word in words]).encode()], streams)
            status = self._asks.recv(1)[0]
            said = [
                stream.seek(0) or stream.read() if s is None else ""
                for s, stream in zip((stdout, stderr), kept, strict=True)
            ]
        return SimpleNamespace(returncode=status, stdout=said[0], stderr=said[1])

    def close(self):
        self._asks.close()
        self._server.wait()
