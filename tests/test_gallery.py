"""The gallery has an entry for every task and every example, and pictures for the tasks that are run."""

import re
import runpy
from pathlib import Path
from xml.etree import ElementTree as ET

from invariantqp import tasks

EXAMPLES = Path(__file__).parent.parent / "examples"


def test_an_entry_for_every_task_and_example(tmp_path, capsys):
    gallery = runpy.run_path(str(EXAMPLES / "24_gallery.py"))
    gallery["main"](tmp_path, ["ur5_wrist"])
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    headings = re.findall("<h3>(.*?)</h3>", page)
    examples = sorted(file.stem for file in EXAMPLES.glob("[0-9]*.py"))
    assert headings == [*tasks.shipped_tasks(), *tasks.shipped_tasks("stability"), *examples]
    assert {"ur5_wrist.svg", "ur5_wrist.html"} == set(re.findall('(?:src|href)="([^"]+)"', page))
    drawn = ET.parse(tmp_path / "ur5_wrist.svg").getroot()
    assert len(drawn.findall(".//{*}animate")) == 1
    assert (tmp_path / "ur5_wrist.svg").stat().st_size < 20_000
    assert (tmp_path / "ur5_wrist.html").stat().st_size > 100_000
