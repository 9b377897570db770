"""A run as one HTML file that needs no network, no server and no library.

Arrays are written as base64 of float32, so a run of any length and an arm's meshes take a few hundred kilobytes.
"""

from __future__ import annotations

import base64
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from invariantqp.errors import BadInput
from invariantqp.geometry.arrays import Array
from invariantqp.workbench.pictures.charts import BLUE, ERROR, ORANGE, SKY, colours
from invariantqp.workbench.runs.trace import Trace
from invariantqp.workbench.template import fill_template
from invariantqp.workbench.view.scenery import Solid
from invariantqp.workbench.view.timeline import FORCE, TRAVEL, Timeline, timeline_of
from invariantqp.workbench.writing import write_text

SCRIPTS = ("motion.js", "hardware.js", "painter.js", "charts.js", "player.js")
# Attributes of a timeline that a page has by the same name: packed arrays, and plain values.
ARRAYS = ("time", "screws", "places", "home", "travel", "wanted", "q", "limits", "speed", "speed_limit", "force")
PLAIN = (
    "joints",
    "coordinates",
    "drivers",
    "recorded",
    "slides",
    "size",
    "status",
    "limit_active",
    "floor",
    "force_scale",
    "travel_scale",
)


def page(timeline: Timeline) -> str:
    """The text of the page."""
    scripts = [(resources.files(__package__) / name).read_text(encoding="utf-8") for name in SCRIPTS]
    parts = [
        {**part._asdict(), "vertices": _pack(part.vertices), "faces": _pack(part.faces, "<u2")}
        for part in timeline.appearance.parts
    ]
    run = {**_content(timeline), "parts": parts}
    values = {"title": timeline.title, "about": timeline.about, "run": run, "scripts": scripts}
    return fill_template("invariantqp.workbench.view", "page.html", values)


def animation(trace: Trace, file: Path | str) -> Path:
    """Write a run as a page that plays in any browser; returns the file.

    Raises:
        BadInput: the file cannot be written.
    """
    text = page(timeline_of(trace))
    try:
        write_text(file, text)
    except OSError as error:
        raise BadInput(str(file), error.strerror or str(error), "a file that can be written") from error
    return Path(file)


def _content(timeline: Timeline) -> dict[str, Any]:
    """The content of a page as JSON, without the arm's appearance."""
    named = {name: a for name in ARRAYS if (a := getattr(timeline, name)) is not None}
    named |= {"path": timeline.wanted[:, :3, 3], "faces": timeline.surroundings.faces}
    return {
        "duration": float(timeline.time[-1]),
        "error_title": ERROR,
        "colours": colours(len(timeline.joints)),
        "hues": {"wanted": ORANGE, "drawn": BLUE, "force": FORCE, "travel": TRAVEL, "body": SKY},
        **{name: getattr(timeline, name) for name in PLAIN},
        "centre": timeline.centre.tolist(),
        "axis": None if timeline.surroundings.axis is None else timeline.surroundings.axis.tolist(),
        "missing": timeline.appearance.missing,
        "solids": [_solid(solid) for solid in timeline.solids],
        # A chart of joints has no legend: its colours are those of the joints' bars.
        "charts": [
            {**c._asdict(), "values": _pack(c.values), "keyed": not set(c.names) <= set(timeline.joints)}
            for c in timeline.charts
        ],
        "arrays": {name: _pack(a) for name, a in named.items()},
    }


def _solid(solid: Solid) -> dict[str, Any]:
    """A shape as JSON; a fixed obstacle has one pose, a body of the arm none."""
    poses = solid.poses
    if poses is not None:
        poses = poses[:1] if (poses == poses[0]).all() else poses
    packed = None if poses is None else _pack(poses[:, :3].reshape(len(poses), 12))
    return {"joint": solid.joint, "faces": _pack(solid.faces), "poses": packed}


def _pack(a: Array, kind: str = "<f4") -> dict[str, Any]:
    return {"shape": a.shape, "data": base64.b64encode(np.ascontiguousarray(a, dtype=kind).tobytes()).decode("ascii")}
