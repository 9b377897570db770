"""CITATION.cff cites the version of this package, and the paper by its authors."""

import re
from pathlib import Path

import invariantqp as iq

TEXT = (Path(__file__).parent.parent / "CITATION.cff").read_text(encoding="utf-8")


def test_it_cites_this_version():
    assert re.findall(r"^version: (.+)$", TEXT, flags=re.MULTILINE) == [iq.__version__]


def test_it_cites_the_paper_by_both_authors():
    own, references = TEXT.split("\nreferences:\n")
    assert "name: The invariantqp authors" in own
    assert re.findall(r"family-names: (\w+)", references) == ["Donelan", "Selig"]
