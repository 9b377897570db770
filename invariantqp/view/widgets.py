"""What the panel beside the robot shows: tables for curves, and HTML."""

from __future__ import annotations

import html

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.view.film import CurveChart, Film, colours


def with_cursor(time: Array, chart: CurveChart, t: float) -> tuple[Array, ...]:
    """Times, the chart's curves and a vertical line at t, as the columns of a table."""
    values = _heights(chart)
    at = int(np.searchsorted(time, t))
    curves = (np.insert(v, at, np.full(2, np.interp(t, time, v))) for v in values)
    cursor = np.full(len(time) + 2, np.nan)
    cursor[at : at + 2] = span(chart)
    return (np.insert(time, at, (t, t)), *curves, cursor)


def _heights(chart: CurveChart) -> Array:
    """(c, k) the curves' heights on the page."""
    return np.log10(chart.values) if chart.log else chart.values


def span(chart: CurveChart) -> tuple[float, float]:
    """The ends of the vertical axis, with some room where the chart gives none."""
    if chart.span is not None:
        return chart.span
    values = np.append(_heights(chart), chart.levels)
    low, high = float(values.min()), float(values.max())
    room = 0.08 * (high - low) or 0.5
    return low - room, high + room


def paragraph(words: str) -> str:
    """Words as HTML; markup in them is escaped."""
    return f'<p style="margin:0;padding:2px 12px;font-size:13px">{html.escape(words)}</p>'


def joint_bars(film: Film, i: int) -> str:
    """Where each joint is in its range in frame i, and its position and velocity, as HTML."""
    rows = []
    lower, upper = film.limits
    for name, colour, q, speed, low, high, slide in zip(
        film.joints, colours(len(film.joints)), film.q[i], film.speed[i], lower, upper, film.slides, strict=True
    ):
        mark = ""
        if np.isfinite(high - low) and high > low:
            place = f"calc({np.clip((q - low) / (high - low), 0.0, 1.0):.4f} * (100% - 6px))"
            mark = f'<b style="position:absolute;left:{place};width:6px;height:100%;background:{colour}"></b>'
        bar = "flex:1 0 40px;position:relative;height:9px;border:1px solid #9995;border-radius:5px;overflow:hidden"
        label = "flex:0 1 110px;min-width:0;overflow:hidden;text-overflow:ellipsis"
        rows.append(
            '<div style="display:flex;gap:8px;align-items:center;font-size:12px">'
            f'<span style="{label}">{html.escape(name)}</span>'
            f'<span style="{bar}">{mark}</span>'
            f'<span style="width:60px;text-align:right">{_with_unit(q, slide)}</span>'
            f'<span style="width:70px;text-align:right">{_with_unit(speed, slide)}/s</span></div>'
        )
    return f'<div style="padding:4px 12px">{"".join(rows)}</div>'


def _with_unit(x: float, slide: bool) -> str:
    """A rotary quantity in degrees, or one of a slide in metres, with its unit."""
    return f"{x:.4g} m" if slide else f"{round(float(np.degrees(x)), 1) + 0.0}°"
