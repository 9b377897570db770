"""The stub of the compiled core, `_native.pyi`: what fields.h has of it, written from there.

python invariantqp/csrc/stub.py     writes it anew; a test asks that it is up to date
"""

from __future__ import annotations

import re
from pathlib import Path

SOURCES = Path(__file__).parent
STUB = SOURCES.parent / "_native.pyi"
# What is between these lines is written.
BEGIN, END = "# From csrc/fields.h by csrc/stub.py:\n", "# By hand:\n"
TABLE = re.compile(r"/\* (?P<about>[^*]*?) \*/\n#define (?P<name>[A-Z]+)_FIELDS \\\n(?P<lines>(?:.*\\\n)*.*\n)")
LINE = re.compile(r"    (?P<kind>[A-Z_]+)\((?P<name>[\w.]+), (?P<rest>.*?), \"(?P<meaning>.*)\"\)")
# What comes before the fields of a call, and its answer.
CALLS = {
    "TICK": ("    law: Law,\n    unlimited: Law = ...,\n", "VelocitySolution"),
}
TYPES = {
    "NUMBER": "float",
    "COUNT": "int",
    "FLAG": "bool",
    "VECTOR": "Array",
    "MATRIX": "Array",
    "TUPLE": "tuple[str, ...]",
}


def fields(lines: str, words: dict[str, str]) -> list[tuple[str, str, bool, str]]:
    """Name, type, whether it has a default, and meaning of each field, lengths apart."""
    found = []
    for line in LINE.finditer(lines):
        kind, rest = line["kind"], line["rest"].split(", ")
        if kind == "LENGTH":
            continue
        needed = rest[-1] == "NEEDED" or kind == "OBJECT"
        shape = rest[: 2 if "MATRIX" in kind else 1] if kind.endswith(("VECTOR", "MATRIX")) else []
        type_ = TYPES.get(kind.removeprefix("MAYBE_"), "")
        if kind == "WORD":
            type_ = f"Literal[{words[rest[0]]}]"
        elif kind.startswith("OBJECT"):
            type_ = rest[0] if kind == "OBJECT" else f"tuple[{rest[0]}, ...]"
        type_ += " | None" if kind.startswith("MAYBE") else ""
        of = f"({', '.join(shape)}{',' * (len(shape) == 1)}) " if shape else ""
        found.append((line["name"].replace(".", "_"), type_, needed, of + line["meaning"]))
    return found


def written(text: str) -> str:
    """The stub's part."""
    words = dict(re.findall(r"#define (\w+_WORDS) (.*)", text))
    parts, calls = [], ""
    for table in TABLE.finditer(text):
        made = fields(table["lines"], words)
        arguments = [
            f"{name}: {type_}" if needed else f"{name}: {type_.removesuffix(' | None')} | None = None"
            for name, type_, needed, _ in made
        ]
        listed = "".join(f"        {argument},\n" for argument in arguments)
        if table["name"] in ("NOW",):  # `step` is written by hand
            continue
        if table["name"] in CALLS:
            given, answer = CALLS[table["name"]]
            part = f"def {table['name'].lower()}(\n{given}    /,\n    *,\n" + listed.replace("        ", "    ")
            calls += f"{part}) -> {answer} | None: ...\n"
            continue
        part = f"class {table['name'].capitalize()}:\n"
        part += "".join(f"    {name}: {type_}  # {meaning}\n" for name, type_, _, meaning in made)
        parts.append(f"{part}    def __init__(\n        self,\n        *,\n{listed}    ) -> None: ...\n")
    return "\n".join([*parts, calls])


def stub() -> str:
    """The whole stub."""
    head, _, rest = STUB.read_text().partition(BEGIN)
    return head + BEGIN + "\n" + written((SOURCES / "fields.h").read_text()) + "\n" + END + rest.partition(END)[2]


if __name__ == "__main__":
    STUB.write_text(stub())
