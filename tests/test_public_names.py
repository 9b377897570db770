"""What is public: the fixed names at the top, the rest in namespaces, all of it shown."""

import inspect
import re
from pathlib import Path

import pytest
from support.public_names import public_names

ROOT = Path(__file__).parent.parent
PUBLIC = public_names()
NAMESPACES = {space: names for space, names in PUBLIC.items() if space}
# Scripts are written against these.
TOP = {
    "a script": "load_robot Controller Follower PathFollower solve_velocity solve_velocities solve_pose solve_poses "
    "load_task run_task",
    "arguments": "Bounds ExactRows Guard PitchForm CarriedMetric Complement Target tool_metric",
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
