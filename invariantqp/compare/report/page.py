"""A page as a list of blocks, written as one HTML file with its pictures in it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from invariantqp.template import fill_template

# A table cell with more characters than this holds words, which are wrapped and aligned to the left.
WORDS = 28


@dataclass(frozen=True)
class Heading:
    """A heading; level 1 is the title of the page."""

    text: str
    level: int = 2


@dataclass(frozen=True)
class Paragraph:
    """Sentences."""

    text: str


@dataclass(frozen=True)
class Bullets:
    """A list of sentences."""

    items: Sequence[str]


@dataclass(frozen=True)
class Code:
    """Lines to type."""

    text: str


@dataclass(frozen=True)
class Table:
    """Rows of strings under the names of their columns; the first column names the row."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Picture:
    """An SVG file with its title and its caption."""

    file: Path
    title: str
    caption: str

    @property
    def svg(self) -> str:
        """The picture as an element of an HTML page."""
        return inline_svg(self.file)


@dataclass(frozen=True)
class Folded:
    """A table that a reader opens."""

    title: str
    table: Table


Block = Heading | Paragraph | Bullets | Code | Table | Picture | Folded


def html(title: str, blocks: Sequence[Block]) -> str:
    """The page as one HTML file that needs no other file."""
    named = [(type(block).__name__, block) for block in blocks]
    return fill_template("invariantqp.compare.report", "page.html", {"title": title, "blocks": named, "words": WORDS})


def table_markdown(table: Table) -> str:
    """A table as Markdown."""
    lines = ["| " + " | ".join(cell.replace("|", r"\|") for cell in row) + " |" for row in (table.columns, *table.rows)]
    lines.insert(1, "|" + "---|" * len(table.columns))
    return "\n".join(lines)


def inline_svg(file: Path) -> str:
    """An SVG file as an element of an HTML page; its ids begin with the name of the file, as no other picture's do."""
    text = file.read_text(encoding="utf-8")
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    name = file.stem
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = re.sub(r'((?:xlink:)?href)="#', rf'\1="#{name}-', text)
    return re.sub(r"url\(#", f"url(#{name}-", text)
