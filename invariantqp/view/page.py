"""A run as one HTML file: no network, no server, no library; a browser with a canvas is enough.

The numbers travel as base64 of float32, in lengths of the robot, so a run of any length is some hundred kilobytes.
"""

from __future__ import annotations

import base64
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from invariantqp.errors import BadInput
from invariantqp.geometry.arrays import Array
from invariantqp.pictures.palette import BLUE, ORANGE
from invariantqp.runs.trace import Trace
from invariantqp.template import fill_template
from invariantqp.view.film import FORCE, Chart, Film, colours, film_of

SCRIPTS = ("painter.js", "charts.js", "player.js")
# Curves whose names stand above a chart; of more, the joints' bars tell which is which.
KEYED = 3


def page(film: Film) -> str:
    """The file's text."""
    scripts = [_script(name) for name in SCRIPTS]
    values = {"title": film.title, "about": film.about, "run": _run(film), "scripts": scripts}
    return fill_template("invariantqp.view", "page.html", values)


def animation(trace: Trace, file: Path | str) -> Path:
    """Write a run as a page to play, pause and scrub in any browser.

    Raises:
        BadInput: the file cannot be written.
        RobotModelError, UnknownName, MissingExtra: the robot cannot be had any more.
    """
    text = page(film_of(trace))
    try:
        Path(file).write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(str(file), error.strerror or str(error), "a file that can be written") from error
    return Path(file)


def _script(name: str) -> str:
    return (resources.files(__package__) / name).read_text(encoding="utf-8")


def _run(film: Film) -> dict[str, Any]:
    """What the page draws."""
    named = {
        "time": film.time,
        "points": film.points,
        "axes": film.axes,
        "tool": film.tool,
        "wanted": film.wanted,
        "q": film.q,
        "limits": film.limits,
        "speed": film.speed,
        "speed_limit": film.speed_limit,
        "faces": film.surroundings.faces,
    }
    if film.force is not None:
        named["force"] = film.force
    return {
        "joints": film.joints,
        "colours": colours(len(film.joints)),
        "hues": {"wanted": ORANGE, "drawn": BLUE, "force": FORCE},
        "slides": film.slides,
        "centre": film.centre.tolist(),
        "size": film.size,
        "status": film.status,
        "bound": film.bound,
        "axis": None if film.surroundings.axis is None else film.surroundings.axis.tolist(),
        "strongest": film.strongest,
        "charts": [_chart(c) for c in film.charts],
        "arrays": {name: _packed(a) for name, a in named.items()},
    }


def _chart(chart: Chart) -> dict[str, Any]:
    return {**chart._asdict(), "values": _packed(chart.values), "keyed": len(chart.names) <= KEYED}


def _packed(a: Array) -> dict[str, Any]:
    return {"shape": a.shape, "data": base64.b64encode(np.ascontiguousarray(a, dtype="<f4").tobytes()).decode("ascii")}
