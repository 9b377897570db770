"""Class names of the comparison are unique in the package."""

import re
from collections import defaultdict
from pathlib import Path

import invariantqp as iq

PACKAGE = Path(iq.__file__).parent


def test_no_class_of_the_comparison_has_the_name_of_another_class():
    places = defaultdict(list)
    for file in sorted(PACKAGE.rglob("*.py")):
        for name in re.findall(r"^ *class (\w+)", file.read_text(encoding="utf-8"), re.MULTILINE):
            places[name].append(file.relative_to(PACKAGE).as_posix())
    assert len(places) > 100
    shared = {name: files for name, files in places.items() if len(files) > 1}
    assert {
        name: files for name, files in shared.items() if any(f.startswith("workbench/compare/") for f in files)
    } == {}
