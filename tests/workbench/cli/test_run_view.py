"""`invariantqp run --view`: where a run is shown, what is refused, and how it is left."""

import json
import os
import re
import signal
import subprocess
import sys
from functools import partial

import pytest
from support.command_line import call
from support.views import TASK, read

from invariantqp.workbench.runs.taskfile import task_from
from invariantqp.workbench.view import server
from invariantqp.workbench.view.server import has_display, page_name


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """`invariantqp run` in an empty folder, of a task file in it, where nobody has a display."""
    law = "".join(f"{k} = {json.dumps(v)}\n" for k, v in TASK["law"].items())
    tables = "".join(
        f"[{name}]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in TASK[name].items()) for name in ("robot", "path")
    )
    (tmp_path / "short.toml").write_text(f'name = "a short/one"\n{tables}[law]\n{law}', encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "CI", "SSH_CONNECTION", "SSH_TTY"):
        monkeypatch.delenv(name, raising=False)
    return partial(call, monkeypatch, capsys, "run")


@pytest.mark.parametrize(
    "arguments",
    [("short.toml", "--view", "seen.html"), ("--view", "seen.html", "short.toml"), ("short.toml", "--view=seen.html")],
    ids=["after", "before", "equals"],
)
def test_the_view_goes_to_a_file(run, tmp_path, arguments):
    assert run(*arguments, "--quiet") == (0, "", "")
    assert read((tmp_path / "seen.html").read_text(encoding="utf-8")).tags[0][0] == "html"


@pytest.mark.parametrize("arguments", [("short.toml", "--view"), ("--view", "short.toml")], ids=["after", "before"])
def test_without_a_display_the_view_is_written(run, tmp_path, arguments):
    status, out, err = run(*arguments)
    assert status == 0
    assert "accepted" in out
    assert err == "no display: the view is written to a_short_one.html\n"
    assert (tmp_path / "a_short_one.html").stat().st_size > 50_000


@pytest.mark.parametrize(
    ("platform", "environment", "display"),
    [
        ("linux", {}, False),
        ("linux", {"DISPLAY": ":0"}, True),
        ("linux", {"WAYLAND_DISPLAY": "wayland-0"}, True),
        ("linux", {"DISPLAY": "localhost:10.0", "SSH_CONNECTION": "a 1 b 22"}, False),
        ("linux", {"DISPLAY": ":99", "CI": "true"}, False),
        ("darwin", {}, True),
        ("darwin", {"SSH_TTY": "/dev/ttys1"}, False),
        ("win32", {}, True),
    ],
)
def test_where_a_browser_would_be_seen(monkeypatch, platform, environment, display):
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(os, "environ", environment)
    assert has_display() is display


def test_over_ssh_a_command_is_told_that_shows_the_view(monkeypatch):
    monkeypatch.setattr(server, "getuser", lambda: "me")
    monkeypatch.setattr(server.socket, "gethostname", lambda: "lab")
    monkeypatch.setattr(os, "environ", {"SSH_CONNECTION": "10.0.0.9 5000 10.0.0.2 22"})
    assert server.tunnel(8080) == "ssh -L 8080:localhost:8080 me@10.0.0.2"
    monkeypatch.setattr(os, "environ", {"SSH_CONNECTION": "10.0.0.9 5000 10.0.0.2 2222"})
    assert server.tunnel(8081) == "ssh -L 8081:localhost:8081 -p 2222 me@10.0.0.2"
    monkeypatch.setattr(os, "environ", {})
    assert server.tunnel(8080) == "ssh -L 8080:localhost:8080 me@lab"
    monkeypatch.setattr(server, "getuser", lambda: {}["no name"])
    assert server.tunnel(8080) == "ssh -L 8080:localhost:8080 lab"


@pytest.mark.parametrize(
    ("environment", "terminal", "remote"),
    [
        ({"SSH_CONNECTION": "a 1 b 22"}, True, True),
        ({"SSH_CONNECTION": "a 1 b 22"}, False, False),  # a script that nobody watches
        ({"SSH_CONNECTION": "a 1 b 22", "CI": "true"}, True, False),
        ({"DISPLAY": ":0"}, True, False),
    ],
)
def test_where_somebody_sits_at_another_machine(monkeypatch, environment, terminal, remote):
    monkeypatch.setattr(os, "environ", environment)
    monkeypatch.setattr(sys.stdin, "isatty", lambda: terminal, raising=False)
    assert server.is_remote() is remote
    monkeypatch.setattr(sys, "stdin", None)  # closed, or under pythonw
    assert server.is_remote() is False


def test_a_pages_name_is_a_files_name():
    assert page_name(task_from(TASK, "short").model_copy(update={"name": "../a b/ü"})) == ".._a_b_.html"


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C cannot be sent to a child there")
def test_ctrl_c_leaves_cleanly(run, tmp_path):
    file = tmp_path / "short.toml"
    file.write_text(file.read_text("utf-8").replace('"panda"', '"fr3"'), "utf-8")  # no meshes to read
    environment = {**os.environ, "DISPLAY": ":7", "BROWSER": "echo open %s"}
    command = [sys.executable, "-u", "-m", "invariantqp", "run", "short.toml", "--view"]
    with subprocess.Popen(
        command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as viewing:
        try:
            said = [viewing.stderr.readline(), viewing.stderr.readline()]
            viewing.send_signal(signal.SIGINT)
            out, err = viewing.communicate(timeout=10)
        finally:
            viewing.kill()
    assert (viewing.returncode, err) == (0, "")
    url = re.fullmatch(r"the view is at (http://localhost:\d+)\n", said[0])[1]
    assert said[1] == "playing; Ctrl-C ends it\n"
    assert f"open {url}\n" in out
    assert "accepted" in out


def test_over_ssh_the_run_is_served_to_another_machine(run, monkeypatch):
    monkeypatch.setattr("invariantqp.workbench.view.server.is_remote", lambda: True)
    monkeypatch.setattr("invariantqp.workbench.view.server.Viewer.play", lambda *_: None)
    monkeypatch.setenv("SSH_CONNECTION", "10.0.0.9 5000 10.0.0.2 22")
    status, _, err = run("short.toml", "--view")
    assert status == 0
    assert re.search(
        r"on your machine: ssh -L (\d+):localhost:\1 \S+@10.0.0.2\nthe view is at http://localhost:\1\n", err
    )
