"""Names beside points, so that no name covers another name or a marker.

    cost of a place = distance from the point + penalties for overlaps and for crossings with lines and markers

Each name takes the cheapest of many places in rings around its point while the other names stay; the names in the
densest crowd are first, and after a first pass every name may move again. Nothing is random: the same points always get
the same places. (The library adjustText moves names by forces instead; on these charts it leaves some names over others
in almost every panel.)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Annotation

from invariantqp.geometry.arrays import Array

# Radii of the rings of places [points], places in each ring, and space around a name [points].
RINGS = np.concatenate((np.arange(5.0, 40.0, 5.0), np.arange(40.0, 260.0, 10.0)))
DIRECTIONS = 32
FREE = 1.5
# Half the size of a marker [points].
MARKER = 4.0
# A name farther than this from its point gets a line to it [points].
NEAR = 9.0
# Penalties [points]: a name over a name or marker; its line through a name, another line, or a marker; a name on a line
# of the chart.
OVERLAP, THROUGH_NAME, THROUGH_LINE, THROUGH_MARKER, ON_LINE = 1e6, 3e3, 60.0, 40.0, 80.0
# Passes over all names at most; usually the second changes nothing.
PASSES = 5
# Points nearer to each other than this share one place for their names [points].
TOGETHER = 9.0
# Cheapest places for which crossings are computed.
LOOKED_AT = 60
# Reach of a crowd [points]: a neighbour at this distance counts 1/e.
CROWD = 40.0


class Named(NamedTuple):
    """A point in data coordinates, its name (a line for each if it stands for several), whether the name is bold."""

    x: float
    y: float
    text: str
    bold: bool = False


def name_points(
    axes: Axes, points: Sequence[Named], size: float = 8.0, lines: Sequence[tuple[float, float]] = ()
) -> list[Annotation]:
    """Write the name of every point near it; points that almost coincide share one place, with a line of text for each.

    Args:
        axes: a panel whose place in the figure is final. Text that it has already stays uncovered.
        points: the points, whose markers stay uncovered.
        size: of the letters [points].
        lines: corners, in data coordinates, of a line that names should not cover.

    Returns:
        The names as Matplotlib's annotations.
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
    """Matplotlib's renderer, which knows the size of text in pixels."""
    canvas: Any = FigureCanvasAgg(axes.get_figure(root=True))
    return canvas.get_renderer()


def _together(points: Sequence[Named], at: Array, near: float) -> list[Named]:
    """The points, with those within `near` pixels of each other made one; a bold point stays by itself."""
    left = list(range(len(points)))
    found = []
    while left:
        group = [left.pop(0)]
        for i in () if points[group[0]].bold else left:
            if not points[i].bold and np.linalg.norm(at[group] - at[i], axis=1).max() < near:
                group.append(i)
        left = [i for i in left if i not in group]
        found.append(_merged([points[i] for i in group]))
    return found


def _merged(points: Sequence[Named]) -> Named:
    """One point in the middle of several, on logarithmic axes, with a line of text for each."""
    members = sorted(points, key=lambda p: p.text)
    x, y = np.exp(np.log([(p.x, p.y) for p in members]).mean(axis=0)).tolist()
    return Named(x, y, "\n".join(p.text for p in members), members[0].bold)


def _extent(axes: Axes, point: Named, size: float, renderer: Any) -> tuple[float, float]:
    """Width and height of a name [pixels]."""
    text = axes.text(0, 0, point.text, fontsize=size, fontweight="bold" if point.bold else "normal", linespacing=1.0)
    box = text.get_window_extent(renderer)
    text.remove()
    return box.width, box.height


class _Places:
    """The places of all names and their costs; in pixels, with boxes as (left, bottom, right, top)."""

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
        self._crowd = np.exp(-np.linalg.norm(at[:, None] - at, axis=2) / (CROWD * pixel)).sum(axis=1)

    def found(self) -> Array:
        """(n, 4) the boxes that the names take."""
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
        """The box for point i while the other names stay where they are; nan stands for a name without a place."""
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
    """(n, 2) the nearest point of each box."""
    return np.clip(point, boxes[:, :2], boxes[:, 2:])


def _around(point: Array, size: Array, shifts: Array, frame: Array) -> Array:
    """(n, 4) boxes around a point, each shifted by one of the shifts; only those inside the frame, if there are any."""
    half = 0.5 * size
    slant = shifts / np.abs(shifts).max(axis=1, keepdims=True)
    centre = point + shifts + half * np.clip(1.5 * slant, -1.0, 1.0)
    boxes = np.hstack((centre - half, centre + half))
    inside = (boxes[:, :2] >= frame[:2]).all(axis=1) & (boxes[:, 2:] <= frame[2:]).all(axis=1)
    return boxes[inside] if inside.any() else boxes


def _overlaps(boxes: Array, others: Array) -> Array:
    """(n,) the number of other boxes that each box overlaps."""
    a, b = boxes[:, None], others[None]
    apart = (a[..., 0] >= b[..., 2]) | (b[..., 0] >= a[..., 2]) | (a[..., 1] >= b[..., 3]) | (b[..., 1] >= a[..., 3])
    return np.asarray((~apart).sum(axis=1), dtype=np.float64)


def _pierced(lines: Array, boxes: Array) -> Array:
    """(n, k) whether each of n segments (x0, y0, x1, y1) crosses each of k boxes."""
    start, along = lines[:, None, :2], (lines[:, 2:] - lines[:, :2])[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (boxes[None, :, :2] - start) / along, (boxes[None, :, 2:] - start) / along
    enter, leave = np.fmin(first, second).max(axis=2), np.fmax(first, second).min(axis=2)
    beside = (along == 0.0) & ((start <= boxes[None, :, :2]) | (start >= boxes[None, :, 2:]))
    return np.asarray((enter < leave) & (leave > 0.0) & (enter < 1.0) & ~beside.any(axis=2))


def _crossed(lines: Array, others: Array) -> Array:
    """(n,) the number of other segments that each segment crosses."""

    def side(a: Array, b: Array, p: Array) -> Array:
        across, along = b - a, p - a
        return np.sign(across[..., 0] * along[..., 1] - across[..., 1] * along[..., 0])

    a, b = lines[:, None, :2], lines[:, None, 2:]
    c, d = others[None, :, :2], others[None, :, 2:]
    crossing = (side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)
    return np.asarray(crossing.sum(axis=1), dtype=np.float64)
