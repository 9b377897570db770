"""Names at the ends of lines, moved up or down as little as possible so that none covers another.

minimise sum (y_i - end_i)^2   with   y_{i+1} - y_i >= the height of a line of text
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Annotation

from invariantqp.compare.report.charts.labels import renderer_of
from invariantqp.geometry.arrays import Array


def name_ends(axes: Axes, ends: Sequence[tuple[float, float, str, bool]], size: float = 7.5) -> list[Annotation]:
    """Write names to the right of the ends (x, y, name, bold) of lines, each with a thin line to its end."""
    if not ends:
        return []
    renderer = renderer_of(axes)
    pixel = renderer.points_to_pixels(1.0)
    ends = sorted(ends, key=lambda end: end[1])
    at = axes.transData.transform([end[:2] for end in ends])
    step = 1.25 * size * pixel
    low, high = axes.get_window_extent(renderer).intervaly
    heights = _apart(at[:, 1], step, low + 0.5 * step, high - 0.5 * step)
    return [
        axes.annotate(
            text,
            (x, y),
            (18.0, (height - start) / pixel),
            textcoords="offset points",
            va="center",
            fontsize=size,
            fontweight="bold" if bold else "normal",
            color="#111111",
            arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": "#888888", "shrinkA": 0, "shrinkB": 2},
        )
        for (x, y, text, bold), (_, start), height in zip(ends, at, heights, strict=True)
    ]


def _apart(wanted: Array, step: float, low: float, high: float) -> Array:
    """Heights inside [low, high] at least a step apart, as close as possible to the ascending heights wanted."""
    ranks = step * np.arange(len(wanted))
    blocks: list[list[float]] = []  # groups of neighbours that touch: their mean, and how many they are
    for value in (wanted - ranks).tolist():
        blocks.append([value, 1.0])
        while len(blocks) > 1 and blocks[-2][0] > blocks[-1][0]:
            (a, n), (b, k) = blocks[-2:]
            blocks[-2:] = [[(n * a + k * b) / (n + k), n + k]]
    heights = np.repeat([value for value, _ in blocks], [int(count) for _, count in blocks])
    return np.asarray(np.clip(heights, low, max(low, high - ranks[-1])) + ranks)
