"""Names beside points, none over another: each takes the cheapest free place around its point, the others fixed.

cost = distance + crossings of leader lines and markers;   a place over another name or a marker costs more than any

Places are tried in rings around the point; after a first pass, most crowded first, every name may move again. Nothing
is random: the same points are named in the same places.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

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
# What overlapping costs, what it costs a leader line to cross a name, another line, a marker, and a name to lie on a
# line of the chart [points].
OVERLAP, THROUGH_NAME, THROUGH_LINE, THROUGH_MARKER, ON_LINE = 1e6, 3e3, 60.0, 40.0, 80.0
PASSES = 5
# Points nearer than this are named together [points].
TOGETHER = 9.0
# Places whose lines are looked at, of those that are free, nearest first.
LOOKED_AT = 60


class Named(NamedTuple):
    """A point in data coordinates, its name (several lines if it stands for several), and whether it is set in bold."""

    x: float
    y: float
    text: str
    bold: bool = False


def name_points(
    axes: Axes, points: Sequence[Named], size: float = 8.0, lines: Sequence[tuple[float, float]] = ()
) -> list[Annotation]:
    """Write every point's name near it; points that all but coincide share one place, a line each.

    Args:
        axes: laid out for good: nothing may move afterwards. What is written in it already is kept free.
        points: what to name; all their markers are kept free.
        size: of the letters [points].
        lines: corners, in data coordinates, of a line that names had better not lie on.
    """
    if not points:
        return []
    renderer = renderer_of(axes)
    pixel = renderer.points_to_pixels(1.0)
    markers = axes.transData.transform([(p.x, p.y) for p in points])
    points = _together(points, markers, TOGETHER * pixel)
    at = axes.transData.transform([(p.x, p.y) for p in points])
    sizes = np.array([_extent(axes, p, size, renderer) for p in points])
    frame = np.array(axes.get_window_extent(renderer).extents)
    corners = axes.transData.transform(lines) if lines else np.empty((0, 2))
    written = np.array([text.get_window_extent(renderer).extents for text in axes.texts]).reshape(-1, 4)
    half = MARKER * pixel
    kept_free = np.vstack((np.hstack((markers - half, markers + half)), written))
    boxes = _Places(at, sizes, frame, kept_free, np.hstack((corners[:-1], corners[1:])), pixel).found()
    drawn = []
    for point, start, box in zip(points, at, boxes, strict=True):
        near = _nearest(box[None], start)[0]
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
                linespacing=1.0,
                multialignment="left" if offset[0] > 0.0 else "right",
                color="#111111",
                arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": "#888888", "shrinkA": 0, "shrinkB": 2}
                if line
                else None,
                zorder=5,
            )
        )
    return drawn


def renderer_of(axes: Axes) -> Any:
    """What measures text where it will be drawn."""
    canvas: Any = FigureCanvasAgg(axes.get_figure(root=True))
    return canvas.get_renderer()


def _together(points: Sequence[Named], at: Array, near: float) -> list[Named]:
    """The points with those nearer than `near` pixels to each other made one, but for a bold one."""
    left = list(range(len(points)))
    found = []
    while left:
        group = [left.pop(0)]
        if not points[group[0]].bold:
            for i in left:
                gap = np.linalg.norm(at[group] - at[i], axis=1).max()
                if gap < near and not points[i].bold:
                    group.append(i)
        left = [i for i in left if i not in group]
        members = sorted((points[i] for i in group), key=lambda p: p.text)
        x, y = (float(np.exp(np.mean(np.log([getattr(p, a) for p in members])))) for a in ("x", "y"))
        found.append(Named(x, y, "\n".join(p.text for p in members), members[0].bold))
    return found


def _extent(axes: Axes, point: Named, size: float, renderer: Any) -> tuple[float, float]:
    text = axes.text(0, 0, point.text, fontsize=size, fontweight="bold" if point.bold else "normal", linespacing=1.0)
    box = text.get_window_extent(renderer)
    text.remove()
    return box.width, box.height


class _Places:
    """Where names could go, and what each place costs; all in pixels, boxes as left, bottom, right, top."""

    def __init__(self, at: Array, sizes: Array, frame: Array, kept_free: Array, lines: Array, pixel: float) -> None:
        self._at = at
        self._kept_free = kept_free
        angles = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
        shifts = (RINGS[:, None, None] * pixel * np.stack((np.cos(angles), np.sin(angles)), axis=1)).reshape(-1, 2)
        self._candidates = [_around(p, s + 2.0 * FREE * pixel, shifts, frame) for p, s in zip(at, sizes, strict=True)]
        self._costs = [
            np.linalg.norm(_nearest(boxes, p) - p, axis=1) / pixel
            + OVERLAP * _overlaps(boxes, kept_free)
            + ON_LINE * _pierced(lines, boxes).sum(axis=0)
            for boxes, p in zip(self._candidates, at, strict=True)
        ]
        self._crowd = np.exp(-np.linalg.norm(at[:, None] - at, axis=2) / (40.0 * pixel)).sum(axis=1)

    def found(self) -> Array:
        """(n, 4) boxes of the names."""
        boxes = np.full((len(self._at), 4), np.nan)
        order = np.argsort(-self._crowd, kind="stable").tolist()
        for turn in range(PASSES):
            before = boxes.copy()
            for i in order:
                boxes[i] = np.nan
                boxes[i] = self._cheapest(i, boxes)
            if turn and np.array_equal(before, boxes):
                break
        return boxes

    def _cheapest(self, i: int, placed: Array) -> Array:
        """The box of point i, the other names being where they are; nan is nowhere yet."""
        there = ~np.isnan(placed[:, 0])
        others = placed[there]
        cost = self._costs[i] + OVERLAP * _overlaps(self._candidates[i], others)
        looked_at = np.argsort(cost, kind="stable")[:LOOKED_AT]
        boxes, cost = self._candidates[i][looked_at], cost[looked_at]
        start = self._at[i]
        lines = np.hstack((np.broadcast_to(start, (len(boxes), 2)), _nearest(boxes, start)))
        roots = self._at[there]
        existing = np.hstack((roots, np.clip(roots, others[:, :2], others[:, 2:])))
        cost += THROUGH_NAME * (_pierced(lines, others).sum(axis=1) + _pierced(existing, boxes).sum(axis=0))
        cost += THROUGH_MARKER * _pierced(lines, self._kept_free).sum(axis=1)
        cost += THROUGH_LINE * _crossed(lines, existing)
        best: Array = boxes[int(np.argmin(cost))]
        return best


def _nearest(boxes: Array, point: Array) -> Array:
    """(n, 2) the point of each box that is nearest."""
    return np.clip(point, boxes[:, :2], boxes[:, 2:])


def _around(point: Array, size: Array, shifts: Array, frame: Array) -> Array:
    """Boxes (n, 4) whose nearest point to `point` lies at a shift from it, inside the frame."""
    half = 0.5 * size
    slant = shifts / np.abs(shifts).max(axis=1, keepdims=True)
    centre = point + shifts + half * np.clip(1.5 * slant, -1.0, 1.0)
    boxes = np.hstack((centre - half, centre + half))
    inside = (boxes[:, :2] >= frame[:2]).all(axis=1) & (boxes[:, 2:] <= frame[2:]).all(axis=1)
    return boxes[inside] if inside.any() else boxes


def _overlaps(boxes: Array, others: Array) -> Array:
    """(n,) how many of the others each box overlaps."""
    a, b = boxes[:, None], others[None]
    apart = (a[..., 0] >= b[..., 2]) | (b[..., 0] >= a[..., 2]) | (a[..., 1] >= b[..., 3]) | (b[..., 1] >= a[..., 3])
    return np.asarray((~apart).sum(axis=1), dtype=np.float64)


def _pierced(lines: Array, boxes: Array) -> Array:
    """(n, k) whether each of n segments, from and to, enters each of k boxes."""
    start, along = lines[:, None, :2], (lines[:, 2:] - lines[:, :2])[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (boxes[None, :, :2] - start) / along, (boxes[None, :, 2:] - start) / along
    enter, leave = np.fmin(first, second).max(axis=2), np.fmax(first, second).min(axis=2)
    beside = (along == 0.0) & ((start <= boxes[None, :, :2]) | (start >= boxes[None, :, 2:]))
    return np.asarray((enter < leave) & (leave > 0.0) & (enter < 1.0) & ~beside.any(axis=2))


def _crossed(lines: Array, others: Array) -> Array:
    """(n,) how many of the other segments each segment crosses."""

    def side(a: Array, b: Array, p: Array) -> Array:
        across, along = b - a, p - a
        return np.sign(across[..., 0] * along[..., 1] - across[..., 1] * along[..., 0])

    a, b = lines[:, None, :2], lines[:, None, 2:]
    c, d = others[None, :, :2], others[None, :, 2:]
    crossing = (side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)
    return np.asarray(crossing.sum(axis=1), dtype=np.float64)
