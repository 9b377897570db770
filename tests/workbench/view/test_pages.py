"""The timeline of a run, and the page that draws it."""

import base64
import json
import re
from dataclasses import replace
from html import unescape
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from support.views import TASK, read

import invariantqp as iq
from invariantqp.robots.load import KNOWN
from invariantqp.workbench.pictures import charts
from invariantqp.workbench.pictures.charts import extremes
from invariantqp.workbench.runs.scene import scene_of
from invariantqp.workbench.runs.taskfile import task_from
from invariantqp.workbench.view.page import page
from invariantqp.workbench.view.timeline import arm_in, timeline_before, timeline_of


@pytest.fixture(scope="module")
def task():
    return task_from(TASK, "short")


@pytest.fixture(scope="module")
def trace(task):
    return iq.run_task(task)


@pytest.fixture(scope="module")
def timeline(trace):
    return timeline_of(trace)


def states(robot, n=5):
    low, high = np.maximum(robot.position_lower, -3.0), np.minimum(robot.position_upper, 3.0)
    return np.random.default_rng(0).uniform(low, high, size=(n, len(low)))


# Where the joints are


@pytest.mark.cases(8)
@pytest.mark.parametrize("name", KNOWN)
def test_joints_are_where_pinocchio_places_them(name):
    robot = iq.load_robot(name)
    data = robot.model.createData()
    for q in states(robot):
        pin.computeJointJacobians(robot.model, data, q)
        (points,) = arm_in(robot, q[None])["points"]
        places = [M.translation for M in data.oMi[1:]]
        turning = robot.jacobian(q)[:3].any(axis=0)  # a slide is drawn where it starts
        np.testing.assert_allclose(points[1:-1][turning], np.array(places)[turning], atol=1e-12)
        np.testing.assert_array_equal(points[-1], robot.pose(q)[:3, 3])


@pytest.mark.cases(8)
@pytest.mark.parametrize("name", KNOWN)
def test_the_joints_of_a_chain_are_on_their_axes_and_its_links_keep_their_lengths(name):
    arm = iq.load_robot(name)
    zero = np.zeros(len(arm.names))
    chain = iq.robots.Chain(arm.jacobian(zero), arm.pose(zero))
    turning = arm.jacobian(zero)[:3].any(axis=0)
    lengths = []
    for q in states(arm):
        points = chain.origins(q)
        for p, joint in zip(points[turning], chain.jacobian(q).T[turning], strict=True):
            np.testing.assert_allclose(np.cross(p, joint[:3]), joint[3:], atol=1e-12)  # v = p x omega
        lengths.append(np.linalg.norm(np.diff(points, axis=0), axis=1))
    rigid = turning[:-1]  # a link after a slide changes its length, as drawn
    np.testing.assert_allclose(np.ptp(np.array(lengths)[:, rigid], axis=0), 0.0, atol=1e-12)


def test_a_chain_is_drawn_as_it_is_built():
    planar = iq.load_task("planar_3r").load_robot()
    np.testing.assert_allclose(planar.origins([0.0, 0.0, 0.0]), [[0, 0, 0], [0.4, 0, 0], [0.75, 0, 0]], atol=1e-15)
    raised = iq.robots.Chain(
        np.column_stack((iq.revolute([0, 1, 0], [0, 0, 0.3]), iq.revolute([0, 0, 1], [0.5, 0, 0]))), np.eye(4)
    )
    np.testing.assert_allclose(raised.origins([0.0, 0.0]), [[0, 0, 0.3], [0.5, 0, 0.3]], atol=1e-15)
    scara = iq.load_task("scara").load_robot()  # the slide is drawn where the flange turns
    np.testing.assert_allclose(
        scara.origins([0.0, np.pi / 2, -0.1, 0.0]),
        [[0, 0, 0], [0.325, 0, 0], [0.325, 0.275, 0], [0.325, 0.275, -0.1]],
        atol=1e-15,
    )
    gantry = iq.robots.Chain(np.eye(6)[:, 3:], iq.transform(translation=(1.0, 2.0, 3.0)))
    np.testing.assert_allclose(gantry.origins([0.1, 0.2, 0.3]), [[1, 2, 3], [1.1, 2, 3], [1.1, 2.2, 3]])


# The timeline


def test_a_film_shows_the_run(timeline, trace, task):
    robot = task.load_robot()
    along = task.path.along(robot, task.start())
    assert timeline.force is None
    assert timeline.joints == robot.names
    assert len(timeline.time) == 101
    for i in (0, 37, 100):
        np.testing.assert_array_equal(timeline.q[i], trace.q[i])
        np.testing.assert_array_equal(timeline.tool[i], robot.pose(trace.q[i]))
        np.testing.assert_array_equal(timeline.wanted[i], along(trace.time[i]))
    errors = timeline.charts[0].values
    np.testing.assert_allclose(errors[0, 1:], np.maximum(1e3 * trace.position_error, 1e-9))
    np.testing.assert_allclose(errors[1, 1:], np.maximum(np.degrees(trace.orientation_error), 1e-9))
    low, high = trace.position_limits
    np.testing.assert_allclose(timeline.charts[1].values.T, (trace.q - low) / (high - low))
    np.testing.assert_allclose(timeline.charts[2].values[:, 1:].T, trace.velocity / trace.velocity_limit)


def test_a_short_film_leaves_no_extreme_out(trace, monkeypatch):
    monkeypatch.setattr(charts, "FRAMES", 11)
    spoilt = replace(
        trace,
        velocity=trace.velocity.copy(),
        position_error=trace.position_error.copy(),
        limit_active=[k == 51 for k in range(100)],
        statuses=["guarded" if k == 73 else "ok" for k in range(100)],
    )
    spoilt.velocity[44, 2] = -9.0
    spoilt.position_error[66] = 0.5
    timeline = timeline_of(spoilt)
    assert timeline.time.tolist() == pytest.approx(np.arange(11) / 10)
    assert timeline.speed[:, 2].min() == -9.0
    assert timeline.speed[5, 2] == -9.0
    assert timeline.charts[0].values[0].argmax() == 7
    assert timeline.charts[0].values[0].max() == 500.0
    assert timeline.limit_active == [i == 6 for i in range(11)]
    assert timeline.status == ["guarded" if i == 8 else "ok" for i in range(11)]


def test_the_farthest_of_each_frames_ticks():
    values = np.random.default_rng(1).normal(size=(40, 3))
    ends = np.array([0, 1, 7, 40])
    found = extremes(values, ends)
    for row, block in zip(found, (values[:1], values[:1], values[1:7], values[7:]), strict=True):
        assert row.tolist() == [max(column, key=abs) for column in block.T]


def test_before_the_run_the_path_is_there(task):
    timeline = timeline_before(task)
    np.testing.assert_array_equal(timeline.tool[0], task.load_robot().pose(task.start()))
    np.testing.assert_allclose(timeline.wanted[-1, :3, 3] - timeline.wanted[0, :3, 3], [0.1, 0.2, 0.05], atol=1e-12)
    assert timeline.size > 0.0


def test_an_observer_sees_every_tick_and_changes_none(task, trace):
    seen = []
    again = iq.run_task(task, observer=lambda k, state, solution: seen.append((k, state.q, solution.velocity)))
    assert [k for k, _, _ in seen] == list(range(100))
    np.testing.assert_array_equal([q for _, q, _ in seen], trace.q[1:])
    np.testing.assert_array_equal([x for _, _, x in seen], trace.velocity)
    np.testing.assert_array_equal(again.q, trace.q)


# What is touched


TOUCH = {**TASK, "force": {"press": 5.0}, "path": {"kind": "circle", "duration": 0.5, "centre": [0.03, 0.0, 0.0]}}


def touched(**contact):
    return task_from({**TOUCH, "contact": {"settle": 0.3, "gap": 0.001, **contact}}, "touched")


def distances(surface, points):
    """Of points from a surface."""
    return np.array([surface.depth(p) for p in points.reshape(-1, 3)])


@pytest.mark.parametrize("shape", [{}, {"normal": [0.3, -0.2, 1.0]}], ids=["plane", "slope"])
def test_faces_lie_on_what_is_touched_and_cover_the_path(shape):
    task = touched(kind="point", tilt=[0.02, -0.01, 0.0], **shape)
    robot = task.load_robot()
    trace = iq.run_task(task)
    timeline = timeline_of(trace)
    surface = scene_of(task, robot.pose(task.start())).springs.surface
    faces = timeline.surroundings.faces
    assert faces.shape[1:] == (4, 3)
    np.testing.assert_allclose(distances(surface, faces), 0.0, atol=1e-12)
    for p in trace.contact.position:  # beside each point of the path there is a corner, and corners all round
        from_here = (faces.reshape(-1, 3) - p)[:, :2]
        assert np.linalg.norm(from_here, axis=1).min() < 0.05
        assert (from_here.min(axis=0) < -0.03).all()
        assert (from_here.max(axis=0) > 0.03).all()


def test_a_doors_axis_is_the_hinges():
    task = touched(kind="hinge", axis=[0.0, 0.0, 1.0], point=[0.0, 0.4, 0.0], size=[0.1, 0.1])
    T = task.load_robot().pose(task.start())
    a, b = timeline_before(task).surroundings.axis
    for end in (a, b):
        np.testing.assert_allclose(end[:2], T[:2, 3] + [0.0, 0.4], atol=1e-12)
    assert a[2] < T[2, 3] < b[2]


def test_the_force_of_a_film_is_the_runs(monkeypatch):
    monkeypatch.setattr(charts, "FRAMES", 9)
    trace = iq.run_task(touched(kind="point"))
    timeline = timeline_of(trace)
    ends = (timeline.time / 0.01).round().astype(int)
    np.testing.assert_array_equal(timeline.force[1:], trace.contact.wrench[ends[1:] - 1, 3:])
    assert timeline.force[-1, 2] < -1.0  # it presses
    chart = timeline.charts[1]
    assert (chart.title, chart.levels) == ("contact force [N]", (5.0,))
    for i, (a, b) in enumerate(pairwise(ends), 1):
        expected = [
            max(x[a:b], key=lambda f: abs(f - 5.0)) for x in (trace.contact.measured_press, trace.contact.press)
        ]
        np.testing.assert_allclose(chart.values[:, i], expected)
    run = json.loads(read(page(timeline)).scripts[0])
    np.testing.assert_array_equal(unpacked(run["arrays"]["force"]), timeline.force.astype("f4"))
    np.testing.assert_array_equal(unpacked(run["arrays"]["faces"]), timeline.surroundings.faces.astype("f4"))


def test_a_moving_obstacle_is_where_it_is_in_each_frame():
    moves = {"kind": "sphere", "at": [1.0, 1.0, 1.0], "radius": 0.1, "moves": [0.0, 0.4, 0.0], "period": 2.0}
    body = [{"link": "tool", "a": [0.0, 0.0, 0.0], "b": [0.0, 0.0, -0.1], "radius": 0.05}]
    timeline = timeline_of(iq.run_task(task_from({**TASK, "obstacle": [moves], "clearance": {"body": body}}, "moving")))
    (poses,) = (solid.poses for solid in timeline.solids if solid.poses is not None)
    np.testing.assert_allclose(poses[:, 1, 3], 1.0 + 0.2 * (1.0 - np.cos(np.pi * timeline.time)), atol=2e-3)


def test_before_a_run_in_touch_the_path_waits():
    timeline = timeline_before(touched(kind="point"))
    assert timeline.time[-1] == 0.8
    np.testing.assert_array_equal(
        timeline.wanted[timeline.time < 0.3], np.broadcast_to(timeline.tool[0], (224 + 1, 4, 4))
    )


# The page


def unpacked(packed, kind="<f4"):
    return np.frombuffer(base64.b64decode(packed["data"]), dtype=kind).reshape(packed["shape"])


def test_a_page_needs_nothing_from_anywhere(timeline):
    text = page(timeline)
    reader = read(text)
    for tag, attributes in reader.tags:
        for name in ("src", "href", "srcset", "action", "data"):
            assert attributes.get(name, "data:").startswith("data:"), (tag, attributes)
    assert not re.search(r"https?://|//cdn|@import|url\(|\bfetch\(|XMLHttpRequest|WebSocket|import\(", text)
    policy = [a["content"] for tag, a in reader.tags if tag == "meta" and "http-equiv" in a]
    assert policy[0].startswith("default-src 'none'")
    assert "@" not in re.sub(r"@media", "", re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL))


def test_a_page_has_all_of_the_film(timeline):
    run = json.loads(read(page(timeline)).scripts[0])
    for name in ("time", "screws", "travel", "wanted", "q", "limits", "speed", "speed_limit"):
        np.testing.assert_array_equal(unpacked(run["arrays"][name]), getattr(timeline, name).astype("f4"))
    assert [c["title"] for c in run["charts"]] == [c.title for c in timeline.charts]
    for packed, chart in zip(run["charts"], timeline.charts, strict=True):
        np.testing.assert_array_equal(unpacked(packed["values"]), chart.values.astype("f4"))
    assert (tuple(run["joints"]), run["status"], run["limit_active"]) == (
        timeline.joints,
        timeline.status,
        timeline.limit_active,
    )


def test_a_look_is_on_the_page(timeline):
    run = json.loads(read(page(timeline)).scripts[0])
    assert len(run["parts"]) == len(timeline.appearance.parts) > 9
    for packed, part in zip(run["parts"], timeline.appearance.parts, strict=True):
        assert (packed["joint"], tuple(packed["colour"])) == (part.joint, part.colour)
        np.testing.assert_array_equal(unpacked(packed["vertices"]), part.vertices.astype("f4"))
        np.testing.assert_array_equal(unpacked(packed["faces"], "<u2"), part.faces)


def test_a_velocity_is_how_the_tool_moves(timeline, trace):
    np.testing.assert_allclose(timeline.travel[2:], np.diff(timeline.tool[1:, :3, 3], axis=0) / 0.01, atol=0.01)
    assert np.linalg.norm(timeline.travel[50]) > 0.2


def test_arrows_are_scaled_by_the_run_but_not_by_rest(timeline, task):
    slowest, longest = timeline.travel_scale
    assert longest == pytest.approx(np.percentile(np.linalg.norm(timeline.travel, axis=1), 99))
    assert slowest == pytest.approx(2e-4 * timeline.size)
    assert timeline_before(task).travel_scale[1] == pytest.approx(longest, rel=0.05)  # before the run, the path's
    resting = replace(timeline, travel=1e-6 * timeline.travel, force=1e-6 * timeline.travel)
    assert resting.travel_scale == (slowest, 10.0 * slowest)
    assert resting.force_scale == pytest.approx((0.05, 0.5))


def test_the_longest_film_is_a_small_file(tmp_path):
    long = iq.run_task(iq.load_task("panda_path"), dt=0.005)
    assert len(timeline_of(long).time) == 600
    assert iq.workbench.animation(long, tmp_path / "long.html").stat().st_size < 450_000


def test_what_a_task_is_called_cannot_break_out_of_the_page(timeline):
    evil = '</script><img src="http://evil/x" onerror="alert(1)">'
    tags = read(page(replace(timeline, title=evil, about=evil, joints=(evil, *timeline.joints[1:])))).tags
    assert not [t for t, _ in tags if t == "img"]
    assert len([t for t, _ in tags if t == "script"]) == 2


@pytest.mark.parametrize("name", ["@SCRIPTS@", "@RUN@", "{{ run }}", "{% include 'page.html' %}", "{# gone #}"])
def test_a_name_is_never_read_as_a_part_of_the_page(timeline, name):
    text = page(replace(timeline, title=name, about=name))
    assert unescape(text).count(name) == 3  # the title, the heading and what it is about
    assert len(text) < len(page(timeline)) + 200
    assert len([t for t, _ in read(text).tags if t == "script"]) == 2


@pytest.mark.parametrize(("about", "then"), [("", ""), ("A circle", "A circle. "), ("A circle.", "A circle. ")])
def test_what_a_run_is_about_ends_before_how_it_went(trace, about, then):
    assert timeline_of(replace(trace, task=trace.task.model_copy(update={"about": about}))).about == f"{then}Accepted."


def test_joints_without_limits_are_drawn_without(tmp_path):
    bare = {**TASK, "robot": {"screws": [{"axis": [0, 0, 1.0]}], "start": [0.3], "tool_point": [0.5, 0, 0]}}
    bare["path"] = {"kind": "joints", "duration": 0.1, "waypoints": [[0.5]]}
    bare["law"] = {"dt": 0.01, "form": "tool"}
    timeline = timeline_of(iq.run_task(task_from(bare, "bare")))
    assert [c.title for c in timeline.charts] == ["tracking error"]
    run = json.loads(read(page(timeline)).scripts[0])
    assert unpacked(run["arrays"]["limits"]).tolist() == [[-np.inf], [np.inf]]


def test_a_page_that_cannot_be_written_says_so(trace, tmp_path):
    with pytest.raises(iq.BadInput, match="expected a file that can be written"):
        iq.workbench.animation(trace, tmp_path)
