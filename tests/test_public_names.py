"""What is public: the fixed names at the top, the rest in namespaces, old names with a warning, all of it shown."""

import inspect
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from support.public_names import public_names

import invariantqp as iq

ROOT = Path(__file__).parent.parent
PUBLIC = public_names()
NAMESPACES = {space: names for space, names in PUBLIC.items() if space}
MOVED = vars(iq)["_MOVED"]
# Scripts are written against these.
TOP = {
    "a script": "load_robot Controller Follower PathFollower solve_velocity solve_velocities solve_pose solve_poses "
    "load_task run_task",
    "arguments": "Bounds ExactRows Guard PitchForm CarriedMetric Complement tool_metric",
    "force": "HybridController HybridTask Wrench WrenchSensor point_contact dual_projectors",
    "frames": "adjoint coadjoint exp log inverse transform revolute",
    "screw systems": "pitch_form pitch_form_inverse pseudoinverse has_pseudoinverse reciprocal principal_pitches "
    "gibson_hunt involution",
    "what is caught": "InvariantQPError BadInput NoPseudoinverse NoProjectors BlindSystem",
    "answers": "Status",
    "more": "__version__ native",
}


def words(table):
    return {word for words in table.values() for word in words.split()}


def test_the_top_has_the_names_of_most_scripts_and_no_other():
    assert set(PUBLIC[""]) == words(TOP)


def test_every_name_at_the_top_is_in_a_namespace_too():
    elsewhere = {name: value for names in NAMESPACES.values() for name, value in names.items()}
    assert {name for name in PUBLIC[""] if name not in elsewhere} == {"__version__", "native"}
    assert all(value is elsewhere[name] for name, value in PUBLIC[""].items() if name in elsewhere)


def test_no_name_is_in_two_namespaces():
    # One for each library whose FrameTask it replaces.
    names = [name for space, names in NAMESPACES.items() if space != "mink" for name in names]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("name", MOVED)
def test_a_name_that_moved_works_and_says_where_it_is(name):
    assert name not in iq.__all__
    assert name not in dir(iq)
    with pytest.warns(DeprecationWarning, match=f"invariantqp.{name} is now {MOVED[name]}.{name}$") as caught:
        value = getattr(iq, name)
    assert value is PUBLIC[MOVED[name].removeprefix("invariantqp.")][name]
    assert caught[0].filename == __file__


def test_an_import_of_a_name_that_moved_blames_the_line_that_imports_it():
    code = "from invariantqp import method_for\nprint(method_for.__name__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "method_for\n"
    assert "<string>:1: DeprecationWarning: invariantqp.method_for is now invariantqp.velocity" in done.stderr


def test_nothing_warns_that_is_where_it_belongs():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        public_names()


@pytest.mark.parametrize("space", NAMESPACES)
def test_every_name_is_documented(space):
    for name, value in NAMESPACES[space].items():
        if callable(value):
            assert inspect.getdoc(value), name


def test_every_name_is_shown_in_the_readme_or_an_example():
    files = [ROOT / "README.md", *(ROOT / "examples").rglob("*.py"), *(ROOT / "examples").rglob("*.md")]
    text = "\n".join(file.read_text(encoding="utf-8") for file in files)
    seen = set(re.findall(r"\w+", text))
    names = {name for names in PUBLIC.values() for name in names}
    assert sorted(names - seen) == []
