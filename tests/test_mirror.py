"""tests/ has the folders of the package; what tests a file or a folder lies beside it, or in a folder above."""

from pathlib import Path

import invariantqp as iq

PACKAGE, TESTS = Path(iq.__file__).parent, Path(__file__).parent
# Tests of the whole, and what tests use.
OTHERS = {"benchmarks", "properties", "support", "typing"}
FILES = [file.relative_to(TESTS) for file in TESTS.rglob("test_*.py") if file.relative_to(TESTS).parts[0] not in OTHERS]


def test_every_folder_is_one_of_the_package():
    assert {str(file.parent) for file in FILES if not (PACKAGE / file.parent).is_dir()} == set()


def test_a_test_named_as_a_file_lies_with_it():
    home = {}
    for file in PACKAGE.rglob("*.py"):
        folder, name = file.relative_to(PACKAGE).parent, file.name
        home.setdefault(f"test_{name}", set()).add(folder)
        if name == "__init__.py":
            home.setdefault(f"test_{folder.name}.py", set()).update((folder, folder.parent))
    stray = [
        file
        for file in FILES
        if file.name in home and not any(place.is_relative_to(file.parent) for place in home[file.name])
    ]
    assert stray == []
