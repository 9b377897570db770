"""Speed against accuracy at equal information: tables and chart, from results kept beside this script.

Every figure is in examples/comparison/results.json: machine, versions, seed. To measure all of it again, in about
twenty minutes on an idle machine (extra peers; invariantqp compare --setup), and write charts, page and README's part:

    python examples/07_speed_and_accuracy.py --measure

Run: python examples/07_speed_and_accuracy.py [picture.svg]      prints who is better and where, and draws the chart
     python examples/07_speed_and_accuracy.py --readme           draws the charts, writes README's part and the page
"""

import json
import sys
from pathlib import Path

from shared.pages import guide, markdown, write_section

from invariantqp.workbench.cli.console import progress
from invariantqp.workbench.compare.report import DARK, draw
from invariantqp.workbench.compare.results import write_results
from invariantqp.workbench.compare.sweep import methods_named, sweep, tasks_of
from invariantqp.workbench.compare.tables import lost_kinds, summary

HERE = Path(__file__).parent
RESULTS, PICTURES = HERE / "comparison" / "results.json", HERE / "pictures"


def main(word):
    if word == "--measure":
        tasks = tasks_of([], None, None, 0, quick=False)
        with progress("measuring", quiet=False) as report:
            write_results(RESULTS, sweep(tasks, methods_named(None), progress=report))
    results = json.loads(RESULTS.read_text("utf-8"))
    for table in (summary(results), lost_kinds(results)):
        print(markdown(table), "\n")
    if word in {"--measure", "--readme"}:
        write_section(HERE / "guide" / "comparison.md", guide(results))
        for columns, width in ((2, ""), (1, "_phone")):
            draw(results, PICTURES / f"speed_and_accuracy{width}.png", columns=columns)
            draw(results, PICTURES / f"speed_and_accuracy{width}_dark.png", DARK, columns)
        write_section(HERE.parent / "README.md", markdown(lost_kinds(results)))
        print("README.md has where ours loses, examples/guide/comparison.md the tables, examples/pictures the charts")
    else:
        if word:
            draw(results, Path(word))
        print(f"measured on {results['machine']['processor']}; to do so again: invariantqp compare --out DIR")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "")
