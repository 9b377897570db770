"""The charts of the comparison, each drawn from results.json alone, with what it says in words computed from it."""

from __future__ import annotations

from invariantqp.compare.report.charts import dependence, growth, loops, maps, solves
from invariantqp.compare.results import Chart

CHARTS = [
    Chart(
        "speed_and_accuracy",
        "Time of one solve against its error",
        solves.main_chart,
        solves.main_caption,
        ("time", "error"),
    ),
    Chart(
        "near_singular",
        "The same close to singularities",
        solves.singular_chart,
        solves.singular_caption,
        ("time", "error"),
    ),
    Chart(
        "tick_and_tracking",
        "Time of one tick against what it tracks",
        loops.tick_chart,
        loops.tick_caption,
        ("tick", "closed_loop"),
    ),
    Chart(
        "dependence",
        "Time of one tick against dependence on frames and units",
        dependence.dependence_chart,
        dependence.dependence_caption,
        ("tick", "dependence"),
    ),
    Chart(
        "singularities",
        "Joint speeds and chatter through singularities",
        loops.singular_loops_chart,
        loops.singular_loops_caption,
        ("singular",),
    ),
    Chart("failed_ticks", "Ticks that fail", maps.failed_chart, loops.failed_caption, ("hard",)),
    Chart("growth", "How cost grows", growth.growth_chart, growth.growth_caption, ("growth",)),
    Chart("failures_ur5", "Where methods fail: UR5", maps.ur5_map, maps.ur5_caption, ("failure_map",)),
    Chart("failures_so101", "Where methods fail: SO-101", maps.so101_map, maps.so101_caption, ("failure_map",)),
]
