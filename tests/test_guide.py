"""Every page of the guide runs, and prints what its comments say; every link leads somewhere."""

import re
import sys
from pathlib import Path

import pytest

from invariantqp.workbench.pictures import inspection as pictured

ROOT = Path(__file__).parent.parent
GUIDE = ROOT / "examples" / "guide"
PAGES = sorted(GUIDE.glob("*.md"))
CODE = re.compile(r"^```python\n(.*?)^```", flags=re.DOTALL | re.MULTILINE)
PRINTED = re.compile(r"\s*print\(.*\)  # (.*)")


def script(page):
    """The code of a page, each line where it is on the page."""
    text = page.read_text(encoding="utf-8")
    lines = [""] * len(text.splitlines())
    for block in CODE.finditer(text):
        code, first = block[1].splitlines(), text[: block.start(1)].count("\n")
        lines[first : first + len(code)] = code
    return lines


def what_it_prints(page):
    """The number of a line, and what it printed, in turn; in this process, where a warning is an error."""
    said = []

    def note(*values):
        said.append((sys._getframe(1).f_lineno, " ".join(map(str, values))))

    code = compile("\n".join(script(page)), page.name, "exec")
    exec(code, {"__name__": "__main__", "print": note})
    return said


@pytest.mark.parametrize("page", [p for p in PAGES if any(script(p))], ids=lambda page: page.stem)
def test_a_page_runs_and_prints_what_it_says(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setattr(pictured, "SWEEP", 13)  # lines of few points
    told = {i: found[1] for i, line in enumerate(script(page), 1) if (found := PRINTED.fullmatch(line))}
    said = [(line, text) for line, text in what_it_prints(page) if line in told]
    assert said == [(line, told[line]) for line, _ in said]
    assert {line for line, _ in said} >= {line for line in told if "error" not in script(page)[line - 1]}


def test_every_page_is_linked_from_the_first():
    first = (GUIDE / "README.md").read_text(encoding="utf-8")
    assert [page.name for page in PAGES if page.name != "README.md" and f"({page.name})" not in first] == []
    assert "(examples/guide/" in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_link_leads_somewhere(page):
    links = re.findall(r"\]\((?!http)([^)#]+)", page.read_text(encoding="utf-8"))
    assert [link for link in links if not (GUIDE / link).exists()] == []
