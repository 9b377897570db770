"""The guide's page of task file keys is what the tables say; run this file to write it anew."""

import json
from pathlib import Path
from typing import get_args

from invariantqp.workbench.runs.clearancespec import BodySpec, ObstacleSpec
from invariantqp.workbench.runs.newtask import PATHS, TABLES, key_default, section_description
from invariantqp.workbench.runs.section import toml
from invariantqp.workbench.runs.taskfile import Screw, Task

PAGE = Path(__file__).parents[3] / "examples" / "guide" / "task_files.md"
# Tables of which a file may have several.
SEVERAL = (Screw, ObstacleSpec, BodySpec)
BEGIN, END = "<!-- generated -->\n", "<!-- end -->"


def reference():
    """Every key of a task file, as Markdown."""
    plain = {name: field for name, field in Task.model_fields.items() if name not in TABLES.values()}
    parts = ["### Keys before the first table\n\n" + rows(plain)]
    kinds = {section: kind for kind, section in PATHS.items()}
    for section, header in TABLES.items():
        kind = kinds.get(section, "")
        heads = f"[[{header}]]" if section in SEVERAL else f"[{header}]"
        title = f"### {heads}{f', kind = {json.dumps(kind)}' if kind else ''}"
        fields = {name: field for name, field in section.model_fields.items() if not (kind and name == "kind")}
        parts.append(f"{title}\n\n{section_description(section)}\n\n{rows(fields)}")
    return "\n\n".join(parts) + "\n"


def rows(fields):
    """A Markdown table of keys."""
    lines = ["| key | default | example | meaning |", "|---|---|---|---|"]
    for name, field in fields.items():
        default = key_default(field)
        shown = "required" if field.is_required() else "" if default is None else f"`{toml(default)}`"
        example = f"`{toml(field.examples[0])}`" if field.examples else ""
        choices = [json.dumps(word) for word in get_args(field.annotation) if isinstance(word, str)]
        listed = f"one of {', '.join(choices)}" if len(choices) > 1 else ""
        said = "; ".join(part for part in (field.description, listed) if part)
        lines.append(f"| `{name}` | {shown} | {example} | {said} |".replace("  ", " "))
    return "\n".join(lines)


def split():
    """The page before, within and after what is generated."""
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    within, after = rest.split(END)
    return before, within, after


def test_the_page_of_keys_is_the_tables():
    assert split()[1] == reference()


if __name__ == "__main__":
    before, _, after = split()
    PAGE.write_text(before + BEGIN + reference() + END + after, encoding="utf-8")
