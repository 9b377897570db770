"""The blocks of code of a page, in its order: fenced ones, and those that are indented by four spaces."""

import re
from typing import NamedTuple

FENCED = re.compile(
    r"(?:^<!-- (?P<mark>\w+) -->\n)?^```(?P<language>\w*)\n(?P<code>.*?)^```\n", re.DOTALL | re.MULTILINE
)
INDENTED = re.compile(r"(?<=\n\n)(?:    .*\n|\n)+")
# What a block of Python says in a comment that it needs; nothing is said where a plain install has all.
EXTRAS = re.compile(r"# pip install -e '\.\[([\w,]+)\]'")


class Block(NamedTuple):
    """One block: "python", or "" for the shell, and the mark in the line above it."""

    language: str
    code: str
    mark: str = ""


def blocks(page: str) -> list[Block]:
    """All blocks of a page."""
    found: dict[int, Block] = {}

    def fenced(match: re.Match[str]) -> str:
        found[match.start()] = Block(match["language"], match["code"], match["mark"] or "")
        return re.sub(r"[^\n]", "-", match[0])

    rest = FENCED.sub(fenced, page)
    for match in INDENTED.finditer(rest):
        code = re.sub(r"^    ", "", match[0], flags=re.MULTILINE).strip("\n")
        if code:
            found[match.start()] = Block("python", f"{code}\n")
    return [found[place] for place in sorted(found)]


def in_python(page: str) -> list[tuple[str, str, str]]:
    """(block, code, extras) of each block of Python: its code is theirs before it too, and so are its extras."""
    code, needed, told = "", [], []
    for block in blocks(page):
        if block.language == "python":
            code += block.code
            needed += [name for names in EXTRAS.findall(block.code) for name in names.split(",") if name not in needed]
            told.append((block.code, code, ",".join(needed)))
    return told
