"""`invariantqp drag`: what is refused, who may connect, how it is left; `support.drag_in_browser` is in a browser."""

import re
import signal
import socket
import subprocess
import sys
import urllib.request

import pytest
from support.command_line import call

pytest.importorskip("viser")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["panda", "--against", "placo"], "--against: found 'placo'; expected a method by hand"),
        (["panda", "--against", "dls,nothing"], "unknown method 'nothing'"),
        (["panda", "--against", "invariantqp"], "--against: found 'invariantqp'"),
        (["pandas"], "unknown robot 'pandas'"),
        (["panda", "--tool", "nowhere"], "nowhere"),
        (["panda", "--port", "65536"], "65535"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_what_is_refused(monkeypatch, capsys, words, said):
    status, out, err = call(monkeypatch, capsys, "drag", *words, "--no-browser")
    assert (status, out) == (2, "")
    assert said.replace("'", "") in " ".join(err.split()).replace("'", "")


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C cannot be sent to a child there")
def test_it_serves_this_machine_until_ctrl_c():
    command = [sys.executable, "-u", "-m", "invariantqp", "drag", "so101", "--no-browser", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as served:
        try:
            url, port = re.fullmatch(
                r"the arm is at (http://localhost:(\d+)); Ctrl-C ends it\n", served.stderr.readline()
            ).groups()
            with urllib.request.urlopen(url) as answer:
                assert answer.status == 200
            with socket.socket() as outside:  # another address of this machine
                assert outside.connect_ex(("127.0.0.2", int(port))) != 0
            served.send_signal(signal.SIGINT)
            out, err = served.communicate(timeout=10)
        finally:
            served.kill()
    assert (served.returncode, out, err) == (0, "", "")
