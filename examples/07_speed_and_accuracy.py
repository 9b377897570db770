"""Speed against accuracy at equal information: tables and chart, from results kept beside this script.

Every figure is in examples/comparison: results.json with machine, versions and seed; needs.json of
46_what_a_scene_needs.py; wipe.json and bullet.json of tests/benchmarks/equal_rate.py. To measure the first two again,
in about ten minutes on an idle machine (extra peers; invariantqp compare --setup), and write charts, page and
README's part:

    python examples/07_speed_and_accuracy.py --measure

Run: python examples/07_speed_and_accuracy.py [picture.svg]      prints who is better and where, and draws the chart
     python examples/07_speed_and_accuracy.py --readme           draws the charts, writes README's part and the page
"""

import json
import runpy
import sys
from pathlib import Path

from shared.pages import MEASURED, markdown, write_sections

from invariantqp.workbench.cli.console import progress
from invariantqp.workbench.compare.report import DARK, LIGHT, draw
from invariantqp.workbench.compare.results import write_results
from invariantqp.workbench.compare.sweep import methods_named, sweep, tasks_of
from invariantqp.workbench.compare.tables import losses, summary

HERE = Path(__file__).parent
RESULTS, PICTURES = MEASURED / "results.json", HERE / "pictures"


def main(word):
    if word == "--measure":
        tasks = tasks_of([], None, None, 0, quick=False)
        with progress("measuring", quiet=False) as report:
            write_results(RESULTS, sweep(tasks, methods_named(None), progress=report))
        runpy.run_path(str(HERE / "46_what_a_scene_needs.py"))["write"]()
    results = json.loads(RESULTS.read_text("utf-8"))
    for table in (summary(results), losses(results)):
        print(markdown(table), "\n")
    if word in {"--measure", "--readme"}:
        write_sections(results)
        for columns, width in ((3, ""), (2, "_phone")):
            for colours, mode in ((LIGHT, ""), (DARK, "_dark")):
                draw(results, PICTURES / f"speed_and_accuracy{width}{mode}.png", colours, columns)
        print("README.md has where ours loses, examples/guide/comparison.md the tables, examples/pictures the charts")
    else:
        if word:
            draw(results, Path(word))
        print(f"measured on {results['machine']['processor']}; to do so again: invariantqp compare --out DIR")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "")
