"""`invariantqp run --view`: the file that is written, and where it is opened."""

import json
import os
import sys
import webbrowser
from functools import partial

import pytest
from support.command_line import call
from support.views import TASK, read

from invariantqp.workbench.cli.run import has_display, page_name
from invariantqp.workbench.runs.taskfile import task_from


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


@pytest.fixture
def opened(monkeypatch):
    """The addresses that a browser is asked to open."""
    addresses = []
    monkeypatch.setattr(webbrowser, "open", addresses.append)
    return addresses


@pytest.mark.parametrize(
    "arguments",
    [("short.toml", "--view", "seen.html"), ("--view", "seen.html", "short.toml"), ("short.toml", "--view=seen.html")],
    ids=["after", "before", "equals"],
)
def test_the_view_goes_to_a_file(run, tmp_path, arguments):
    assert run(*arguments, "--quiet") == (0, "", "")
    assert read((tmp_path / "seen.html").read_text(encoding="utf-8")).tags[0][0] == "html"


@pytest.mark.parametrize("arguments", [("short.toml", "--view"), ("--view", "short.toml")], ids=["after", "before"])
@pytest.mark.parametrize("display", [False, True], ids=["no display", "display"])
def test_without_a_file_the_view_is_named_by_the_task(run, opened, monkeypatch, tmp_path, arguments, display):
    monkeypatch.setattr(sys, "platform", "linux")
    if display:
        monkeypatch.setenv("DISPLAY", ":0")
    status, out, err = run(*arguments)
    page = tmp_path / "a_short_one.html"
    assert status == 0
    assert "accepted" in out
    assert err == "the view is written to a_short_one.html\n"
    assert page.stat().st_size > 50_000
    assert opened == ([page.resolve().as_uri()] if display else [])


def test_a_quiet_view_is_opened_and_one_with_a_file_is_not(run, opened, monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", ":0")
    assert run("short.toml", "--view", "seen.html", "--quiet") == (0, "", "")
    assert opened == []
    assert run("short.toml", "--view", "--quiet") == (0, "", "")
    assert len(opened) == 1


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
def test_where_there_is_a_screen(monkeypatch, platform, environment, display):
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(os, "environ", environment)
    assert has_display() is display


def test_a_pages_name_is_a_files_name():
    assert page_name(task_from(TASK, "short").model_copy(update={"name": "../a b/ü"})) == ".._a_b_.html"
