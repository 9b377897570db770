"""Names beside points, none over another: each takes the cheapest free place around its point, the others fixed.

cost = distance + crossings of leader lines and markers;   a place over another name or a marker costs more than any

Places are tried in rings around the point; after a first pass, most crowded first, every name may move again. Nothing
is random: the same points are named in the same places.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Annotation

from invariantqp.geometry.arrays import Array

# Rings and directions in which places are tried [points], and what each side of a name keeps free.
RINGS = np.concatenate((np.arange(5.0, 40.0, 5.0), np.arange(40.0, 260.0, 10.0)))
DIRECTIONS = 32
FREE = 1.5
# Half the size of a marker [points].
MARKER = 4.0
# A name nearer than this needs no line to its point [points].
NEAR = 9.0
# What overlapping costs, what it costs a leader line to cross a name, another line, a marker [points].
OVERLAP, THROUGH_NAME, THROUGH_LINE, THROUGH_MARKER = 1e6, 3e3, 60.0, 40.0
PASSES = 5


class Named(NamedTuple):
    """A point in data coordinates, its name, and whether the name is set in bold."""

    x: float
    y: float
    text: str
    bold: bool = False


def name_points(axes: Axes, points: Sequence[Named], size: float = 8.0, taken: Sequence[Array] = ()) -> list[Annotation]:
    """Write every point's name near it.

    Args:
        axes: laid out for good: nothing may move afterwards.
        points: what to name; all their markers are kept free.
        size: of the letters [points].
        taken: (n, 4) boxes of the canvas, left, bottom, right, top [pixels], to keep free as well.
    """
    if not points:
        return []
    canvas = FigureCanvasAgg(axes.figure.get_figure(root=True))  # type: ignore[union-attr, arg-type]
    renderer = canvas.get_renderer()
    pixel = renderer.points_to_pixels(1.0)
    at = axes.transData.transform([(p.x, p.y) for p in points])
    sizes = np.array([_extent(axes, p, size, renderer) for p in points])
    frame = np.array(axes.get_window_extent(renderer).extents)
    places = _Places(at, sizes, frame, np.array(taken).reshape(-1, 4), pixel)
    boxes = places.found()
    drawn = []
    for point, start, box in zip(points, at, boxes, strict=True):
        near = np.clip(start, box[:2], box[2:])
        line = np.linalg.norm(near - start) > NEAR * pixel
        offset = (0.5 * (box[:2] + box[2:]) - start) / pixel
        drawn.append(
            axes.annotate(
                point.text,
                (point.x, point.y),
                tuple(offset),
                textcoords="offset points",
                ha="center",
                va="center",
                fontsize=size,
                fontweight="bold" if point.bold else "normal",
                color="#111111",
                arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": "#888888", "shrinkA": 0, "shrinkB": 2}
                if line
                else None,
                zorder=5,
            )
        )
    return drawn


def _extent(axes: Axes, point: Named, size: float, renderer: object) -> tuple[float, float]:
    text = axes.text(0, 0, point.text, fontsize=size, fontweight="bold" if point.bold else "normal")
    box = text.get_window_extent(renderer)  # type: ignore[arg-type]
    text.remove()
    return box.width, box.height


class _Places:
    """Where names could go, and what each place costs; all in pixels, boxes as left, bottom, right, top."""

    def __init__(self, at: Array, sizes: Array, frame: Array, taken: Array, pixel: float) -> None:
        self._at = at
        self._taken = taken
        self._pixel = pixel
        half = MARKER * pixel
        self._markers = np.hstack((at - half, at + half))
        angles = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
        ways = np.stack((np.cos(angles), np.sin(angles)), axis=1)
        shifts = (RINGS[:, None, None] * pixel * ways).reshape(-1, 2)
        self._candidates = [_around(p, s + 2.0 * FREE * pixel, shifts, frame) for p, s in zip(at, sizes, strict=True)]

    def found(self) -> Array:
        """(n, 4) boxes of the names."""
        n = len(self._at)
        boxes = np.full((n, 4), np.nan)
        gaps = np.linalg.norm(self._at[:, None] - self._at[None], axis=2)
        crowd = np.exp(-gaps / (40.0 * self._pixel)).sum(axis=1)
        order = np.argsort(-crowd, kind="stable")
        for turn in range(PASSES):
            moved = False
            for i in order.tolist():
                before = boxes[i].copy()
                boxes[i] = np.nan
                candidates = self._candidates[i]
                boxes[i] = candidates[int(np.argmin(self._cost(i, candidates, boxes)))]
                moved = moved or not np.array_equal(before, boxes[i])
            if turn and not moved:
                break
        return boxes

    def _cost(self, i: int, boxes: Array, placed: Array) -> Array:
        there = ~np.isnan(placed[:, 0])
        others = np.vstack((placed[there], self._taken))
        start = self._at[i]
        ends = np.clip(start, boxes[:, :2], boxes[:, 2:])
        cost = np.linalg.norm(ends - start, axis=1) / self._pixel
        cost += OVERLAP * _overlaps(boxes, others) + OVERLAP * _overlaps(boxes, self._markers)
        lines = np.hstack((np.broadcast_to(start, ends.shape), ends))
        cost += THROUGH_NAME * _pierced(lines, others)
        away = np.arange(len(self._at)) != i
        cost += THROUGH_MARKER * _pierced(lines, self._markers[away])
        roots = self._at[there]
        tips = np.clip(roots, placed[there, :2], placed[there, 2:])
        existing = np.hstack((roots, tips))
        cost += THROUGH_LINE * _crossed(lines, existing)
        return np.asarray(cost + THROUGH_NAME * _pierced(existing, boxes, transpose=True))


def _around(point: Array, size: Array, shifts: Array, frame: Array) -> Array:
    """Boxes (n, 4) whose nearest point to `point` lies at a shift from it, inside the frame."""
    near = point + shifts
    half = 0.5 * size
    centre = near + half * np.sign(np.round(shifts, 9)) * np.minimum(1.0, np.abs(shifts) / np.abs(shifts).max(axis=1, keepdims=True) * 1.5)
    boxes = np.hstack((centre - half, centre + half))
    inside = (boxes[:, :2] >= frame[:2]).all(axis=1) & (boxes[:, 2:] <= frame[2:]).all(axis=1)
    return boxes[inside] if inside.any() else boxes


def _overlaps(boxes: Array, others: Array) -> Array:
    """(n,) how many of the others each box overlaps."""
    a, b = boxes[:, None], others[None]
    apart = (a[..., 0] >= b[..., 2]) | (b[..., 0] >= a[..., 2]) | (a[..., 1] >= b[..., 3]) | (b[..., 1] >= a[..., 3])
    return np.asarray((~apart).sum(axis=1), dtype=np.float64)


def _pierced(lines: Array, boxes: Array, *, transpose: bool = False) -> Array:
    """(n,) how many boxes each segment (n, 4) enters; transposed, how many segments enter each box."""
    start, along = lines[:, None, :2], (lines[:, 2:] - lines[:, :2])[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (boxes[None, :, :2] - start) / along, (boxes[None, :, 2:] - start) / along
    enter, leave = np.fmin(first, second).max(axis=2), np.fmax(first, second).min(axis=2)
    still = (along == 0.0) & ((start <= boxes[None, :, :2]) | (start >= boxes[None, :, 2:]))
    inside = (enter < leave) & (leave > 0.0) & (enter < 1.0) & ~still.any(axis=2)
    return np.asarray(inside.sum(axis=0 if transpose else 1), dtype=np.float64)


def _crossed(lines: Array, others: Array) -> Array:
    """(n,) how many of the other segments each segment crosses."""

    def side(a: Array, b: Array, p: Array) -> Array:
        return np.sign((b[..., 0] - a[..., 0]) * (p[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (p[..., 0] - a[..., 0]))

    a, b = lines[:, None, :2], lines[:, None, 2:]
    c, d = others[None, :, :2], others[None, :, 2:]
    crossing = (side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)
    return np.asarray(crossing.sum(axis=1), dtype=np.float64)
