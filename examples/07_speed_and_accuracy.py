"""Speed against accuracy at equal information: table, verdict and chart, from results kept beside this script.

Every figure is in examples/comparison/results.json: machine, versions, seeds. To measure all of it again in about ten
minutes on an idle machine (extras robots, peers, placo, drake), draw charts, and write README's part and the report:

    python examples/07_speed_and_accuracy.py --measure

Run: python examples/07_speed_and_accuracy.py [picture.svg]      prints table and verdict, and draws the chart
     python examples/07_speed_and_accuracy.py --readme           draws the charts, writes README's part and the page
     python examples/07_speed_and_accuracy.py --everyday         measures the everyday tasks, a minute; writes the page
"""

import json
import sys
from pathlib import Path

from shared.pages import guide, listed, markdown, write_section

from invariantqp.cli.console import progress
from invariantqp.compare.measurements import KINDS
from invariantqp.compare.report import DARK, draw, losses, verdict, write_report
from invariantqp.compare.results import write_results
from invariantqp.compare.sweep import DEFAULT_TASKS, sweep
from invariantqp.compare.tables import summary

HERE = Path(__file__).parent
FOLDER, PICTURES = HERE / "comparison", HERE / "pictures"


def main(word):
    if word == "--measure":
        with progress("measuring", quiet=False) as report:
            rest = [name for name, kind in KINDS.items() if name != "everyday" and not kind.on_request]
            results = sweep(DEFAULT_TASKS, None, jobs=-1, only=rest, progress=report)
        write_results(FOLDER / "results.json", results)
        write_report(results, FOLDER)
    if word in {"--measure", "--everyday"}:
        with progress("measuring", quiet=False) as report:
            first = sweep([], None, jobs=-1, only=["everyday"], progress=report)
        write_results(FOLDER / "everyday.json", first)
    results, first = (json.loads((FOLDER / file).read_text("utf-8")) for file in ("results.json", "everyday.json"))
    print(markdown(summary(results)), "\n")
    for sentence in verdict(results):
        print("-", sentence)
    if word in {"--measure", "--readme", "--everyday"}:
        write_section(HERE / "guide" / "comparison.md", guide(results, first))
    if word in {"--measure", "--readme"}:
        for columns, width in ((2, ""), (1, "_phone")):
            draw(results, PICTURES / f"speed_and_accuracy{width}.png", columns=columns)
            draw(results, PICTURES / f"speed_and_accuracy{width}_dark.png", DARK, columns)
        write_section(HERE.parent / "README.md", listed(losses(results)))
        print("\nREADME.md has where ours loses, examples/guide/comparison.md the tables, examples/pictures the charts")
    elif word != "--everyday":
        if word:
            draw(results, Path(word))
        print(f"\nmeasured on {results['machine']['processor']}; to do so again: invariantqp compare --out DIR")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "")
