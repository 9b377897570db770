"""Every file and every name in CONTRIBUTING exists."""

import re
from pathlib import Path

import invariantqp as iq

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / ".github" / "CONTRIBUTING.md").read_text(encoding="utf-8")
QUOTED = set(re.findall(r"`([^`\s]+)`", TEXT))
# Paths are from the root, from the package, or from the velocity law.
PACKAGE = Path(iq.__file__).parent
FILES = {word for word in QUOTED if re.fullmatch(r"(?!\.venv)[\w./]+(/|\.(py|md|toml|json|png))", word)}
SCRIPTS = set(re.findall(r"^    (?:python )?((?:\.ci|examples|tests)/[\w./]+)", TEXT, flags=re.MULTILINE))


def exists(name):
    return any((folder / name).exists() for folder in (ROOT, PACKAGE, PACKAGE / "velocity"))


def test_every_file_it_names_exists():
    assert len(FILES) > 40
    assert len(SCRIPTS) >= 2
    assert sorted(name for name in FILES | SCRIPTS if not exists(name)) == []


def test_every_name_in_it_is_used_in_the_package():
    source = "\n".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py"))
    names = {word for word in QUOTED if re.fullmatch(r"_?[A-Z]\w+", word)}
    assert len(names) > 5
    assert sorted(name for name in names if not re.search(rf"\b{name}\b", source)) == []
