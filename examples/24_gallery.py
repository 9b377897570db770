"""A gallery: every task as a moving picture and as a page that plays, every example with what it draws.

    python examples/24_gallery.py gallery                 half a minute; open gallery/index.html
    python examples/24_gallery.py gallery so101_line      these alone are run, the others only listed

A picture is one SVG of 10 to 20 kB that needs no script: the arm as the run moved it, the path that was asked for
(orange), and what the tool drew (blue).
"""

import html
import runpy
import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np

import invariantqp as iq
from invariantqp import tasks, workbench
from invariantqp.workbench.pictures.charts import BLUE, ORANGE
from invariantqp.workbench.view.timeline import timeline_of

HERE = Path(__file__).parent
# Examples that draw: what is run, and the file that comes of it.
DRAWING = {"07_speed_and_accuracy": "speed_and_accuracy.svg", "23_conventions": "conventions.svg"}
WIDTH, HEIGHT, EDGE, FRAMES, GHOSTS = 420, 300, 16, 60, 5
# Seen from the front, the right and above: rows are the page's right and down.
ABOVE = np.array([[-0.5, 0.866, 0.0], [0.3, 0.173, -0.938]])
STYLE = f"""path, polyline, polygon {{ fill: none; stroke-linejoin: round; stroke-linecap: round; stroke-width: 2 }}
.arm {{ stroke: #57606a; stroke-width: 5 }} .ghost {{ stroke: #8c959f; stroke-opacity: .3; stroke-width: 3 }}
.wanted {{ stroke: {ORANGE}; stroke-width: 6; stroke-opacity: .7 }} .drawn {{ stroke: {BLUE} }}
.joint {{ fill: #24292f }}
.face {{ fill: #8c959f; fill-opacity: .16; stroke: none }} .axis {{ stroke: #8c959f; stroke-dasharray: 6 5 }}
@media (prefers-color-scheme: dark) {{
.arm {{ stroke: #9da7b1 }} .joint {{ fill: #e6edf3 }} .drawn {{ stroke: #58a6ff }} }}
"""
PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>invariantqp: gallery</title><style>
:root {{ color-scheme: light dark }}
body {{ font: 15px/1.45 system-ui, sans-serif; margin: 24px auto; max-width: 1320px; padding: 0 16px }}
main {{ display: grid; grid-template-columns: repeat(auto-fill, minmax(380px, 1fr)); gap: 24px }}
section {{ border: 1px solid #8c959f66; border-radius: 8px; padding: 14px }} img {{ width: 100% }} h3 {{ margin: 0 }}
code {{ background: #8c959f26; padding: 1px 5px; border-radius: 4px }} p {{ margin: 6px 0 }}
</style></head><body><h1>invariantqp: gallery</h1>
<h2>Tasks</h2><main>{tasks}</main><h2>Hard ones</h2><main>{hard}</main>
<h2>Examples</h2><main>{examples}</main></body></html>
"""


def line(points, kind, inside=""):
    spots = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline points="{spots}" class="{kind}">{inside}</polyline>'


def moving_picture(film):
    """The run as an SVG."""
    chosen = np.unique(np.linspace(0, len(film.time) - 1, FRAMES).round().astype(int))
    shapes = [film.points, film.wanted[:, :3, 3], film.tool[:, :3, 3], film.surroundings.faces]
    axis = np.empty((0, 3)) if film.surroundings.axis is None else film.surroundings.axis
    flat = [a @ ABOVE.T for a in (*shapes, axis)]
    spots = np.vstack([a.reshape(-1, 2) for a in flat])
    low, high = spots.min(axis=0), spots.max(axis=0)
    scale = ((np.array([WIDTH, HEIGHT]) - 2 * EDGE) / (high - low)).min()
    shift = 0.5 * np.array([WIDTH, HEIGHT]) - 0.5 * scale * (low + high)
    arms, wanted, drawn, faces, axis = (scale * a + shift for a in flat)
    moves = ";".join(" ".join(f"{x:.0f},{y:.0f}" for x, y in arm) for arm in arms[chosen])
    animate = f'<animate attributeName="points" dur="{film.time[-1]:.2f}s" repeatCount="indefinite" values="{moves}"/>'
    dot = '<circle cx="2" cy="2" r="1.1" class="joint"/>'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}">',
        f"<style>{STYLE}",
        ".arm { marker-start: url(#j); marker-mid: url(#j) }</style>",
        f'<defs><marker id="j" markerWidth="4" markerHeight="4" refX="2" refY="2">{dot}</marker></defs>',
        *(f'<polygon points="{" ".join(f"{x:.0f},{y:.0f}" for x, y in face)}" class="face"/>' for face in faces),
        line(axis, "axis") if len(axis) else "",
        *(line(arms[i], "ghost") for i in chosen[:: len(chosen) // GHOSTS]),
        line(wanted[:: max(1, len(wanted) // 200)], "wanted"),
        line(drawn[:: max(1, len(drawn) // 200)], "drawn"),
        line(arms[0], "arm", animate),
    ]
    return "".join([*parts, "</svg>\n"])


def card(name, picture, words, link):
    image = f'<a href="{link}"><img src="{picture}" alt="{name}"></a>' if picture else ""
    return f"<section><h3>{name}</h3>{image}{words}</section>"


def task_card(name, folder, *, run):
    """A task: what it is and how to run it; drawn if it is run."""
    task = iq.load_task(name)
    words = f"<p>{html.escape(task.about)}</p><p><code>invariantqp run {name}</code></p>"
    if not run:
        return card(name, "", words, "")
    trace, file = iq.run_task(task), name.replace("/", "_")
    (folder / f"{file}.svg").write_text(moving_picture(timeline_of(trace)), encoding="utf-8")
    workbench.animation(trace, folder / f"{file}.html")
    error, limits = 1e3 * trace.position_error.max(), 100 * np.mean(trace.limit_active)
    told = f"<p>Largest error {error:.2g} mm; a limit is active in {limits:.0f} % of the ticks.</p>"
    return card(name, f"{file}.svg", told + words, f"{file}.html")


def example_card(file, folder, *, run):
    """An example: its first sentence, and what it draws if it is run."""
    first = file.read_text(encoding="utf-8").removeprefix('"""').split("\n", 1)[0].removesuffix('"""')
    words = f"<p>{html.escape(first)}</p><p><code>python examples/{file.name}</code></p>"
    picture = DRAWING.get(file.stem, "") if run else ""
    if picture:
        with redirect_stdout(StringIO()):
            runpy.run_path(str(file))["main"](str(folder / picture))
    return card(file.stem, picture, words, picture)


def main(folder, chosen):
    folder.mkdir(parents=True, exist_ok=True)
    jobs, hard = (
        [task_card(name, folder, run=not chosen or name in chosen) for name in tasks.shipped_tasks(part)]
        for part in ("", "stability")
    )
    files = sorted(HERE.glob("[0-9]*.py"))
    shown = [example_card(file, folder, run=not chosen or file.stem in chosen) for file in files]
    text = PAGE.format(tasks="".join(jobs), hard="".join(hard), examples="".join(shown))
    (folder / "index.html").write_text(text, encoding="utf-8")
    print(f"{len(jobs) + len(hard)} tasks and {len(shown)} examples: {folder / 'index.html'}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "gallery"), sys.argv[2:])
