"""Every line of code in the README is a line that runs; every name and every file in it is there."""

import json
import re
import shlex
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from support.readme import Block, blocks, in_python

import invariantqp as iq
from invariantqp.workbench import cli
from invariantqp.workbench.compare import results
from invariantqp.workbench.compare.figures import CHANGES
from invariantqp.workbench.compare.tables import change
from invariantqp.workbench.runs.taskfile import tomllib

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
KEPT = json.loads((ROOT / "examples" / "comparison" / "results.json").read_text(encoding="utf-8"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PROSE = re.sub(r"^```.*?^```", "", README, flags=re.DOTALL | re.MULTILINE)
# Names that the text has introduced where a block of code uses them.
PREAMBLE = """
import numpy as np
import invariantqp
import invariantqp as iq
robot = iq.load_robot("panda")
q = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])
target = robot.pose(q)
J, twist = robot.jacobian(q), np.array([0.1, 0.0, 0.2, 0.0, 0.05, 0.1])
lower, upper = -robot.velocity_limit, robot.velocity_limit
A, b = J[3:], np.zeros(3)
dt = 0.001
controller = iq.Controller(robot, dt=dt)
path = [target, iq.transform(translation=[0.01, 0.0, 0.0]) @ target]
wrist = iq.transform(translation=[0.0, 0.0, -0.1])
reading = np.zeros(6)
Z, matrix, pose = np.eye(6), np.eye(6), np.eye(4)
hand_pose = pose
"""
BLOCKS = in_python(README)
SHELL = [block.code for block in blocks(README) if not block.language]


@pytest.fixture
def python(monkeypatch, tmp_path, capsys):
    """Runs code in this process, where a warning is an error, and returns what it prints."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")

    def said(code):
        exec(compile(code, "README.md", "exec"), {"__name__": "__main__"})
        return capsys.readouterr().out

    return said


def test_no_block_is_overlooked():
    assert len(BLOCKS) >= 4
    assert {block.language for block in blocks(README)} == {"", "python"}
    assert {block.mark for block in blocks(README)} == {"", "run", "test"}
    assert (BLOCKS[0][2], BLOCKS[-1][2]) == ("", "pink")
    page = (
        "Words\n\n    a\n\n    # pip install -e '.[b,c]'\n\n<!-- d -->\n```\ne\n```\n- f\n    g\n\n```python\nh\n```\n"
    )
    first = "a\n\n# pip install -e '.[b,c]'\n"
    assert blocks(page) == [Block("python", first), Block("", "e\n", "d"), Block("python", "h\n")]
    assert in_python(page) == [(first, first, "b,c"), ("h\n", f"{first}h\n", "b,c")]


@pytest.mark.parametrize("block", [code for _, code, _ in BLOCKS], ids=range(len(BLOCKS)))
def test_a_block_of_python_runs_after_those_before_it(block, python):
    """`.ci/readme.py` runs each with no other extras than those that it names."""
    pytest.importorskip("pink") if "pink" in block else None
    said = python(block + "print('', solution.status, solution.reason)")
    assert "closed-form ok" in said
    if "reading" in block:
        assert said.endswith(" lost no contact yet: approaching\n")


@pytest.mark.parametrize("page", [ROOT / "README.md", *(ROOT / "examples").rglob("*.md")], ids=lambda page: page.name)
def test_what_is_to_be_installed_is_this_checkout(page):
    """No index of packages has it."""
    for command in re.findall(r"pip install ([^`\n]+)", page.read_text(encoding="utf-8")):
        for word in set(shlex.split(command)) - {"-e", "--quiet"}:
            assert re.fullmatch(r"\.(\[[\w,]+\])?", word)
            assert set(re.findall(r"\w+", word)) <= PROJECT["optional-dependencies"].keys()


def inline():
    """Code in the text that is an expression or an import, without an ellipsis."""
    for code in re.findall(r"`([^`]+)`", PROSE):
        line = " ".join(code.split())
        if re.match(r"(iq\.|Controller|from invariantqp|invariantqp\.)", line) and "..." not in line:
            yield line


CALLS = [line for line in inline() if "(" in line or line.startswith("from")]


@pytest.mark.parametrize("line", CALLS)
def test_a_line_of_python_in_the_text_runs(line, python):
    python(f"{PREAMBLE}Controller = iq.Controller\n{line}")


def test_every_name_of_ours_is_there():
    names = set(re.findall(r"\b(?:iq|invariantqp)((?:\.[A-Za-z_]\w*)+)", README))
    assert len(names) > 10
    for name in names:
        found = iq
        for part in name.strip(".").split("."):
            found = getattr(found, part)


def commands():
    """Command lines of ours, in blocks and in the text."""
    lines = [line for block in SHELL for line in block.splitlines()]
    lines += [" ".join(code.split()) for code in re.findall(r"`([^`]+)`", PROSE)]
    for line in lines:
        found = re.match(r"(?:\.venv/bin/)?invariantqp (run|inspect|tasks|compare|drag)\b(.*?)(  .*)?$", line)
        if found:
            yield found[1], shlex.split(found[2])


COMMANDS = sorted({(name, *words) for name, words in commands()})
# A task in fewer ticks, so that running it is short whatever is asked of it.
SHORT = (ROOT / "tasks" / "scara.toml").read_text(encoding="utf-8").replace("dt = 0.002", "dt = 0.005")
MEANT = {"TASK": "short.toml", "ROBOT": "so101"}


def test_commands_are_found():
    assert {name for name, *_ in COMMANDS} == {"run", "inspect", "tasks", "compare", "drag"}


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_command_runs(command, tmp_path, monkeypatch, capsys):
    """Those that take minutes are asked for their help, with the same options."""
    words = [MEANT.get(word, word) for word in command]
    if command[0] in {"compare", "drag"} or "mujoco" in command or command in (("run",), ("inspect",)):
        words = [words[0], "--help"]
    (tmp_path / "short.toml").write_text(SHORT, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for name, value in {"COLUMNS": "300", "DISPLAY": "", "WAYLAND_DISPLAY": ""}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "argv", ["invariantqp", *words])
    with pytest.raises(SystemExit) as left:
        cli.main()
    said, complained = capsys.readouterr()
    assert not left.value.code, complained
    if words[-1] == "--help":
        for option in (word for word in command if word.startswith("--")):
            assert option in said
    for option, file in pairwise(words):
        if option in ("--plot", "--json", "--view") and not file.startswith("-"):
            assert (tmp_path / file).stat().st_size > 1000


def test_every_file_it_names_is_there():
    named = re.findall(r"\]\((?!http)([^)#]+)\)|`((?:tests|examples|tasks)/[\w./]+)`", README)
    files = [a or b for a, b in named]
    assert len(files) >= 3
    assert [f for f in files if not (ROOT / f).exists()] == []


def measured(task, figure, method="invariantqp"):
    """A figure of the stored comparison, with the two digits that the README prints."""
    (found,) = [r["figures"][figure] for r in KEPT["runs"] if (r["method"], r["task"]) == (method, task)]
    return f"{found:.2g}"


def test_its_promises_are_what_was_measured():
    said = " ".join(re.search("<!-- promises -->(.*)<!-- end of promises -->", README, re.DOTALL)[1].split())
    ours, theirs = (measured("panda/stay", "joints_deg", who) for who in ("invariantqp", "QP"))
    assert (
        f"Joints of a Panda move by {ours} deg; with a hand-written QP loop and the same posture by {theirs}." in said
    )
    ours, theirs = (measured("ur5e/singular wrist", "acceleration", who) for who in ("invariantqp", "QP"))
    assert f"joints accelerate by {float(ours):.0f} rad/s^2, not {float(theirs):.0f};" in said
    ours, theirs = (float(measured("panda/turn 45", "mm", who)) for who in ("invariantqp", "QP"))
    assert f"swings by {ours:.1g} mm, not {theirs:.0f};" in said
    (fast, slow), (least, most) = (
        (min(times), max(times))
        for who in ("invariantqp", "QP")
        for times in [[r["figures"]["us"] for r in KEPT["runs"] if r["method"] == who]]
    )
    assert f"A tick takes {fast:.0f} to {slow:.0f} us**, the hand-written loop's {least:.0f} to {most:.0f}" in said
    most = max(change(results.measured(KEPT), "invariantqp", kind) for kind in CHANGES)
    assert f"lengths in any unit: the joints move the same, to {most:.0e} rad" in said


def test_the_film_s_figure_is_what_was_recorded():
    recorded = np.loadtxt(ROOT / "examples" / "shared" / "out_of_reach_placo.csv", delimiter=",")
    fastest = 30.0 * np.abs(np.diff(recorded, axis=0)).max()  # frames a second
    assert f"joints at up to {fastest:,.0f} deg/s".replace(",", " ") in README
