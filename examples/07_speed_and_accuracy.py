"""Speed against accuracy: the chart and the table of ten rows, from results that are kept beside this script.

Every figure is in examples/comparison/results.json: machine, versions, seeds, medians. To measure it all again,
ten minutes on two cores, and to draw README's chart and write its table from that:

    invariantqp compare --out examples/comparison
    python examples/07_speed_and_accuracy.py --readme

Run: python examples/07_speed_and_accuracy.py [picture.svg]      draws the chart and prints the table
"""

import sys
from pathlib import Path

from invariantqp.compare.report.findings import findings
from invariantqp.compare.report.report import charts_of
from invariantqp.compare.report.tables import readme_table, write_readme
from invariantqp.compare.results import load_results

HERE = Path(__file__).parent
RESULTS = HERE / "comparison" / "results.json"
PICTURE = HERE / "pictures" / "speed_and_accuracy.png"


def main(word):
    results = load_results(RESULTS)
    picture = PICTURE if word == "--readme" else Path(word)
    chart = charts_of(results)[0]
    chart.draw(results, picture)
    print(f"{chart.title}: {picture.name}\n\n{chart.caption(results)}\n")
    print(readme_table(results), "\n")
    for sentence in findings(results):
        print("-", sentence)
    if word == "--readme":
        write_readme(results, HERE.parent / "README.md")
        print("\nREADME.md has the table.")
    else:
        print(f"\nmeasured on {results['machine']['processor']}; to do so again: invariantqp compare --out DIR")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "speed_and_accuracy.svg")
