"""Obstacles and clearance in task files: shapes as written, moving ones, acceptance, and pages that draw them."""

import json

import numpy as np
import pytest
from support.task_files import content

import invariantqp as iq
from invariantqp.workbench.pictures.charts import charts_of, frame_ends
from invariantqp.workbench.runs.taskfile import task_from
from invariantqp.workbench.runs.trace import ClearanceTrace
from invariantqp.workbench.view.page import page
from invariantqp.workbench.view.timeline import timeline_of

BALL = {
    "kind": "sphere",
    "name": "ball",
    "at": [0.6, 0.5, 0.4],
    "radius": 0.1,
    "moves": [0.0, -0.2, 0.0],
    "period": 2.0,
}
SHELF = {"kind": "box", "name": "shelf", "at": [0.5, 0.0, 1.2], "size": [0.4, 0.4, 0.02], "turn": [0.0, 0.0, 0.5]}
BODY = [{"link": "tool", "a": [0, 0, 0], "b": [0, 0, -0.1], "radius": 0.05}]


def task(obstacles, **clearance):
    return task_from({**content(), "obstacle": obstacles, "clearance": {"body": BODY, **clearance}}, "t.toml")


def test_obstacles_are_where_the_file_says_and_go_there_and_back():
    one = task(
        [
            BALL,
            SHELF,
            {"kind": "half-space", "at": [0, 0, -0.1]},
            {"kind": "capsule", "at": [1, 0, 0], "to": [1, 0, 1], "radius": 0.1},
        ]
    )
    obstacle_scene = one.obstacle_scene(one.load_robot())
    ball, shelf = obstacle_scene.obstacles[:2]
    obstacle_scene.move(1.0)
    np.testing.assert_allclose((ball.pose @ ball.placement)[:3, 3], [0.6, 0.3, 0.4], atol=1e-12)
    np.testing.assert_allclose(ball.twist, 0.0, atol=1e-12)
    obstacle_scene.move(0.5)
    np.testing.assert_allclose(ball.twist[3:], [0, -0.1 * np.pi, 0], atol=1e-12)
    np.testing.assert_allclose(2 * shelf.half, [0.4, 0.4, 0.02])
    assert {name for pair in obstacle_scene.clearance.pairs for name in pair} == {
        "tool",
        "ball",
        "shelf",
        "half-space",
        "capsule",
    }


def test_a_run_records_the_least_distance_and_is_accepted_by_it():
    trace = iq.run_task(task([BALL]))
    assert trace.clearance.distance.shape == trace.time.shape
    assert trace.summary()["nearest"].endswith("tool and ball")
    judged = task_from(
        {**content(), "obstacle": [BALL], "clearance": {"body": BODY}, "accept": {"clearance_mm": 9000.0}}, "t.toml"
    )
    missed = iq.run_task(judged)
    assert not missed.passed
    assert "least distance" in missed.shortfalls[-1]
    assert iq.run_task(task_from(content(), "t.toml")).summary()["least_clearance_mm"] is None


def test_a_binding_clearance_counts_as_an_active_limit():
    wall = {"kind": "half-space", "name": "wall", "at": [0.55, 0.0, 0.0], "normal": [-1.0, 0.0, 0.0]}
    room = iq.run_task(task([wall])).clearance.distance[0]
    near = task([wall], distance=room - 0.0005)  # the path is twice as long
    trace = iq.run_task(near)
    assert not trace.limit_active[0]
    assert trace.limit_active[-1]
    assert "clearance: tool and wall" in trace.warnings[0]


def test_the_page_has_bodies_obstacles_and_the_curve():
    trace = iq.run_task(task([BALL, SHELF]))
    timeline = timeline_of(trace)
    assert [solid.joint for solid in timeline.solids] == [7, 0, 0]
    assert timeline.solids[0].poses is None
    assert any(chart.title == "least distance [mm]" for chart in timeline.charts)
    text = page(timeline)
    run = json.loads(text.split('id="run">')[1].split("</script>")[0])
    assert [solid["poses"] is None for solid in run["solids"]] == [True, False, False]
    assert run["solids"][1]["poses"]["shape"][0] > 1  # it moves
    assert run["solids"][2]["poses"]["shape"][0] == 1


@pytest.mark.parametrize(("obstacle", "said"), [
    ({"kind": "sphere"}, "a sphere needs radius"),
    ({"kind": "arm", "start": [0.0]}, "an arm needs source"),
    ({"kind": "box", "size": [0.1, -0.1, 0.1]}, "greater than or equal to 0"),
    ({"kind": "cone"}, "kind"),
    ({"kind": "half-space", "normal": [0.0, 0.0, 0.0]}, "zero vector"),
    ({"kind": "arm", "source": "ur5", "start": [0.0] * 6, "end": [0.0] * 5}, "as many joints"),
    ({"kind": "box", "size": [0.1] * 3, "radius": 0.1, "end": [0.0]}, "a box has no end and no radius"),
    ({"kind": "half-space", "turn": [0.0, 1.0, 0.0]}, "a half-space has no turn"),
    ({"kind": "arm", "source": "ur5", "start": [0.0] * 6, "moves": [0.0, 0.1, 0.0]}, "an arm has no moves"),
])  # fmt: skip
def test_an_error_of_an_obstacle_has_its_path(obstacle, said):
    with pytest.raises(iq.errors.TaskFileError, match=said) as caught:
        task([obstacle])
    assert "$.obstacle[0]" in str(caught.value)


def test_an_obstacle_in_single_brackets_gets_advice():
    with pytest.raises(iq.errors.TaskFileError, match=r"\$\.obstacle: write \[\[obstacle\]\], of which there may be"):
        task(BALL)


@pytest.mark.parametrize(("key", "joints", "said"), [
    ("start", [0.0, -1.0], r"obstacle\[1\].start: found shape \(2,\); expected \(6,\): shoulder_pan_joint"),
    ("start", [0.0, -90.0, 90.0, 0.0, 0.0, 0.0], r"obstacle\[1\].start: found joint 1 .* degrees"),
    ("end", [0.0, 0.0, 180.0, 0.0, 0.0, 0.0], r"obstacle\[1\].end: found joint 2 .* degrees"),
])  # fmt: skip
def test_wrong_joint_positions_of_another_arm_are_refused(key, joints, said):
    arm = {"kind": "arm", "source": "ur5", "at": [1.5, 0.0, 0.0], "start": [0.0] * 6, key: joints}
    arm["end" if key == "start" else "start"] = [0.0] * len(joints)
    one = task([BALL, arm])
    robot = one.load_robot()
    with pytest.raises(iq.BadInput, match=said):
        one.obstacle_scene(robot)


@pytest.mark.filterwarnings("ignore:clearance. nothing is kept apart")
def test_without_pairs_there_is_no_distance():
    one = task([], exclude=[])
    assert iq.run_task(one).clearance is None


def test_the_range_of_a_clearance_chart_is_limited():
    far, near = np.array([np.inf, 0.5, 0.03]), np.array([0.01, -0.004])
    np.testing.assert_allclose(ClearanceTrace(far, [""] * 3, 0.02).chart_range[0], [0.2, 0.2, 0.03])
    np.testing.assert_allclose(ClearanceTrace(near, [""] * 2, 0.02).chart_range[1], 0.04)
    shown, most = ClearanceTrace(far, [""] * 3, 0.0).chart_range
    np.testing.assert_allclose(shown, [0.5, 0.5, 0.03])
    assert most == 0.5


def test_the_picture_of_a_run_has_the_least_distance(tmp_path):
    mpl = pytest.importorskip("matplotlib")
    one = iq.load_task("wipe_under_shelf")
    pressing = one.model_copy(update={"path": one.path.model_copy(update={"duration": 0.1})})
    traces = [iq.run_task(run, dt=0.01) for run in (pressing, task([BALL]), task_from(content(), "t.toml"))]
    titles = [[chart.title for chart in charts_of(trace, frame_ends(len(trace.velocity)))] for trace in traces]
    assert [told.count("least distance [mm]") for told in titles] == [1, 1, 0]
    with mpl.rc_context({"svg.fonttype": "none"}):
        text = iq.workbench.picture(traces[1], tmp_path / "run.svg").read_text(encoding="utf-8")
    assert text.count("least distance [mm]") == 1
    assert text.count("time [s]") == 1


def test_a_mesh_is_scaled_placed_and_drawn(tmp_path):
    file = tmp_path / "ramp.obj"
    file.write_text("v 0 0 0\nv 400 0 0\nv 0 200 0\nv 0 0 300\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    ramp = {"kind": "mesh", "name": "ramp", "source": str(file), "scale": 0.001, "at": [0.8, 0.5, 0.0], "hull": True}
    one = task([ramp])
    made = one.obstacle_scene(one.load_robot()).obstacles[0]
    np.testing.assert_allclose(2.0 * made.half, [0.4, 0.2, 0.3])
    np.testing.assert_allclose(made.placement[:3, 3], [1.0, 0.6, 0.15])
    drawn = timeline_of(iq.run_task(one)).solids[-1]
    assert drawn.faces.shape == (4, 4, 3)
    missing = task([{**ramp, "source": "nowhere.stl"}])
    robot = missing.load_robot()
    with pytest.raises(iq.BadInput, match="no mesh at"):
        missing.obstacle_scene(robot)
