"""The charts of the comparison; each, and its caption, is made from the results alone."""

from __future__ import annotations

from invariantqp.compare.report.charts import dependence, growth, loops, maps, solves
from invariantqp.compare.report.charts.chart import CaptionedChart

CHARTS = [
    CaptionedChart(
        "speed_and_accuracy",
        "Time of one solve against its error",
        solves.main_chart,
        solves.main_caption,
        ("time", "error"),
    ),
    CaptionedChart(
        "near_singular",
        "Time of one solve against its error, close to singularities",
        solves.singular_chart,
        solves.singular_caption,
        ("time", "error"),
    ),
    CaptionedChart(
        "tick_and_tracking",
        "Time of one tick against the tracking error",
        loops.tick_chart,
        loops.tick_caption,
        ("tick", "closed_loop"),
    ),
    CaptionedChart(
        "dependence",
        "Time of one tick against dependence on frames and units",
        dependence.dependence_chart,
        dependence.dependence_caption,
        ("tick", "dependence"),
    ),
    CaptionedChart(
        "singularities",
        "Joint speeds and chatter through singularities",
        loops.singular_loops_chart,
        loops.singular_loops_caption,
        ("singular",),
    ),
    CaptionedChart("failed_ticks", "Failed ticks", maps.failed_chart, loops.failed_caption, ("hard",)),
    CaptionedChart("growth", "How the time of a solve grows", growth.growth_chart, growth.growth_caption, ("growth",)),
    CaptionedChart("failures_ur5", "Where methods fail: UR5", maps.ur5_map, maps.ur5_caption, ("failure_map",)),
    CaptionedChart(
        "failures_so101", "Where methods fail: SO-101", maps.so101_map, maps.so101_caption, ("failure_map",)
    ),
]
