"""The guide's page of task file keys is what the tables say; run this file to write it anew."""

from pathlib import Path

from invariantqp.runs.reference import reference

PAGE = Path(__file__).parents[2] / "examples" / "guide" / "task_files.md"
BEGIN, END = "<!-- generated -->\n", "<!-- end -->"


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
