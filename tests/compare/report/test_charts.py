import json
import re
from html import unescape
from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text

from invariantqp.compare.measure.closed_loop import HARD, SINGULAR
from invariantqp.compare.measure.failure_map import AXES
from invariantqp.compare.measure.growth import JOINTS
from invariantqp.compare.method import FAMILIES
from invariantqp.compare.registry import methods
from invariantqp.compare.report.charts import CHARTS, dependence, loops, maps, solves
from invariantqp.compare.report.charts.ends import name_ends
from invariantqp.compare.report.charts.labels import Named, name_points
from invariantqp.compare.report.charts.scatter import Point, front
from invariantqp.compare.report.charts.style import STYLES, short

TASKS = ["panda_path"]
NAMES = list(methods())
OURS, LU, GRAM = "invariantqp", "Moore-Penrose, LU", "h, Gram + LDL'"
# Text that touches by less is not read as one [pixels].
TOUCHING = 0.5


def made_up(seed=0):
    """Results with every kind of cell, as crowded as true ones: many methods agree in one figure or the other."""
    rng = np.random.default_rng(seed)
    patterns = rng.integers(0, 3, (6, 5, 5))
    cells = []

    def add(kind, task, name, result):
        cells.append({"kind": kind, "task": task, "method": name, "result": result})

    for name in NAMES:
        fast, exact = 10.0 ** rng.uniform(0.6, 3.2), 10.0 ** rng.choice([-15.0, -14.9, -8.0, -3.0, -0.5])
        for task in TASKS:
            sorts = ("free", "limited", "singular")
            spread = {"median_us": fast, "p99_us": 2.0 * fast}
            if methods()[name].make is not None:
                add("time", task, name, dict.fromkeys(sorts, spread))
                add("error", task, name, {sort: {"error": exact, "missed": rng.uniform()} for sort in sorts})
            add("tick", task, name, {"median_us": fast + 20.0, "p99_us": 3.0 * fast})
            error = {"median": 10.0 * exact, "p99": 100.0 * exact, "max": 1e3 * exact}
            add("closed_loop", task, name, {"position_mm": error, "orientation_deg": error})
            changed = {"median": exact, "p99": exact, "worst": 10.0 * exact, "states": 40, "left_out": 0}
            add("dependence", task, name, {"frame": changed, "unit": changed})
        for task in SINGULAR:
            add("singular", task, name, {"peak": 10.0 ** rng.uniform(-1, 3), "variation": 10.0 ** rng.uniform(0, 2)})
        for task in HARD:  # a third of the methods fail now and then
            often = 0.3 * rng.integers(0, 2, 3) * (NAMES.index(name) % 3 == 1)
            ways = dict(zip(("raised", "not_finite", "outside"), often.tolist(), strict=True))
            add("hard", task, name, ways | {"failed_ticks": sum(ways.values())})
        if methods()[name].make is not None:
            cost = [fast * (m / 3.0) ** 0.5 for m in JOINTS]
            add("growth", "joints", name, {"size": list(JOINTS), "median_us": cost, "slope": 0.5})
        for arm in AXES:
            squares = patterns[NAMES.index(name) % len(patterns)].tolist()
            run = {"axes": ["a", "b"], "ranges": [[-1.0, 1.0], [-2.0, 2.0]], "samples": 2, "map": squares}
            add("failure_map", arm, name, run | {"share": float(np.mean(squares)) / 2.0})
    for name in ("invariantqp, solve_velocities", "numpy pinv, stacked"):
        add("growth", "batch", name, {"size": [1, 30, 1000], "median_us": [90.0, 20.0, 5.0], "slope": -0.4})
    listed = [methods()[name].as_json() for name in NAMES]
    return {"schema": 1, "tasks": TASKS, "methods": listed, "cells": cells}


@pytest.fixture(scope="module")
def results():
    return made_up()


@pytest.fixture
def figures(monkeypatch):
    """Figures as they were when they were saved."""
    kept, save = [], Figure.savefig

    def kept_and_saved(figure, *args, **options):
        kept.append(figure)
        save(figure, *args, **options)

    monkeypatch.setattr(Figure, "savefig", kept_and_saved)
    return kept


def words(svg):
    """Every text of an SVG, tags and entities undone."""
    return " ".join(
        unescape(re.sub(r"<[^>]+>", "", text)).strip() for text in re.findall(r"<text.*?</text>", svg, re.DOTALL)
    )


def box(text, renderer):
    """A text's box without its line's."""
    if isinstance(text, Annotation):
        text.update_positions(renderer)
    return Text.get_window_extent(text, renderer).extents


def overlapping(a, b):
    return (np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]) > TOUCHING).all()


@pytest.mark.parametrize("chart", CHARTS, ids=lambda chart: chart.slug)
def test_every_chart_is_drawn_with_every_name_and_no_name_over_another(results, tmp_path, figures, chart):
    file = tmp_path / f"{chart.slug}.svg"
    chart.draw(results, file)
    said = words(file.read_text(encoding="utf-8"))
    have = {cell["method"] for cell in results["cells"] if cell["kind"] == chart.shows[0]}
    if chart.slug.startswith("failures"):  # one of those alike stands for all; the caption has them
        have, said = have & set(NAMES), said + chart.caption(results)
    if chart.slug == "growth":  # named lines; the others are grey
        have = {name for name in have if short(name) in said}
        assert {OURS, LU, GRAM} <= have
    for name in have:
        assert short(name) in said or name in said, name
    (figure,) = figures
    width, height = figure.canvas.get_width_height()
    renderer = FigureCanvasAgg(figure).get_renderer()
    titles = [axes._left_title for axes in figure.axes] + [figure._suptitle] * (figure._suptitle is not None)
    titles = [title for title in titles if title.get_text()]
    for texts in (titles, *(axes.texts for axes in figure.axes)):
        placed = [(text.get_text(), box(text, renderer)) for text in texts]
        for text, (left, bottom, right, top) in placed:
            assert (left > 0, bottom > 0, right < width, top < height) == (True,) * 4, text
        for (one, a), (other, b) in combinations(placed, 2):
            assert not overlapping(a, b), (one, other)


@pytest.mark.parametrize("names", [[OURS, "DLS"], ["Pink"]], ids=str)
def test_every_chart_can_be_drawn_for_a_few_methods(results, tmp_path, names):
    few = {
        **results,
        "methods": [m for m in results["methods"] if m["name"] in names],
        "cells": [c for c in results["cells"] if c["method"] in names],
    }
    for chart in CHARTS:
        if set(chart.shows) <= {cell["kind"] for cell in few["cells"]}:
            chart.draw(few, tmp_path / "chart.png")
            assert chart.caption(few)


def test_a_chart_is_the_same_each_time_it_is_drawn(results, tmp_path):
    files = [tmp_path / "a.svg", tmp_path / "b.svg"]
    for file in files:
        maps.failed_chart(results, file)
    assert files[0].read_bytes() == files[1].read_bytes()


def test_charts_read_what_was_written_to_a_file(results):
    again = json.loads(json.dumps(results))
    for chart in CHARTS:
        assert chart.caption(again) == chart.caption(results)


def test_families_are_told_apart_by_colour_and_by_marker():
    assert set(STYLES) == set(FAMILIES)
    assert len({s.colour for s in STYLES.values()}) == len({s.marker for s in STYLES.values()}) == len(STYLES)


def test_short_names_are_different():
    assert len({short(name) for name in NAMES}) == len(NAMES)


def test_the_front_is_what_nothing_dominates():
    rng = np.random.default_rng(0)
    points = [Point(str(i), *10.0 ** rng.integers(-3, 3, 2).astype(float)) for i in range(60)]
    best = front(points)
    for p in points:
        beaten = any(q.x <= p.x and q.y <= p.y and (q.x, q.y) != (p.x, p.y) for q in points)
        assert beaten or (p.x, p.y) in {(b.x, b.y) for b in best}
    assert not any(a.x <= b.x and a.y <= b.y for a, b in combinations(best, 2))
    alike = [Point("slow", 5.0, 1e-16), Point("fast", 1.0, 1e-14), Point("off", 0.5, 1.0)]
    assert [p.method for p in front(alike, 1e-12)] == ["off", "fast"]
    assert [p.method for p in front(alike)] == ["off", "fast", "slow"]


def test_names_of_a_crowd_stand_clear_of_each_other_and_of_every_marker():
    rng = np.random.default_rng(1)
    figure = Figure(figsize=(9, 5), dpi=100)
    renderer = FigureCanvasAgg(figure).get_renderer()
    axes = figure.subplots()
    points = [Named(*rng.normal(0.5, 0.08, 2), f"method number {i}") for i in range(45)]
    axes.set(xlim=(0, 1), ylim=(0, 1))
    names = name_points(axes, points)
    assert sorted("\n".join(n.get_text() for n in names).split("\n")) == sorted(p.text for p in points)
    placed = [box(name, renderer) for name in names]
    assert not any(overlapping(a, b) for a, b in combinations(placed, 2))
    for x, y in axes.transData.transform([(p.x, p.y) for p in points]):
        assert not any(a[0] < x < a[2] and a[1] < y < a[3] for a in placed)


def test_names_of_lines_that_end_together_are_moved_apart():
    figure = Figure()
    renderer = FigureCanvasAgg(figure).get_renderer()
    axes = figure.subplots()
    axes.set(xlim=(0, 2), ylim=(0, 1))
    names = name_ends(axes, [(1.0, 0.5 + 1e-3 * i, f"line {i}", False) for i in range(10)])
    assert not any(overlapping(a, b) for a, b in combinations([box(name, renderer) for name in names], 2))


def changed(results, kind, method, path, value):
    """The results with one figure of a method another in every task."""
    again = json.loads(json.dumps(results))
    for cell in again["cells"]:
        if cell["kind"] == kind and cell["method"] == method:
            inner = cell["result"]
            for key in path[:-1]:
                inner = inner[key]
            inner[path[-1]] = value
    return again


def test_captions_name_the_winner_that_the_figures_have(results):
    for winner in (LU, GRAM):
        told = changed(results, "time", winner, ("free", "median_us"), 0.123)
        told = changed(told, "error", winner, ("free", "error"), 1e-15)
        assert f"exact to rounding is {winner}, 0.1 us" in solves.main_caption(told)
    told = changed(results, "singular", OURS, ("peak",), 0.5)
    assert f"{OURS}: 0.5 times the limit" in loops.singular_loops_caption(told)
    told = changed(results, "dependence", LU, ("frame", "median"), 1e-14)
    assert "On panda_path the median state" in dependence.dependence_caption(told)
    told = changed(results, "dependence", LU, ("frame", "median"), 1e-2)
    assert "does not depend" not in dependence.dependence_caption(told)
    told = changed(results, "hard", "DLS", ("raised",), 0.97)
    assert "Most: DLS, " in loops.failed_caption(told)


def test_methods_that_fail_in_the_same_places_share_a_map(results):
    same = next(c["result"] for c in results["cells"] if c["kind"] == "failure_map") | {"map": np.eye(5).tolist()}
    told = json.loads(json.dumps(results))
    for cell in told["cells"]:
        if cell["kind"] == "failure_map" and cell["task"] == "ur5" and cell["method"] in {LU, GRAM, OURS}:
            cell["result"] = same
    groups = maps.groups(told, "ur5")
    assert groups[0].names == [OURS]  # always by itself, and first
    assert [group.names for group in groups if LU in group.names] == [[GRAM, LU]]
